"""Where along the self-motion of three pitch joints the sum of their turns is stationary, and a minimum.

With plane angles t and senses e_k = ±1 of |θ_k| the condition is that the null vector of the planar Jacobian
has no component along the senses:

    e2 l3 l4 sin t4 - e3 (l4 l2 sin(t3+t4) + l4 l3 sin t4) + e4 (l2 l3 sin t3 + l2 l4 sin(t3+t4)) = 0

which up to a common sign is

    e = (+,+,+):  sin t3 = 0
    e = (+,+,-):  l3 sin t3 + 2 l4 sin(t3+t4) = 0
    e = (+,-,+):  l2 l3 sin t3 + 2 l3 l4 sin t4 + 2 l2 l4 sin(t3+t4) = 0
    e = (+,-,-):  2 l4 sin t4 = l2 sin t3

The first is a lock (``pitch_locks.py``). The others are curves that depend on the arm alone, and only their
distance from the first pitch axis on the target. Where a curve is never a minimum inside the limits it is
dropped once and for all; along what lives, tables of what the joints turn spare most targets the rest.
"""

from __future__ import annotations

import cmath
import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.pitch_locks import PitchJoint
from armctl.kinematics.yaw_pitch_roll.stationary_curve import StationaryCurve, coefficients

FloatArray = NDArray[np.float64]
_Pattern = tuple[int, int, int]
_PATTERNS: tuple[_Pattern, ...] = ((1, 1, -1), (1, -1, 1), (1, -1, -1))


class LiveCurve:
    """A part of a stationary curve that may hold a minimum: its distance only grows or only falls."""

    def __init__(
        self, curve: StationaryCurve, joints: Sequence[PitchJoint], lengths: tuple[float, ...]
    ) -> None:
        """Tabulate a part; ``joints`` are the three pitch joints, ``lengths`` the links behind them [m]."""
        l2, l3, l4 = lengths
        whole = l2 + np.exp(1j * curve.t3) * (l3 + l4 * np.exp(1j * curve.t4))
        phase = np.unwrap(np.angle(whole))
        turns = _turns(joints[1], curve.t3) + _turns(joints[2], curve.t4)
        # between two samples a smooth function is no farther off than they are apart, or their neighbours
        step = np.diff(curve.t3)
        spent = np.minimum(turns[:-1], turns[1:]) - _wider(np.abs(np.diff(turns))) - step
        slack = _wider(np.abs(np.diff(phase))) + step
        self._curve, self._lengths = curve, lengths
        self._falls = bool(curve.squares[-1] < curve.squares[0])
        order = slice(None, None, -1 if self._falls else 1)  # rows by growing distance
        self._squares: FloatArray = curve.squares[order]
        self._spent, self._slack = spent[order], slack[order]
        self._phase = (phase[:-1] + joints[0].offset)[order]
        self._ascending: list[float] = self._squares.tolist()
        self._rows = list(zip(self._spent.tolist(), self._phase.tolist(), self._slack.tolist(), strict=True))
        self.nearest, self.farthest = self._ascending[0], self._ascending[-1]
        """squared distances [m²] between which the curve has points, but for what falls between samples"""
        self.spent = float(self._spent.min())
        """what the second and the third joint turn at least [rad]"""

    def bound(self, square: float, direction: float) -> float:
        """What the joints turn at least [rad], for a target between ``nearest`` and ``farthest``."""
        spent, phase, slack = self._rows[self._segment(square)]
        return spent + max(0.0, abs(math.remainder(direction - phase, TWO_PI)) - slack)

    def bounds(self, square: FloatArray, direction: FloatArray) -> FloatArray:
        """``bound`` of many targets (k,)."""
        i = np.clip(np.searchsorted(self._squares, square, side="right") - 1, 0, len(self._rows) - 1)
        first = direction - self._phase[i]
        first -= TWO_PI * np.rint(first / TWO_PI)
        return self._spent[i] + np.maximum(0.0, np.abs(first) - self._slack[i])

    def at(self, square: float, direction: float) -> tuple[float, float, float]:
        """The plane angles for a target between ``nearest`` and ``farthest``, to machine precision [rad]."""
        i, (l2, l3, l4) = self._segment(square), self._lengths
        t3, t4 = self._curve.between(len(self._rows) - 1 - i if self._falls else i, square)
        whole = l2 + cmath.exp(1j * t3) * (l3 + l4 * cmath.exp(1j * t4))
        return direction - cmath.phase(whole), t3, t4

    def _segment(self, square: float) -> int:
        return min(max(bisect_right(self._ascending, square) - 1, 0), len(self._rows) - 1)


