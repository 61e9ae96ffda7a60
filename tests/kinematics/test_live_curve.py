"""Along a live curve the sum of what the joints turn is stationary, and a minimum."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.kinematics.kit import FloatArray, chain_of, random_planar_arm

from armctl import load_robot
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll, recognise
from armctl.kinematics.yaw_pitch_roll.least_rotation import LiveCurve, PitchJoint, live_curves

STEP = 1e-3
"""along the self-motion [rad]"""


def joints_of(geometry: YawPitchRoll, limits: FloatArray) -> list[PitchJoint]:
    """The pitch joints; ``limits`` (3, 2) [rad]."""
    return [PitchJoint(geometry.signs[k], geometry.offsets[k], *map(float, limits[k])) for k in range(3)]


def random_arms(count: int) -> list[tuple[YawPitchRoll, list[PitchJoint]]]:
    """Arms whose first pitch joint may turn as it likes: it only carries the others."""
    rng = np.random.default_rng(51)
    arms: list[tuple[YawPitchRoll, list[PitchJoint]]] = []
    for i in range(count):
        arm = random_planar_arm(rng, offsets=i % 2 == 0)
        geometry = recognise(chain_of(arm, "standard"))
        assert geometry is not None
        limits = arm.limits[1:].copy()
        limits[0] = -math.pi, math.pi
        arms.append((geometry, joints_of(geometry, limits)))
    return arms


def tip(lengths: tuple[float, ...], plane: FloatArray) -> complex:
    return complex(np.sum(np.array(lengths) * np.exp(1j * np.cumsum(plane))))


def turned(joints: list[PitchJoint], plane: FloatArray) -> FloatArray:
    """Joint angles (3,) of plane angles, each within half a turn of zero."""
    return np.array(
        [
            joint.sense * math.remainder(t - joint.offset, 2 * math.pi)
            for joint, t in zip(joints, plane, strict=True)
        ]
    )


def jacobian(lengths: tuple[float, ...], plane: FloatArray) -> FloatArray:
    """(2, 3) of the tool point in the plane by the plane angles [m]."""
    links = np.array(lengths) * np.exp(1j * np.cumsum(plane))
    columns = 1j * np.cumsum(links[::-1])[::-1]
    return np.stack([columns.real, columns.imag])


def moved(lengths: tuple[float, ...], plane: FloatArray, step: float) -> FloatArray:
    """Plane angles a step along the self-motion, brought back to the very same tool point by Newton."""
    there, J = tip(lengths, plane), jacobian(lengths, plane)
    out = plane + step * np.linalg.svd(J)[2][2]
    for _ in range(8):
        off = there - tip(lengths, out)
        out += np.linalg.pinv(J) @ np.array([off.real, off.imag])
    assert abs(tip(lengths, out) - there) < 1e-12
    return out


def sums(joints: list[PitchJoint], lengths: tuple[float, ...], plane: FloatArray) -> FloatArray:
    """Σ|θ| a step back, here, and a step ahead along the self-motion."""
    return np.array(
        [np.abs(turned(joints, moved(lengths, plane, step))).sum() for step in (-STEP, 0.0, STEP)]
    )


def points_of(curve: LiveCurve) -> list[FloatArray]:
    """Plane angles along a curve, away from its ends."""
    span = curve.farthest - curve.nearest
    return [np.array(curve.at(curve.nearest + share * span, 0.4)) for share in (0.3, 0.5, 0.7)]


def test_the_sum_is_stationary_and_least_with_the_first_joint_on_one_side_of_zero() -> None:
    checked = 0
    for geometry, joints in random_arms(24):
        for curve in live_curves(geometry, joints):
            for plane in points_of(curve):
                angles = turned(joints, plane)
                inside = [joint.low < a < joint.high for joint, a in zip(joints[1:], angles[1:], strict=True)]
                stretched = np.linalg.svd(jacobian(geometry.lengths, plane))[1][1] < 0.1 * sum(
                    geometry.lengths
                )
                if not all(inside) or np.abs(angles[1:]).min() < 0.02 or stretched:
                    continue  # another image of the angle, or a step from here leads past zero or too far
                sides: list[FloatArray] = []
                for first in (0.5, -0.5):  # turning the whole about the first axis moves along no link
                    plane[0] = joints[0].sense * first + joints[0].offset
                    sides.append(sums(joints, geometry.lengths, plane))
                slopes = [abs(after - before) / (2 * STEP) for before, _, after in sides]
                before, here, after = sides[int(np.argmin(slopes))]
                assert min(slopes) < 1e-4 < 1e-2 < max(slopes)
                # a curve goes on for one sample beyond where it is a minimum
                assert (before + after - 2 * here) / STEP**2 > -0.02
                checked += 1
    assert checked > 50


def test_a_curve_reaches_from_its_nearest_to_its_farthest_point() -> None:
    for geometry, joints in random_arms(8):
        for curve in live_curves(geometry, joints):
            assert curve.nearest < curve.farthest
            for square in (curve.nearest, curve.farthest):
                assert abs(tip(geometry.lengths, np.array(curve.at(square, 0.4)))) == pytest.approx(
                    math.sqrt(square), abs=1e-9
                )


def test_the_curve_that_turns_least_comes_first() -> None:
    for geometry, joints in random_arms(8):
        spent = [curve.spent for curve in live_curves(geometry, joints)]
        assert spent == sorted(spent)


def test_no_curve_lives_where_the_limits_leave_no_minimum() -> None:
    geometry = recognise(load_robot("uzuner").chain)
    assert geometry is not None
    limits = np.radians([[-180.0, 180.0], [40.0, 40.5], [40.0, 40.5]])
    assert live_curves(geometry, joints_of(geometry, limits)) == []
    limits[1:] = np.radians([[-170.0, 170.0], [-170.0, 170.0]])
    assert live_curves(geometry, joints_of(geometry, limits)) != []
