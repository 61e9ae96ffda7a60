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

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import images
from armctl.kinematics.chain import DHChain
from armctl.kinematics.rotation import quaternion_wxyz
from armctl.kinematics.spherical.vectors import (
    Quaternion,
    Vector,
    angle_about,
    angle_between,
    circle,
    cross,
    dot,
    norm,
    plus,
    times,
    turned,
    vector,
)

FloatArray = NDArray[np.float64]
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


def recognise_spherical(chain: DHChain) -> SphericalShoulder | None:
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
