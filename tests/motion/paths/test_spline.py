from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline

from armctl.errors import InputError
from armctl.motion.paths.spline import spline_through


@given(
    st.integers(2, 40).flatmap(
        lambda k: arrays(
            np.float64, (k, 3), elements=st.integers(-3000, 3000).map(lambda i: i / 1000), unique=True
        )
    )
)
def test_it_is_scipys_not_a_knot_spline(points: np.ndarray) -> None:
    spline = spline_through(points)
    if np.diff(spline.breaks).min() < 1e-3 * np.diff(spline.breaks).max():
        return  # two solvers of an ill-conditioned system agree in nothing but its residual
    reference = CubicSpline(spline.breaks, points[: len(spline.breaks)])
    x = np.linspace(spline.low, spline.high, 300)
    size = 1 + np.abs(reference(x)).max()
    np.testing.assert_allclose(spline(x), reference(x), rtol=0, atol=1e-7 * size)


@pytest.mark.parametrize("k", [2, 3, 4, 5, 58, 200])
def test_evenly_spread_points_give_the_same_as_nearly_even_ones(k: int) -> None:
    turns = np.random.default_rng(k).uniform(-1.0, 1.0, size=(k, 3))
    points = np.column_stack([2.5 * np.arange(k), turns])  # the first coordinate has the longest way
    even, uneven = spline_through(points), points.copy()
    uneven[-1, 0] += 1e-9
    x = np.linspace(even.low, even.high, 40 * k)
    np.testing.assert_allclose(even(x), spline_through(uneven)(x), rtol=0, atol=1e-8 + 1e-13 * k)
    np.testing.assert_allclose(even(even.breaks), points, rtol=0, atol=1e-13 * (1 + np.abs(points).max()))
    if k >= 4:
        np.testing.assert_allclose(even(x), CubicSpline(even.breaks, points)(x), rtol=0, atol=1e-12 * k)


def test_it_meets_the_points_and_is_smooth() -> None:
    points = np.random.default_rng(3).normal(size=(30, 5))
    spline = spline_through(points, weights=[1, 2, 3, 4, 5])
    np.testing.assert_allclose(spline(spline.breaks), points, atol=1e-12)
    inner = spline.breaks[1:-1]
    before, after = spline.derivatives(inner - 1e-9, 2), spline.derivatives(inner + 1e-9, 2)
    np.testing.assert_allclose(before, after, atol=1e-5)
    np.testing.assert_allclose(
        np.diff(spline.breaks), (np.abs(np.diff(points, axis=0)) * [1, 2, 3, 4, 5]).max(axis=1)
    )


def test_ten_thousand_points_take_a_moment_only() -> None:
    points = np.cumsum(np.random.default_rng(1).normal(size=(10_000, 5)), axis=0)
    spline = spline_through(points)
    np.testing.assert_allclose(spline(spline.breaks), points, atol=1e-9)


def test_points_that_follow_on_themselves_count_once() -> None:
    points = np.array([[0.0], [0.0], [1.0], [1.0], [3.0]])
    np.testing.assert_allclose(spline_through(points).breaks, [0, 1, 3])


@pytest.mark.parametrize(
    "points",
    [
        [[1.0, 2.0]],
        [[1.0], [1.0]],
        np.zeros((0, 3)),
        [[np.nan], [1.0]],
        [[np.nan], [np.nan]],
        [[np.inf], [np.inf]],
        [[0.0, 1.0], [-np.inf, 2.0], [3.0, 4.0]],
        [1.0, 2.0],
    ],
)
def test_what_gives_no_spline_is_refused(points: object) -> None:
    with pytest.raises(InputError, match="spline needs"):
        spline_through(points)  # pyright: ignore[reportArgumentType]
