"""``python -m benchmarks.best_solutions``: the best solutions of every arm against a search of its own.

A ratio above 1 says that the search found something better. In minutes an arm; not a part of ``make bench``.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from benchmarks.own_search import Best, Search, least

from armctl import Robot, load_robot, shipped_robots
from armctl.arrays import FloatArray

_STARTS = 6
_TURNED = 0.3
"""of every third rotation asked for, how far it is from one that the arm has there [rad]"""
WORKS = "time", "travel", "orientation"
ASKED = "position", "pitch", "pose"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.best_solutions", description=__doc__)
    parser.add_argument("arms", nargs="*", help="names of shipped arms; all, if none is given")
    parser.add_argument("--targets", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--asked", choices=ASKED, default=ASKED[0], help="of time and travel")
    parser.add_argument("--only", choices=WORKS, action="append")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)  # SLSQP's, of starts that lead nowhere
    for name in options.arms or shipped_robots():
        robot = load_robot(name)
        for work in options.only or WORKS:
            rng = np.random.default_rng(options.seed)
            begun = time.perf_counter()
            pairs = np.array(list(compared(robot, work, options.targets, rng, options.asked)))
            better = pairs[:, 1] < pairs[:, 0] - 2e-6
            ratio = np.where(better, pairs[:, 0] / np.maximum(pairs[:, 1], 1e-9), 1.0)
            print(
                f"{name:20} {work:12} worst ratio {ratio.max():.5f}, above 1.001: "
                f"{np.count_nonzero(ratio > 1.001)} of {len(ratio)} ({time.perf_counter() - begun:.0f} s)",
                flush=True,
            )


def compared(
    robot: Robot, work: str, count: int, rng: np.random.Generator, asked: str = ASKED[0]
) -> Iterator[tuple[float, float]]:
    """The cost that armctl's best has, and the least that the search found from it and from other starts."""
    for i in range(count):
        q, start = _configuration(robot, rng), _configuration(robot, rng)
        if i % 4 == 0:  # near by
            start = np.clip(q + rng.normal(0.0, 0.1, robot.n), *robot.limits.T)
        T = robot.forward(q)
        free = asked == "position" or work == "orientation"
        pitch = math.asin(max(-1.0, min(1.0, float(T[2, 2])))) if asked == "pitch" and not free else None
        pose = T[:3, :3] if asked == "pose" and not free else None
        search = Search(robot, T[:3, 3], pitch, pose)
        one: Callable[[FloatArray], Best]
        if work == "orientation":
            rotation = _rotation(rng, T[:3, :3] if i % 3 == 0 else None)
            found = robot.inverse(T[:3, 3], rotation=rotation)
            at = int(found.residual_rad.argmin())
            best, mine = found.q[at], float(found.residual_rad[at])
            one = partial(search.nearest_rotation, rotation)
        else:
            criterion = "shortest-time" if work == "time" else "least-travel"
            best = robot.inverse(T[:3, 3], pitch, rotation=pose, start=start).best(criterion, start)
            mine = search.time(best, start) if work == "time" else search.travel(best, start)
            one = partial(search.shortest_time if work == "time" else search.least_travel, start)
        others = rng.uniform(*robot.limits.T, (_STARTS, robot.n))
        yield mine, least(one, [best, q, np.clip(start, *robot.limits.T), *others])[0]


def _configuration(robot: Robot, rng: np.random.Generator) -> FloatArray:
    """(n,) inside the limits, and those of the angles between links of a linkage [rad]."""
    while True:
        q = rng.uniform(*robot.limits.T)
        if robot.chain.keeps_turns(q):
            return q


def _rotation(rng: np.random.Generator, near: FloatArray | None) -> FloatArray:
    """(3, 3) evenly spread, or near to one."""
    if near is None:
        R, triangle = np.linalg.qr(rng.normal(size=(3, 3)))
        R = R * np.sign(np.diag(triangle))
        return np.asarray(R * np.linalg.det(R))
    x, y, z = rng.normal(0.0, _TURNED, 3).tolist()
    angle = math.hypot(x, y, z)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / angle
    return (np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K)) @ near


if __name__ == "__main__":
    main()
