"""The least rotation over the continuum: one point, many points, and that the sweep never beats it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from benchmarks.measure import Effort, Work, compare, must_agree
from benchmarks.paper_loop import PaperLoop
from benchmarks.peers.ikpy import Ikpy
from benchmarks.peers.roboticstoolbox import RoboticsToolbox
from benchmarks.planar_arm import UZUNER, FloatArray
from benchmarks.row import Goal, NotMeasuredError, Row
from benchmarks.works.sweep import STEP

from armctl import Robot, load_robot

_ONE = "uzuner, least rotation, one point"
_FOR_IKPY = 5
_ROUNDING = 1e-9
"""what a sum of four rounded angles may differ by [rad]"""


def rows(effort: Effort) -> Iterator[Row]:
    robot = load_robot("uzuner")
    positions = UZUNER.tip(UZUNER.random(np.random.default_rng(2014), effort.count(20_000)))
    yield from _one(robot, positions[:200], effort)
    yield _never_above_the_sweep(robot, positions)


def _one(robot: Robot, positions: FloatArray, effort: Effort) -> Iterator[Row]:
    singles = list(positions)

    def exact() -> None:
        for position in singles:
            robot.least_rotation(position)

    def toolbox() -> tuple[Work, Work]:
        peer = RoboticsToolbox(robot)
        poses = [np.eye(4) for _ in positions]
        for pose, position in zip(poses, positions, strict=True):
            pose[:3, 3] = position
        _must_reach(robot, [peer.position_only(pose)[0] for pose in poses[:20]], positions)
        return lambda: [peer.position_only(pose) for pose in poses], exact

    def ikpy() -> tuple[Work, Work]:
        peer, few = Ikpy(robot), list(positions[:_FOR_IKPY])
        return lambda: [peer.position_only(position) for position in few], exact

    each = len(positions)
    yield compare(
        _ONE,
        "roboticstoolbox, ik_LM in C++ (any solution)",
        toolbox,
        effort,
        each=each,
        goal=Goal("speed", 4),
    )
    yield compare(
        _ONE, "ikpy (any solution)", ikpy, effort, each=_FOR_IKPY, ours_each=each, goal=Goal("speed", 1000)
    )


def _must_reach(robot: Robot, found: list[FloatArray], positions: FloatArray) -> None:
    tips = robot.forward(np.array(found))[:, :3, 3]
    must_agree("the positions that the peer reaches", tips, positions[: len(tips)], 1e-5)


def _never_above_the_sweep(robot: Robot, positions: FloatArray) -> Row:
    """Against every solution that the paper's own loop lists for each position."""
    work, reference = (
        f"uzuner, least rotation never above the 0.01° sweep, {len(positions):,} points",
        "the paper's own loop in C",
    )
    goal = Goal("share", 1.0)
    try:
        loop = PaperLoop(UZUNER, STEP)
    except NotMeasuredError as missing:
        return Row(work, reference, goal=goal, missing=str(missing))
    swept = np.array([loop.least_sum(loop.solutions(position)) for position in positions])
    exact = _sums(robot.least_rotation(positions))
    share = float(np.mean(exact <= swept + _ROUNDING))  # a missing answer is no answer: NaN compares as false
    return Row(work, reference, ratio=share, goal=goal)


def _sums(q: FloatArray) -> FloatArray:
    """(k,) sums of absolute angles of the yaw and pitch joints."""
    return np.abs(q[:, :4]).sum(axis=1)
