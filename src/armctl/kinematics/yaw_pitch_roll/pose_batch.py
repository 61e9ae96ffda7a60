"""Position, tool pitch and roll of many poses at once: every branch, in numpy.

All ways to face a target and to read its pitch are looked at together, as columns of one flat list; those
that the links cannot reach are dropped before anything costly is computed, and the few with the links in
line, where rounding decides, are left to the scalar closed form.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, images, into_limits, rest_angle
from armctl.kinematics.cos_sin import SCRATCH, cos_sin
from armctl.kinematics.solutions import BatchSolutions
from armctl.kinematics.yaw_pitch_roll.closed_form import REACHED, SAME_LENGTH, SURE, UPRIGHT, PlanePostures
from armctl.kinematics.yaw_pitch_roll.geometry import (
    BRANCHES,
    LEVEL,
    YawPitchRoll,
    base_angles,
    bend_sense,
    branch_index,
)

FloatArray = NDArray[np.float64]
Rows = NDArray[np.intp]
_CHUNK = 16_384
"""poses worked on at a time: more would leave the cache, fewer would not spread the cost of the calls"""
_NEARLY_STRAIGHT = 1e-4
"""how near to ±1 the elbow's cosine may come before the cosine rule loses more than four digits"""


class _Asked(NamedTuple):
    """Poses to be solved: tool points (m, 3) [m], pitches and rolls (m,) [rad] where there are any."""

    position: FloatArray
    pitch: FloatArray | None
    roll: FloatArray | None


class _Places(NamedTuple):
    """Where the postures of some poses go: branch by branch, ``poses`` each, theirs from ``at`` on."""

    q: FloatArray
    """(n, branches · poses) joint angles [rad]"""
    found: NDArray[np.bool_]
    """(branches · poses)"""
    poses: int
    at: int

    def fill(self, branch: Rows, pose: Rows, joints: list[FloatArray]) -> None:
        """Write joint angles (m,) each [rad], of a branch and a pose each."""
        place = branch * self.poses
        place += pose
        place += self.at
        self.found[place] = True
        for flat, angles in zip(self.q, joints, strict=True):
            flat[place] = angles


class _Columns(NamedTuple):
    """Triangles to be solved, each of one pose, one way to face it and one reading of its pitch."""

    pose: Rows
    """row of the pose"""
    back: Rows
    """1 where the arm reaches over its back, else 0"""
    inward: Rows
    """1 where the tool points back at the base axis, else 0"""
    yaw: FloatArray
    """base angle [rad]"""
    x: FloatArray
    y: FloatArray
    """what the first two links have to reach, seen from the first pitch axis [m]"""
    cosine: FloatArray
    """of the bend between them"""
    last: FloatArray | None
    """direction of the third link [rad]"""


