"""Whole poses of six-joint arms: every branch inside the limits, one pose and many."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from benchmarks.measure import Effort, Work, compare, must_agree
from benchmarks.peers.eaik import Eaik
from benchmarks.row import Goal, Row
from benchmarks.works.pose import must_find, nearest
from numpy.typing import NDArray

from armctl import Robot, load_robot

_ARMS = ("ar4", "parol6", "ur5")


def rows(effort: Effort) -> Iterator[Row]:
    for name in _ARMS:
        robot, rng = load_robot(name), np.random.default_rng(2017)
        q = rng.uniform(*robot.limits.T, (200, 6))
        yield _one(robot, q, effort)
        yield _kept(robot, q, effort)
        yield _many(robot, rng.uniform(*robot.limits.T, (effort.count(100_000), 6)), effort)


def _one(robot: Robot, q: NDArray[np.float64], effort: Effort) -> Row:
    poses = list(robot.forward(q))
    targets = [(pose[:3, 3], pose[:3, :3]) for pose in poses]

    def sides() -> tuple[Work, Work]:
        peer = Eaik(robot)
        must_find(np.array([nearest(peer.answers(T), one) for T, one in zip(poses, q, strict=True)]), q)
        ours = [robot.inverse(p, rotation=R).q for p, R in targets]
        must_find(np.array([nearest(found, one) for found, one in zip(ours, q, strict=True)]), q)
        return (
            lambda: [peer.all_solutions(pose) for pose in poses],
            lambda: [robot.inverse(p, rotation=R) for p, R in targets],
        )

    work = f"{robot.name}, whole pose, all branches, one pose"
    return compare(work, "EAIK, C++ (keeps no limits)", sides, effort, each=len(q), goal=Goal("time", 2.0))


def _kept(robot: Robot, q: NDArray[np.float64], effort: Effort) -> Row:
    """The same answer of both: inside the limits, at every whole turn."""
    poses = list(robot.forward(q))
    targets = [(pose[:3, 3], pose[:3, :3]) for pose in poses]

    def sides() -> tuple[Work, Work]:
        peer = Eaik(robot)
        for pose, (p, R) in zip(poses, targets, strict=True):
            theirs, ours = peer.inside_limits(pose), robot.inverse(p, rotation=R).q
            must_agree("how many solutions there are", np.array(len(ours)), np.array(len(theirs)), 0.0)
        return (
            lambda: [peer.inside_limits(pose) for pose in poses],
            lambda: [robot.inverse(p, rotation=R).q for p, R in targets],
        )

    work = f"{robot.name}, the same, inside the limits at every whole turn"
    return compare(
        work, "EAIK, C++, and numpy for the limits", sides, effort, each=len(q), goal=Goal("time", 2.0)
    )


def _many(robot: Robot, q: NDArray[np.float64], effort: Effort) -> Row:
    T = robot.forward(q)
    poses, positions, rotations = list(T), T[:, :3, 3].copy(), T[:, :3, :3].copy()

    def sides() -> tuple[Work, Work]:
        peer = Eaik(robot)
        solutions = robot.inverse_batch(positions, rotation=rotations)
        must_find(nearest(np.where(solutions.found[..., None], solutions.q, np.inf), q), q)
        return lambda: peer.batch(poses), lambda: robot.inverse_batch(positions, rotation=rotations)

    work = f"{robot.name}, the same, {len(q):,} poses, a pose"
    reference = "EAIK's batch, all cores (keeps no limits)"
    return compare(work, reference, sides, effort, each=len(q), goal=Goal("speed", 1.0))
