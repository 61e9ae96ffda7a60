from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial, first_crossing, quintic, spline_through


@st.composite
def polynomials(draw: st.DrawFn) -> PiecewisePolynomial:
    pieces, size, n = draw(st.integers(1, 4)), draw(st.integers(1, 6)), draw(st.integers(1, 3))
    widths = draw(arrays(np.float64, pieces, elements=st.floats(0.1, 3.0)))
    coefficients = draw(arrays(np.float64, (pieces, size, n), elements=st.floats(-5.0, 5.0)))
    start = draw(st.floats(-2.0, 2.0))
    return PiecewisePolynomial(start + np.concatenate([[0.0], np.cumsum(widths)]), coefficients)


def inside(p: PiecewisePolynomial, count: int = 40) -> np.ndarray:
    """Places in every piece, none on a break."""
    shares = (np.arange(count) + 0.5) / count
    return (p.breaks[:-1, None] + np.diff(p.breaks)[:, None] * shares).ravel()


@given(polynomials())
def test_derivatives_are_those_of_numpy(p: PiecewisePolynomial) -> None:
    found = p.derivatives(inside(p), 3)
    shares = (np.arange(40) + 0.5) / 40
    for piece in range(len(p.coefficients)):
        h = shares * (p.breaks[piece + 1] - p.breaks[piece])
        for j in range(p.n):
            powers = np.polynomial.Polynomial(p.coefficients[piece, :, j])
            for order in range(4):
                expected = powers.deriv(order)(h) if order else powers(h)
                np.testing.assert_allclose(
                    found[order, 40 * piece : 40 * (piece + 1), j], expected, rtol=1e-7, atol=1e-7
                )


@given(polynomials())
def test_extremes_are_never_passed_and_are_met(p: PiecewisePolynomial) -> None:
    low, high = p.extremes_by_piece()
    below, above = p.bounds_by_piece()
    fine = p(inside(p, 4000)).reshape(len(p.coefficients), 4000, p.n)
    size = 1 + np.abs(fine).max()
    assert (fine >= low[:, None] - 1e-9 * size).all()
    assert (fine <= high[:, None] + 1e-9 * size).all()
    # 4,000 samples come close to an extreme inside a piece, and to the ends of one
    slack = 2e-3 * np.abs(p.derivative().bound_by_piece()).max() * np.diff(p.breaks).max() + 1e-9 * size
    assert (fine.min(axis=1) <= low + slack).all()
    assert (fine.max(axis=1) >= high - slack).all()
    assert (below <= low + 1e-9 * size).all()
    assert (above >= high - 1e-9 * size).all()


