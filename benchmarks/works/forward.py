"""Forward kinematics of uzuner: one pose, and a million."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from benchmarks.measure import Effort, Work, compare, must_agree
from benchmarks.naive_forward import naive_forward
from benchmarks.peers.ikpy import Ikpy
from benchmarks.planar_arm import UZUNER, FloatArray
from benchmarks.row import Goal, Row

from armctl import Robot, load_robot

_PART = 50_000
"""poses of the naive products: more at once would wait for memory, and a pose costs the same"""
_ONE = "uzuner, forward, one pose"

Forward = Callable[[FloatArray], FloatArray]


def rows(effort: Effort) -> Iterator[Row]:
    robot = load_robot("uzuner")
    rng = np.random.default_rng(2011)
    q = UZUNER.random(rng, 200)

    def ikpy() -> tuple[Work, Work]:
        return _each(Ikpy(robot).forward, robot, q, [Ikpy.padded(pose) for pose in q])

    def naive() -> tuple[Work, Work]:
        return _each(lambda pose: naive_forward(robot.chain, pose), robot, q)

    yield compare(_ONE, "ikpy", ikpy, effort, each=200, goal=Goal("speed", 20))
    yield compare(_ONE, "naive numpy, nine 4×4 products", naive, effort, each=200)
    yield _many(robot, UZUNER.random(rng, effort.count(1_000_000)), effort)


def _each(
    forward: Forward, robot: Robot, q: FloatArray, given: list[FloatArray] | None = None
) -> tuple[Work, Work]:
    """One pose after the other; ``given`` is q as the reference wants it."""
    poses = list(q)
    theirs = poses if given is None else given
    must_agree("forward kinematics", np.array([forward(pose) for pose in theirs]), robot.forward(q), 1e-9)
    return lambda: [forward(pose) for pose in theirs], lambda: [robot.forward(pose) for pose in poses]


def _many(robot: Robot, q: FloatArray, effort: Effort) -> Row:
    work, some = f"uzuner, forward, {len(q):,} poses, a pose", q[:1000]

    def naive() -> tuple[Work, Work]:
        must_agree("the naive products", naive_forward(robot.chain, some), robot.forward(some), 1e-9)
        part = q[:_PART]
        return lambda: naive_forward(robot.chain, part), lambda: robot.forward(q)

    return compare(
        work,
        "naive numpy, batched products",
        naive,
        effort,
        each=min(_PART, len(q)),
        ours_each=len(q),
        goal=Goal("speed", 10),
    )
