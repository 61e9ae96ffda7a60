"""Distances of segments against points sampled on them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from armctl.robot.body import box_distance, segment_box_distance, segment_distance

FloatArray = NDArray[np.float64]
Triple = tuple[float, float, float]
SHARE = np.linspace(0.0, 1.0, 201)
COORDINATE = st.floats(-1, 1).map(lambda value: round(value, 3))
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE).map(np.array)


def brute(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray) -> float:
    one, other = p + SHARE[:, None] * u, q + SHARE[:, None] * v
    return float(np.linalg.norm(one[:, None] - other[None], axis=2).min())


@given(POINT, POINT, POINT, POINT)
def test_as_near_as_the_nearest_of_many_points(
    p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray
) -> None:
    exact, sampled = float(segment_distance(p, u, q, v)), brute(p, u, q, v)
    step = (np.linalg.norm(u) + np.linalg.norm(v)) / 400
    assert sampled - step - 1e-9 <= exact <= sampled + 1e-9
    assert float(segment_distance(q, v, p, u)) == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize(
    ("p", "u", "q", "v", "distance"),
    [
        ((0, 0, 0), (1, 0, 0), (0.5, -1, 0.3), (0, 2, 0), 0.3),  # crossing
        ((0, 0, 0), (1, 0, 0), (0.4, 0.2, 0), (1, 0, 0), 0.2),  # side by side
        ((0, 0, 0), (1, 0, 0), (3, 0, 0), (-1, 0, 0), 1.0),  # in one line, apart
        ((0, 0, 0), (1, 0, 0), (0.2, 0, 0), (0.2, 0, 0), 0.0),  # in one line, one in the other
        ((0, 0, 0), (0, 0, 0), (0, 3, 0), (0, 0, 4), 3.0),  # a point
        ((1, 2, 3), (0, 0, 0), (1, 2, 5), (0, 0, 0), 2.0),  # two points
        ((0, 0, 0), (1, 0, 0), (2, 1, 0), (1, 0, 0), np.sqrt(2)),  # end to end
    ],
)
def test_special_places(p: Triple, u: Triple, q: Triple, v: Triple, distance: float) -> None:
    arrays = (np.array(x, dtype=np.float64) for x in (p, u, q, v))
    assert float(segment_distance(*arrays)) == pytest.approx(distance, abs=1e-12)


def test_many_at_once_are_those_one_by_one() -> None:
    rng = np.random.default_rng(3)
    p, u, q, v = rng.normal(size=(4, 3, 50))
    many = segment_distance(p, u, q, v)
    one = [float(segment_distance(p[:, i], u[:, i], q[:, i], v[:, i])) for i in range(50)]
    np.testing.assert_allclose(many, one, atol=1e-14)


@given(POINT, POINT)
def test_to_a_box(p: FloatArray, u: FloatArray) -> None:
    low, high = np.array([-0.3, -0.2, -0.5]), np.array([0.4, 0.1, 0.2])
    exact = float(segment_box_distance(p, u, low, high))
    points = p + np.linspace(0, 1, 2001)[:, None] * u
    sampled = float(box_distance(points.T, low, high).min())
    assert sampled - np.linalg.norm(u) / 2000 - 1e-9 <= exact <= sampled + 1e-9


def test_inside_a_box_the_distance_is_minus_the_depth() -> None:
    low, high = np.array([0.0, 0, 0]), np.array([1.0, 1, 1])
    points = np.array([[0.5, 0.5, 0.9], [2.0, 2.0, 1.0], [0.5, 0.5, 0.5], [1.0, 0.5, 0.5]])
    np.testing.assert_allclose(box_distance(points.T, low, high), [-0.1, np.sqrt(2), -0.5, 0.0], atol=1e-15)
