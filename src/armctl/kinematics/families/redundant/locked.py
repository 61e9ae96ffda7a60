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
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import half_angle_cos_sin, into_limits
from armctl.kinematics.chain import Chain
from armctl.kinematics.subproblems import (
    Columns,
    across,
    added,
    circle,
    cross,
    dot,
    meeting_point,
    roots,
    scaled,
    turned_by,
)
from armctl.lazy_dataclass import dataclass

JOINTS = 7
_ALIGNED = 1e-9
"""how nearly parallel axes may be (sine of the angle)"""
_MEETING = 1e-11
"""how far axes may miss a common point [m]: a row misses its pose by about as much"""
_REACH_TOLERANCE = 1e-13
"""how far rounding may carry the squared distance of W from P beyond what the elbow reaches [m²]"""
_TURN_TOLERANCE = 1e-12
"""the same for a direction that joint 1 and 2, or 4 and 5, turn to (unit vectors)"""
_DOUBLE = 1e-6
"""two roots this near to each other are one [rad]: rounding splits a double one by 1e-8 and more"""

_UNMOVED = 1e-11
"""a unit vector this near to an axis does not move when it turns"""

IndexArray = NDArray[np.intp]


class LockedSolutions(NamedTuple):
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
            shoulder = meeting_point(points[1:3], axes[1:3], _MEETING)
            wrist = meeting_point(points[4:], axes[4:], _MEETING)
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

    def solve(
        self, pose: FloatArray, angles: FloatArray, limits: FloatArray, only: IndexArray | None = None
    ) -> LockedSolutions:
        """Every solution inside limits (7, 2) [rad] of ``T_base_tool`` (4, 4), for angles (k,) [rad].

        ``only``: for each angle that of one branch (k,); the rows then rise.
        """
        h: list[Columns] = [tuple(axis) for axis in self.axes.tolist()]
        limits = limits if self.joint == 0 else limits[::-1]
        R, t = _inside_out(pose, self.home, back=self.joint != 0)

        def seen(v: FloatArray) -> Columns:
            """A vector (3,) that all joints have turned, from link 0."""
            return _turned(tuple(v.tolist()), h[0], -angles)

        # W as joint 1 to 3 must bring it to its place, seen from P; link 0 stands still
        ahead = seen(R @ self.wrist + t - self.origin)
        ends = added(ahead, tuple((self.origin - self.shoulder).tolist()))

        fore, upper = self.wrist - self.elbow, self.shoulder - self.elbow
        product = 0.5 * (fore @ fore + upper @ upper - dot(ends, ends))
        both = roots(self._elbow_circle, product, _REACH_TOLERANCE)
        elbow, row, third = _choices(both, limits[3], None if only is None else only // 4)

        hand = added(_turned(tuple(fore.tolist()), h[3], third), tuple((-upper).tolist()))
        end = _taken(ends, row)
        length = np.maximum(np.sqrt(dot(hand, hand)), 1e-300)
        hand, end = scaled(hand, 1.0 / length), scaled(end, 1.0 / length)
        fixed = dot(h[1], h[2]) * dot(h[2], hand)
        turning = fixed, dot(h[1], hand) - fixed, dot(h[1], cross(h[2], hand))
        both = roots(turning, dot(h[1], end), _TURN_TOLERANCE, rest=0.0)
        shoulder, of, second = _choices(both, limits[2], None if only is None else only[row] // 2 % 2)
        first = _about(h[1], _turned(_taken(hand, of), h[2], second), _taken(end, of))
        _, kept, first = _choices(first[None], limits[1])
        shoulder, of, second = shoulder[kept], of[kept], second[kept]
        elbow, row, third = elbow[of], row[of], third[of]

        def before_wrist(v: FloatArray) -> Columns:
            """The same as the wrist alone must turn it."""
            turned = _turned(_taken(seen(R @ v), row), h[1], -first)
            return _turned(_turned(turned, h[2], -second), h[3], -third)

        aim = before_wrist(self.axes[6])
        both = roots(circle(self.axes[5], self.axes[6], self.axes[4]), dot(h[4], aim), _TURN_TOLERANCE, 0.0)
        wrist, of, fifth = _choices(both, limits[5], None if only is None else only[row] % 2)
        fourth = _about(h[4], _turned(h[6], h[5], fifth), _taken(aim, of))
        side = _sideways(self.axes[6])
        rest = _turned(_turned(_taken(before_wrist(side), of), h[4], -fourth), h[5], -fifth)
        sixth = _about(h[6], tuple(side.tolist()), rest)

        q = np.stack([angles[row[of]], first[of], second[of], third[of], fourth, fifth, sixth], axis=1)
        inside = np.ones(len(q), dtype=np.bool_)
        for k in (4, 6):
            column = q[:, k].copy()
            inside &= into_limits(column, *limits[k].tolist())
            q[:, k] = np.clip(column, *limits[k])
        branch = 4 * elbow[of] + 2 * shoulder[of] + wrist
        if self.joint != 0:
            q = q[:, ::-1]
        return LockedSolutions(row[of][inside], branch[inside], q[inside])


def _taken(a: Columns, of: IndexArray) -> Columns:
    return a[0][of], a[1][of], a[2][of]


def _turned(v: Columns, axis: Columns, angle: FloatArray) -> Columns:
    return turned_by(v, axis, half_angle_cos_sin(angle))


def _about(axis: Columns, start: Columns, end: Columns) -> FloatArray:
    """Subproblem 1: the turn [rad] about a unit axis from one vector to another; 0 where it moves neither."""
    sideways = cross(axis, start)
    cosine = dot(start, end) - dot(axis, start) * dot(axis, end)
    still = dot(sideways, sideways) < _UNMOVED * _UNMOVED
    return np.where(still, 0.0, np.arctan2(dot(sideways, end), cosine))


def _inside_out(pose: FloatArray, home: FloatArray, *, back: bool) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and shift (3,) of X = T M⁻¹, or of its inverse [m]."""
    R = pose[:3, :3] @ home[:3, :3].T
    t = pose[:3, 3] - R @ home[:3, 3]
    return (R.T, -R.T @ t) if back else (R, t)


def _choices(
    both: FloatArray, limits: FloatArray, wanted: IndexArray | None = None
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Those of the roots (2, m) or (1, m) [rad] that a joint's limits (2,) allow, each once.

    Which root, of which column, and the angle; (c,) each. ``wanted`` (m,): only that root of each column.
    """
    both = both.copy()
    if len(both) > 1:
        both[1, np.abs(np.sin(0.5 * (both[0] - both[1]))) < _DOUBLE] = np.nan
    if wanted is not None:
        one = both[wanted, np.arange(len(wanted))]
        of = np.flatnonzero(into_limits(one, *limits.tolist()))
        return wanted[of], of, np.clip(one[of], *limits)
    which, of = np.nonzero(into_limits(both, *limits.tolist()))
    return which, of, np.clip(both[which, of], *limits)


def _sideways(axis: FloatArray) -> FloatArray:
    """A unit vector (3,) at a right angle to another."""
    side: FloatArray = across(axis)[:, int(np.abs(axis).argmin())]
    return side / np.linalg.norm(side)
