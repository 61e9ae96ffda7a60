"""Every branch of a target, and what the limits say of it."""

from __future__ import annotations

import numpy as np
import pytest

from armctl import load_robot
from armctl.kinematics import BranchFinder, Target

TARGETS = [
    ("mico", (0.3, 0.0, 0.1), {}),
    ("mico", (-0.2, 0.1, 0.2), {"roll": 0.3}),
    ("scorbot", (0.4, 0.1, 0.2), {"pitch": -1.0}),
    ("abaas", (0.0, 0.2, 0.1), {"pitch": 0.0, "roll": 1.0}),
    ("uzuner", (0.2, 0.0, 0.1), {"pitch": -0.5}),
]


@pytest.mark.parametrize(("name", "position", "wish"), TARGETS)
def test_every_branch_meets_the_target_and_inverse_lists_those_allowed(
    name: str, position: tuple[float, float, float], wish: dict[str, float]
) -> None:
    robot = load_robot(name)
    branches = robot.branches(position, **wish)
    assert len(branches) >= 4
    for branch in branches:
        assert np.abs(robot.forward(branch.q)[:3, 3] - position).max() < 1e-9
        pitch, roll = robot.inverse_kinematics.pitch_and_roll(branch.q)
        assert pitch == pytest.approx(wish.get("pitch", pitch), abs=1e-9)
        assert roll == pytest.approx(wish.get("roll", 0.0), abs=1e-9)
    allowed = [branch.q for branch in branches if not branch.forbidden]
    for q in allowed:
        robot.check_limits(q)
    listed = robot.inverse(position, **wish).q
    directions, expected = ({tuple(np.round(np.exp(1j * q), 6)) for q in some} for some in (listed, allowed))
    assert directions == expected


def test_the_reason_names_each_joint_with_its_figures() -> None:
    front = {branch.name: branch for branch in load_robot("mico").branches([0.3, 0.0, 0.1])}
    assert front["front elbow-up"].forbidden == ()
    (why,) = front["front elbow-down"].forbidden
    assert why == "Shoulder needs 82.14°, its limits are -220.00° … 40.00°"


def test_both_printed_solutions_of_mico_come_first() -> None:
    first, second, *others = load_robot("mico").branches([0.0, 0.0, 0.7])
    assert np.degrees(first.q[:3]) == pytest.approx([0, -131.626, -5.532], abs=1e-3)
    assert np.degrees(second.q[:3]) == pytest.approx([0, -48.374, -174.468], abs=1e-3)
    assert not first.forbidden and not second.forbidden
    assert len(others) == 2  # the base half a turn round


def test_the_humanoid_elbow_branches_with_a_held_roll() -> None:
    robot = load_robot("humanoid")
    q = np.radians([10, -30, 40, 50, 0])
    T = robot.forward(q)
    branches = robot.branches(T[:3, 3], rotation=T[:3, :3])
    assert any(np.abs(branch.q - q).max() < 1e-6 and not branch.forbidden for branch in branches)
    assert all(branch.q[4] == 0.0 for branch in branches)


