"""Lines and arcs of the tool as geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.motion.paths.tool_curve import ToolArc, ToolCurve, ToolLine

A, B, C = np.array([0.2, 0.0, 0.1]), np.array([0.0, 0.2, 0.1]), np.array([-0.2, 0.0, 0.1])


def check_derivatives(curve: ToolCurve) -> None:
    h = 1e-5 * curve.length
    for s in np.linspace(0.1, 0.9, 5) * curve.length:
        point, direction, bend = curve.derivatives(float(s))
        ahead, behind = curve.derivatives(float(s + h)), curve.derivatives(float(s - h))
        np.testing.assert_allclose(point, curve.positions(float(s)), atol=1e-15)
        np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * h), direction, atol=1e-6)
        np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * h), bend, atol=1e-5 * (1 + 1 / curve.length))
        assert np.linalg.norm(direction) == pytest.approx(1.0, abs=1e-12)


def test_a_line_goes_straight_from_end_to_end() -> None:
    line = ToolLine(A, B)
    assert line.length == pytest.approx(0.2 * math.sqrt(2), abs=1e-15)
    np.testing.assert_allclose(line.positions(line.length), B, atol=1e-15)
    np.testing.assert_allclose(line.positions(np.array([0.0, line.length / 2])), [A, (A + B) / 2], atol=1e-15)
    assert line.derivatives(np.zeros((4, 2))).shape == (3, 4, 2, 3)
    check_derivatives(line)
    assert ToolLine(A, A + 1e-9).length == 0.0
    np.testing.assert_array_equal(ToolLine(A, A).positions(0.0), A)


@given(
    radius=st.floats(0.005, 0.6),
    angles=st.lists(st.floats(0.0, 2 * math.pi - 0.01), min_size=3, max_size=3, unique=True),
    seed=st.integers(0, 1000),
)
def test_an_arc_passes_its_three_points_in_their_order(radius: float, angles: list[float], seed: int) -> None:
    first, via, last = sorted(angles)
    assume(min(via - first, last - via) > 0.02)
    rng = np.random.default_rng(seed)
    centre, axes = rng.uniform(-0.3, 0.3, 3), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    on_circle = [
        centre + radius * (math.cos(x) * axes[0] + math.sin(x) * axes[1]) for x in (first, via, last)
    ]
    arc = ToolArc(*on_circle)
    assert arc.length == pytest.approx(radius * (last - first), rel=1e-9)
    np.testing.assert_allclose(arc.positions(0.0), on_circle[0], atol=1e-15)
    np.testing.assert_allclose(arc.positions(radius * (via - first)), on_circle[1], atol=1e-10)
    np.testing.assert_allclose(arc.positions(arc.length), on_circle[2], atol=1e-10)
    np.testing.assert_allclose(arc.start + arc.radius * arc.inward, centre, atol=1e-10)
    check_derivatives(arc)


def test_the_way_round_is_the_one_over_the_via_point() -> None:
    over_b, over_other = ToolArc(A, B, C), ToolArc(A, [0.0, -0.2, 0.1], C)
    np.testing.assert_allclose(over_b.positions(over_b.length / 2), B, atol=1e-12)
    np.testing.assert_allclose(over_other.positions(over_other.length / 2), [0.0, -0.2, 0.1], atol=1e-12)
    near_start = ToolArc(A, [0.2 * math.cos(0.1), -0.2 * math.sin(0.1), 0.1], B)
    assert near_start.sweep == pytest.approx(1.5 * math.pi)


def test_an_arc_through_nearly_straight_points_keeps_its_digits() -> None:
    via = (A + B) / 2 + [0.0, 0.0, 3e-6]
    arc = ToolArc(A, via, B)
    assert arc.radius > 1000.0
    np.testing.assert_allclose(arc.positions(arc.length), B, atol=1e-9)
    np.testing.assert_allclose(arc.positions(arc.length / 2), via, atol=1e-9)


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ((A, A, B), "the start and via points of an arc are the same point"),
        ((A, B, B + 1e-9), "the via and end points of an arc are the same point"),
        ((A, B, A), "the start and end points of an arc are the same point"),
        ((A, (A + B) / 2, B), r"start \(200.00, 0.00, 100.00 mm\), via .* stand on one line"),
        ((A, 2 * B - A, B), "stand on one line"),  # beyond the end
        ((A, [0.0, math.inf, 0.1], C), "finite"),
        ((A, B, [0.1, 0.2]), "shape"),
    ],
)
def test_what_makes_no_arc_is_refused(points: tuple[np.ndarray, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        ToolArc(*points)
    with pytest.raises(InputError, match="finite"):
        ToolLine(A, np.array([0.1, math.nan, 0.0]))
