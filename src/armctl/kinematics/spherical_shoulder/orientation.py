"""Orientation along a swivel: the posture and roll nearest to a rotation, and postures at a given pitch.

With a half the swivel angle phi and b half the roll, the tool's quaternion is bilinear in (cos a, sin a) and
(cos b, sin b), and so is its inner product with the one asked for,

    ½ [(Q11 + Q22) cos(a - b) + (Q21 - Q12) sin(a - b) + (Q11 - Q22) cos(a + b) + (Q21 + Q12) sin(a + b)]

which is largest where each half of the sum is: exact. With the roll given only a is left. The approach
axis has the elevation ``sin(pitch) = A + B cos phi + C sin phi``: two roots.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images, rest_angle
from armctl.kinematics.rotation import quaternion_wxyz
from armctl.kinematics.spherical_shoulder.geometry import (
    Quaternion,
    SphericalShoulder,
    about,
    circle,
    conjugate,
    product,
    rotated,
    turn_about,
    turn_of,
)
from armctl.kinematics.spherical_shoulder.swivel import Angles, Swivel, roots

_AS_GOOD = 1e-7
"""how much farther from the rotation or pitch asked for a posture may be than the best one [rad]"""
_ALIKE = 1e-6
"""where the nearest rotation depends on swivel or roll by less than this, either makes up for the other"""
_UP = (0.0, 0.0, 1.0)
_Bilinear = tuple[float, float, float, float]
"""Q11, Q12, Q21, Q22"""


@dataclass(frozen=True, slots=True)
class ToolPosture:
    """Shoulder joints, elbow and roll, and how far the tool is from what was asked for."""

    shoulder: Angles
    elbow: float
    roll: float
    """[rad]; 0 where the arm has no roll joint"""
    miss: float
    """angle from the rotation or pitch asked for [rad]"""


class ToolOrientation:
    """Orientations that one arm takes inside its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: SphericalShoulder, roll_limits: tuple[float, float] | None) -> None:
        self._geometry, self._roll_limits = geometry, roll_limits

    def wanted(self, rotation: FloatArray) -> Quaternion:
        """What shoulder, elbow and roll must turn by together to give the tool a rotation (3, 3)."""
        w, x, y, z = quaternion_wxyz(rotation).tolist()
        return product((w, x, y, z), conjugate(self._geometry.tool))

    def nearest(self, postures: list[tuple[float, Swivel]], wanted: Quaternion) -> list[ToolPosture]:
        """Every posture inside the limits that comes nearest to a rotation.

        Where the limits forbid the best one of an elbow angle, the nearest lies where they begin: with
        the roll at a limit, or with a shoulder joint at one.
        """
        forms = [self._bilinear(swivel, elbow, wanted) for elbow, swivel in postures]
        found: list[ToolPosture] = []
        blind: list[bool] = []
        for (elbow, swivel), form in zip(postures, forms, strict=True):
            best, ambiguous = self._unhindered(swivel, form)
            found += [self._tool_posture(angles, elbow, roll, wanted) for angles, roll in best]
            blind.append(ambiguous)
        for i, (elbow, swivel) in enumerate(postures):
            least, bound = _least(found), _least_miss(*forms[i])
            if not blind[i] and least <= bound + _AS_GOOD:
                continue  # with this elbow angle nothing comes as near, or only what was found
            hindered = self._hindered(swivel, elbow, wanted, forms[i])
            found += [self._tool_posture(angles, elbow, roll, wanted) for angles, roll in hindered]
        least = _least(found)
        return [posture for posture in found if posture.miss <= least + _AS_GOOD]

    def at_pitch(self, postures: list[tuple[float, Swivel]], pitch: float, roll: float) -> list[ToolPosture]:
        """Postures inside the limits that hold the approach axis at a pitch, the roll joint at ``roll``."""
        found: list[ToolPosture] = []
        for elbow, swivel in postures:
            a, b, c = self._elevation(swivel, elbow, roll)
            blind = math.hypot(b, c) < _ALIKE
            angles: list[Angles] = []
            for phi in roots(a, b, c, math.sin(pitch)):
                angles += swivel.at(phi)
                blind = blind or swivel.is_singular_at(phi)
            if blind or not angles:
                angles += swivel.landmarks()
            found += [self._pitched(triple, elbow, roll, pitch) for triple in angles]
        return [posture for posture in found if posture.miss < _AS_GOOD]

    def pitches(
        self, postures: list[tuple[float, Swivel]], pitch: float, roll: float
    ) -> list[tuple[float, ToolPosture]]:
        """The ends of the pitches [rad] that the arm can hold, each with its posture."""
        ends: list[tuple[float, ToolPosture]] = []
        for elbow, swivel in postures:
            _, b, c = self._elevation(swivel, elbow, roll)
            top = math.atan2(c, b)
            for angles in (*swivel.landmarks(), *swivel.at(top), *swivel.at(top + math.pi)):
                posture = self._pitched(angles, elbow, roll, pitch)
                ends.append((self._pitch(angles, elbow, roll), posture))
        return ends

    def _unhindered(self, swivel: Swivel, form: _Bilinear) -> tuple[list[tuple[Angles, float]], bool]:
        """The best postures and rolls of one elbow angle, where the limits allow them.

        And whether there may be more: where swivel and roll, or first and third joint, are interchangeable.
        """
        q11, q12, q21, q22 = form
        roll_limits = self._roll_limits
        if roll_limits is None or roll_limits[0] == roll_limits[1]:
            roll = 0.0 if roll_limits is None else roll_limits[0]
            along, across = _with_roll(roll, q11, q12), _with_roll(roll, q21, q22)
            phi, rolls, blind = 2.0 * math.atan2(across, along), [roll], math.hypot(along, across) < _ALIKE
        else:
            less, more = (q21 - q12, q11 + q22), (q21 + q12, q11 - q22)
            minus, plus = math.atan2(*less), math.atan2(*more)
            phi, rolls = minus + plus, images(plus - minus, *roll_limits)
            blind = min(math.hypot(*less), math.hypot(*more)) < _ALIKE
        best = [(angles, roll) for angles in swivel.at(phi) for roll in rolls] if rolls else []
        return best, blind or swivel.is_singular_at(phi)

    def _hindered(
        self, swivel: Swivel, elbow: float, wanted: Quaternion, form: _Bilinear
    ) -> Iterator[tuple[Angles, float]]:
        """Postures of one elbow angle that can be the best with a joint or the roll at a limit."""
        q11, q12, q21, q22 = form
        roll_limits = self._roll_limits
        if roll_limits is not None:
            for roll in (*roll_limits, rest_angle(*roll_limits)):
                half = math.atan2(_with_roll(roll, q21, q22), _with_roll(roll, q11, q12))
                for angles in swivel.at(2.0 * half):
                    yield angles, roll
        for angles in swivel.landmarks():
            for roll in self._rolls(angles, elbow, wanted):
                yield angles, roll

    def _rolls(self, angles: Angles, elbow: float, wanted: Quaternion) -> list[float]:
        """The roll nearest to a rotation with the other joints given, or the limits."""
        axis, limits = self._geometry.roll_axis, self._roll_limits
        if axis is None or limits is None:
            return [0.0]
        left = product(conjugate(self._turn(angles, elbow, 0.0)), wanted)
        return images(turn_about(left, axis), *limits) or list(limits)

    def _bilinear(self, swivel: Swivel, elbow: float, wanted: Quaternion) -> _Bilinear:
        """Inner products of the quaternion asked for with the four that swivel and roll combine."""
        arm = product(swivel.base, about(self._geometry.elbow_axis, elbow))
        swung = product((0.0, *swivel.aim), arm)
        axis = self._geometry.roll_axis
        if axis is None:
            return _inner(wanted, arm), 0.0, _inner(wanted, swung), 0.0
        roll = (0.0, *axis)
        return (
            _inner(wanted, arm),
            _inner(wanted, product(arm, roll)),
            _inner(wanted, swung),
            _inner(wanted, product(swung, roll)),
        )

    def _elevation(self, swivel: Swivel, elbow: float, roll: float) -> tuple[float, float, float]:
        """Sine of the pitch over the swivel angle as (A, B, C)."""
        start = rotated(product(swivel.base, self._beyond(elbow, roll)), self._geometry.tool_axis)
        return circle(swivel.aim, start, _UP)

    def _beyond(self, elbow: float, roll: float) -> Quaternion:
        """Turn of elbow and roll joint."""
        turn = about(self._geometry.elbow_axis, elbow)
        axis = self._geometry.roll_axis
        return turn if axis is None else product(turn, about(axis, roll))

    def _turn(self, angles: Angles, elbow: float, roll: float) -> Quaternion:
        turn = self._beyond(elbow, roll)
        for axis, angle in zip(self._geometry.axes[::-1], angles[::-1], strict=True):
            turn = product(about(axis, angle), turn)
        return turn

    def _tool_posture(self, angles: Angles, elbow: float, roll: float, wanted: Quaternion) -> ToolPosture:
        miss = turn_of(product(conjugate(self._turn(angles, elbow, roll)), wanted))
        return ToolPosture(angles, elbow, roll, miss)

    def _pitch(self, angles: Angles, elbow: float, roll: float) -> float:
        x, y, z = rotated(self._turn(angles, elbow, roll), self._geometry.tool_axis)
        return math.atan2(z, math.hypot(x, y))

    def _pitched(self, angles: Angles, elbow: float, roll: float, pitch: float) -> ToolPosture:
        asked = math.atan2(math.sin(pitch), abs(math.cos(pitch)))  # beyond ±90° the tool points back
        return ToolPosture(angles, elbow, roll, abs(self._pitch(angles, elbow, roll) - asked))


def _inner(p: Quaternion, q: Quaternion) -> float:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]


def _with_roll(roll: float, straight: float, rolled: float) -> float:
    """One half of the bilinear form at a roll angle [rad]."""
    return straight * math.cos(0.5 * roll) + rolled * math.sin(0.5 * roll)


def _least(found: list[ToolPosture]) -> float:
    return min((posture.miss for posture in found), default=math.inf)


def _least_miss(q11: float, q12: float, q21: float, q22: float) -> float:
    """The least angle from the rotation asked for that any swivel and any roll leave [rad]."""
    most = 0.5 * (math.hypot(q11 + q22, q21 - q12) + math.hypot(q11 - q22, q21 + q12))
    return 2.0 * math.acos(min(1.0, most))