@pytest.mark.parametrize("name", ["ur5", "so101", "al5d"])
def test_a_rotation_that_is_only_come_near_to_has_no_branch(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(2)
    for q in rng.uniform(*np.clip(robot.limits, -3.0, 3.0).T, (2, len(robot.limits))):
        T = robot.forward(q)
        assert any(not branch.forbidden for branch in robot.branches(T[:3, 3], rotation=T[:3, :3]))
        for turned in (T[:3, [2, 0, 1]], T[:3, [1, 2, 0]]):
            for branch in robot.branches(T[:3, 3], rotation=turned):
                assert np.abs(robot.forward(branch.q)[:3, :3] - turned).max() < 2e-6


def test_a_free_joint_or_a_point_out_of_reach_has_no_branches() -> None:
    assert load_robot("uzuner").branches([0.2, 0.0, 0.1]) == ()
    assert load_robot("mico").branches([0.5, 0.0, 0.7]) == ()
    assert load_robot("ur5").branches([0.3, 0.2, 0.3]) == ()
    assert load_robot("ar4").branches([0.3, 0.1, 0.3], pitch=-0.5) == ()
    assert load_robot("so101").branches([0.25, 0.0, 0.1]) == ()  # the roll moves the tool point: it is free
    assert load_robot("so101").branches([0.25, 0.0, 0.1], pitch=-1.2) == ()
    assert load_robot("so101").branches([0.25, 0.0, 0.1], pitch=-1.2, roll=0.3)
    uarm = load_robot("uarm")
    assert uarm.branches(uarm.forward(uarm.pose("home"))[:3, 3])


def test_any_roll_is_one_that_the_roll_joint_can_take() -> None:
    robot = load_robot("scorbot")
    limits = robot.limits.copy()
    limits[4] = [0.5, 1.0]
    titles = [joint.title for joint in robot.joints]
    finder = BranchFinder(robot.chain, limits, robot.energy, titles)
    found = finder.find(Target.of([0.4, 0.1, 0.2], pitch=-1.0))
    assert [branch.q[4] for branch in found] == [0.5] * len(found)
    assert not all(branch.forbidden for branch in found)


@pytest.mark.parametrize("name", ["ar4", "ur5"])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_straight_up_or_down_has_the_branches_of_any_rotation_about_the_vertical(
    name: str, up: float
) -> None:
    robot, rng = load_robot(name), np.random.default_rng(3)
    for _ in range(3):
        point = rng.uniform([0.2, -0.2, 0.1], [0.35, 0.2, 0.4])
        down = robot.branches(point, pitch=up * np.pi / 2)
        yaw = rng.uniform(-3.0, 3.0)
        about = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        turned = robot.branches(point, rotation=about @ np.diag([1.0, up, up]))
        assert [branch.name for branch in down] == [branch.name for branch in turned]
        for one, other in zip(down, turned, strict=True):
            assert np.abs(np.exp(1j * one.q[:5]) - np.exp(1j * other.q[:5])).max() < 1e-7
            assert one.q[5] == 0.0
        inside = [branch for branch in down if not branch.forbidden]
        for roll in (None, 0.4) if inside else ():
            solutions = robot.inverse(point, up * np.pi / 2, roll)
            assert {*solutions.branch} == {branch.name for branch in inside}
            if solutions.success:
                T = robot.forward(solutions.q)
                assert np.abs(T[:, :3, 3] - point).max() < 1e-9
                assert np.abs(T[:, :3, 2] - [0.0, 0.0, up]).max() < 1e-9
                assert (solutions.q[:, 5] == (roll or 0.0)).all()
                assert solutions.complete or "may turn" in (solutions.incomplete_reason or "")


@pytest.mark.parametrize(
    ("name", "q_deg", "turn_deg", "says"),
    [
        ("ar4", [0, 20, 20, 0, 100, 0], 30, "for the one asked for, at the least, Joint 5 needs 126.48°"),
        ("uzuner", [0, 60, -40, 20, 0], 90, "the links do not allow the one asked for, whatever the joint"),
    ],
)
def test_what_forbids_an_orientation(name: str, q_deg: list[float], turn_deg: float, says: str) -> None:
    robot = load_robot(name)
    T = robot.forward(np.radians(q_deg))
    a = np.radians(turn_deg)
    about = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    if name == "uzuner":  # out of the plane of the links
        about = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    wish = about @ T[:3, :3]
    solutions = robot.inverse(T[:3, 3], rotation=wish)
    said = robot.turned_off(solutions, solutions[0])
    assert said is not None and says in said
    assert len(np.unique(solutions.q.round(3), axis=0)) == len(solutions)
    assert robot.turned_off(robot.inverse(T[:3, 3], rotation=T[:3, :3]), np.radians(q_deg)) is None
