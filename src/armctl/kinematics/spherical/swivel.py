"""The swivel: every posture of the shoulder that points the hand at the target, for one elbow angle.

With v the unit vector from the shoulder to the tip (joints at zero) and t that to the target, the shoulder
rotations R with ``R v = t`` are one circle, ``R = Rot(t, phi) R_min``. A posture of it is found from phi, or
from any one of the shoulder joints (Paden-Kahan subproblem 2 for axes at any angle):

    θ1 given:  w2 · Rot(w3, θ3) v = w2 · u            u = Rot(w1, -θ1) t; then θ2 turns Rot(w3, θ3) v onto u
    θ2 given:  t · Rot(w1, θ1) Rot(w2, θ2) w3 = w3 · v    then θ3 turns v onto Rot(w2, -θ2) Rot(w1, -θ1) t
    θ3 given:  t · Rot(w1, θ1) w2 = w2 · Rot(w3, θ3) v    then θ2 as above

Each is an ``A + B cos x + C sin x = k`` with two roots.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import half_angle_cos_sin
from armctl.kinematics.spherical.limits import Angles, ShoulderLimits
from armctl.kinematics.spherical.shoulder import SphericalShoulder
from armctl.kinematics.spherical.vectors import (
    Quaternion,
    Vector,
    about,
    angle_about,
    angle_between,
    circle,
    cross,
    dot,
    norm,
    plus,
    product,
    rotated,
    shortest_turn,
    times,
    turn_about,
    turned,
)

FloatArray = NDArray[np.float64]
_ROOT_TOLERANCE = 1e-10
"""how far rounding, of a nearly straight elbow too, may carry ``k`` beyond ``A + B cos x + C sin x``, of unit
vectors; what then misses the target is dropped by the look at the tip"""
_ROUNDING = 1e-15
"""the same for what nobody looks at"""
_STILL = 1e-11
"""a vector that lies this near to an axis does not move when the axis turns (unit vectors)"""
_GIMBAL = 1e-6
"""how nearly parallel the first and the third axis may be before their turns are told apart poorly (sine)"""


def roots(a: float, b: float, c: float, k: float) -> tuple[float, ...]:
    """The angles [rad] at which ``a + b cos x + c sin x = k``; none where every angle serves or none."""
    size = math.hypot(b, c)
    if size <= _STILL or abs(k - a) > size + _ROOT_TOLERANCE:
        return ()
    middle = math.atan2(c, b)
    away = 2.0 * math.atan2(math.sqrt(max(0.0, size - (k - a))), math.sqrt(max(0.0, size + (k - a))))
    return (middle,) if away == 0.0 else (middle + away, middle - away)


@dataclass(frozen=True, slots=True)
class Swivel:
    """The circle of postures of one arm for one elbow angle and one target."""

    geometry: SphericalShoulder
    limits: ShoulderLimits
    hand: Vector
    """v, unit"""
    aim: Vector
    """t, unit"""
    base: Quaternion
    """R_min: the shortest turn of v onto t"""

    @classmethod
    def of(cls, geometry: SphericalShoulder, limits: ShoulderLimits, hand: Vector, aim: Vector) -> Swivel:
        """From the directions of the tip (joints at zero) and of the target; lengths do not matter."""
        v, t = times(hand, 1.0 / norm(hand)), times(aim, 1.0 / norm(aim))
        return cls(geometry, limits, v, t, shortest_turn(v, t))

    def rotation_at(self, phi: float) -> Quaternion:
        """The shoulder's rotation at one swivel angle [rad]."""
        return product(about(self.aim, phi), self.base)

    def at(self, phi: float) -> list[Angles]:
        """Postures inside the limits at one swivel angle [rad]."""
        return self.inside(shoulder_angles(self.geometry, self.rotation_at(phi)))

    def is_singular_at(self, phi: float) -> bool:
        """True where the first and the third shoulder axis are parallel, or nearly."""
        first, _, third = self.geometry.axes
        return norm(cross(first, rotated(self.rotation_at(phi), third))) < _GIMBAL

    def inside(self, candidates: Iterator[Angles] | list[Angles]) -> list[Angles]:
        """Those inside the limits, with all images."""
        axes = self.geometry.axes
        return [q for angles in candidates for q in self.limits.inside(angles, axes, self.hand, self.aim)]

    def landmarks(self) -> list[Angles]:
        """Postures inside the limits with a joint at a limit, at zero or where two ways meet.

        Among them are both ends of every continuum of postures.
        """
        return self.inside(self._landmarks())

    def brushing(self) -> list[Angles]:
        """Landmarks barely outside the limits, clipped onto them: they miss the target by a little."""
        inside = {*self.landmarks()}
        nearly = [q for angles in self._landmarks() for q in self.limits.nearly(angles)]
        return [q for q in nearly if q not in inside]

    def _landmarks(self) -> list[Angles]:
        found = self.over_first(np.array(self.limits.values(0), dtype=np.float64))
        singular = self.geometry.singular
        for value in (*self.limits.values(1), singular, singular + math.pi):
            found += self._at_second(value)
        for value in self.limits.values(2):
            found += self._at_third(value)
        return found

    def over_first(self, first: FloatArray) -> list[Angles]:
        """Postures at values of θ1 (m,) [rad]; limits not looked at."""
        return [(x, y, z) for q in self.sheets(first, _ROOT_TOLERANCE) for x, y, z in q.T.tolist()]

    def _at_second(self, second: float) -> Iterator[Angles]:
        first_axis, second_axis, third_axis = self.geometry.axes
        along = turned(third_axis, second_axis, second)
        for first in roots(*circle(first_axis, along, self.aim), dot(third_axis, self.hand)):
            start = turned(turned(self.aim, first_axis, -first), second_axis, -second)
            still = norm(cross(third_axis, self.hand)) < _STILL
            yield first, second, self.limits.rest(2) if still else angle_about(third_axis, self.hand, start)

    def _at_third(self, third: float) -> Iterator[Angles]:
        first_axis, second_axis, third_axis = self.geometry.axes
        hand = turned(self.hand, third_axis, third)
        for first in roots(*circle(first_axis, second_axis, self.aim), dot(second_axis, hand)):
            aim = turned(self.aim, first_axis, -first)
            still = norm(cross(second_axis, hand)) < _STILL
            yield first, self.limits.rest(1) if still else angle_about(second_axis, hand, aim), third

    def sheets(self, first: FloatArray, tolerance: float = _ROUNDING) -> list[FloatArray]:
        """Both postures at each of many values of θ1.

        Args:
            first: (m,) θ1 [rad].
            tolerance: how far beyond the range of a cosine a value still counts as its end; with more than
                rounding the postures may miss the target, and need a look.

        Returns:
            Twice (3, k) joint angles [rad], for those k of the values that have a posture; limits not
            looked at.
        """
        w1, w2, w3 = self.geometry.axes
        c1, s1 = half_angle_cos_sin(first)
        a, b, c = circle(w1, w2, self.aim)
        u2 = a + b * c1 + c * s1
        a, b, c = circle(w3, self.hand, w2)
        size, middle = math.hypot(b, c), math.atan2(c, b)
        reached = np.flatnonzero(np.abs(u2 - a) <= size + tolerance)
        first, c1, s1, u2 = first[reached], c1[reached], s1[reached], u2[reached]
        if size <= _STILL:
            rest = np.full(first.shape, self.limits.rest(2))
            ways = [(rest, np.cos(rest), np.sin(rest))]
        else:
            x = np.clip((u2 - a) / size, -1.0, 1.0)
            away, across = np.arccos(x), np.sqrt((1.0 - x) * (1.0 + x))
            cm, sm = b / size, c / size
            ways = [
                (middle + away, cm * x - sm * across, sm * x + cm * across),
                (middle - away, cm * x + sm * across, sm * x - cm * across),
            ]
        a, b, c = circle(w1, w3, self.aim)
        u3 = a + b * c1 + c * s1
        a, b, c = circle(w1, cross(w2, w3), self.aim)
        u = (u2, u3, a + b * c1 + c * s1)
        return [np.stack([first, self._second(c3, s3, u), third]) for third, c3, s3 in ways]

    def _second(
        self, c3: FloatArray, s3: FloatArray, u: tuple[FloatArray, FloatArray, FloatArray]
    ) -> FloatArray:
        """θ2 that turns Rot(w3, θ3) v onto u; given cos θ3, sin θ3 and u along w2, w3, w2 x w3, all (k,)."""
        _, w2, w3 = self.geometry.axes
        k, height = dot(w2, w3), dot(w3, self.hand)
        level = plus(self.hand, w3, -height)
        ahead, beside = dot(level, w2), dot(level, cross(w2, w3))
        u2, u3, across = u
        # Rot(w3, θ3) v along w2 and along w2 x w3, then as x2 w2 + x3 w3 + y (w2 x w3)
        x = k * height + ahead * c3 + beside * s3
        square = 1.0 - k * k
        y = (beside * c3 - ahead * s3) / square
        x2, x3 = (x - k * height) / square, (height - k * x) / square
        sine = x3 * across + y * (k * u2 - u3)
        cosine = x2 * u2 + x3 * u3 + y * across - x * u2
        return np.arctan2(sine, cosine)