class PoseBatch:
    """One arm inside its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray, planar: PlanePostures) -> None:
        self._geometry, self._planar = geometry, planar
        self._limits = [(float(low), float(high)) for low, high in limits]
        l2, l3, *_ = geometry.lengths
        self._l2, self._l3 = l2, l3
        self._l4 = geometry.lengths[2] if len(geometry.lengths) == 3 else 0.0
        self._cosines = _cosines_within(geometry.plane_limits(1, limits))

    def solve(
        self, position: FloatArray, pitch: FloatArray | None, roll: FloatArray | None
    ) -> BatchSolutions:
        """Every branch of each pose.

        Args:
            position: (k, 3) tool points in the base frame [m].
            pitch: (k,) of the approach axis above the horizontal, within ±90° [rad]; None with two pitch
                joints.
            roll: (k,) the roll joint's angle [rad]; None: the one nearest to zero.
        """
        k, branches = len(position), len(BRANCHES)
        q = np.empty((len(self._limits), branches, k))  # joint by joint in memory, as it is computed
        found = np.zeros((branches, k), dtype=np.bool_)
        flat_q, flat_found = q.reshape(len(q), -1), found.ravel()

        for at in range(0, k, _CHUNK):
            cut = slice(at, at + _CHUNK)
            q[..., cut] = np.nan
            asked = _Asked(
                position[cut],
                None if pitch is None else pitch[cut],
                None if roll is None else roll[cut],
            )
            with np.errstate(invalid="ignore", divide="ignore"):
                self._solve_chunk(asked, _Places(flat_q, flat_found, k, at))
        return BatchSolutions(q.transpose(2, 1, 0), found.T, BRANCHES)

    def _solve_chunk(self, asked: _Asked, places: _Places) -> None:
        roll, rolled = self._rolls(asked)
        columns = self._columns(asked, rolled)
        in_line = np.abs(columns.cosine) > SURE
        if in_line.any():
            self._fill_in_line(columns, np.flatnonzero(in_line), roll, places)
        bend, inner = self._triangle(columns)
        direction = np.arctan2(columns.y, columns.x)
        for sense in (1, -1):
            t2, t3 = (direction - inner, bend) if sense > 0 else (direction + inner, -bend)
            planes = [t2, t3] if columns.last is None else [t2, t3, columns.last - t2 - t3]
            angles, inside = self._joints(planes)
            inside &= ~in_line
            keep = np.flatnonzero(inside)
            pose, back = columns.pose.take(keep), columns.back.take(keep)
            # a positive bend leaves the elbow below the line to the target in front, above it at the back
            branch = (2 + 2 * back if sense > 0 else 6 * back) + columns.inward.take(keep)
            joints = [columns.yaw.take(keep), *(angle.take(keep) for angle in angles)]
            places.fill(branch, pose, self._clipped(joints, pose, roll))

    def _clipped(self, joints: list[FloatArray], pose: Rows, roll: FloatArray | None) -> list[FloatArray]:
        """Joint angles inside their limits but for rounding [rad], clipped onto them; with the roll."""
        if roll is not None:
            joints = [*joints, roll.take(pose)]
        for angle, (low, high) in zip(joints, self._limits, strict=True):
            np.maximum(angle, low, out=angle)
            np.minimum(angle, high, out=angle)
        return joints

    def _fill_in_line(self, columns: _Columns, rows: Rows, roll: FloatArray | None, places: _Places) -> None:
        """Columns with the links in line, one by one; the first of two that are the same one counts."""
        taken: set[tuple[int, int]] = set()
        for i in rows.tolist():
            pose, back, inward = int(columns.pose[i]), int(columns.back[i]), int(columns.inward[i])
            last = None if columns.last is None else float(columns.last[i])
            for plane in self._planar.reaching(float(columns.x[i]), float(columns.y[i]), last):
                branch = branch_index(not back, bend_sense(plane[1]), bool(inward))
                images = self._planar.joint_images(plane)
                if images and (branch, pose) not in taken:
                    taken.add((branch, pose))
                    row = np.array([pose])
                    joints = [np.array([angle]) for angle in (columns.yaw[i], *images[0])]
                    places.fill(np.array([branch]), row, self._clipped(joints, row, roll))

    def _joints(self, planes: list[FloatArray]) -> tuple[list[FloatArray], NDArray[np.bool_]]:
        """Pitch joint angles of plane angles, and where they are all inside their limits."""
        geometry, inside = self._geometry, np.ones(len(planes[0]), dtype=np.bool_)
        angles: list[FloatArray] = []
        for k, plane in enumerate(planes):
            angle = plane - geometry.offsets[k] if geometry.offsets[k] else plane.copy()
            if geometry.signs[k] < 0:
                np.negative(angle, out=angle)
            inside &= into_limits(angle, *self._limits[1 + k])
            angles.append(angle)
        return angles, inside

    def _rolls(self, asked: _Asked) -> tuple[FloatArray | None, NDArray[np.bool_] | None]:
        """The roll joint's angle of each pose and where it is inside the limits; None without one."""
        joint = self._geometry.roll_joint
        if joint is None:
            return None, None
        low, high = self._limits[joint]
        if asked.roll is None:
            return np.full(len(asked.position), rest_angle(low, high)), None
        angle = asked.roll.copy()
        inside = into_limits(angle, low, high)
        return angle, None if inside.all() else inside

    def _columns(self, asked: _Asked, rolled: NDArray[np.bool_] | None) -> _Columns:
        """What the first two links must reach, where they can: (facing, reading, pose), then flat."""
        geometry, m = self._geometry, len(asked.position)
        forward, left, up = self._local(asked.position)
        yaw, r, faces = base_angles(geometry, forward, left, self._limits[0])
        if rolled is not None:
            faces &= rolled
        last, along, across, two, inward = self._readings(asked)
        shape = (2, len(along), m)
        x, y = np.empty(shape), np.empty(shape)
        np.subtract((r - geometry.shoulder.real)[:, None], along, out=x)
        np.subtract(up - geometry.shoulder.imag, across, out=y[0])
        y[1] = y[0]
        cosine = x * x
        square = y[0] * y[0]
        cosine += square
        cosine -= self._l2**2 + self._l3**2
        cosine *= 0.5 / (self._l2 * self._l3)
        ok = (cosine > self._cosines[0]) & (cosine < self._cosines[1])
        ok &= faces[:, None]
        if two is not None:
            ok[:, 1] &= two
        flat = np.flatnonzero(ok)
        pose = np.tile(np.arange(m), 2 * len(along)).take(flat)
        back = (flat >= len(along) * m).astype(np.intp)
        return _Columns(
            pose=pose, back=back, inward=inward.ravel().take(flat), yaw=yaw.ravel().take(pose + m * back),
            x=x.ravel().take(flat), y=y.ravel().take(flat), cosine=cosine.ravel().take(flat),
            last=None if last is None else last.ravel().take(flat - len(along) * m * back),
        )  # fmt: skip

    def _local(self, position: FloatArray) -> FloatArray:
        """Forward, left, up about the base axis (3, m)."""
        if self._geometry.upright:
            return np.ascontiguousarray(position.T)
        return np.ascontiguousarray(((position - self._geometry.origin) @ self._geometry.frame).T)

    def _readings(
        self, asked: _Asked
    ) -> tuple[FloatArray | None, FloatArray, FloatArray, NDArray[np.bool_] | None, NDArray[np.intp]]:
        """Each reading of each pitch.

        Direction of the last link (readings, m) [rad], where there is a pitch; what it adds forward and
        up [m]; where the second reading is another than the first (None: everywhere); and (2, readings, m)
        whether the tool points back at the base axis, in front and at the back.
        """
        m, pitch = len(asked.position), asked.pitch
        if pitch is None:
            nothing = np.zeros((1, m))
            return None, nothing, nothing, None, np.zeros((2, 1, m), dtype=np.intp)
        tool = self._geometry.tool_angle or 0.0
        outward, up = np.empty(m), np.empty(m)
        cos_sin(pitch, outward, up, np.empty((SCRATCH, m)))
        c, s = self._l4 * outward, self._l4 * up
        along, across = np.stack([c, -c]), np.stack([s, s])
        if tool:
            along, across = (
                math.cos(tool) * along + math.sin(tool) * across,
                math.cos(tool) * across - math.sin(tool) * along,
            )
        last = np.stack([pitch, math.pi - pitch])
        last -= tool
        inward = np.zeros((2, 2, m), dtype=np.intp)
        inward[0, 1] = inward[1, 0] = 1
        single = np.abs(pitch) > math.pi / 2 - UPRIGHT
        if not single.any():
            return last, along, across, None, inward
        inward[:, 0, single] = outward[single] < -LEVEL, outward[single] > LEVEL
        readings = 1 if single.all() else 2
        two = None if readings == 1 else ~single
        return last[:readings], along[:readings], across[:readings], two, inward[:, :readings]

    def _triangle(self, columns: _Columns) -> tuple[FloatArray, FloatArray]:
        """Bend in [0, pi] and angle between the first link and the line to the target.

        As complements of arc sines: half the time of arc cosines, and the same digits.
        """
        l2, l3, cosine = self._l2, self._l3, columns.cosine
        bend = np.arcsin(cosine)
        np.subtract(0.5 * math.pi, bend, out=bend)
        if abs(l2 - l3) < SAME_LENGTH:
            return bend, 0.5 * bend
        square = columns.x * columns.x
        square += columns.y * columns.y
        inner = square + (l2 * l2 - l3 * l3)
        np.sqrt(square, out=square)
        square *= 2.0 * l2
        inner /= square
        np.minimum(inner, 1.0, out=inner)
        np.maximum(inner, -1.0, out=inner)
        np.arcsin(inner, out=inner)
        np.subtract(0.5 * math.pi, inner, out=inner)
        near = np.flatnonzero(np.abs(cosine) > 1.0 - _NEARLY_STRAIGHT)
        c = cosine[near]
        inner[near] = np.arctan2(l3 * np.sqrt((1.0 - c) * (1.0 + c)), l2 + l3 * c)
        return bend, inner


def _cosines_within(limits: tuple[float, float]) -> tuple[float, float]:
    """Between which cosines a bend inside its limits [rad] lies; no wider than the links reach."""
    sizes = [abs(math.remainder(limit, TWO_PI)) for limit in limits]
    sharpest = math.pi if images(math.pi, *limits) else max(sizes)
    slightest = 0.0 if images(0.0, *limits) else min(sizes)
    slack = 2.0 * LIMIT_TOLERANCE
    return max(math.cos(sharpest) - slack, -REACHED), min(math.cos(slightest) + slack, REACHED)
