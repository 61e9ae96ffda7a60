"""Geometry that families share: all angles, least squares and continua, against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.kinematics.kit import rotation_about

from armctl.arrays import FloatArray
from armctl.kinematics.angles import wrap
from armctl.kinematics.subproblems import (
    AnglePairs,
    angle_about,
    angle_onto,
    circle,
    circle_angles,
    columns,
    meeting_point,
    roots,
    turned_by,
    two_turns,
    two_turns_of_many,
)

TIMES = 60
GRID = np.linspace(-math.pi, math.pi, 721)


def unit(rng: np.random.Generator) -> FloatArray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def near(found: float, angle: float) -> bool:
    return abs(math.remainder(found - angle, math.tau)) < 1e-6


def has(answer: AnglePairs, *angles: float) -> bool:
    return any(all(map(near, found, angles)) for found in answer.angles)


def test_the_turn_of_one_vector_onto_another_leaves_the_least() -> None:
    rng = np.random.default_rng(1)
    for _ in range(TIMES):
        k, p, q, x = unit(rng), rng.normal(size=3), rng.normal(size=3), rng.uniform(-3, 3)
        assert near(float(angle_about(k, p, rotation_about(k, x) @ p)), x)
        best = float(angle_about(k, p, q))
        least = min(np.linalg.norm(rotation_about(k, one) @ p - q) for one in GRID[::8])
        assert np.linalg.norm(rotation_about(k, best) @ p - q) <= least + 1e-12
        assert float(angle_onto(columns(k), columns(p), columns(q))) == pytest.approx(best, abs=1e-12)
        turned = turned_by(columns(p), columns(k), (np.cos(x), np.sin(x)))
        np.testing.assert_allclose(turned, rotation_about(k, x) @ p, rtol=0, atol=1e-14)


def test_a_height_on_a_circle_is_met_at_two_angles_or_missed_by_the_least() -> None:
    rng = np.random.default_rng(3)
    for _ in range(TIMES):
        k, p, h, x = unit(rng), rng.normal(size=3), rng.normal(size=3), rng.uniform(-3, 3)
        height = float(h @ rotation_about(k, x) @ p)
        a, b, c = map(float, circle(k, p, h))
        angles, missed = circle_angles(a, b, c, height)
        assert missed == 0.0 and len(angles) == 2 and any(near(one, x) for one in angles)
        many = roots((a, b, c), height, 1e-12)
        assert sorted(angles) == pytest.approx(sorted(wrap(one) for one in many.tolist()), abs=1e-9)
        highest = max(float(h @ rotation_about(k, one) @ p) for one in GRID)
        (far,), missed = circle_angles(a, b, c, highest + 1.0)
        assert float(h @ rotation_about(k, far) @ p) >= highest - 1e-9
        assert missed == pytest.approx(1.0, abs=1e-3)
        assert np.isnan(roots((a, b, c), highest + 1.0, 1e-12)).all()


def test_lines_meet_in_one_point_or_not() -> None:
    rng = np.random.default_rng(4)
    for count in (2, 3):
        axes = np.array([unit(rng) for _ in range(count)])
        centre = rng.normal(size=3)
        points = centre + rng.normal(size=(count, 1)) * axes
        found = meeting_point(points, axes, 1e-9)
        assert found is not None
        np.testing.assert_allclose(found, centre, rtol=0, atol=1e-12)
        assert meeting_point(points + 1e-3 * np.eye(3)[:count], axes, 1e-9) is None
        assert meeting_point(points, np.tile(axes[0], (count, 1)), 1e-9) is None


def test_two_turns_say_what_may_be_anywhere() -> None:
    turn = ((1.0, 0.0), (0.0, 1.0))
    none = ((0.0, 0.0), (0.0, 0.0))
    answer = two_turns(none, turn, (0.6, 0.8))
    assert answer.free == (0,) and has(answer, 0.0, math.atan2(0.8, 0.6))
    assert two_turns(turn, none, (0.6, 0.8)).free == (1,)
    assert not two_turns(none, turn, (0.6, 0.9)).angles
    # equal circles: one angle hangs on the other
    back = ((-1.0, 0.0), (0.0, -1.0))
    answer = two_turns(turn, back, (0.0, 0.0))
    assert answer.free == (0, 1)
    assert answer.angles[0][0] == pytest.approx(answer.angles[0][1], abs=1e-9)
    # circles that touch: a double root
    answer = two_turns(turn, back, (2.0, 0.0))
    assert len(answer.angles) == 1
    assert has(answer, 0.0, math.pi)


@pytest.mark.parametrize("off", [1e-12, 1e-9, 1e-6, 1e-3])
def test_two_turns_that_nearly_split_lose_no_pair(off: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(TIMES // 2):
        a, c, d = rng.normal(size=(3, 2))
        A = np.array([a, off * rng.normal(size=2)])
        B = np.array([off * c, d])
        x, y = rng.uniform(-3, 3, 2)
        value = A @ [math.cos(x), math.sin(x)] + B @ [math.cos(y), math.sin(y)]
        answer = two_turns(A.tolist(), B.tolist(), tuple(value.tolist()))
        assert has(answer, x, y)
        (many,), _ = two_turns_of_many(A[None], B[None], value[None], 1e-9)
        assert any(near(one, x) and near(other, y) for one, other in many.tolist() if one == one)
        if (
            off < 1e-4
            and min(abs(math.sin(x - math.atan2(a[1], a[0]))), abs(math.sin(y - math.atan2(d[1], d[0]))))
            > 0.1
        ):
            assert len(answer.angles) == 4
