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

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, half_angle_cos_sin, images, rest_angle
from armctl.kinematics.samples import grid_values
from armctl.kinematics.spherical_shoulder.geometry import (
    Quaternion,
    SphericalShoulder,
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

# Shoulder joint angles inside their limits.

BoolArray = NDArray[np.bool_]
Angles = tuple[float, float, float]
"""θ1, θ2, θ3 [rad]"""
_NEARLY = 1e-5
"""how far outside a limit an angle may lie that rounding alone has put there [rad]: near a singular pose
1e-16 of the tip are 1e-8 rad and more"""
_ROUNDING = 1e-12
"""an angle clipped by less than this is as good as inside [rad]"""
_CLIPPED = 5e-10
"""how far from the target clipping by up to ``LIMIT_TOLERANCE`` may take the tip (unit vectors)"""
_UNFELT = 1e-10
"""how far from the target anything else may (unit vectors)"""


@dataclass(frozen=True, slots=True)
class ShoulderLimits:
    """Limits of the three shoulder joints."""

    pairs: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    """lower and upper [rad]"""

    @classmethod
    def of(cls, limits: FloatArray) -> ShoulderLimits:
        """From the joint limits (n, 2) of the arm [rad]."""
        first, second, third = ((float(low), float(high)) for low, high in limits[:3])
        return cls((first, second, third))

    def values(self, joint: int) -> list[float]:
        """Where |θ| of a joint has an end or a kink: its limits, and zero if that is inside [rad]."""
        low, high = self.pairs[joint]
        return [low, high, *((0.0,) if low < 0.0 < high else ())]

    def rest(self, joint: int) -> float:
        """The angle nearest to zero [rad]."""
        return rest_angle(*self.pairs[joint])

    def inside(
        self, angles: Angles, axes: tuple[Vector, Vector, Vector], hand: Vector, aim: Vector
    ) -> list[Angles]:
        """Every set of equal angles inside the limits, clipped onto them.

        Clipping by more than rounding is right only where the tip does not feel it: near a singular pose.
        There, too, a candidate may miss the target, and is dropped.

        Args:
            angles: candidate that turns ``hand`` onto ``aim`` [rad].
            axes: of the three joints.
            hand: unit vector from the shoulder to the tip, joints at zero.
            aim: unit vector from the shoulder to the target.
        """
        found: list[Angles] = []
        for first, second, third in self.nearly(angles):
            clipped = max(
                abs(math.remainder(kept - angle, TWO_PI))
                for kept, angle in zip((first, second, third), angles, strict=True)
            )
            tip = turned(turned(turned(hand, axes[2], third), axes[1], second), axes[0], first)
            allowed = _CLIPPED if _ROUNDING < clipped <= LIMIT_TOLERANCE else _UNFELT
            if norm(plus(tip, aim, -1.0)) > allowed:
                continue
            found.append((first, second, third))
        return found

    def nearly(self, angles: Angles) -> list[Angles]:
        """Every set of equal angles inside the limits or barely outside, clipped; the tip not looked at."""
        first, second, third = (
            images(angle, *pair, _NEARLY) for angle, pair in zip(angles, self.pairs, strict=True)
        )
        return list(itertools.product(first, second, third))

    def inside_arrays(self, joint: int, angles: FloatArray) -> list[tuple[FloatArray, BoolArray]]:
        """Images of angles (m,) of one joint, clipped onto its limits, and which of them are inside.

        One entry a whole turn of the joint's range.
        """
        low, high = self.pairs[joint]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        near = angles - TWO_PI * np.rint((angles - middle) / TWO_PI)
        more = max(0, math.ceil((half - math.pi) / TWO_PI))
        out: list[tuple[FloatArray, BoolArray]] = []
        for k in range(-more, more + 1):
            image = near + TWO_PI * k if k else near
            out.append((np.clip(image, low, high), np.abs(image - middle) <= half + 0.1 * LIMIT_TOLERANCE))
        return out


_ROOT_TOLERANCE = 1e-10
"""how far rounding, of a nearly straight elbow too, may carry ``k`` beyond ``A + B cos x + C sin x``, of unit
vectors; what then misses the target is dropped by the look at the tip"""
_SHEET_ROUNDING = 1e-15
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

    def sheets(self, first: FloatArray, tolerance: float = _SHEET_ROUNDING) -> list[FloatArray]:
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


# The sweep of the first shoulder joint: every swivel posture on its grid.

_CHUNK = 8192
"""values at a time: temporaries that stay in the processor's cache"""


def sweep(postures: list[tuple[float, Swivel]], step: float) -> FloatArray:
    """Every posture inside the limits with the first joint on its grid.

    Args:
        postures: elbow angles inside their limits [rad], each with its swivel.
        step: of the grid [rad].

    Returns:
        (4, k) shoulder joints and elbow [rad].

    Raises:
        InputError: see ``grid_values``.
    """
    parts: list[FloatArray] = [np.empty((4, 0))]
    for elbow, swivel in postures:
        grid = grid_values(*swivel.limits.pairs[0], step)
        for at in range(0, len(grid), _CHUNK):
            for q in swivel.sheets(grid[at : at + _CHUNK]):
                parts += _inside(swivel, q, elbow)
    return np.concatenate(parts, axis=1)


def _inside(swivel: Swivel, q: FloatArray, elbow: float) -> Iterator[FloatArray]:
    """Postures (3, m) as configurations (4, k) inside the limits, one entry a whole turn of the joints."""
    for third, third_inside in swivel.limits.inside_arrays(2, q[2]):
        for second, second_inside in swivel.limits.inside_arrays(1, q[1]):
            kept = np.flatnonzero(second_inside & third_inside)
            part = np.empty((4, len(kept)))
            part[0], part[1], part[2], part[3] = q[0, kept], second[kept], third[kept], elbow
            yield part


# The exact least rotation: min Σ|θ| over the continuum of swivel postures.
#
# Between the points where a joint passes zero the sum is smooth, so a minimum lies where a joint is at a
# limit or at zero (the swivel's landmarks), or where the sum is stationary along the swivel. The swivel
# turns the arm about t, which the shoulder joints do at the rates ``J⁻¹ t``, J = (j1, j2, j3) their axes.
# With e_k = ±1 the senses of |θ_k| the sum is stationary where
#
#     t · (e1 j2 x j3 + e2 j3 x j1 + e3 j1 x j2) = 0
#
# With u = Rot(w1, -θ1) t this and the posture itself, ``u · Rot(w2, θ2) w3 = w3 · v``, are both of the form
# ``P + Q cos θ2 + T sin θ2 = 0``, P, Q and T being of the first degree in cos θ1 and sin θ1. To have a
# common θ2 they need ``(P T' - P' T)² + (Q P' - Q' P)² = (Q T' - Q' T)²``: a polynomial of degree 8 in
# exp(i θ1), whose roots are eigenvalues.

_DEGREE = 4
_SAMPLES = 16
_ON_CIRCLE = 1e-2
"""how far off the unit circle a root may lie, for rounding splits a double one: one too many is harmless"""


def least_rotation(postures: Iterable[tuple[float, Swivel]]) -> FloatArray | None:
    """The configuration of least Σ|θ|.

    Args:
        postures: elbow angles inside their limits [rad], each with its swivel.

    Returns:
        (4,) shoulder joints and elbow [rad], or None when no posture is inside the limits.
    """
    best, best_energy = None, math.inf
    for elbow, swivel in postures:
        for angles in itertools.chain(swivel.landmarks(), _stationary(swivel)):
            energy = abs(angles[0]) + abs(angles[1]) + abs(angles[2]) + abs(elbow)
            if energy < best_energy:
                best, best_energy = (*angles, elbow), energy
    return None if best is None else np.array(best)


def _stationary(swivel: Swivel) -> list[Angles]:
    """Postures inside the limits at which the sum may be stationary."""
    w1, w2, w3 = swivel.geometry.axes
    first = np.linspace(0.0, 2.0 * math.pi, _SAMPLES, endpoint=False)
    c, s = np.cos(first), np.sin(first)
    k, across = dot(w2, w3), cross(w2, w3)
    level = plus(w3, w2, -k)

    def along(axis: Vector) -> FloatArray:
        a, b, d = circle(w1, axis, swivel.aim)
        return a + b * c + d * s

    u2 = along(w2)
    P, Q, T = k * u2 - dot(w3, swivel.hand), along(level), along(across)
    u12, beside = along(cross(w1, w2)), along(cross(w2, across))
    level1, across1 = along(cross(level, w1)), along(cross(across, w1))
    firsts: list[FloatArray] = []
    for e2, e3 in itertools.product((1.0, -1.0), repeat=2):  # e1 = 1: a common sign does not matter
        P1, Q1, T1 = (e3 - e2 * k) * u12, T + e2 * level1, beside + e2 * across1
        value = (P * T1 - P1 * T) ** 2 + (Q * P1 - Q1 * P) ** 2 - (Q * T1 - Q1 * T) ** 2
        firsts.append(_zeros(value))
    return swivel.inside(swivel.over_first(np.concatenate(firsts)))


def _zeros(value: FloatArray) -> FloatArray:
    """Angles [rad] of the zeros of a trigonometric polynomial of degree 4 from its 16 samples."""
    spectrum = np.fft.fft(value)
    coefficients = spectrum[np.arange(_DEGREE, -_DEGREE - 1, -1)]  # highest power of exp(i x) first
    size = np.abs(coefficients).max()
    if size == 0.0:
        return np.empty(0)
    z = np.roots(coefficients / size)
    angles: FloatArray = np.arctan2(z.imag, z.real).astype(np.float64)
    return angles[np.abs(np.abs(z) - 1.0) < _ON_CIRCLE]
