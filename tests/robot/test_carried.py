"""A carried part: where it is, what it is kept apart from, and how a motion begins with it on the floor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError
from armctl.facts import say
from armctl.kinematics.samples import joint_samples
from armctl.motion import plan_joints
from armctl.motion.clearance import FLOOR_TOLERANCE_M, Floor, Obstacles, SelfCollision, touching
from armctl.robot import CarriedPart, Robot, load_robot
from armctl.robot.body.arm_body import CARRIED
from armctl.robot.body.collision import NEAR_M
from armctl.robot.parts import Obstacle

UZUNER = load_robot("uzuner").gripping(0.3)
CUBE = CarriedPart((30.0, 30.0, 30.0))


def over(robot: Robot, x_mm: float, z_mm: float, y_mm: float = 0.0) -> FloatArray:
    """The tool straight down over a place of the floor."""
    found = robot.inverse((x_mm / 1000, y_mm / 1000, z_mm / 1000 + robot.floor_z), math.radians(-90))
    return found.best("least-rotation")


@pytest.mark.parametrize(
    ("edges", "told"),
    [
        ((0, 30, 40), "part_mm: the edge along x of the tool, 0 mm is outside 0.1 … 1000 mm"),
        ((20, -1, 40), "the edge along y of the tool, -1 mm"),
        ((20, 30, 1001), "the edge along z of the tool, 1001 mm is outside 0.1 … 1000 mm"),
        ((20, 30, math.nan), "the edge along z of the tool, nan mm"),
        ((20, 30), r"part_mm must be three edges in mm, along x, y and z of the tool, got \(20, 30\)"),
        (20, "part_mm must be three edges"),
        ("20 x 30 x 40", "part_mm must be numbers"),
    ],
)
def test_edges_that_no_part_has_are_refused(edges: tuple[float, ...], told: str) -> None:
    with pytest.raises(InputError, match=told):
        CarriedPart.of(edges)


def test_nothing_is_no_part() -> None:
    assert CarriedPart.of(None) is None
    part = CarriedPart.of([20, 30, 12.5])
    assert part == CarriedPart((20.0, 30.0, 12.5))
    assert str(part) == "20 × 30 × 12.5 mm"


@pytest.mark.parametrize("name", ["uzuner", "so101", "uarm", "ar4"])
def test_its_middle_is_at_the_tool_point_and_its_edges_along_the_tool(name: str) -> None:
    robot = load_robot(name)
    arm, edges_m = robot.carrying(CarriedPart((20.0, 30.0, 90.0))), np.array([0.02, 0.03, 0.09])
    (piece,) = (one for one in arm.collision.capsules if one.part == CARRIED)
    assert piece.hull is not None
    for q in joint_samples(robot.limits, 6):
        links = arm.body_frames(q[None])
        corners = links.place(piece.link, piece.corners)[:, :, 0].T
        T = robot.forward(q)
        at = (corners - T[:3, 3]) @ T[:3, :3]
        np.testing.assert_allclose(np.abs(at), np.tile(edges_m / 2, (8, 1)), atol=1e-12)
        assert len(np.unique(at.round(6), axis=0)) == 8
        ends = links.place(piece.link, np.array([piece.start, piece.end]))[:, :, 0].T
        away = np.linalg.norm(np.cross(corners - ends[0], ends[1] - ends[0]), axis=1)
        assert (away <= (piece.radius + 1e-12) * np.linalg.norm(ends[1] - ends[0])).all()


def test_an_arm_that_carries_shares_what_is_worked_out() -> None:
    robot = load_robot("so101")
    arm = robot.gripping(0.4).carrying(CUBE)
    assert arm is robot.carrying(CUBE).gripping(0.4)
    assert arm.inverse_kinematics is robot.inverse_kinematics
    assert arm.bodies is robot.bodies
    assert arm != robot.gripping(0.4)
    assert arm.carrying(None) == robot.gripping(0.4)
    jaws = [one.corners.tolist() for one in robot.gripping(0.4).collision.capsules]
    assert [one.corners.tolist() for one in arm.collision.capsules[:-1]] == jaws


@pytest.mark.parametrize("name", ["uzuner", "so101", "uarm", "ar4", "humanoid"])
def test_it_is_kept_apart_from_all_but_its_own_link(name: str) -> None:
    robot = load_robot(name)
    model = robot.carrying(CUBE).collision
    part = len(model.capsules) - 1
    links = {model.capsules[i].link for i, j in (*model.pairs, *model.touching) if j == part}
    last = model.capsules[part].link
    assert last not in links
    assert {-1, *range(last)} & {one.link for one in robot.collision.capsules} <= links


@pytest.mark.parametrize("name", ["mearm", "so101", "ar4"])
def test_no_gap_closes_faster_than_its_lever_says(name: str) -> None:
    robot = load_robot(name).carrying(CarriedPart((40.0, 60.0, 120.0)))
    for source in (SelfCollision(robot), Floor(robot)):
        own = [k for k, part in enumerate(source.parts) if part == CARRIED]
        assert own
        for q in joint_samples(robot.limits, 6):
            steps = q + 0.05 * np.vstack([np.zeros(robot.n), np.eye(robot.n)])
            gaps = source.gaps(robot.body_frames(steps))[own]
            near = slice(None) if isinstance(source, Floor) else (gaps < NEAR_M).all(axis=1)
            change = np.abs(gaps[:, 1:] - gaps[:, :1])[near]
            assert (change <= 0.05 * source.levers[own][near] + 2.2e-4).all()


@pytest.mark.parametrize("z_mm", [15.0, 12.0])
def test_a_part_is_lifted_from_the_floor(z_mm: float) -> None:
    """It stands on the floor, or is gripped lower than in its middle: then it seems to be in the floor."""
    arm = UZUNER.carrying(CUBE)
    low, high = over(UZUNER, 200, z_mm), over(UZUNER, 200, 100)
    plan_joints(arm, low, high)
    plan_joints(UZUNER, high, low)
    if z_mm < 15:
        with pytest.raises(MotionRefusedError, match=rf"{CARRIED}: at .* 3\.0 mm below the floor"):
            plan_joints(arm, high, low)
        with pytest.raises(MotionRefusedError, match=rf"{CARRIED}: at .* below the floor"):
            plan_joints(arm, low, over(UZUNER, 200, z_mm - 2))
    else:
        plan_joints(arm, high, low)


def test_it_hits_an_obstacle_that_the_empty_jaws_miss() -> None:
    low, beside = over(UZUNER, 200, 40), over(UZUNER, 200, 40, -60)
    crate = Obstacle("the crate", np.array([0.1, 0.06, 0.0]), np.array([0.3, 0.15, 0.06]))
    around = replace(UZUNER, obstacles=(crate,))
    arm = around.carrying(CarriedPart((160.0, 160.0, 20.0)))
    plan_joints(around, beside, low)
    with pytest.raises(MotionRefusedError, match=rf"{CARRIED}: at .* 2\d\.\d mm inside the crate"):
        plan_joints(arm, beside, low)
    assert Obstacles(arm).parts.count(CARRIED) == 1


def test_it_hits_the_arm_itself() -> None:
    robot = load_robot("scorbot").gripping(0.3)
    far = robot.inverse((0.25, 0.0, 0.1 + robot.floor_z), math.radians(-60)).best("least-rotation")
    near = robot.inverse((0.17, 0.0, 0.1 + robot.floor_z), math.radians(-60)).best("least-rotation")
    plan_joints(robot, far, near)
    with pytest.raises(MotionRefusedError, match=rf"{CARRIED}: at .* mm inside the base"):
        plan_joints(robot.carrying(CarriedPart((120.0, 120.0, 40.0))), far, near)


def test_rest_is_no_excuse_for_it() -> None:
    """Where home or rest would put it below the floor or into the arm, it may not be as deep elsewhere."""
    for name in ("uzuner", "so101", "mearm"):
        robot = load_robot(name).carrying(CarriedPart((200.0, 200.0, 200.0)))
        for source in (Floor(robot), SelfCollision(robot)):
            own = [k for k, part in enumerate(source.parts) if part == CARRIED]
            assert not source.closed[own].any()
    low = over(UZUNER, 200, 15 - 1000 * FLOOR_TOLERANCE_M - 0.3)
    arm = UZUNER.carrying(CUBE)
    found = touching((Floor(arm),), arm, low)
    assert found is not None
    assert say(found).startswith(f"{CARRIED}: 0.8 mm below the floor")
