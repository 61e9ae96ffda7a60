"""Angles brought into limits: what is written for one angle and for many is one rule."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armctl.kinematics import angles as a

TURN = a.TWO_PI


def spans(rng: np.random.Generator) -> list[tuple[float, float]]:
    """Limits narrow and wide, a turn and half a turn apart, and equal ones."""
    some = [(low, low + width) for low, width in rng.uniform([-9.0, 0.0], [9.0, 15.0], (60, 2)).tolist()]
    return [
        *some,
        (-math.pi, math.pi),
        (0.0, TURN),
        (-TURN, TURN),
        (0.3, 0.3),
        (-0.5 * math.pi, 0.5 * math.pi),
    ]


def test_one_angle_and_many_are_brought_into_limits_alike() -> None:
    rng = np.random.default_rng(0)
    for low, high in spans(rng):
        ends = [end + off + k * TURN for end in (low, high) for off in (-1e-3, 0.0, 1e-3) for k in (-2, 0, 1)]
        q = np.append(rng.uniform(-20.0, 20.0, 60), ends)
        span = np.array([[low, high]])
        moved = q.copy()
        has = a.into_limits(moved, low, high)
        central, listed = a.central_images(q, low, high), a.all_images(q[:, None], span)
        fewest, most = a.turns_inside(q[:, None], span)
        assert (a.within(q, low, high) == has).all()
        assert (has == (fewest <= most)[:, 0]).all()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        for i, angle in enumerate(q.tolist()):
            images = a.images(angle, low, high)
            nearest = a.nearest_image(angle, low, high)
            assert bool(images) == has[i] == (nearest is not None)
            assert sorted(listed.q[listed.source == i, 0]) == pytest.approx(images, abs=1e-12)
            if nearest is not None:
                assert abs(nearest) == pytest.approx(min(map(abs, images)), abs=1e-12)
                assert abs(min(max(moved[i], low), high)) == pytest.approx(abs(nearest), abs=1e-12)
            one = a.central_image(angle, low, high)
            off = one - central[i]
            assert min(abs(off), abs(abs(off) - TURN)) < 1e-12  # either of two that are as near
            assert abs(one - middle) == pytest.approx(abs(central[i] - middle), abs=1e-12)
            fitted = a.fitted(angle, a.Range.of(low, high, 1e-4))
            if abs(one - middle) < half - 1e-6:
                assert fitted == pytest.approx(one, abs=1e-12)
            else:
                assert math.isnan(fitted) if abs(one - middle) > half + 2e-4 else not fitted < math.inf


def test_whole_turns_are_taken_off_alike() -> None:
    q = np.random.default_rng(1).uniform(-40.0, 40.0, 500)
    assert a.wrapped(q) == pytest.approx(np.array([a.wrap(angle) for angle in q.tolist()]), abs=1e-12)


def test_of_several_images_that_toward_the_start_is_taken() -> None:
    rng = np.random.default_rng(2)
    limits = np.array([[-7.0, 8.0], [-1.0, 12.0], [0.0, 3.0]])
    q, start = rng.uniform(*limits.T, (200, 3)), rng.uniform(-10.0, 14.0, 3)
    every = a.all_images(q, limits)
    for i, there in enumerate(a.images_toward(q + TURN * rng.integers(-2, 3, q.shape), limits, start)):
        best = np.abs(every.q[every.source == i] - start).min(axis=0)
        assert np.abs(there - start) == pytest.approx(best, abs=1e-12)