def shoulder_angles(geometry: SphericalShoulder, rotation: Quaternion) -> list[Angles]:
    """The two ways in which the shoulder joints make a rotation; none where they cannot.

    With r = R w3, the axes w1, w2 and Rot(w2, θ2) w3 span a spherical triangle whose third side is the
    angle between w1 and r; the half-angle formula for θ2 keeps its digits near the singular poses.
    """
    w1, w2, w3 = geometry.axes
    r = rotated(rotation, w3)
    side, first, second = angle_between(w1, r), angle_between(w1, w2), angle_between(w2, w3)
    wide = math.sin(0.5 * (side + first - second)) * math.sin(0.5 * (side - first + second))
    close = math.sin(0.5 * (first + second + side)) * math.sin(0.5 * (first + second - side))
    if min(wide, close) < -_ROOT_TOLERANCE:
        return []
    away = 2.0 * math.atan2(math.sqrt(max(0.0, wide)), math.sqrt(max(0.0, close)))
    found: list[Angles] = []
    for turn in (away, -away) if away > 0.0 else (0.0,):
        theta2 = geometry.singular + turn
        theta1 = angle_about(w1, turned(w3, w2, theta2), r)
        left = product(about(w2, -theta2), product(about(w1, -theta1), rotation))
        found.append((theta1, theta2, turn_about(left, w3)))
    return found
