"""Recognising arms of the build *spherical shoulder + elbow (+ roll)*, and their geometry.

All that the solvers need is read off the joint axes at the zero pose, so the DH convention, the signs
of alpha and fixed rows make no difference. With w_i the axes at the zero pose and S the point in which
the first three meet, the tip and the tool's rotation are

    tip = S + R v(θ4)         R = Rot(w1, θ1) Rot(w2, θ2) Rot(w3, θ3)
    v(θ4) = a + Rot(w4, θ4) b
    rotation = R Rot(w4, θ4) Rot(w5, θ5) R0

a leads from S straight across to the elbow axis, b from there to the tip. Only the elbow changes the
distance of the tip from the shoulder: |v|² = |a|² + |b|² + 2 |a| |b across w4| cos(θ4 + o).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images
from armctl.kinematics.chain import Chain
from armctl.kinematics.rotation import quaternion_wxyz

# Three-vectors and quaternions of one rotation, in plain floats: a ufunc call costs more than all of it.

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""w, x, y, z"""


def vector(array: FloatArray) -> Vector:
    """(3,) as a tuple."""
    x, y, z = array.tolist()
    return x, y, z


def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    """``a + factor · b``."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def times(a: Vector, factor: float) -> Vector:
    """``factor · a``."""
    return factor * a[0], factor * a[1], factor * a[2]


def norm(a: Vector) -> float:
    """Length."""
    return math.hypot(*a)


def angle_between(a: Vector, b: Vector) -> float:
    """Angle [rad] in 0..pi, accurate also near 0 and pi."""
    return math.atan2(norm(cross(a, b)), dot(a, b))


def turned(v: Vector, axis: Vector, angle: float) -> Vector:
    """``v`` turned about a unit axis by an angle [rad] (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    along = dot(axis, v) * (1.0 - c)
    x, y, z = cross(axis, v)
    return (
        c * v[0] + s * x + along * axis[0],
        c * v[1] + s * y + along * axis[1],
        c * v[2] + s * z + along * axis[2],
    )


def angle_about(axis: Vector, start: Vector, end: Vector) -> float:
    """The turn about a unit axis [rad] that brings ``start`` onto ``end`` (Paden-Kahan subproblem 1)."""
    return math.atan2(dot(axis, cross(start, end)), dot(start, end) - dot(axis, start) * dot(axis, end))


def circle(axis: Vector, turning: Vector, fixed: Vector) -> tuple[float, float, float]:
    """``fixed · Rot(axis, x) turning`` as (A, B, C) of ``A + B cos x + C sin x``."""
    along = dot(axis, turning) * dot(axis, fixed)
    return along, dot(fixed, turning) - along, dot(fixed, cross(axis, turning))


def any_perpendicular(v: Vector) -> Vector:
    """A unit vector across a unit vector."""
    k = min(range(3), key=lambda i: abs(v[i]))
    across = cross(v, (float(k == 0), float(k == 1), float(k == 2)))
    return times(across, 1.0 / norm(across))


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The rotation ``q``, then ``p``."""
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a rotation."""
    return q[0], -q[1], -q[2], -q[3]


def about(axis: Vector, angle: float) -> Quaternion:
    """The turn about a unit axis by an angle [rad]."""
    s = math.sin(0.5 * angle)
    return math.cos(0.5 * angle), s * axis[0], s * axis[1], s * axis[2]


def rotated(q: Quaternion, v: Vector) -> Vector:
    """``v`` turned by a unit quaternion."""
    w, *u = q
    axis = (u[0], u[1], u[2])
    across = cross(axis, v)
    twice = cross(axis, across)
    return (
        v[0] + 2.0 * (w * across[0] + twice[0]),
        v[1] + 2.0 * (w * across[1] + twice[1]),
        v[2] + 2.0 * (w * across[2] + twice[2]),
    )


def shortest_turn(start: Vector, end: Vector) -> Quaternion:
    """The least rotation that brings one unit vector onto another."""
    if dot(start, end) < -0.5:  # first half a turn across: 1 + start · end loses its digits near -1
        half_turn = about(any_perpendicular(start), math.pi)
        return product(shortest_turn(times(start, -1.0), end), half_turn)
    w = 1.0 + dot(start, end)
    x, y, z = cross(start, end)
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return w / size, x / size, y / size, z / size


def turn_about(q: Quaternion, axis: Vector) -> float:
    """The turn about a unit axis that comes nearest to a rotation [rad]."""
    return 2.0 * math.atan2(q[1] * axis[0] + q[2] * axis[1] + q[3] * axis[2], q[0])


def turn_of(q: Quaternion) -> float:
    """The angle of a rotation [rad] in 0..pi."""
    return 2.0 * math.atan2(math.hypot(q[1], q[2], q[3]), abs(q[0]))


_ALIGNED = 1e-9
"""how far axes may miss a common point [m] and how nearly parallel they may be (sine of the angle)"""
REACH_TOLERANCE = 1e-11
"""how far rounding may carry a target beyond what the elbow reaches [m]"""
_STRAIGHT = 1e-14
"""how near to stretched or folded a distance may be just that, in whole lengths: rounding of 1e-16 alone
bends the arm by some 1e-8 rad there, so that it may, but need not, be straight"""
_NEARLY = 1e-5
"""how far outside a limit an elbow angle may lie that rounding alone has put there [rad]: near the
straight arm 1e-16 m of distance are 1e-8 rad"""


@dataclass(frozen=True)
class SphericalShoulder:
    """Geometry of one such arm, in the base frame at the zero pose: metres and radians."""

    centre: Vector
    """S"""
    axes: tuple[Vector, Vector, Vector]
    """w1, w2, w3"""
    elbow_axis: Vector
    upper: Vector
    """a: from the shoulder straight across to the elbow axis"""
    fore: Vector
    """b: from there to the tip"""
    offset: float
    """o: how far the elbow is bent at θ4 = 0, in (-pi, pi]"""
    roll_axis: Vector | None
    """axis of the fifth joint, which passes through the tip; None where there is none"""
    tool: Quaternion
    """R0"""
    tool_axis: Vector
    """approach axis"""

    @property
    def links(self) -> tuple[float, float, float]:
        """Lengths |a|, |b across the elbow axis| and |b along it| [m]."""
        along = dot(self.fore, self.elbow_axis)
        return norm(self.upper), norm(cross(self.fore, self.elbow_axis)), abs(along)

    @property
    def reach(self) -> tuple[float, float]:
        """Least and largest distance of the tip from the shoulder, whatever the limits [m]."""
        first, second, along = self.links
        return math.hypot(first - second, along), math.hypot(first + second, along)

    @property
    def singular(self) -> float:
        """The θ2 at which the three shoulder axes lie in one plane, the third nearest to the first [rad].

        Half a turn from it they do so again. Between the two lie the two ways to take up a rotation.
        """
        _, b, c = circle(self.axes[1], self.axes[2], self.axes[0])
        return math.atan2(c, b)

    @property
    def roll_swings_the_tool(self) -> bool:
        """True where the roll joint does not turn about the approach axis, so that it changes the pitch."""
        return self.roll_axis is not None and norm(cross(self.roll_axis, self.tool_axis)) > _ALIGNED

    def bend(self, elbow: float) -> float:
        """How far the elbow is bent from straight at θ4 [rad]; not wrapped."""
        return elbow + self.offset

    def hand(self, elbow: float) -> Vector:
        """v: the tip seen from the shoulder at θ4, the shoulder joints at zero [m]."""
        return plus(self.upper, turned(self.fore, self.elbow_axis, elbow))

    def bends(self, distance: float) -> tuple[float, ...]:
        """Bends in (-pi, pi] that hold the tip at a distance from the shoulder [m]; limits not looked at."""
        first, second, along = self.links
        nearest, farthest = self.reach
        if not nearest - REACH_TOLERANCE <= distance <= farthest + REACH_TOLERANCE:
            return ()
        flat = math.sqrt(max(0.0, (distance - along) * (distance + along)))
        folded, stretched = abs(first - second), first + second
        if flat >= stretched:
            return (0.0,)
        if flat <= folded:
            return (math.pi,)
        # the half-angle form keeps its digits where the arc cosine loses them
        wide, close = (stretched - flat) * (stretched + flat), (flat - folded) * (flat + folded)
        bend = 2.0 * math.atan2(math.sqrt(wide), math.sqrt(close))
        if stretched - flat < _STRAIGHT * stretched:
            return 0.0, bend, -bend
        if flat - folded < _STRAIGHT * stretched:
            return math.pi, bend, -bend
        return bend, -bend

    def is_straight(self, elbow: float) -> bool:
        """True where the elbow is stretched or folded, or so nearly that its angle is lost in rounding."""
        return abs(math.sin(self.bend(elbow))) < _NEARLY

    def elbow_angles(self, distance: float, low: float, high: float) -> list[float]:
        """Every θ4 inside its limits that holds the tip at a distance from the shoulder [rad]."""
        found: list[float] = []
        for bend in self.bends(distance):
            for angle in images(bend - self.offset, low, high, _NEARLY):
                held = abs(norm(self.hand(angle)) - distance) <= 10 * REACH_TOLERANCE
                if held and angle not in found:
                    found.append(angle)
        return found


def recognise_spherical(chain: Chain) -> SphericalShoulder | None:
    """The arm's geometry, or None when it is not of this build.

    Needed: three joints whose axes meet in one point, neighbours not parallel; a fourth one whose axis
    passes through neither that point nor the tip; at most one more, whose axis passes through the tip.
    """
    if chain.n not in (4, 5):
        return None
    points, axes = chain.axes()
    tool = chain.forward(np.zeros(chain.n))
    centre = _meeting_point(points, axes)
    if centre is None:
        return None
    tip, elbow_axis = tool[:3, 3], vector(axes[3])
    if chain.n == 5 and np.linalg.norm(np.cross(tip - points[4], axes[4])) > _ALIGNED:
        return None
    foot = points[3] + ((centre - points[3]) @ axes[3]) * axes[3]
    upper, fore = vector(foot - centre), vector(tip - foot)
    if norm(upper) < _ALIGNED or norm(cross(fore, elbow_axis)) < _ALIGNED:
        return None
    first, second, third = (vector(axis / np.linalg.norm(axis)) for axis in axes[:3])
    w, x, y, z = quaternion_wxyz(tool[:3, :3]).tolist()
    return SphericalShoulder(
        centre=vector(centre),
        axes=(first, second, third),
        elbow_axis=times(elbow_axis, 1.0 / norm(elbow_axis)),
        upper=upper,
        fore=fore,
        offset=angle_about(elbow_axis, upper, fore),
        roll_axis=vector(axes[4] / np.linalg.norm(axes[4])) if chain.n == 5 else None,
        tool=(w, x, y, z),
        tool_axis=vector(tool[:3, 2]),
    )


def _meeting_point(points: FloatArray, axes: FloatArray) -> FloatArray | None:
    """(3,) where the first three axes meet; None where they do not, or where neighbours are parallel."""
    for first, second in ((0, 1), (1, 2)):
        if math.sin(angle_between(vector(axes[first]), vector(axes[second]))) < 1e-6:
            return None
    across: list[FloatArray] = [np.eye(3) - np.outer(axis, axis) for axis in axes[:3]]
    both = np.vstack(across[:2])
    along = np.concatenate([across[k] @ points[k] for k in (0, 1)])
    meeting = np.asarray(np.linalg.lstsq(both, along, rcond=None)[0], dtype=np.float64)
    misses = [float(np.linalg.norm(p @ (meeting - q))) for p, q in zip(across, points[:3], strict=True)]
    return meeting if max(misses) <= _ALIGNED else None


# Names of the branches of *spherical shoulder + elbow (+ roll)*.
#
# Both depend on the configuration alone. Between two singular values of θ2, at which the three shoulder axes
# lie in one plane, the shoulder is *direct* while θ2 lies in the half turn that begins where the third axis
# is nearest to the first, and *flipped* in the other half: the two ways to take up one rotation. The elbow is
# *plus* while it is bent from straight in the positive sense of its joint, and *minus* when against it.

SPHERICAL_BRANCHES = tuple(
    f"shoulder-{shoulder} elbow-{elbow}"
    for shoulder, elbow in itertools.product(("direct", "flipped"), ("plus", "minus"))
)
"""Index: 2 · flipped + minus."""


def spherical_branch_index(geometry: SphericalShoulder, q: FloatArray) -> NDArray[np.int8]:
    """(k,) index into ``SPHERICAL_BRANCHES`` of configurations ``q`` (k, n) [rad]."""
    flipped, minus = (
        np.floor(angle / math.pi).astype(np.int64) & 1  # odd in the half turn in which the sine is negative
        for angle in (q[:, 1] - geometry.singular, q[:, 3] + geometry.offset)
    )
    return (2 * flipped + minus).astype(np.int8)
