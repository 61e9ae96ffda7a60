"""Lines, arcs and splines made motions: their duration, their limits and what planning takes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator

import numpy as np
from benchmarks.measure import Effort, Work, compare
from benchmarks.peers.toppra import Toppra
from benchmarks.row import Goal, NotMeasuredError, Row

from armctl import ArmctlError, Robot, load_robot
from armctl.motion import PathTrajectory, PiecewisePolynomial, plan_line
from armctl.motion.plan import follow_tool
from armctl.motion.polynomial import spline_through

_ARMS = ("uzuner", "abaas", "scorbot", "humanoid", "mico", "ur5", "ar4", "parol6")
_KINDS = ("line", "arc", "spline")
_SAMPLES, _TRIES = 4000, 5
_KEPT = 1 + 1e-9
_MOST_US = 10_000.0


def rows(effort: Effort) -> Iterator[Row]:
    each = effort.count(500, least=3)
    arms = [load_robot(name) for name in _ARMS]
    paths = [list(random_paths(robot, each)) for robot in arms]
    yield from _durations(arms, paths, each)
    yield _limits(arms, paths, each)
    few = [path for path, kind in zip(paths[0], _kinds(each), strict=True) if kind == "line"][:10]

    def sides() -> tuple[Work, Work]:
        peer = Toppra(arms[0])
        return (
            lambda: [peer.duration(path) for path in few],
            lambda: [PathTrajectory.fastest(arms[0], path) for path in few],
        )

    goal = Goal("time", 1.0)
    yield compare("uzuner, speed along a line", "toppra, 500 places", sides, effort, each=len(few), goal=goal)
    yield _planning(arms[0], effort.count(200, least=5))


def _kinds(count: int) -> list[str]:
    return [_KINDS[k % 3] for k in range(count)]


def random_paths(robot: Robot, count: int) -> Iterator[PiecewisePolynomial]:
    """Lines and arcs of 1 to 50 cm from random configurations, splines through 2 to 8, in turn."""
    rng = np.random.default_rng(2018)
    low, high = robot.limits.T
    for kind in _kinds(count):
        path = None
        while path is None:
            q, size = rng.uniform(low, high), 10 ** rng.uniform(-2, -0.3)
            if kind == "spline":
                points = rng.uniform(low, high, (int(rng.integers(2, 9)), robot.n))
                path = spline_through(points, 1 / robot.speed_limits)
                continue
            tool = robot.forward(q)[:3, 3]
            end = tool + size * rng.normal(size=3) / 1.7
            via = 0.5 * (tool + end) + 0.4 * size * rng.normal(size=3) / 1.7 if kind == "arc" else None
            try:
                path = follow_tool(robot, q, via, end, "free", None)
            except ArmctlError:  # out of reach, or a limit on the way
                continue
        yield path


def _durations(arms: list[Robot], paths: list[list[PiecewisePolynomial]], each: int) -> Iterator[Row]:
    work = f"{len(arms)} arms, {each} lines, arcs and splines each: duration"
    works = ((f"{work}, median of the slowest arm", 1.03), (f"{work}, worst path", 1.10))
    try:
        ratios = [
            [PathTrajectory.fastest(robot, path).duration / peer.duration(path) for path in own]
            for robot, own in zip(arms, paths, strict=True)
            for peer in [Toppra(robot)]
        ]
    except NotMeasuredError as missing:
        for name, bound in works:
            yield Row(name, Toppra.name, goal=Goal("time", bound), missing=str(missing))
        return
    figures = max(statistics.median(one) for one in ratios), max(max(one) for one in ratios)
    for (name, bound), figure in zip(works, figures, strict=True):
        yield Row(name, Toppra.name, ratio=figure, goal=Goal("time", bound))


def _limits(arms: list[Robot], paths: list[list[PiecewisePolynomial]], each: int) -> Row:
    """Speeds and accelerations at dense samples of every motion."""
    kept: list[bool] = []
    for robot, own in zip(arms, paths, strict=True):
        for path in own:
            motion = PathTrajectory.fastest(robot, path)
            state = motion.sample(np.linspace(0.0, motion.duration, _SAMPLES))
            shares = (
                np.abs(state.velocity) / robot.speed_limits,
                (np.abs(state.acceleration) / robot.acceleration_limits),
            )
            kept.append(bool(np.max(shares) <= _KEPT))
    work = f"{len(arms)} arms, {each} paths each: limits kept"
    return Row(work, f"{_SAMPLES:,} samples a motion", ratio=float(np.mean(kept)), goal=Goal("share", 1.0))


def _planning(robot: Robot, count: int) -> Row:
    """A whole ``plan_line`` but for the pre-flight: the best of some tries, the median of all lines."""
    rng = np.random.default_rng(10)
    taken: list[float] = []
    while len(taken) < count:
        q, tries = rng.uniform(*robot.limits.T), list[float]()
        end = robot.forward(q)[:3, 3] + rng.normal(size=3) * 0.05
        try:
            for _ in range(_TRIES):
                begin = time.thread_time()
                plan_line(robot, q, end, pitch="free", checked=False)
                tries.append(time.thread_time() - begin)
        except ArmctlError:
            continue
        taken.append(min(tries))
    ours = 1e6 * statistics.median(taken)
    return Row(
        f"{robot.name}, a line planned, pre-flight aside",
        "10 ms of the processor",
        _MOST_US,
        ours,
        ratio=ours / _MOST_US,
        goal=Goal("time", 1.0),
    )
