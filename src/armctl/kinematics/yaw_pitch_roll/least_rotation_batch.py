"""The exact least rotation of many points at once; ``least_rotation.py`` derives the candidates.

Every lock (a joint at a limit or at zero) of every point is solved together, a row a lock and a column a
point and way to face it. Where rounding weighs on the cosine rule (links nearly in line) and where a
stationary curve may hold the optimum, the point goes to the scalar solver.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.yaw_pitch_roll.base_yaw import BaseBranch, base_angles
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import into_limits
from armctl.kinematics.yaw_pitch_roll.least_rotation import LeastRotation

FloatArray = NDArray[np.float64]
_CHUNK = 512
"""points worked on at a time"""
_NEARLY_STRAIGHT = 1e-7
"""how near to ±1 a cosine may come before the angle from it is worth less than 1e-12 rad"""


class _Locks(NamedTuple):
    """The locks of one joint, as columns (locks, 1); ``Lock`` says what they are."""

    joint: int
    spent: FloatArray
    angle: FloatArray
    x: FloatArray
    y: FloatArray
    near: FloatArray
    far: FloatArray
    lag: FloatArray
    lead: FloatArray


class LeastRotationBatch:
    """The optimum for one arm and its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray, scalar: LeastRotation) -> None:
        self._geometry, self._scalar = geometry, scalar
        self._limits = [(float(low), float(high)) for low, high in limits[:4]]
        self._families = [self._family(k) for k in range(3)]

    def _family(self, joint: int) -> _Locks:
        numbers = [lock[:9] for lock in self._scalar.locks if lock.joint == joint]
        spent, _, *rest = np.array(numbers, dtype=np.float64).reshape(-1, 9).T[:, :, None]
        return _Locks(joint, spent, *rest)

    def solve(self, position: FloatArray) -> FloatArray:
        """The least rotation of each point.

        Args:
            position: (k, 3) tool points in the base frame [m].

        Returns:
            (k, 4) base and pitch joint angles [rad]; NaN where a point is out of reach.
        """
        q = np.full((4, len(position)), np.nan)
        geometry = self._geometry
        forward, left, height = np.ascontiguousarray(((position - geometry.origin) @ geometry.frame).T)
        with np.errstate(invalid="ignore", divide="ignore"):
            yaw, r, faces = base_angles(geometry, forward, left, self._limits[0])
            np.clip(yaw, *self._limits[0], out=yaw)
            for at in range(0, len(position), _CHUNK):
                cut = slice(at, at + _CHUNK)
                self._solve_chunk(yaw[:, cut], r[:, cut], faces[:, cut], height[cut], q[:, cut])
        return q.T

    def _solve_chunk(
        self, yaw: FloatArray, r: FloatArray, faces: NDArray[np.bool_], height: FloatArray, q: FloatArray
    ) -> None:
        m, shoulder = len(height), self._geometry.shoulder
        columns = np.flatnonzero(faces)
        back = columns >= m
        point = columns - m * back
        base = yaw.ravel()[columns]
        x, y = r.ravel()[columns] - shoulder.real, height[point] - shoulder.imag
        square, direction = x * x + y * y, np.arctan2(y, x)
        energy, angles, doubtful = self._least(x, y, square, direction)
        rest = np.abs(base)
        energy += rest
        least = np.full((2, m), np.inf)
        least[back.astype(np.intp), point] = energy
        for side in (0, 1):  # each point is found at most once on each side
            better = np.flatnonzero((back == side) & (energy < np.inf) & (energy <= least[1 - side, point]))
            q[0, point[better]] = base[better]
            for k in range(3):
                q[1 + k, point[better]] = angles[k][better]
        rest = least.min(axis=0)[point] - rest  # what a curve must stay below to matter
        for curve in self._scalar.curves:
            reached = (square >= curve.nearest) & (square <= curve.farthest)
            some = np.flatnonzero(reached & (rest > curve.spent))
            if len(some):
                doubtful[some] |= rest[some] > curve.bounds(square[some], direction[some])
        for i in np.unique(point[doubtful]).tolist():
            branches = [
                BaseBranch(side == 0, float(yaw[side, i]), float(r[side, i]))
                for side in (0, 1)
                if faces[side, i]
            ]
            found = self._scalar.solve(branches, float(height[i]))
            q[:, i] = math.nan if found is None else found

    def _least(
        self, x: FloatArray, y: FloatArray, square: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, list[FloatArray], NDArray[np.bool_]]:
        """Energy of the pitch joints (infinite out of reach), their angles, and where to look closer."""
        count = len(x)
        energy = np.full(count, np.inf)
        angles = [np.full(count, np.nan) for _ in range(3)]
        doubtful = np.zeros(count, dtype=np.bool_)
        every = np.arange(count)
        for locks in self._families:
            if not len(locks.spent):
                continue
            found, free, near = self._candidates(locks, x, y, square, direction)
            doubtful |= near
            row = found.argmin(axis=0)
            value = found[row, every]
            better = np.flatnonzero(value < energy)
            energy[better] = value[better]
            row, others = row[better], [k for k in range(3) if k != locks.joint]
            angles[locks.joint][better] = locks.angle[row % len(locks.spent), 0]
            for k, values in zip(others, free, strict=True):
                angles[k][better] = np.clip(values[row, better], *self._limits[1 + k])
        return energy, angles, doubtful

    def _candidates(
        self, locks: _Locks, x: FloatArray, y: FloatArray, square: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, list[FloatArray], NDArray[np.bool_]]:
        """Energies (2 · locks, m), the two free joints' angles (the same shape), and where to look closer."""
        if locks.joint == 0:
            x, y = x - locks.x, y - locks.y
            square, direction = x * x + y * y, np.arctan2(y, x)
        rows = len(locks.spent)
        a, b = locks.near, locks.far
        bend = square - (a * a + b * b)
        bend *= 0.5 / (a * b)
        size = np.abs(bend)
        near = np.any(np.abs(size - 1.0) < _NEARLY_STRAIGHT, axis=0)
        np.arccos(bend, out=bend)
        inner = square + (a * a - b * b)
        inner /= np.sqrt(square) * (2.0 * a)
        np.arccos(inner, out=inner)
        first = np.empty((2 * rows, bend.shape[1]))
        second = np.empty_like(first)
        direction = direction - locks.lag
        np.subtract(direction, inner, out=first[:rows])
        np.add(direction, inner, out=first[rows:])
        np.add(locks.lead, bend, out=second[:rows])
        np.subtract(locks.lead, bend, out=second[rows:])
        geometry, free = self._geometry, [k for k in range(3) if k != locks.joint]
        inside = np.ones(first.shape, dtype=np.bool_)
        energy = np.empty_like(first)
        energy[:rows], energy[rows:] = locks.spent, locks.spent
        for k, angle in zip(free, (first, second), strict=True):
            if geometry.offsets[k]:
                angle -= geometry.offsets[k]
            if geometry.signs[k] < 0:
                np.negative(angle, out=angle)
            inside &= into_limits(angle, *self._limits[1 + k])
            energy += np.abs(angle)
        energy[~inside] = np.inf
        return energy, [first, second], near
