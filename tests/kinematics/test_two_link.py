"""The planar triangle: exact where links are nearly in line, where an arc cosine loses its digits."""

from __future__ import annotations

import cmath
import math

import pytest

from armctl.kinematics.families.yaw_pitch_roll.closed_form import bend_angle, two_link

LENGTHS = ((0.15, 0.15), (0.2, 0.05), (0.05, 0.2), (0.15, 0.15 + 1e-9), (0.15, 0.15 - 1e-7))
TURN = 0.7


def tip(first: float, bend: float, a: float, b: float) -> complex:
    return cmath.exp(1j * first) * (a + b * cmath.exp(1j * bend))


@pytest.mark.parametrize(("a", "b"), LENGTHS)
@pytest.mark.parametrize("straight", [0.0, math.pi])
def test_links_nearly_in_line_reach_their_target(a: float, b: float, straight: float) -> None:
    for exponent in range(-32, 0):
        for sense in (1, -1):
            target = tip(TURN, sense * (straight - 10 ** (exponent / 2)), a, b)
            found = two_link(target.real, target.imag, a, b)
            assert found
            for first, bend in found:
                assert abs(tip(first, bend, a, b) - target) < 3e-14


@pytest.mark.parametrize(("a", "b"), LENGTHS)
def test_exactly_in_line_there_is_one_posture(a: float, b: float) -> None:
    stretched = two_link(a + b, 0.0, a, b)
    assert stretched == [(0.0, 0.0)]
    folded = two_link(a - b, 0.0, a, b)
    assert [bend for _, bend in folded] == [math.pi]
    for first, bend in folded:
        assert abs(tip(first, bend, a, b) - (a - b)) < 1e-16


@pytest.mark.parametrize(("a", "b"), LENGTHS)
def test_rounding_does_not_put_a_target_out_of_reach_but_a_micrometre_does(a: float, b: float) -> None:
    assert bend_angle((a + b + 1e-13) ** 2, a, b) == 0.0
    assert bend_angle((a + b + 1e-6) ** 2, a, b) is None
    least = abs(a - b)
    if least > 1e-6:
        assert bend_angle((least - 1e-13) ** 2, a, b) == math.pi
        assert bend_angle((least - 1e-6) ** 2, a, b) is None
    assert two_link(0.0, 0.0, 0.15, 0.15 - 1e-7) == []  # no nearer than their difference, however small
    assert [bend for _, bend in two_link(0.0, 0.0, 0.15, 0.15)] == [math.pi]
