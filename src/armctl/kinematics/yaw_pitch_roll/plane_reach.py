"""Which points of its tool plane a yaw + pitch arm can reach inside its limits, for many points at once.

Two pitch joints: the triangle's two postures, tried against the limits. Three leave one joint free: the
configurations that reach a point form curves, and a curve ends where a joint meets a limit. One without
ends runs on until its first joint turns back, where the outer links are stretched or folded, or until
it has gone all the way round and passed any angle. So a point is reachable if, and only if, it is with a
joint at a limit, with the outer links in line, or with the first joint in the middle of its range.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
_NO_LENGTH = 1e-12
_COSINE_TOLERANCE = 1e-11
"""how far rounding may carry the elbow's cosine beyond ±1"""
_CHUNK = 8192


class PlaneReach:
    """Reachable points of one arm's tool plane. Immutable; safe in several threads."""

    def __init__(
        self, geometry: YawPitchRoll, limits: FloatArray, tolerance: float = LIMIT_TOLERANCE
    ) -> None:
        """``tolerance``: how far rounding may carry a joint over its limit [rad]."""
        self._tolerance = tolerance
        self._shoulder, self._lengths = geometry.shoulder, geometry.lengths
        self._limits = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]

    def contains(self, points: ComplexArray) -> BoolArray:
        """Whether the tip can come to each point with the base standing still.

        Args:
            points: (k,) r + i z: forward of the base axis and above the base origin [m].
        """
        found = np.zeros(len(points), dtype=np.bool_)
        for first in range(0, len(points), _CHUNK):
            part = slice(first, first + _CHUNK)
            for postures in self._postures(points[part] - self._shoulder):
                found[part] |= self._inside(postures).any(axis=0)
        return found

    def _postures(self, tip: ComplexArray) -> Iterator[tuple[FloatArray, ...]]:
        """Plane angles (2, k) of each pitch joint; NaN where the links do not reach."""
        if len(self._lengths) == 2:
            yield _triangle(tip, *self._lengths)
            return
        l1, l2, l3 = self._lengths
        first, second, third = self._limits
        for angle in (*first, 0.5 * sum(first)):
            direction, bend = _triangle(tip - l1 * cmath.exp(1j * angle), l2, l3)
            yield np.full_like(bend, angle), direction - angle, bend
        for angle in second:
            rigid = l1 + l2 * cmath.exp(1j * angle)
            direction, bend = _triangle(tip, abs(rigid), l3)
            lead = cmath.phase(rigid)
            yield direction - lead, np.full_like(bend, angle), bend + lead - angle
        for angle in (*third, 0.0, math.pi):
            rigid = l2 + l3 * cmath.exp(1j * angle)
            direction, bend = _triangle(tip, l1, abs(rigid))
            yield direction, bend - cmath.phase(rigid), np.full_like(bend, angle)

    def _inside(self, postures: tuple[FloatArray, ...]) -> BoolArray:
        inside = np.ones(postures[0].shape, dtype=np.bool_)
        for angles, limits in zip(postures, self._limits, strict=True):
            inside &= within(angles, *limits, self._tolerance)
        return inside


def within(angle: FloatArray, low: float, high: float, tolerance: float = LIMIT_TOLERANCE) -> BoolArray:
    """Whether an image of each angle [rad] lies inside limits; no for NaN."""
    away = angle - 0.5 * (low + high)
    return np.abs(away - TWO_PI * np.rint(away / TWO_PI)) <= 0.5 * (high - low) + tolerance


def _triangle(tip: ComplexArray, a: float, b: float) -> tuple[FloatArray, FloatArray]:
    """Both postures (2, k) of two links: direction of the first, bend of the second; NaN out of reach."""
    if a < _NO_LENGTH or b < _NO_LENGTH:
        # a circle of points at most, and each of them is found with another joint at its limit
        nowhere = np.full((2, len(tip)), np.nan)
        return nowhere, nowhere
    cosine = (tip.real**2 + tip.imag**2 - a * a - b * b) / (2.0 * a * b)
    reached = np.abs(cosine) <= 1.0 + _COSINE_TOLERANCE
    bend = np.where(reached, np.arccos(np.clip(cosine, -1.0, 1.0)), np.nan)
    inner = np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
    direction = np.angle(tip)
    return np.stack([direction - inner, direction + inner]), np.stack([bend, -bend])
