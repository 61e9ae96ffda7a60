"""A tool pitch that leads an arm with three parallel pitch joints along a curve inside its joint limits.

Where the pitch is free, the least motion may run into a limit that another pitch would have avoided. Here the
whole way is looked at: over a grid of places on the curve and angles of the tool in the arm's plane, on the
branch that the arm is on, dynamic programming finds the way of least joint motion that keeps inside the
limits, and a smoothing spline makes it a pitch to be led along.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.kinematics.yaw_pitch_roll.branch_names import bend_sense
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.motion.paths.tool_curve import ToolCurve
from armctl.motion.paths.tool_pitch import reaches_forward
from armctl.motion.polynomial import PiecewisePolynomial

FloatArray = NDArray[np.float64]
_PLACES = 49
_ANGLES = 360
_REACH = 12
"""by how many angles of the grid the tool may turn from one place to the next"""
_SHIFTS = np.arange(-_REACH, _REACH + 1)
_MARGIN = math.radians(5.0)
"""how near to a limit a place begins to cost more [rad]"""
_CLOSE = 0.03
"""what a place on a limit costs, in squared radians of joint motion"""
_BENT, _STRAIGHT = 0.98, 0.9995
"""cosines of the elbow from which a place costs more, and at which it is too nearly straight or folded"""
SMOOTHINGS = (30.0, 3.0, 0.3)
"""tried in this order: how much a smooth way counts against a near one"""


@dataclass(frozen=True, slots=True, eq=False)
class PitchGrid:
    """The arm on its branch, at places of a curve and angles of the tool."""

    places: FloatArray
    """(m,) [m]"""
    turns: FloatArray
    """(a,) angle of the tool from that at the start, a whole turn in even steps [rad]"""
    q: FloatArray
    """(m, 3, a) pitch joints [rad], any number where the links do not reach"""
    toll: FloatArray
    """(m, a) what it costs to be there; infinite where the links do not reach and outside the limits"""

    @classmethod
    def of(cls, geometry: YawPitchRoll, limits: FloatArray, q: FloatArray, curve: ToolCurve) -> PitchGrid:
        """Lay it out.

        Args:
            geometry: of an arm with three pitch joints.
            limits: (n, 2) joint limits [rad].
            q: (n,) where it stands [rad]: tells the branch and the angle of the tool.
            curve: that begins there.
        """
        places = np.linspace(0.0, curve.length, _PLACES)
        turns = 2.0 * math.pi * np.arange(_ANGLES) / _ANGLES
        forward, left, up = ((curve.positions(places) - geometry.origin) @ geometry.frame).T
        r = np.sqrt(np.maximum(forward**2 + left**2 - geometry.lateral**2, 0.0))
        if not reaches_forward(geometry, q, curve.positions(0.0)):
            r = -r
        at_start = [geometry.plane_angle(k, float(q[1 + k])) for k in range(3)]
        last = sum(at_start) + turns
        first_length, second_length, third_length = geometry.lengths
        wrist = (r + 1j * up - geometry.shoulder)[:, None] - third_length * np.exp(1j * last)
        cosine = np.abs(wrist) ** 2 - first_length**2 - second_length**2
        cosine /= 2.0 * first_length * second_length
        bend = bend_sense(at_start[1]) * np.arccos(np.clip(cosine, -1.0, 1.0))
        first = np.angle(wrist) - np.angle(first_length + second_length * np.exp(1j * bend))
        plane = np.stack([first, bend, last - first - bend], axis=1)
        signs, offsets = np.array(geometry.signs)[:, None], np.array(geometry.offsets)[:, None]
        low, high = limits[1:4].T[..., None]
        whole_turns = np.rint((signs * (plane - offsets) - 0.5 * (low + high)) / (2.0 * math.pi))
        angles = signs * (plane - offsets) - 2.0 * math.pi * whole_turns
        room = np.minimum(angles - low, high - angles)
        toll = _CLOSE * (np.maximum(1.0 - room / _MARGIN, 0.0) ** 2).sum(axis=1)
        toll += _CLOSE * (np.maximum(np.abs(cosine) - _BENT, 0.0) / (_STRAIGHT - _BENT)) ** 2
        toll[(room.min(axis=1) < -LIMIT_TOLERANCE) | (np.abs(cosine) > _STRAIGHT)] = np.inf
        return cls(places, turns, angles, toll)

    def way(self, weights: FloatArray) -> FloatArray:
        """The way of least joint motion that leads farthest, from the first angle on.

        Args:
            weights: (3,) of the squared motion of the pitch joints.

        Returns:
            (m,) angle of the tool at each place, from that at the start [rad]; where nothing leads on, it
            stays what it was.
        """
        count = len(self.turns)
        weighted = self.q * np.sqrt(weights)[:, None]
        # for each shift and angle, the angle that lies the shift away
        around = (np.arange(count) + _SHIFTS[:, None]) % count
        cost = np.where(np.arange(count) == 0, 0.0, np.inf)
        choices: list[NDArray[np.intp]] = []
        for here, ahead, toll in zip(weighted[:-1], weighted[1:], self.toll[1:], strict=True):
            open_ = np.flatnonzero(np.isfinite(toll))  # mostly few: the limits close the rest
            near = around.take(open_, axis=1)
            moved = ahead.take(open_, axis=1)[:, None] - here.take(near, axis=1)
            moved *= moved
            total = moved.sum(axis=0)
            total += cost.take(near)
            best, reached = np.zeros(count, dtype=np.intp), np.full(count, np.inf)
            best[open_] = total.argmin(axis=0)
            reached[open_] = total.min(axis=0) + toll[open_]
            if not np.isfinite(reached).any():
                break
            cost = reached
            choices.append(best)
        at = int(cost.argmin())
        steps = np.zeros(len(self.places), dtype=np.intp)
        for i in range(len(choices), 0, -1):
            shift = int(_SHIFTS[choices[i - 1][at]])
            steps[i] = -shift
            at = (at + shift) % count
        return np.cumsum(steps) * self.turns[1]


def led_pitch(grid: PitchGrid, way: FloatArray, start: float, smoothing: float) -> PiecewisePolynomial:
    """A smooth curve near a way, as a sum of joint angles that begins at ``start`` [rad], over the places."""
    count = len(way)
    second = np.diff(np.eye(count), 2, axis=0)
    rows = np.eye(count) + smoothing * second.T @ second
    values = np.zeros(count)  # the first one is given
    values[1:] = np.linalg.solve(rows[1:, 1:], way[1:])
    spline = CubicSpline(grid.places, start + values)
    return PiecewisePolynomial(grid.places, np.moveaxis(spline.c[::-1], 0, 1)[:, :, None])


def motion_weights(speeds: FloatArray) -> FloatArray:
    """(3,) of the pitch joints, from the largest speeds (n,) of all joints."""
    return (speeds[1:4].max() / speeds[1:4]) ** 2