def live_curves(geometry: YawPitchRoll, joints: Sequence[PitchJoint]) -> list[LiveCurve]:
    """The parts of the stationary curves that can be a minimum inside the limits."""
    low, high = sorted(geometry.plane_angle(1, angle) for angle in (joints[1].low, joints[1].high))
    return sorted(
        (
            LiveCurve(part, joints, geometry.lengths)
            for pattern in _PATTERNS
            for root in (0, 1)
            for piece in StationaryCurve.over(pattern, geometry.lengths, root, low, high)
            for part in piece.parts(_may_be_minimum(pattern, piece, geometry, joints))
        ),
        key=lambda curve: curve.spent,
    )


def _turns(joint: PitchJoint, plane: FloatArray) -> FloatArray:
    """(m,) |θ| [rad] at neighbouring samples; outside the limits as at the last sample inside."""
    angle, inside = _image(joint, plane)
    return np.interp(np.arange(len(angle)), np.flatnonzero(inside), np.abs(angle[inside]))


def _wider(steps: FloatArray) -> FloatArray:
    """The largest of each step and its two neighbours."""
    wide = steps.copy()
    np.maximum(wide[1:], steps[:-1], out=wide[1:])
    np.maximum(wide[:-1], steps[1:], out=wide[:-1])
    return wide


def _may_be_minimum(
    pattern: _Pattern, curve: StationaryCurve, geometry: YawPitchRoll, joints: Sequence[PitchJoint]
) -> NDArray[np.bool_]:
    """Senses that agree with the pattern, the wrist inside its limits, and not a maximum."""
    t3, t4 = curve.t3, curve.t4
    angle3, _ = _image(joints[1], t3)
    angle4, inside = _image(joints[2], t4)
    sense3, sense4 = (np.sign(a) * geometry.signs[k] for k, a in ((1, angle3), (2, angle4)))
    agree = sense3 * sense4 * pattern[1] * pattern[2] >= 0
    # second derivative along the null vector (l3 l4 s4, -(l2 l4 s34 + l3 l4 s4), l2 l3 s3 + l2 l4 s34)
    a, b, c = coefficients(pattern, geometry.lengths)
    l2, l3, l4 = geometry.lengths
    n3 = -(l2 * l4 * np.sin(t3 + t4) + l3 * l4 * np.sin(t4))
    n4 = l2 * l3 * np.sin(t3) + l2 * l4 * np.sin(t3 + t4)
    slope3 = a * np.cos(t3) + c * np.cos(t3 + t4)
    slope4 = b * np.cos(t4) + c * np.cos(t3 + t4)
    curvature = (slope3 * n3 + slope4 * n4) * sense3 * pattern[1]
    return inside & agree & (curvature >= -1e-9 * (l2 + l3 + l4) ** 4)


def _image(joint: PitchJoint, plane: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Joint angle of least magnitude inside its limits for plane angles (m,), and where there is one."""
    sense, offset, low, high = joint
    angle = sense * (plane - offset)
    angle -= TWO_PI * np.rint(angle / TWO_PI)
    angle += TWO_PI * np.ceil(np.maximum(0.0, low - 1e-6 - angle) / TWO_PI)
    angle -= TWO_PI * np.ceil(np.maximum(0.0, angle - high - 1e-6) / TWO_PI)
    return angle, (angle >= low - 1e-6) & (angle <= high + 1e-6)
