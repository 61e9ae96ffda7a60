"""Gaps to the floor, to obstacles and to the arm itself over whole motions."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.kinematics.kit import plain_frames
from tests.long import examples
from tests.motion.arm_kit import arm, axis_points, brute_gap, random_arm
from tests.sticks import of_sticks

from armctl.arrays import FloatArray
from armctl.kinematics import Chain, DHRow
from armctl.kinematics.frames import LinkFrames
from armctl.motion import Trajectory
from armctl.motion.clearance import FLOOR_TOLERANCE_M, Floor, Gaps, Obstacles, SelfCollision
from armctl.motion.preflight import preflight
from armctl.motion.profiles import PROFILES, PointToPoint
from armctl.motion.trajectory import SampledMotion
from armctl.robot import Robot
from armctl.robot.body.arm_body import capsule
from armctl.robot.parts import Obstacle

UZUNER, SCORBOT = of_sticks("uzuner"), of_sticks("scorbot")

# Three links of a metre that turn the same way: between two samples the tool turns by 12 degrees.
CHAIN = Chain.from_dh([DHRow(0.0, np.pi / 2, 4.0), *[DHRow(1.0, 0.0, 0.0)] * 3])
ARM = arm(CHAIN, np.tile(np.radians([[-170.0, 170.0]]), (4, 1)))
HANGING = np.radians([0.0, -90.0, 0.0, 0.0])
"""the tool is at its lowest: 1 m above the base frame, straight below the shoulder"""
DEPTH, RADIUS = 0.004, 0.02


def swing() -> PointToPoint:
    """Past the lowest point, which lies a quarter of the way: between the first two samples of three."""
    turn = np.array([0.0, 1.0, 1.0, 1.0])
    return PointToPoint.plan(ARM, HANGING - np.radians(2.0) * turn, HANGING + np.radians(6.0) * turn)


def with_floor(depth: float) -> Robot:
    titles = [joint.title for joint in ARM.joints]
    last = capsule(CHAIN, titles, 4, ([-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]), RADIUS)
    return replace(ARM, floor_z=1.0 - RADIUS + depth, capsules=(last,))


def with_obstacle(depth: float) -> Robot:
    step = Obstacle("the step", np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.0 - RADIUS + depth]))
    return replace(with_body(-1.0), obstacles=(step,))


def with_body(depth: float) -> Robot:
    bar = np.array([[-1.0, 0.0, 1.0 - 2 * RADIUS + depth], [1.0, 0.0, 1.0 - 2 * RADIUS + depth]])
    link = np.array([[-0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    titles = [joint.title for joint in ARM.joints]
    body = (
        capsule(CHAIN, titles, 0, (bar[0], bar[1]), RADIUS),
        capsule(CHAIN, titles, 4, (link[0], link[1]), RADIUS),
    )
    return replace(ARM, capsules=body)


@pytest.mark.parametrize(
    ("build", "source", "kind"),
    [
        (with_floor, Floor, "floor"),
        (with_obstacle, Obstacles, "obstacle"),
        (with_body, SelfCollision, "self-collision"),
    ],
    ids=["floor", "obstacle", "self-collision"],
)
def test_a_dip_between_two_clear_samples_is_found(
    build: Callable[[float], Robot], source: Callable[[Robot], Gaps], kind: str
) -> None:
    robot = build(DEPTH)
    gaps = source(robot)
    motion = swing()
    at_samples = gaps.gaps(LinkFrames.at(CHAIN, SampledMotion(robot, motion).q))
    assert at_samples.min() > DEPTH
    (finding,) = [one for one in preflight(robot, motion) if one.kind == kind]
    assert finding.severity == "error"
    dense = motion.sample(np.linspace(0.0, motion.duration, 20_001)).q
    worst = gaps.gaps(LinkFrames.at(CHAIN, dense)).min()
    assert worst == pytest.approx(-DEPTH, abs=1e-6)
    # the deepest place of the half that shows a dip, at a hundredth of a second
    assert 0.0 < float(finding.what.split(" mm")[0]) <= 1000 * DEPTH
    assert [one for one in preflight(build(-DEPTH), motion) if one.kind == kind] == []


def test_memory_is_bounded_by_halving_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    grazing, through = with_floor(-DEPTH), with_floor(DEPTH)
    expected = preflight(grazing, swing()), [finding.kind for finding in preflight(through, swing())]
    monkeypatch.setattr(import_module("armctl.motion.clearance"), "_BLOCK", 1)
    assert (
        preflight(grazing, swing()),
        [finding.kind for finding in preflight(through, swing())],
    ) == expected


def motions(robot: Robot, seed: int, count: int) -> list[Trajectory]:
    rng = np.random.default_rng(seed)
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (count + 1, robot.n))
    return [
        PointToPoint.plan(robot, a, b, None, PROFILES[k % len(PROFILES)])
        for k, (a, b) in enumerate(pairwise(q))
    ]


def dense(trajectory: Trajectory, count: int = 1500) -> FloatArray:
    return trajectory.sample(np.linspace(0.0, trajectory.duration, count)).q


@settings(max_examples=12 if os.environ.get("ARMCTL_LONG") else 4)
@given(st.integers(0, 10_000))
def test_no_dip_below_the_floor_is_missed(seed: int) -> None:
    robot = random_arm(seed % 7) if seed % 2 else UZUNER
    for trajectory in motions(robot, seed, 3):
        q = dense(trajectory, 200)
        heights = np.array([undersides(robot, row) for row in q])
        posed = np.array([undersides(robot, row) for row in robot.poses.values()]).min(axis=0)
        radii = np.array([*(piece.radius for piece in robot.collision.capsules for _ in range(2)), 0.0])
        resting = np.clip(posed, -radii, 0.0)
        allowed = np.minimum(heights[0], resting) - FLOOR_TOLERANCE_M
        lacking = float((allowed - heights).max())
        found = any(f.kind == "floor" for f in preflight(robot, trajectory))
        if lacking > 1e-3:
            assert found
        if lacking < -1e-3:
            assert not found


def undersides(robot: Robot, q: FloatArray) -> list[float]:
    """Heights above the floor of the lowest points below the ends of all capsules and of the tool point."""
    pieces = robot.collision.capsules
    ends = [(p[2], piece.radius) for piece in pieces for p in axis_points(robot, piece, q, 2)]
    tool = plain_frames(robot.chain.rows, robot.chain.convention, q)[-1][2, 3]
    return [height - radius - robot.floor_z for height, radius in [*ends, (tool, 0.0)]]


@settings(max_examples=examples(15))
@given(st.integers(0, 10_000))
def test_no_touch_is_missed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # folded more than not, so that many motions touch
    low, high = np.radians([[-20, 0, 80, -60, 0], [20, 35, 130, 0, 1]])
    a, b = rng.uniform(low, high, (2, 5))
    trajectory = PointToPoint.plan(SCORBOT, a, b)
    model = SCORBOT.collision
    pairs = [(model.capsules[i], model.capsules[j]) for i, j in model.pairs]
    gaps = np.array([[brute_gap(SCORBOT, *pair, q, 40) for pair in pairs] for q in dense(trajectory, 30)])
    lacking = float((np.minimum(gaps[0], 0.0) - gaps).max())
    found = any(f.kind == "self-collision" for f in preflight(SCORBOT, trajectory))
    if lacking > 0.008:  # what 40 points an axis can be wrong by
        assert found
    if lacking < -0.02:
        assert not found


def test_the_turning_column_is_exempt_and_the_tool_is_the_last_part() -> None:
    floor = Floor(UZUNER)
    assert "the base" not in floor.parts
    assert floor.parts[-1] == "the tool"
    assert "the link behind elbow" in floor.parts and "the gripper" in floor.parts
    q = np.radians([[20, 40, -30, -60, 10], [0, 90, -80, -40, 0]])
    lift = np.cumsum(np.sin(np.cumsum(q[:, 1:4], axis=1)) * [0.125, 0.104, 0.101], axis=1) + 0.163
    np.testing.assert_allclose(floor.clearance(q)[:, -1], lift[:, -1])
    np.testing.assert_allclose(floor.clearance(q[0]), floor.clearance(q)[0], atol=1e-15)


def test_what_lies_on_the_floor_may_lie_there_but_its_axis_not_below_it() -> None:
    """A link 20 mm thick whose axis comes to 5 mm above the floor where the arm rests."""
    titles = [joint.title for joint in ARM.joints]
    body = (capsule(CHAIN, titles, 4, ([-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]), RADIUS),)
    raised = HANGING + np.radians([0.0, 20.0, 0.0, 0.0])

    def lying(height: float) -> Robot:
        poses = {"home": raised, "rest": HANGING}
        return replace(ARM, floor_z=1.0 - height, capsules=body, poses=poses)

    down, up = PointToPoint.plan(ARM, raised, HANGING), PointToPoint.plan(ARM, HANGING, raised)
    for motion in (down, up):
        assert [f for f in preflight(lying(0.005), motion) if f.kind == "floor"] == []
    # without the pose that lies there, 15 mm are too deep; a motion that begins there may end there
    standing = replace(lying(0.005), poses={"home": raised, "rest": raised})
    (finding,) = [f for f in preflight(standing, down) if f.kind == "floor"]
    assert finding.what == "15.0 mm below the floor" and finding.time == pytest.approx(
        down.duration, abs=0.01
    )
    assert [f for f in preflight(standing, up) if f.kind == "floor"] == []
    # 5 mm below the floor it is the axis itself: a pose of the file does not make that right
    (finding,) = [f for f in preflight(lying(-0.005), down) if f.kind == "floor"]
    assert (finding.part, finding.what) == ("the link behind joint 3", "25.0 mm below the floor")