@given(polynomials(), st.integers(1, 4), st.floats(0.2, 5.0))
def test_cutting_and_scaling_keep_the_curve(p: PiecewisePolynomial, parts: int, factor: float) -> None:
    x = inside(p)
    size = 1 + np.abs(p(x)).max()
    finer = np.unique([np.linspace(*ends, parts + 1) for ends in pairwise(p.breaks)])
    np.testing.assert_allclose(p.cut(finer)(x), p(x), rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(p.scaled(factor)(factor * x), p(x), rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(p.derivative()(x), p.derivatives(x, 1)[1], rtol=1e-9, atol=1e-9 * size)


@given(polynomials())
def test_many_places_in_order_give_what_each_gives_alone(p: PiecewisePolynomial) -> None:
    x = np.sort(np.concatenate([inside(p), p.breaks, p.breaks, [p.low - 1.0, p.high + 1.0]]))
    alone = np.array([p(place) for place in x.tolist()])
    mixed = np.random.default_rng(5).permutation(len(x))
    np.testing.assert_array_equal(p(x), alone)
    np.testing.assert_array_equal(p(x[mixed]), alone[mixed])
    np.testing.assert_array_equal(p(x.reshape(2, -1)), alone.reshape(2, -1, p.n))
    np.testing.assert_array_equal(p.derivatives(x.reshape(2, -1), 1)[0], alone.reshape(2, -1, p.n))


def test_one_curve_after_another() -> None:
    first = PiecewisePolynomial([0.0, 1.0], [[[0.0], [1.0]]])
    second = PiecewisePolynomial([5.0, 7.0], [[[1.0], [0.0], [3.0]]])
    third = PiecewisePolynomial([0.0, 1.0], [[[13.0], [2.0]]])
    all_three = first.followed_by(second, third)
    np.testing.assert_allclose(all_three.breaks, [0, 1, 3, 4])
    np.testing.assert_allclose(all_three([0.5, 1.0, 2.0, 3.5])[:, 0], [0.5, 1.0, 4.0, 14.0])


def test_beyond_its_ends_it_holds_them() -> None:
    p = PiecewisePolynomial([0.0, 2.0], [[[1.0], [1.0]]])
    np.testing.assert_array_equal(p([-1.0, 0.0, 2.0, 9.0])[:, 0], [1, 1, 3, 3])


@pytest.mark.parametrize(
    ("breaks", "coefficients", "text"),
    [
        ([0.0, 1.0], np.zeros((2, 2, 1)), "do not fit"),
        ([0.0, 0.0], np.zeros((1, 2, 1)), "must rise"),
        ([0.0, np.nan], np.zeros((1, 2, 1)), "finite"),
        ([0.0, 1.0], np.full((1, 2, 1), np.inf), "finite"),
        ([0.0, 1.0], np.zeros((1, 13, 1)), "13 coefficients, 12 at most"),
    ],
)
def test_what_is_no_polynomial_is_refused(breaks: list[float], coefficients: np.ndarray, text: str) -> None:
    with pytest.raises(InputError, match=text):
        PiecewisePolynomial(breaks, coefficients)
    with pytest.raises(InputError, match="cannot be cut"):
        PiecewisePolynomial([0.0, 1.0], np.zeros((1, 2, 1))).cut(np.array([0.5, 1.5]))


def test_a_quintic_has_what_is_given_at_both_ends() -> None:
    start, end = np.random.default_rng(2).normal(size=(2, 3, 4))
    curve = PiecewisePolynomial([0.0, 1.0], quintic(start, end)[None])
    np.testing.assert_allclose(curve.derivatives(0.0, 2), start, atol=1e-13)
    np.testing.assert_allclose(curve.derivatives(1.0, 2), end, atol=1e-12)


@given(
    st.integers(2, 40).flatmap(
        lambda k: arrays(
            np.float64, (k, 3), elements=st.integers(-3000, 3000).map(lambda i: i / 1000), unique=True
        )
    )
)
def test_a_spline_is_scipys_not_a_knot_spline(points: np.ndarray) -> None:
    spline = spline_through(points)
    if np.diff(spline.breaks).min() < 1e-3 * np.diff(spline.breaks).max():
        return  # two solvers of an ill-conditioned system agree in nothing but its residual
    reference = CubicSpline(spline.breaks, points[: len(spline.breaks)])
    x = np.linspace(spline.low, spline.high, 300)
    size = 1 + np.abs(reference(x)).max()
    np.testing.assert_allclose(spline(x), reference(x), rtol=0, atol=1e-7 * size)


def test_a_spline_meets_the_points_and_is_smooth() -> None:
    points = np.random.default_rng(3).normal(size=(30, 5))
    spline = spline_through(points, weights=[1, 2, 3, 4, 5])
    np.testing.assert_allclose(spline(spline.breaks), points, atol=1e-12)
    np.testing.assert_allclose(spline_through([[0.0], [0.0], [1.0], [1.0], [3.0]]).breaks, [0, 1, 3])
    inner = spline.breaks[1:-1]
    before, after = spline.derivatives(inner - 1e-9, 2), spline.derivatives(inner + 1e-9, 2)
    np.testing.assert_allclose(before, after, atol=1e-5)
    np.testing.assert_allclose(
        np.diff(spline.breaks), (np.abs(np.diff(points, axis=0)) * [1, 2, 3, 4, 5]).max(axis=1)
    )


@pytest.mark.parametrize(
    "points",
    [
        [[1.0, 2.0]],
        [[1.0], [1.0]],
        np.zeros((0, 3)),
        [[0.0, 1.0], [-np.inf, 2.0], [3.0, np.nan]],
        [1.0, 2.0],
    ],
)
def test_what_gives_no_spline_is_refused(points: object) -> None:
    with pytest.raises(InputError, match="spline needs"):
        spline_through(points)  # pyright: ignore[reportArgumentType]


def test_the_first_crossing_of_a_polynomial() -> None:
    limits = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    # the first coordinate passes 1 at x = 2.5; the second one -1 at x = 2.25, in the same piece
    path = PiecewisePolynomial([0.0, 2.0, 4.0], [[[0.0, 0.0], [0.25, -0.25]], [[0.5, -0.5], [1.0, -2.0]]])
    crossing = first_crossing(path, limits)
    assert crossing is not None and crossing[1] == 1
    assert crossing[0] == pytest.approx(2.25, abs=1e-7)
    assert first_crossing(path, 3.0 * limits[:, ::1] - np.array([2.0, 0.0])) is None
    # out and in again between two breaks
    hump = PiecewisePolynomial([0.0, 1.0], [[[0.9], [0.8], [-0.8]]])
    crossing = first_crossing(hump, limits[:1])
    assert crossing is not None and crossing[0] == pytest.approx((1 - math.sqrt(0.5)) / 2, abs=1e-6)


def test_polynomials_near_a_limit_are_told_apart() -> None:
    rng = np.random.default_rng(6)
    inside = outside = 0
    for _ in range(200):
        path = PiecewisePolynomial(
            [0.0, 0.3, 0.5], rng.uniform(-1, 1, (2, 6, 1)) * 3.0 ** np.arange(6)[:, None]
        )
        values = path(np.linspace(0.0, 0.5, 20_001))[:, 0]
        edge = values.max() + rng.choice([1e-4, -1e-4])
        crossing = first_crossing(path, np.array([[-100.0, edge]]))
        if edge > values.max():
            assert crossing is None
            inside += 1
            continue
        assert crossing is not None
        first = np.linspace(0.0, 0.5, 20_001)[(values > edge).argmax()]
        assert crossing[0] == pytest.approx(first, abs=3e-5)
        outside += 1
    assert inside > 50 and outside > 50
