from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples

from armctl import load_robot
from armctl.errors import InputError
from armctl.motion.analysis import arc
from armctl.motion.blend import Blend, Leg, blend
from armctl.motion.polynomial import PiecewisePolynomial

ROBOT = load_robot("uzuner")
LOW, HIGH = ROBOT.limits.T


def legs_through(points: np.ndarray, blend_m: float) -> list[Leg]:
    return [
        Leg(PiecewisePolynomial([0.0, 1.0], np.stack([a, b - a])[None]), blend_m) for a, b in pairwise(points)
    ]


def random_points(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(LOW, HIGH, (count, ROBOT.n))


def assert_one_smooth_motion(found: Blend, first: np.ndarray, last: np.ndarray) -> None:
    """Inside the limits, without a jump of angle or speed, and acceleration bounded: from rest to rest."""
    before = None
    for trajectory in found.trajectories:
        state = trajectory.sample(np.linspace(0.0, trajectory.duration, 400))
        assert (state.q >= LOW - 1e-9).all()
        assert (state.q <= HIGH + 1e-9).all()
        assert (np.abs(state.velocity) <= ROBOT.speed_limits * (1 + 1e-9)).all()
        assert (np.abs(state.acceleration) <= ROBOT.acceleration_limits * (1 + 1e-9)).all()
        if before is None:
            np.testing.assert_array_equal(state.q[0], first)
            np.testing.assert_allclose(state.velocity[0], 0.0, atol=1e-9)
        else:
            np.testing.assert_allclose(state.q[0], before.q[-1], atol=1e-12)
            np.testing.assert_allclose(state.velocity[0], before.velocity[-1], atol=1e-9)
        before = state
    assert before is not None
    np.testing.assert_allclose(before.q[-1], last, atol=1e-12)
    np.testing.assert_allclose(before.velocity[-1], 0.0, atol=1e-9)


@given(st.integers(0, 10_000), st.integers(2, 9), st.floats(1e-4, 0.5))
@settings(max_examples=examples(60))
def test_one_smooth_motion_inside_the_limits(seed: int, count: int, blend_m: float) -> None:
    points = random_points(seed, count)
    assert_one_smooth_motion(blend(ROBOT, legs_through(points, blend_m)), points[0], points[-1])


@given(st.integers(0, 10_000), st.floats(1e-3, 0.1))
@settings(max_examples=examples(30))
def test_the_tool_leaves_the_way_only_within_the_radius(seed: int, radius: float) -> None:
    points = random_points(seed, 4)
    found = blend(ROBOT, legs_through(points, radius))
    corners = ROBOT.forward(points[1:-1])[:, :3, 3]
    straight = np.concatenate([a + (b - a) * np.linspace(0, 1, 800)[:, None] for a, b in pairwise(points)])
    for trajectory in found.trajectories:
        q = trajectory.sample(np.linspace(0.0, trajectory.duration, 60)).q
        off = np.abs(q[:, None] - straight).max(axis=2).min(axis=1)
        tool = ROBOT.forward(q)[:, :3, 3]
        to_corner = np.linalg.norm(tool[:, None] - corners, axis=2).min(axis=1)
        assert (to_corner[off > 0.02] <= 1.3 * radius).all()


def test_it_does_not_stop_between_the_points_of_the_published_arc() -> None:
    points = np.array([ROBOT.inverse(p).best("least-rotation") for p in arc()])
    found = blend(ROBOT, legs_through(points, 0.002))
    assert len(found.trajectories) == 57
    for trajectory in found.trajectories[1:-1]:
        speed = np.abs(trajectory.sample(np.linspace(0.0, trajectory.duration, 50)).velocity).max(axis=1)
        assert speed.min() > np.radians(20)
    assert_one_smooth_motion(found, points[0], points[-1])


def test_without_a_radius_it_stops_at_every_point() -> None:
    points = random_points(1, 5)
    found = blend(ROBOT, legs_through(points, 0.0))
    assert found.entries == (None,) * 4
    for trajectory, end in zip(found.trajectories, points[1:], strict=True):
        np.testing.assert_allclose(trajectory.end, end, atol=1e-12)
        np.testing.assert_allclose(trajectory.sample(trajectory.duration).velocity, 0.0, atol=1e-9)


@given(st.integers(0, 10_000), st.integers(0, 5))
@settings(max_examples=examples(40))
def test_it_can_be_planned_piece_by_piece(seed: int, run: int) -> None:
    points = random_points(seed, 9)
    legs = legs_through(points, 0.03)
    first = blend(ROBOT, legs[: run + 3])
    rest = blend(ROBOT, legs[run + 1 :], first.entries[run])
    whole = Blend((*first.trajectories[: run + 1], *rest.trajectories), ())
    assert_one_smooth_motion(whole, points[0], points[-1])


def test_a_largest_rate_is_kept() -> None:
    points = random_points(5, 3)
    slow = [Leg(leg.path, leg.blend_m, rate_cap=0.05) for leg in legs_through(points, 0.02)]
    found = blend(ROBOT, slow)
    assert sum(t.duration for t in found.trajectories) > 2 / 0.05 * 0.8


def test_legs_that_do_not_meet_are_refused() -> None:
    points = random_points(6, 4)
    legs = legs_through(points, 0.01)
    with pytest.raises(InputError, match=r"begins .*° away"):
        blend(ROBOT, [legs[0], legs[2]])
    with pytest.raises(InputError, match="at least one leg"):
        blend(ROBOT, [])
