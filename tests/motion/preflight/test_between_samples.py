"""A dip between two samples that are clear themselves: only halving the interval finds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.motion.preflight.kit import arm

from armctl.kinematics import DHChain, DHRow
from armctl.kinematics.link_frames import LinkFrames
from armctl.motion.preflight import Floor, Obstacles, SelfCollision, preflight
from armctl.motion.preflight.batch import Batch
from armctl.motion.preflight.clearance import Gaps
from armctl.motion.profiles import PointToPoint
from armctl.robot import Robot
from armctl.robot.body import capsule
from armctl.robot.parts import Obstacle

# Three links of a metre that turn the same way: between two samples the tool turns by 12 degrees.
CHAIN = DHChain([DHRow(0.0, np.pi / 2, 4.0), *[DHRow(1.0, 0.0, 0.0)] * 3])
ARM = arm(CHAIN, np.tile(np.radians([[-170.0, 170.0]]), (4, 1)))
HANGING = np.radians([0.0, -90.0, 0.0, 0.0])
"""the tool is at its lowest: 1 m above the base frame, straight below the shoulder"""
DEPTH, RADIUS = 0.004, 0.02


def swing() -> PointToPoint:
    """Past the lowest point, which lies a quarter of the way: between the first two samples of three."""
    turn = np.array([0.0, 1.0, 1.0, 1.0])
    return PointToPoint.plan(ARM, HANGING - np.radians(2.0) * turn, HANGING + np.radians(6.0) * turn)


def with_floor(depth: float) -> Robot:
    return replace(ARM, floor_z=1.0 + depth)


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
    at_samples = gaps.gaps(LinkFrames.at(CHAIN, Batch.of(robot, [motion]).q))
    assert at_samples.min() > DEPTH
    (finding,) = [one for one in preflight(robot, motion) if one.kind == kind]
    assert finding.severity == "error"
    dense = motion.sample(np.linspace(0.0, motion.duration, 20_001)).q
    worst = gaps.gaps(LinkFrames.at(CHAIN, dense)).min()
    assert worst == pytest.approx(-DEPTH, abs=1e-6)
    # one look inside is enough: the deepest place is not searched for
    assert 0.0 < float(finding.what.split(" mm")[0]) <= 1000 * DEPTH
    assert [one for one in preflight(build(-DEPTH), motion) if one.kind == kind] == []
