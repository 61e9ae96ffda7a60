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

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images
from armctl.kinematics.chain import Chain
from armctl.kinematics.subproblems import across, angle_about, angle_between, meeting_point, turn, turned
from armctl.lazy_dataclass import dataclass

_ALIGNED = 1e-9
"""how far axes may miss a common point [m] and how nearly parallel they may be (sine of the angle)"""
REACH_TOLERANCE = 1e-11
"""how far rounding may carry a target beyond what the elbow reaches [m]"""
_STRAIGHT = 1e-14
"""how near to stretched or folded a distance may be just that, in whole lengths"""
_NEARLY = 1e-5
"""how far outside a limit rounding may put an elbow angle [rad]: near straight 1e-16 m are 1e-8 rad"""


@dataclass(frozen=True)
class SphericalShoulder:
    """Geometry of one such arm, in the base frame at the zero pose: metres and radians."""

    centre: FloatArray
    """(3,) S"""
    axes: FloatArray
    """(4, 3) w1, w2, w3 and the elbow's w4; (5, 3) with that of the roll, which passes through the tip"""
    upper: FloatArray
    """(3,) a: from the shoulder straight across to the elbow axis"""
    fore: FloatArray
    """(3,) b: from there to the tip"""
    offset: float
    """o: how far the elbow is bent at θ4 = 0, in (-pi, pi]"""
    tool: FloatArray
    """(3, 3) R0; its last column is the approach axis"""

    @property
    def links(self) -> tuple[float, float, float]:
        """Lengths |a|, |b across the elbow axis| and |b along it| [m]."""
        along = float(self.fore @ self.axes[3])
        flat = float(np.linalg.norm(across(self.axes[3]) @ self.fore))
        return float(np.linalg.norm(self.upper)), flat, abs(along)

    @property
    def reach(self) -> tuple[float, float]:
        """Least and largest distance of the tip from the shoulder, whatever the limits [m]."""
        first, second, along = self.links
        return math.hypot(first - second, along), math.hypot(first + second, along)

    @property
    def singular(self) -> float:
        """The θ2 at which the three shoulder axes lie in one plane, the third nearest to the first [rad]."""
        return float(angle_about(self.axes[1], self.axes[2], self.axes[0]))

    @property
    def roll_swings_the_tool(self) -> bool:
        """True where the roll joint does not turn about the approach axis, so that it changes the pitch."""
        return any(np.linalg.norm(across(axis) @ self.tool[:, 2]) > _ALIGNED for axis in self.axes[4:])

    def hand(self, elbow: float) -> FloatArray:
        """(3,) v: the tip seen from the shoulder at θ4, the shoulder joints at zero [m]."""
        return self.upper + turned(self.fore, self.axes[3], elbow)

    def beyond(self, elbow: float, roll: float) -> FloatArray:
        """(3, 3) the turn of elbow and roll joint [rad]."""
        elbow_turn = turn(self.axes[3], elbow)
        return elbow_turn @ turn(self.axes[4], roll) if len(self.axes) > 4 else elbow_turn

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
        return abs(math.sin(elbow + self.offset)) < _NEARLY

    def elbow_angles(self, distance: float, low: float, high: float) -> list[float]:
        """Every θ4 inside its limits that holds the tip at a distance from the shoulder [rad]."""
        found: list[float] = []
        for bend in self.bends(distance):
            for angle in images(bend - self.offset, low, high, _NEARLY):
                held = abs(np.linalg.norm(self.hand(angle)) - distance) <= 10 * REACH_TOLERANCE
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
    centre = meeting_point(points[:3], axes[:3], _ALIGNED)
    if centre is None:
        return None
    tip = tool[:3, 3]
    if chain.n == 5 and np.linalg.norm(across(axes[4]) @ (tip - points[4])) > _ALIGNED:
        return None
    foot = points[3] + ((centre - points[3]) @ axes[3]) * axes[3]
    upper, fore = foot - centre, tip - foot
    if np.linalg.norm(upper) < _ALIGNED or np.linalg.norm(across(axes[3]) @ fore) < _ALIGNED:
        return None
    return SphericalShoulder(
        centre=centre,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        upper=upper,
        fore=fore,
        offset=float(angle_about(axes[3], upper, fore)),
        tool=tool[:3, :3],
    )


ROOT_TOLERANCE = 1e-10
"""how far rounding, of a nearly straight elbow too, may carry ``k`` beyond ``A + B cos x + C sin x``, of unit
vectors; what then misses the target is dropped by the look at the tip"""


def shoulder_angles(geometry: SphericalShoulder, rotation: FloatArray) -> FloatArray:
    """The two ways (2 m, 3) in which the shoulder joints make rotations (m, 3, 3); NaN where they cannot.

    With r = R w3, the axes w1, w2 and Rot(w2, θ2) w3 span a spherical triangle whose third side is the
    angle between w1 and r; the half-angle formula for θ2 keeps its digits near the singular poses.
    """
    w1, w2, w3 = geometry.axes[:3]
    r = rotation @ w3
    side, first, second = angle_between(r, w1), angle_between(w1, w2), angle_between(w3, w2)
    wide = np.sin(0.5 * (side + first - second)) * np.sin(0.5 * (side - first + second))
    close = np.sin(0.5 * (first + second + side)) * np.sin(0.5 * (first + second - side))
    away = 2.0 * np.arctan2(np.sqrt(np.maximum(0.0, wide)), np.sqrt(np.maximum(0.0, close)))
    away[np.minimum(wide, close) < -ROOT_TOLERANCE] = math.nan
    theta2 = geometry.singular + np.stack([away, -away])
    theta1 = angle_about(w1, turned(w3, w2, theta2), r)
    left = turn(w2, -theta2) @ turn(w1, -theta1) @ rotation
    return np.stack([theta1, theta2, turn_about(left, w3)], axis=-1).reshape(-1, 3)


def turn_about(rotation: FloatArray, axis: FloatArray) -> FloatArray:
    """The turns about a unit axis (...) [rad] that come nearest to rotations (..., 3, 3)."""
    sine = (rotation * across(axis)).sum(axis=(-2, -1))
    cosine = (rotation * (np.eye(3) - np.outer(axis, axis))).sum(axis=(-2, -1))
    return np.arctan2(sine, cosine)


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
