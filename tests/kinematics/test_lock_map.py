"""What spares the least rotation most of its work never hides a solution: the map of locks, the curves."""

from __future__ import annotations

import itertools
import math

import numpy as np
from tests.kinematics.kit import FloatArray, chain_of, random_planar_arm, random_q

from armctl import load_robot
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll, recognise
from armctl.kinematics.yaw_pitch_roll.least_rotation import LeastRotation, LockMap, bent_lock


def random_arms(count: int) -> list[tuple[YawPitchRoll, LeastRotation, FloatArray]]:
    rng = np.random.default_rng(41)
    out: list[tuple[YawPitchRoll, LeastRotation, FloatArray]] = []
    for i in range(count):
        arm = random_planar_arm(rng, offsets=i % 3 != 0)
        limits = arm.limits.copy()
        if i % 4 == 0:
            limits[1:] *= 1.7  # more than a turn, where a joint has several images
        geometry = recognise(chain_of(arm, "standard"))
        assert geometry is not None
        out.append((geometry, LeastRotation(geometry, limits), limits))
    return out


def test_the_map_bounds_every_lock_from_below() -> None:
    rng = np.random.default_rng(42)
    found, tried = 0, 0
    for geometry, least, limits in random_arms(12):
        reach = sum(geometry.lengths)
        cells = LockMap(least.locks, reach)
        points = [tip(geometry, q) for q in random_q(rng, limits, 60)]
        corners = (rng.integers(-14, 15, (80, 2)) / 16 + rng.choice([-1e-9, 1e-9], (80, 2))) * reach
        for x, y in (*points, *corners.tolist()):  # at its cell's corner a point comes nearest to the bound
            cell = cells.at(x, y)
            bounds = {(lock, side): bound for bound, lock, side in cell}
            assert [bound for bound, _, _ in cell] == sorted(bounds.values())
            for lock, side in itertools.product(least.locks, (1, -1)):
                posture = bent_lock(lock, side, x, y)
                if posture is not None:
                    assert bounds[lock, side] <= posture[0]
                    found += 1
            tried += len(cell)
    assert found > 2000
    assert tried < 4 * found  # a map of zeros would be true and of no use


def test_a_point_out_of_the_map_has_no_locks() -> None:
    least = LeastRotation(*uzuner())
    cells = LockMap(least.locks, 0.33)
    assert cells.at(0.34, 0.0) == ()
    assert cells.at(0.0, -5.0) == ()
    assert cells.at(math.nan, 0.0) == ()


def test_few_locks_are_tried_before_the_least_is_sure() -> None:
    geometry, limits = uzuner()
    least = LeastRotation(geometry, limits)
    cells = LockMap(least.locks, sum(geometry.lengths))
    tried: list[int] = []
    for q in random_q(np.random.default_rng(43), limits, 300):
        x, y = tip(geometry, q)
        cell = cells.at(x, y)
        best = min(p[0] for _, lock, side in cell if (p := bent_lock(lock, side, x, y)) is not None)
        tried.append(sum(bound < best for bound, _, _ in cell))
    assert np.mean(tried) < 4  # of 18


def test_the_curves_bound_what_lies_on_them_from_below() -> None:
    rng = np.random.default_rng(44)
    compared = 0
    for geometry, least, _ in random_arms(24):
        l2, l3, l4 = geometry.lengths
        for curve in least.curves:
            share = rng.uniform(0.0, 1.0, 12)
            square = curve.nearest + share * (curve.farthest - curve.nearest)
            direction = rng.uniform(-math.pi, math.pi, 12)
            bounds = curve.bounds(square, direction)
            for i in range(12):
                s, towards = float(square[i]), float(direction[i])
                assert math.isclose(curve.bound(s, towards), bounds[i], abs_tol=1e-12)
                t2, t3, t4 = curve.at(s, towards)
                reached = np.exp(1j * t2) * (l2 + np.exp(1j * t3) * (l3 + l4 * np.exp(1j * t4)))
                assert abs(reached - math.sqrt(s) * np.exp(1j * towards)) < 1e-9
                angles = least.inside((t2, t3, t4))
                if angles is not None:
                    assert bounds[i] <= sum(map(abs, angles))
                    assert curve.spent <= bounds[i]
                    compared += 1
    assert compared > 100


def uzuner() -> tuple[YawPitchRoll, FloatArray]:
    robot = load_robot("uzuner")
    geometry = recognise(robot.chain)
    assert geometry is not None
    return geometry, robot.limits[:4]


def tip(geometry: YawPitchRoll, q: FloatArray) -> tuple[float, float]:
    """The tool point of a configuration, from the first pitch axis in the tool plane [m]."""
    turns = np.cumsum([geometry.plane_angle(k, float(q[1 + k])) for k in range(3)])
    point = np.sum(np.array(geometry.lengths) * np.exp(1j * turns))
    return float(point.real), float(point.imag)
