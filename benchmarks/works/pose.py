"""Position, pitch and roll of abaas and scorbot: every branch inside the limits, one pose and many."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from benchmarks.measure import Effort, Work, compare, must_agree
from benchmarks.peers.eaik import Eaik
from benchmarks.planar_arm import ABAAS, SCORBOT, FloatArray, PlanarArm
from benchmarks.row import Goal, Row

from armctl import Robot, load_robot


def rows(effort: Effort) -> Iterator[Row]:
    for name, arm in (("abaas", ABAAS), ("scorbot", SCORBOT)):
        robot, rng = load_robot(name), np.random.default_rng(2015)
        yield _one(robot, arm, arm.random(rng, 200), effort)
        yield _many(robot, arm, arm.random(rng, effort.count(100_000)), effort)


def _one(robot: Robot, arm: PlanarArm, q: FloatArray, effort: Effort) -> Row:
    poses = list(robot.forward(q))
    targets = list(zip(arm.tip(q), arm.pitch(q).tolist(), q[:, 4].tolist(), strict=True))

    def sides() -> tuple[Work, Work]:
        peer = Eaik(robot)
        must_find(np.array([nearest(peer.answers(T), one) for T, one in zip(poses, q, strict=True)]), q)
        ours = [nearest(robot.inverse(*target).q, one) for target, one in zip(targets, q, strict=True)]
        must_find(np.array(ours), q)
        return (
            lambda: [peer.all_solutions(pose) for pose in poses],
            lambda: [robot.inverse(*target) for target in targets],
        )

    work = f"{robot.name}, position + pitch + roll, all branches, one pose"
    return compare(work, "EAIK, C++ (keeps no limits)", sides, effort, each=len(q), goal=Goal("time", 1.0))


def _many(robot: Robot, arm: PlanarArm, q: FloatArray, effort: Effort) -> Row:
    poses, count = list(robot.forward(q)), len(q)
    positions, pitch, roll = arm.tip(q), arm.pitch(q), np.ascontiguousarray(q[:, 4])

    def ours() -> object:
        return robot.inverse_batch(positions, pitch, roll)

    def eaik() -> tuple[Work, Work]:
        peer = Eaik(robot)
        solutions = robot.inverse_batch(positions, pitch, roll)
        must_find(nearest(np.where(solutions.found[..., None], solutions.q, np.inf), q), q)
        return lambda: peer.batch(poses), ours

    work = f"{robot.name}, the same, {count:,} poses, a pose"
    goal = Goal("speed", 10)
    return compare(work, "EAIK's batch, all cores (keeps no limits)", eaik, effort, each=count, goal=goal)


def nearest(found: FloatArray, q: FloatArray) -> FloatArray:
    """Of the configurations (..., b, n) that were found, each target's nearest to its own q (..., n)."""
    away = np.abs(np.angle(np.exp(1j * np.where(np.isfinite(found), found - q[..., None, :], np.pi)))).max(
        axis=-1
    )
    return np.take_along_axis(found, away.argmin(axis=-1)[..., None, None], axis=-2)[..., 0, :]


def must_find(found: FloatArray, q: FloatArray) -> None:
    """The configuration that the target was made from is among the answers, whole turns aside."""
    for part in (np.cos, np.sin):
        must_agree("the configuration behind the target", part(found), part(q), 1e-5)
