"""Seven joints with the first or the last one locked: the six others in closed form, for many angles of it.

The joints are counted from the locked one on, 0 to 6; from the tool to the base where that is the last. With
h_i the axes at the zero pose, Rot_i the turn of joint i about its own axis, M the tool pose there and T the
one that is asked for

    X = Rot_0(θ0) Rot_1(θ1) … Rot_6(θ6)        X = T M⁻¹, or its inverse from the tool to the base

The axes 1 and 2 meet in P, and 4, 5 and 6 in W. So, seen from link 0, the elbow 3 alone says how far W is
from P (subproblem 3), joints 1 and 2 turn W to its place (subproblem 2), and 4 to 6 turn the rest: two times
two times two branches. P is the wrist of a Panda or xArm 7, and the shoulder of an iiwa, Gen3 or WAM.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import into_limits
from armctl.kinematics.chain import Chain
from armctl.kinematics.subproblems import across, angle_about, circle, roots, turned

JOINTS = 7
_ALIGNED = 1e-9
"""how far axes may miss a common point [m] and how nearly parallel they may be (sine of the angle)"""
_REACH_TOLERANCE = 1e-13
"""how far rounding may carry the squared distance of W from P beyond what the elbow reaches [m²]"""
_TURN_TOLERANCE = 1e-12
"""the same for a direction that joint 1 and 2, or 4 and 5, turn to (unit vectors)"""
_DOUBLE = 1e-9
"""two roots this near to each other are one [rad]"""

IndexArray = NDArray[np.intp]


class Found(NamedTuple):
    """Configurations that meet a pose, each for one of the angles of the locked joint."""

    row: IndexArray
    """(m,) index of the angle"""
    branch: IndexArray
    """(m,) index into ``LockedArm.branch_names``"""
    q: FloatArray
    """(m, 7) inside the limits, each joint at the image nearest to zero [rad]"""


@dataclass(frozen=True, eq=False)
class LockedArm:
    """Geometry of one such arm at its zero pose, base frame [m]."""

    joint: int
    """index of the joint that is locked, 0 or 6"""
    axes: FloatArray
    """(7, 3) h, unit vectors, counted from the locked joint on; pointing back where that is the last one"""
    origin: FloatArray
    """(3,) a point of the locked joint's axis"""
    elbow: FloatArray
    """(3,) a point of the axis of joint 3"""
    shoulder: FloatArray
    """(3,) P"""
    wrist: FloatArray
    """(3,) W"""
    home: FloatArray
    """(4, 4) M"""

    branch_names: ClassVar[tuple[str, ...]] = tuple(
        " ".join(names)
        for names in itertools.product(
            ("elbow-plus", "elbow-minus"), ("inner-plus", "inner-minus"), ("outer-plus", "outer-minus")
        )
    )

    @classmethod
    def of(cls, chain: Chain) -> Self | None:
        """The arm of a chain, or None: neither end joint can be locked so that the rest is closed form."""
        if chain.n != JOINTS:
            return None
        ahead, forward = chain.axes()
        for joint, points, axes in ((0, ahead, forward), (JOINTS - 1, ahead[::-1], -forward[::-1])):
            shoulder, wrist = common_point(points[1:3], axes[1:3]), common_point(points[4:], axes[4:])
            if shoulder is not None and wrist is not None:
                home = chain.forward(np.zeros(JOINTS))
                found = cls(joint, axes.copy(), points[0].copy(), points[3].copy(), shoulder, wrist, home)
                return found if found._bends else None
        return None

    @property
    def _bends(self) -> bool:
        """Whether the elbow changes the distance of W from P."""
        _, cosine, sine = self._elbow_circle
        return bool(np.hypot(cosine, sine) > _ALIGNED)

    @property
    def _elbow_circle(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the inner product of the ways from the elbow axis to W and to P, over θ3 [m²]."""
        return circle(self.axes[3], self.wrist - self.elbow, self.shoulder - self.elbow)

    def solve(self, pose: FloatArray, angles: FloatArray, limits: FloatArray) -> Found:
        """Every solution inside limits (7, 2) [rad] of ``T_base_tool`` (4, 4), for angles (k,) [rad]."""
        h = self.axes
        limits = limits if self.joint == 0 else limits[::-1]
        R, t = _inside_out(pose, self.home, back=self.joint != 0)
        # W as joint 1 to 3 must bring it to its place, seen from P; link 0 stands still
        ends = turned(R @ self.wrist + t - self.origin, h[0], -angles) + (self.origin - self.shoulder)

        fore, upper = self.wrist - self.elbow, self.shoulder - self.elbow
        product = 0.5 * (fore @ fore + upper @ upper - np.einsum("ki,ki->k", ends, ends))
        elbow, row, third = _choices(roots(self._elbow_circle, product, _REACH_TOLERANCE), limits[3])

        hand = turned(fore, h[3], third) - upper
        length = np.maximum(np.linalg.norm(hand, axis=1, keepdims=True), 1e-300)
        hand, end = hand / length, ends[row] / length
        both = roots(circle(h[2], hand, h[1]), end @ h[1], _TURN_TOLERANCE, rest=0.0)
        shoulder, of, second = _choices(both, limits[2])
        hand, end, elbow, row, third = hand[of], end[of], elbow[of], row[of], third[of]
        first = angle_about(h[1], turned(hand, h[2], second), end)
        _, of, first = _choices(first[None], limits[1])
        shoulder, elbow, row = shoulder[of], elbow[of], row[of]
        second, third = second[of], third[of]

        def before_wrist(v: FloatArray) -> FloatArray:
            """A vector (3,) that all joints have turned, as the wrist alone must turn it (m, 3)."""
            v = turned(turned(R @ v, h[0], -angles)[row], h[1], -first)
            return turned(turned(v, h[2], -second), h[3], -third)

        aim = before_wrist(h[6])
        both = roots(circle(h[5], h[6], h[4]), aim @ h[4], _TURN_TOLERANCE, rest=0.0)
        wrist, of, fifth = _choices(both, limits[5])
        fourth = angle_about(h[4], turned(h[6], h[5], fifth), aim[of])
        side = _sideways(h[6])
        rest = turned(turned(before_wrist(side)[of], h[4], -fourth), h[5], -fifth)
        sixth = angle_about(h[6], side, rest)

        q = np.stack([angles[row[of]], first[of], second[of], third[of], fourth, fifth, sixth], axis=1)
        inside = np.ones(len(q), dtype=np.bool_)
        for k in (4, 6):
            column = q[:, k].copy()
            inside &= into_limits(column, *limits[k].tolist())
            q[:, k] = np.clip(column, *limits[k])
        branch = 4 * elbow[of] + 2 * shoulder[of] + wrist
        if self.joint != 0:
            q = q[:, ::-1]
        return Found(row[of][inside], branch[inside], q[inside])


def common_point(points: FloatArray, axes: FloatArray) -> FloatArray | None:
    """The point (3,) in which lines meet, through points (k, 3) along unit axes (k, 3); None: they do not.

    Neighbours that are parallel do not meet either.
    """
    if np.linalg.norm(np.cross(axes[1:], axes[:-1]), axis=1).min() < _ALIGNED:
        return None
    levels: FloatArray = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    right: FloatArray = np.einsum("kij,kj->i", levels, points)
    matrix: FloatArray = levels.sum(axis=0)
    point = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    missed = np.einsum("kij,kj->ki", levels, points - point)
    return None if np.linalg.norm(missed, axis=1).max() > _ALIGNED else point


def _inside_out(pose: FloatArray, home: FloatArray, *, back: bool) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and shift (3,) of X = T M⁻¹, or of its inverse [m]."""
    R = pose[:3, :3] @ home[:3, :3].T
    t = pose[:3, 3] - R @ home[:3, 3]
    return (R.T, -R.T @ t) if back else (R, t)


def _choices(both: FloatArray, limits: FloatArray) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Those of the roots (2, m) or (1, m) [rad] that a joint's limits (2,) allow, each once.

    Which root, of which column, and the angle; (c,) each.
    """
    both = both.copy()
    if len(both) > 1:
        both[1, np.abs(np.sin(0.5 * (both[0] - both[1]))) < _DOUBLE] = np.nan
    which, of = np.nonzero(into_limits(both, *limits.tolist()))
    return which, of, np.clip(both[which, of], *limits)


def _sideways(axis: FloatArray) -> FloatArray:
    """A unit vector (3,) at a right angle to another."""
    side: FloatArray = across(axis)[:, int(np.abs(axis).argmin())]
    return side / np.linalg.norm(side)
