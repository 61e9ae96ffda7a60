"""Time-optimal laws along lines, arcs and splines, held against a linear program over a fine grid."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, sparse
from tests.long import examples

from armctl.errors import ArmctlError, MotionRefusedError
from armctl.motion import ProfileName
from armctl.motion.plan import follow_tool
from armctl.motion.polynomial import PiecewisePolynomial, spline_through
from armctl.motion.profiles import law_over
from armctl.motion.timing import PathTrajectory, timed
from armctl.robot import Robot, load_robot

LONG = "ARMCTL_LONG" in os.environ
ARMS = ("uzuner", "abaas", "scorbot", "humanoid", "mico", "ur5", "ar4", "parol6")
EACH = 160 if LONG else 2
UZUNER = load_robot("uzuner")


def paths(robot: Robot, count: int, seed: int = 14) -> Iterator[PiecewisePolynomial]:
    """Of each kind so many: random lines and arcs of the tool, and splines through random configurations."""
    rng = np.random.default_rng(seed)
    low, high = robot.limits.T
    for kind in ("line", "arc", "spline"):
        found = 0
        while found < count:
            if kind == "spline":
                points = rng.uniform(low, high, (int(rng.integers(2, 9)), robot.n))
                path = spline_through(points, 1 / robot.speed_limits)
            else:
                q, size = rng.uniform(low, high), 10 ** rng.uniform(-2, -0.3)
                tool = robot.forward(q)[:3, 3]
                end = tool + size * rng.normal(size=3) / 1.7
                via = 0.5 * (tool + end) + 0.4 * size * rng.normal(size=3) / 1.7
                try:
                    path = follow_tool(robot, q, via if kind == "arc" else None, end, "free", None)
                except ArmctlError:
                    continue
            if path is not None:
                found += 1
                yield path


def fine_grid_duration(robot: Robot, path: PiecewisePolynomial, count: int = 300) -> float:
    """Shortest duration by a linear program in x = (ds/dt)² at the points of a fine grid [s].

    x is linear between them and as large as it can be; the limits are asked for at the points alone.
    """
    parts = -(-count // len(path.coefficients))
    s = np.unique([np.linspace(*ends, parts + 1) for ends in pairwise(path.breaks)])
    width = np.diff(s)
    _, slope, bend = path.derivatives(s, 2)
    with np.errstate(divide="ignore"):
        speed = ((robot.speed_limits / np.abs(slope)) ** 2).min(axis=1)
        still = (robot.acceleration_limits / np.abs(bend)).min(axis=1)
    unit = np.minimum(speed, 4 * still)  # the numbers that the program sees are near 1
    blocks = []
    for end in (0, 1):
        here = slice(end, len(width) + end)
        for joint, most in enumerate(robot.acceleration_limits):
            change = 0.5 * slope[here, joint] / width / most
            early, late = -change, change.copy()
            (late if end else early)[:] += bend[here, joint] / most
            rows = sparse.diags([early * unit[:-1], late * unit[1:]], [0, 1], (len(width), len(s)))
            blocks += [rows, -rows]
    rows = sparse.vstack(blocks)
    most = speed / unit
    most[[0, -1]] = 0.0
    bounds = np.column_stack([np.zeros(len(s)), most])
    found = optimize.linprog(-np.ones(len(s)), rows, np.ones(rows.shape[0]), bounds=bounds)
    assert found.status == 0, found.message
    rates = np.sqrt(found.x * unit)
    return float((2 * width / (rates[1:] + rates[:-1])).sum())


def largest_shares(robot: Robot, motion: PathTrajectory, count: int = 20_000) -> list[float]:
    """Speed, acceleration and jerk as shares of the limits, by dense samples."""
    state = motion.sample((np.arange(count) + 0.5) * (motion.duration / count))
    limits = (robot.speed_limits, robot.acceleration_limits, robot.jerk_limits)
    values = (state.velocity, state.acceleration, state.jerk)
    return [float((np.abs(one) / most).max()) for one, most in zip(values, limits, strict=True)]


def there_and_back(robot: Robot, motion: PathTrajectory, count: int = 20_000) -> float:
    """How often the acceleration goes to a limit, to the other and back; each takes a ramp of the jerk."""
    shares = motion.sample(np.linspace(0.0, motion.duration, count)).acceleration / robot.acceleration_limits
    return float(np.abs(np.diff(shares, axis=0, prepend=0.0, append=0.0)).sum(axis=0).max()) / 4


@pytest.mark.parametrize("name", ARMS)
def test_no_law_is_much_faster_and_all_limits_are_kept(name: str) -> None:
    robot, ratios = load_robot(name), []
    for path in paths(robot, EACH):
        motion = timed(robot, path)
        assert max(largest_shares(robot, motion)[:2]) <= 1 + 1e-9
        assert (motion.peaks.speed <= robot.speed_limits * (1 + 1e-9)).all()
        assert (motion.peaks.acceleration <= robot.acceleration_limits * (1 + 1e-9)).all()
        assert motion.peaks.jerk is None
        ratios.append(motion.duration / fine_grid_duration(robot, path))
    assert max(ratios) <= 1.10
    assert np.median(ratios) <= 1.03


@pytest.mark.parametrize("profile", ["s-curve", "quintic"])
@pytest.mark.parametrize("name", ARMS if LONG else ("uzuner", "scorbot", "ur5"))
def test_jerk_is_kept_in_at_most_1_3_of_the_trapezoids_time(name: str, profile: ProfileName) -> None:
    robot = load_robot(name)
    for path in paths(robot, EACH // 2, seed=4):
        motion, fastest = timed(robot, path, profile=profile), timed(robot, path)
        shares = largest_shares(robot, motion)
        assert max(shares) <= 1 + 1e-9
        assert max(shares) >= 0.9
        assert motion.peaks.jerk is not None
        assert (motion.peaks.jerk <= robot.jerk_limits * (1 + 1e-9)).all()
        assert motion.law.is_smooth_from_rest()
        ramp = float((robot.acceleration_limits / robot.jerk_limits).max())
        ramps = max(2.0, there_and_back(robot, fastest))
        assert motion.duration <= max(1.3 * fastest.duration, fastest.duration + ramps * ramp)


@given(
    st.integers(0, 10_000), st.integers(2, 6), st.floats(0.05, 20.0), st.sampled_from(["s-curve", "quintic"])
)
@settings(max_examples=examples(15))
def test_any_cap_is_kept_by_every_profile(seed: int, count: int, cap: float, profile: ProfileName) -> None:
    points = np.random.default_rng(seed).uniform(*UZUNER.limits.T, (count, UZUNER.n))
    path = spline_through(points, 1 / UZUNER.speed_limits)
    for motion in (timed(UZUNER, path, rate_cap=cap), timed(UZUNER, path, profile=profile, rate_cap=cap)):
        rates = motion.law.derivatives(np.linspace(0.0, motion.duration, 2000), 1)[1]
        assert rates.max() <= cap * (1 + 1e-9)
        assert motion.duration >= (path.high - path.low) / cap


def test_a_slow_line_takes_its_way_by_its_speed_and_its_ramps() -> None:
    path = next(paths(UZUNER, 1))
    cap = 0.01 * path.high
    assert timed(UZUNER, path, rate_cap=cap).duration == pytest.approx(path.high / cap, rel=1e-3)


def test_where_a_joint_turns_back_it_need_not_wait() -> None:
    """Base goes along (s - 1)²: at s = 1 its slope is 0, and no rate along the path moves it."""
    row = np.zeros((1, 3, UZUNER.n))
    row[0, :, 0] = [1.0, -2.0, 1.0]
    there_and_back = timed(UZUNER, PiecewisePolynomial([0.0, 2.0], row)).duration
    base = UZUNER.joints[0]
    once = law_over(1.0, base.speed, base.acceleration, base.jerk, "trapezoid").high
    assert there_and_back == pytest.approx(2 * once, rel=5e-3)


def test_a_long_path_is_planned_in_parts() -> None:
    points = np.random.default_rng(3).uniform(*UZUNER.limits.T, (40, UZUNER.n))
    motion = timed(UZUNER, spline_through(points, 1 / UZUNER.speed_limits))
    assert len(motion.law.coefficients) > 1024  # more than are held at once
    shares = largest_shares(UZUNER, motion)[:2]
    assert 0.99 < max(shares) <= 1 + 1e-9


@pytest.mark.parametrize("profile", ["trapezoid", "s-curve", "cubic"])
def test_the_limit_that_is_named_is_the_one_that_is_near_for_longest(profile: ProfileName) -> None:
    robot, units = UZUNER, ("speed", "acceleration", "jerk")
    for path in paths(robot, 20 if LONG else 2, seed=7):
        with pytest.raises(MotionRefusedError) as refused:
            timed(robot, path, profile=profile, duration_s=1e-3)
        said = re.search(
            r"s: (most of the time|at one place|for (\d+) % of the time, longer than any other,) "
            r"(.+) is near its largest (\w+), (\S+) °",
            str(refused.value),
        )
        assert said is not None
        when, percent, title, unit, limit = said.groups()
        motion = timed(robot, path, profile=profile)
        state = motion.sample(np.linspace(0.0, motion.duration, 5003)[1:-1])
        shares = np.concatenate(
            [
                np.abs(values) / most
                for values, most in (
                    (state.velocity, robot.speed_limits),
                    (state.acceleration, robot.acceleration_limits),
                    (state.jerk, robot.jerk_limits),
                )[: 3 if profile == "s-curve" else 2]
            ],
            axis=1,
        )
        joint = [one.title for one in robot.joints].index(title)
        column = robot.n * units.index(unit) + joint
        one = robot.joints[joint]
        most = np.degrees((one.speed, one.acceleration, one.jerk)[units.index(unit)])
        assert float(limit) == pytest.approx(most, rel=5e-3)
        near = (shares >= 0.95).mean(axis=0)
        if when == "most of the time":
            assert near[column] > 0.5
        elif when == "at one place":
            assert shares[:, column].max() > 0.99
            assert near.max() < 0.02
        else:
            assert near[column] == pytest.approx(int(percent) / 100, abs=0.015)
            assert near[column] >= near.max() - 0.005
