"""Position, tool pitch and roll of many poses at once: every branch, in numpy.

All ways to face a target and to read its pitch are looked at together, as columns of one flat list; those
that the links cannot reach are dropped before anything costly is computed, and the few with the links in
line, where rounding decides, are left to the scalar closed form.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI, rest_angle
from armctl.kinematics.batch_solutions import BatchSolutions
from armctl.kinematics.cos_sin import SCRATCH, cos_sin
from armctl.kinematics.yaw_pitch_roll.base_yaw import base_angles
from armctl.kinematics.yaw_pitch_roll.branch_names import BRANCHES, LEVEL, bend_sense, branch_index
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import into_limits
from armctl.kinematics.yaw_pitch_roll.plane_postures import PlanePostures
from armctl.kinematics.yaw_pitch_roll.pose_branches import REACHED, SURE, UPRIGHT

FloatArray = NDArray[np.float64]
_CHUNK = 4096
"""poses worked on at a time"""
_NEARLY_STRAIGHT = 1e-4
"""how near to ±1 the elbow's cosine may come before the cosine rule loses more than four digits"""


class _Columns(NamedTuple):
    """Triangles to be solved, each of one pose, one way to face it and one reading of its pitch."""

    pose: NDArray[np.intp]
    """row of the pose in the chunk"""
    back: NDArray[np.intp]
    """1 where the arm reaches over its back, else 0"""
    inward: NDArray[np.intp]
    """1 where the tool points back at the base axis, else 0"""
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

    def solve(
        self, position: FloatArray, pitch: FloatArray | None, roll: FloatArray | None
    ) -> BatchSolutions:
        """Every branch of each pose.

        Args:
            position: (k, 3) tool points in the base frame [m].
            pitch: (k,) of the approach axis above the horizontal [rad]; None with two pitch joints.
            roll: (k,) the roll joint's angle [rad]; None: the one nearest to zero.
        """
        k, branches = len(position), len(BRANCHES)
        q = np.full((len(self._limits), branches, k), np.nan)  # joint by joint in memory, as it is computed
        found = np.zeros((branches, k), dtype=np.bool_)
        with np.errstate(invalid="ignore", divide="ignore"):
            for at in range(0, k, _CHUNK):
                cut = slice(at, at + _CHUNK)
                asked = (
                    position[cut],
                    None if pitch is None else pitch[cut],
                    None if roll is None else roll[cut],
                )
                for branch, pose, angles in self._solve_chunk(*asked):
                    place = branch * k
                    place += pose
                    place += at
                    found.ravel()[place] = True
                    for flat, values, limits in zip(
                        q.reshape(-1, branches * k), angles, self._limits, strict=True
                    ):
                        flat[place] = np.clip(values, *limits)
        return BatchSolutions(q.transpose(2, 1, 0), found.T, BRANCHES)

    def _solve_chunk(
        self,
        position: FloatArray,
        pitch: FloatArray | None,
        roll: FloatArray | None,
    ) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], list[FloatArray]]]:
        """Branches, poses (rows of the chunk) and joint angles of some of the solutions, in parts."""
        geometry, m = self._geometry, len(position)
        forward, left, height = np.ascontiguousarray(((position - geometry.origin) @ geometry.frame).T)
        yaw, r, faces = base_angles(geometry, forward, left, self._limits[0])
        rolls = self._rolls(roll, m)
        if rolls is not None:
            faces &= rolls[1]
        columns = self._columns(r, height - geometry.shoulder.imag, faces, pitch)
        base = yaw.ravel()[columns.pose + m * columns.back]
        direction = np.arctan2(columns.y, columns.x)
        tail = [] if rolls is None else [rolls[0]]
        in_line = np.abs(columns.cosine) > SURE
        if in_line.any():
            branch, pose, back, angles = self._in_line(columns, np.flatnonzero(in_line))
            yield branch, pose, [yaw[back, pose], *angles, *(values[pose] for values in tail)]
        bend, inner = self._triangle(columns)
        for sense in (1, -1):
            t2, t3 = (direction - inner, bend) if sense > 0 else (direction + inner, -bend)
            planes = [t2, t3] if columns.last is None else [t2, t3, columns.last - t2 - t3]
            angles, inside = self._joints(planes)
            inside &= ~in_line
            keep = np.flatnonzero(inside)
            pose, back = columns.pose[keep], columns.back[keep]
            # a positive bend leaves the elbow below the line to the target in front, above it at the back
            down = 1 - back if sense > 0 else back
            branch = 4 * back + 2 * down + columns.inward[keep]
            joints = [base[keep], *(angle[keep] for angle in angles)]
            yield branch, pose, [*joints, *(values[pose] for values in tail)]

    def _in_line(
        self, columns: _Columns, rows: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], FloatArray]:
        """Branches, poses, sides and pitch joint angles (joints, k) of columns with the links in line."""
        found: dict[tuple[int, int], tuple[int, tuple[float, ...]]] = {}
        for i in rows.tolist():
            pose, back, inward = int(columns.pose[i]), int(columns.back[i]), int(columns.inward[i])
            last = None if columns.last is None else float(columns.last[i])
            for plane in self._planar.reaching(float(columns.x[i]), float(columns.y[i]), last):
                branch = branch_index(not back, bend_sense(plane[1]), bool(inward))
                for angles in self._planar.joint_images(plane)[:1]:
                    found.setdefault((branch, pose), (back, angles))
        branches, poses = np.array(list(found), dtype=np.intp).reshape(-1, 2).T
        sides = np.array([back for back, _ in found.values()], dtype=np.intp)
        joints = np.array([angles for _, angles in found.values()]).reshape(len(found), -1)
        return branches, poses, sides, joints.T

    def _joints(self, planes: list[FloatArray]) -> tuple[list[FloatArray], NDArray[np.bool_]]:
        """Pitch joint angles of plane angles, and where they are all inside their limits."""
        geometry, inside = self._geometry, np.ones(len(planes[0]), dtype=np.bool_)
        angles: list[FloatArray] = []
        for k, plane in enumerate(planes):
            angle = plane - geometry.offsets[k]
            if geometry.signs[k] < 0:
                np.negative(angle, out=angle)
            inside &= into_limits(angle, *self._limits[1 + k])
            angles.append(angle)
        return angles, inside

    def _rolls(self, roll: FloatArray | None, count: int) -> tuple[FloatArray, NDArray[np.bool_]] | None:
        """The roll joint's angle of each pose and where it is inside the limits; None without one."""
        joint = self._geometry.roll_joint
        if joint is None:
            return None
        low, high = self._limits[joint]
        angle = np.full(count, rest_angle(low, high)) if roll is None else roll.copy()
        return angle, into_limits(angle, low, high)

    def _columns(
        self, r: FloatArray, y: FloatArray, faces: NDArray[np.bool_], pitch: FloatArray | None
    ) -> _Columns:
        """What the first two links must reach, where they can."""
        m, x = len(y), r - self._geometry.shoulder.real
        if pitch is None:
            x, y, last, inward = x[:, None], y[None], None, np.zeros((2, 1, m), dtype=np.bool_)
            ok = faces[:, None].copy()
        else:
            last, along, across, single, outward = self._readings(pitch)
            x, y = x[:, None] - self._l4 * along, y - self._l4 * across
            inward = np.stack([outward < 0.0, outward > 0.0])
            inward &= ~(single & (np.abs(outward) < LEVEL))
            ok = np.repeat(faces[:, None], 2, axis=1)
            ok[:, 1] &= ~single
        cosine = x * x + y * y
        cosine -= self._l2**2 + self._l3**2
        cosine *= 0.5 / (self._l2 * self._l3)
        ok &= np.abs(cosine) < REACHED
        flat = np.flatnonzero(ok)
        readings = ok.shape[1]
        back = (flat >= readings * m).astype(np.intp)
        once = flat - readings * m * back
        return _Columns(
            pose=once - m * (once >= m), back=back, inward=inward.ravel()[flat].astype(np.intp),
            x=x.ravel()[flat], y=y.ravel()[once],
            cosine=cosine.ravel()[flat], last=None if last is None else last.ravel()[once],
        )  # fmt: skip

    def _readings(
        self, pitch: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_], FloatArray]:
        """Both readings of each pitch, (2, m) each but for ``single``.

        Direction of the last link, its cosine and sine; where there is one reading only (m,); and the
        cosine of the approach axis over forward.
        """
        tool = self._geometry.tool_angle or 0.0
        single = np.abs(pitch) > math.pi / 2 - UPRIGHT
        last = np.stack([pitch - tool, math.pi - pitch - tool])
        small = last - TWO_PI * np.rint(last / TWO_PI)
        along, across = np.empty_like(last), np.empty_like(last)
        cos_sin(small, along, across, np.empty((SCRATCH, *last.shape)))
        c, s = math.cos(tool), math.sin(tool)
        return last, along, across, single, c * along - s * across

    def _triangle(self, columns: _Columns) -> tuple[FloatArray, FloatArray]:
        """Bend in [0, pi] and angle between the first link and the line to the target."""
        l2, l3, cosine = self._l2, self._l3, columns.cosine
        size = np.abs(cosine)
        square = columns.x * columns.x + columns.y * columns.y
        inner = (square + (l2 * l2 - l3 * l3)) / (2.0 * l2 * np.sqrt(square))
        inner = np.arccos(np.clip(inner, -1.0, 1.0))
        near = np.flatnonzero(size > 1.0 - _NEARLY_STRAIGHT)
        c = cosine[near]
        inner[near] = np.arctan2(l3 * np.sqrt((1.0 - c) * (1.0 + c)), l2 + l3 * c)
        return np.arccos(cosine), inner
