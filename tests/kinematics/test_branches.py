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
    straight_down = load_robot("ur5").branches([0.3, 0.2, 0.3], pitch=-np.pi / 2)
    assert straight_down
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
