"""Which locks may hold the least rotation, by where in the plane of the pitch joints the target lies.

The plane is cut into square cells. For each cell, each lock and each way to bend, the distances and
directions of the cell's points give intervals of the two free angles, and these a lower bound of what the
pitch joints turn in all. A target then tries the locks of its cell, least bound first, until a bound is no
better than what is found: two or three locks of eighteen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI
from armctl.kinematics.yaw_pitch_roll.pitch_locks import Lock, PitchJoint

FloatArray = NDArray[np.float64]
_CELLS = 32
"""along a side of the map"""
_SPARE_LENGTH = 1e-9
"""by how much a cell is taken larger than it is [m]: far more than what triangles allow for rounding"""
_SPARE_ANGLE = 1e-8
"""by how much limits are taken wider, and bounds less [rad]: more than ``LIMIT_TOLERANCE``"""
_TINY = 1e-300
"""stands for a distance of nothing where one is divided by it [m]"""
Cell = Sequence[tuple[float, Lock, int]]
"""what the pitch joints turn in all at least [rad], with which lock, bent which way; least first"""


class LockMap:
    """The cells of one arm. Immutable."""

    def __init__(self, locks: Sequence[Lock], reach: float) -> None:
        """Draw the map of some locks; ``reach``: how far the stretched links come [m]."""
        self._half = reach + 2.0 * _SPARE_LENGTH
        self._scale = _CELLS / (2.0 * self._half)
        bounds = np.concatenate([self._bounds(lock) for lock in locks]).T
        order = bounds.argsort(axis=1)
        bounds = np.take_along_axis(bounds, order, axis=1)
        counts = np.isfinite(bounds).sum(axis=1)
        bent = [(lock, side) for lock in locks for side in (1, -1)]
        rows = zip(bounds.tolist(), order.tolist(), counts.tolist(), strict=True)
        self._cells: list[Cell] = [
            [(least, *bent[i]) for least, i in zip(some[:count], which, strict=False)]
            for some, which, count in rows
        ]

    def at(self, x: float, y: float) -> Cell:
        """The locks to try for a target seen from the first pitch axis [m]; none out of the links' reach."""
        half, scale = self._half, self._scale
        if -half < x < half and -half < y < half:
            return self._cells[int((x + half) * scale) * _CELLS + int((y + half) * scale)]
        return ()

    def _bounds(self, lock: Lock) -> FloatArray:
        """(2, cells) what the joints turn at least, bent either way [rad]; infinite out of reach."""
        a, b = lock.near, lock.far
        middle = (np.arange(_CELLS) + 0.5) / self._scale - self._half
        x, y = np.meshgrid(middle - lock.x, middle - lock.y, indexing="ij")
        distance = np.hypot(x, y).ravel()
        radius = math.sqrt(0.5) / self._scale + _SPARE_LENGTH  # of the circle around a cell
        some = np.flatnonzero((distance - radius <= a + b) & (distance + radius >= abs(a - b)))
        distance, direction = distance[some], np.arctan2(y, x).ravel()[some]
        # the distances of the cell's points that the two links reach
        ends = np.clip([distance - radius, distance + radius], abs(a - b), a + b)
        bend = _arccos((ends * ends - (a * a + b * b)) / (2.0 * a * b))
        inner = _arccos((ends * ends + (a * a - b * b)) / (2.0 * a * np.maximum(ends, _TINY)))
        least, most = np.minimum(*inner), np.maximum(*inner)
        if a > b:  # between the ends the inner angle may have its largest value
            widest = math.sqrt(a * a - b * b)
            most[(ends[0] < widest) & (widest < ends[1])] = math.asin(b / a)
        # half the angle that the cell takes up; seen from inside, it is everywhere
        half = np.where(distance > radius, np.arcsin(radius / np.maximum(distance, radius)), math.pi)
        towards = direction - half - lock.lag
        bounds = np.full((2, x.size), np.inf)
        for way, first, second in ((0, towards - most, bend[1]), (1, towards + least, -bend[0])):
            turn = _least_turn(lock.first, first, 2.0 * half + most - least)
            turn += _least_turn(lock.second, second + lock.lead, bend[0] - bend[1])
            bounds[way, some] = lock.spent + turn - _SPARE_ANGLE
        return bounds


def _arccos(cosine: FloatArray) -> FloatArray:
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _least_turn(joint: PitchJoint, start: FloatArray, width: FloatArray) -> FloatArray:
    """The least |θ| [rad] that plane angles from ``start`` on give inside the limits; infinite if none."""
    start = start - joint.offset if joint.sense > 0 else joint.offset - start - width
    start = start - TWO_PI * np.rint(start * (1.0 / TWO_PI))
    low, high = joint.low - _SPARE_ANGLE, joint.high + _SPARE_ANGLE
    least = np.full(len(start), np.inf)
    for turns in range(math.ceil((low - 5 * math.pi) / TWO_PI), math.floor((high + math.pi) / TWO_PI) + 1):
        begin = np.maximum(start + TWO_PI * turns, low)
        end = np.minimum(start + (width + TWO_PI * turns), high)
        size = np.maximum(np.maximum(begin, -end), 0.0)
        np.minimum(least, np.where(begin <= end, size, np.inf), out=least)
    return least
