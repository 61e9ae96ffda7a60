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
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    TWO_PI,
    central_images,
    images,
    quaternion_product,
    quaternion_wxyz,
    rest_angle,
    rotation_angle,
    trigonometric_zeros,
)
from armctl.kinematics.chain import Chain
from armctl.kinematics.families.spherical_shoulder.geometry import (
    ROOT_TOLERANCE,
    SphericalShoulder,
    shoulder_angles,
    turn_about,
)
from armctl.kinematics.families.whole_pose import turned_onto
from armctl.kinematics.samples import grid_values
from armctl.kinematics.subproblems import (
    Circle,
    across,
    angle_about,
    circle,
    roots,
    turn,
    turned,
)
from armctl.kinematics.target import elevation
from armctl.lazy_dataclass import dataclass

_NEARLY = 1e-5
"""how far outside a limit an angle may lie that rounding alone has put there [rad]: near a singular pose
1e-16 of the tip are 1e-8 rad and more"""
_ROUNDING = 1e-12
"""an angle clipped by less than this is as good as inside [rad]"""
_CLIPPED = 5e-10
"""how far from the target clipping by up to ``LIMIT_TOLERANCE`` may take the tip (unit vectors)"""
_UNFELT = 1e-10
"""how far from the target anything else may (unit vectors)"""

_SHEET_ROUNDING = 1e-15
"""the same for what nobody looks at"""
_ZEROS = (0.0, 0.0, 0.0)
_GIMBAL = 1e-6
"""how nearly parallel the first and the third axis may be before their turns are told apart poorly (sine)"""


@dataclass(frozen=True, eq=False)
class Swivel:
    """The circle of postures of one arm for one elbow angle and one target. Postures are rows θ1, θ2, θ3."""

    geometry: SphericalShoulder
    limits: FloatArray
    """(3, 2) of the shoulder joints [rad]"""
    elbow: float
    """θ4 [rad]"""
    hand: FloatArray
    """(3,) v, unit"""
    aim: FloatArray
    """(3,) t, unit"""

    @classmethod
    def of(
        cls, geometry: SphericalShoulder, limits: FloatArray, elbow: float, hand: FloatArray, aim: FloatArray
    ) -> Swivel:
        """From the directions of the tip (joints at zero) and of the target; lengths do not matter."""
        return cls(geometry, limits[:3], elbow, hand / np.linalg.norm(hand), aim / np.linalg.norm(aim))

    @cached_property
    def base(self) -> FloatArray:
        """(3, 3) R_min: the shortest turn of v onto t."""
        return _shortest_turn(self.hand, self.aim)

    def at(self, phi: FloatArray | float) -> FloatArray:
        """Postures (k, 3) inside the limits at swivel angles (...) [rad]."""
        rotation = turn(self.aim, np.atleast_1d(phi)) @ self.base
        return self.inside(shoulder_angles(self.geometry, rotation))

    def by_angle(self, phi: FloatArray) -> tuple[FloatArray, FloatArray]:
        """All postures (k, 3) at swivel angles (m,) [rad], whatever the limits, and the angle of each."""
        q = shoulder_angles(self.geometry, turn(self.aim, phi) @ self.base)
        reached = np.isfinite(q).all(axis=1)
        return np.tile(phi, 2)[reached], q[reached]

    def by_first(self, first: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As ``by_angle``, at values of θ1 (m,) [rad]."""
        q = np.concatenate(self.with_joint(0, first, _SHEET_ROUNDING))
        return q[:, 0], q

    def is_singular_at(self, phi: FloatArray | float) -> bool:
        """True where the first and the third shoulder axis are parallel, or nearly, at any of the angles."""
        first, _, third = self.geometry.axes[:3]
        along = turn(self.aim, np.atleast_1d(phi)) @ self.base @ third
        return bool((np.linalg.norm(along @ across(first), axis=-1) < _GIMBAL).any())

    def with_elbow(self, q: FloatArray) -> FloatArray:
        """Postures (k, 3) with θ4 (k, 4)."""
        return np.column_stack([q, np.full(len(q), self.elbow)])

    def images(self, q: FloatArray, tolerance: float, kept: int = 0) -> tuple[FloatArray, FloatArray]:
        """All equal angles (k, 3) of postures (m, 3) that are outside the limits by no more than a tolerance.

        And the same clipped onto the limits. The angles of the first ``kept`` joints stay as they are.
        """
        low, high = self.limits.T
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        near = central_images(q, low, high)
        more = np.ceil(np.maximum(0.0, half + tolerance - math.pi - LIMIT_TOLERANCE) / TWO_PI).astype(int)
        near[:, :kept], more[:kept] = q[:, :kept], 0
        turns = itertools.product(*(range(-k, k + 1) for k in more.tolist()))
        image = np.concatenate([near + TWO_PI * np.array(k) for k in turns])
        image = image[(np.abs(image - middle) <= half + tolerance).all(axis=1)]
        return image, np.clip(image, low, high)

    def inside(self, q: FloatArray) -> FloatArray:
        """Those of postures (m, 3) inside the limits, with all equal angles (k, 3)."""
        kept, met = self._met(q)
        return kept[met]

    def _met(self, q: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Equal angles of (m, 3), clipped onto the limits (k, 3), and which of them meet the target (k,)."""
        image, kept = self.images(q, _NEARLY)
        clipped = np.abs(kept - image).max(axis=1, initial=0.0)
        tip = self.hand
        for joint in (2, 1, 0):
            tip = turned(tip, self.geometry.axes[joint], kept[:, joint])
        allowed = np.where((clipped > _ROUNDING) & (clipped <= LIMIT_TOLERANCE), _CLIPPED, _UNFELT)
        return kept, np.linalg.norm(tip - self.aim, axis=-1) <= allowed

    def landmarks(self, kinks: Sequence[float] = _ZEROS) -> FloatArray:
        """Postures (k, 3) inside the limits with a joint at a limit, at its kink or where two ways meet.

        The kinks [rad] are zero unless others are given.
        """
        return self.inside(self._landmarks if kinks is _ZEROS else self._landmarks_of(kinks))

    def brushing(self) -> FloatArray:
        """Landmarks barely outside the limits, clipped onto them: they miss the target by a little."""
        kept, met = self._met(self._landmarks)
        return kept[~met]

    @cached_property
    def _landmarks(self) -> FloatArray:
        return self._landmarks_of(_ZEROS)

    def _landmarks_of(self, kinks: Sequence[float]) -> FloatArray:
        singular = self.geometry.singular
        found: list[FloatArray] = []
        for joint, ((low, high), at) in enumerate(zip(self.limits.tolist(), kinks, strict=True)):
            kink = [at] if low < at < high else []
            meeting = [singular, singular + math.pi] if joint == 1 else []
            found += self.with_joint(joint, np.array([low, high, *kink, *meeting]))
        return np.concatenate(found)

    def with_joint(
        self, joint: int, values: FloatArray, tolerance: float = ROOT_TOLERANCE
    ) -> list[FloatArray]:
        """Both postures (k, 3) for those k of some values (m,) [rad] of one joint that have any.

        The limits are not looked at; with a ``tolerance`` (``roots``) they may miss the target.
        """
        w1, w2, w3 = self.geometry.axes[:3]
        rest = [rest_angle(low, high) for low, high in self.limits.tolist()]
        first = second = third = values
        if joint == 0:
            aim = turned(self.aim, w1, -first)
            third = roots(circle(w3, self.hand, w2), aim @ w2, tolerance, rest[2])
            second = angle_about(w2, turned(self.hand, w3, third), aim, rest[1])
        elif joint == 1:
            first = roots(circle(w1, turned(w3, w2, second), self.aim), w3 @ self.hand, tolerance)
            aim = turned(turned(self.aim, w1, -first), w2, -second)
            third = angle_about(w3, self.hand, aim, rest[2])
        else:
            hand = turned(self.hand, w3, third)
            first = roots(circle(w1, w2, self.aim), hand @ w2, tolerance)
            second = angle_about(w2, hand, turned(self.aim, w1, -first), rest[1])
        q = np.stack(np.broadcast_arrays(first, second, third), axis=-1)
        return [way[np.isfinite(way).all(axis=1)] for way in q]


def _shortest_turn(start: FloatArray, end: FloatArray) -> FloatArray:
    """(3, 3) the least rotation that brings one unit vector onto another."""
    if start @ end < -0.5:  # first half a turn: 1 + start · end loses its digits near -1
        sideways = across(start) @ np.eye(3)[np.abs(start).argmin()]
        return _shortest_turn(-start, end) @ turn(sideways / np.linalg.norm(sideways), math.pi)
    K = across(across(start) @ end)
    return np.eye(3) + K + K @ K / (1.0 + start @ end)


_CHUNK = 8192
"""values of the swept joint at a time: temporaries that stay in the processor's cache"""


def sweep(swivels: Sequence[Swivel], step: float) -> FloatArray:
    """Every posture inside the limits with the first joint on its grid: (k, 4) with the elbow [rad]."""
    parts = [np.empty((0, 4))]
    for swivel in swivels:
        low, high = swivel.limits[0].tolist()
        grid = grid_values(low, high, step)
        for at in range(0, len(grid), _CHUNK):
            for q in swivel.with_joint(0, grid[at : at + _CHUNK], _SHEET_ROUNDING):
                parts.append(swivel.with_elbow(swivel.images(q, 0.1 * LIMIT_TOLERANCE, kept=1)[1]))
    return np.concatenate(parts)


# The exact least rotation: min Σ|θ| over the continuum of swivel postures.
#
# Between the points where a joint passes zero the sum is smooth, so a minimum lies where a joint is at a
# limit or at zero (the swivel's landmarks), or where the sum is stationary along the swivel. The swivel
# turns the arm about t, which the shoulder joints do at the rates ``J⁻¹ t``, J = (j1, j2, j3) their axes.
# With e_k = ±1 the senses of |θ_k|, times the weights of a weighted sum, the sum is stationary where
#
#     t · (e1 j2 x j3 + e2 j3 x j1 + e3 j1 x j2) = 0
#
# With u = Rot(w1, -θ1) t this and the posture itself, ``u · Rot(w2, θ2) w3 = w3 · v``, are both of the form
# ``P + Q cos θ2 + T sin θ2 = 0``, P, Q and T being of the first degree in cos θ1 and sin θ1. To have a
# common θ2 they need ``(P T' - P' T)² + (Q P' - Q' P)² = (Q T' - Q' T)²``: a polynomial of degree 8 in
# exp(i θ1), whose roots are eigenvalues.

_DEGREE = 4
_SAMPLES = 16


def least_rotation(swivels: Sequence[Swivel]) -> FloatArray | None:
    """(4,) the posture and elbow [rad] of least Σ|θ|, or None when no posture is inside the limits."""
    q = least_candidates(swivels)
    return q[np.abs(q).sum(axis=1).argmin()] if len(q) else None


def least_candidates(
    swivels: Sequence[Swivel], start: Sequence[float] = _ZEROS, weights: Sequence[float] = (1.0, 1.0, 1.0)
) -> FloatArray:
    """Postures (k, 4) with the elbow among which Σ weight · |θ - start| is least, [rad] and positive."""
    parts = [np.empty((0, 4))]
    for swivel in swivels:
        parts.append(swivel.with_elbow(np.vstack([swivel.landmarks(start), _stationary(swivel, weights)])))
    return np.concatenate(parts)


def _stationary(swivel: Swivel, weights: Sequence[float]) -> FloatArray:
    """Postures (k, 3) inside the limits at which the sum may be stationary."""
    w1, w2, w3 = swivel.geometry.axes[:3]
    u = turned(swivel.aim, w1, np.linspace(0.0, -TWO_PI, _SAMPLES, endpoint=False))
    k, beside = w2 @ w3, across(w2) @ w3
    level = w3 - k * w2
    P, Q, T = k * (u @ w2) - w3 @ swivel.hand, u @ level, u @ beside
    firsts: list[FloatArray] = []
    # e1 = 1: a common factor does not matter
    for e2, e3 in itertools.product(*((weight / weights[0], -weight / weights[0]) for weight in weights[1:])):
        P1 = (e3 - e2 * k) * (u @ (across(w1) @ w2))
        Q1 = T + e2 * (u @ (across(level) @ w1))
        T1 = u @ (across(w2) @ beside + e2 * (across(beside) @ w1))
        values = (P * T1 - P1 * T) ** 2 + (Q * P1 - Q1 * P) ** 2 - (Q * T1 - Q1 * T) ** 2
        firsts.append(trigonometric_zeros(values, _DEGREE))
    return swivel.inside(np.concatenate(swivel.with_joint(0, np.concatenate(firsts))))


# Orientation along a swivel: the posture and roll nearest to a rotation, and postures at a given pitch.
#
# With a half the swivel angle phi and b half the roll, the tool's quaternion is bilinear in (cos a, sin a)
# and (cos b, sin b), and so is its inner product with the one asked for,
#
#     ½ [(Q11 + Q22) cos(a - b) + (Q21 - Q12) sin(a - b) + (Q11 - Q22) cos(a + b) + (Q21 + Q12) sin(a + b)]
#
# which is largest where each half of the sum is: exact. With the roll given only a is left. The approach
# axis has the elevation ``sin(pitch) = A + B cos phi + C sin phi``: two roots.

_AS_GOOD = 1e-7
"""how much farther from the pitch asked for a posture may be than the best one [rad]"""
_AS_NEAR = 5e-10
"""the same for a rotation"""
_ALIKE = 1e-6
"""where the nearest rotation depends on swivel or roll by less than this, either makes up for the other"""
_UP = np.array([0.0, 0.0, 1.0])
_Bilinear = tuple[float, float, float, float]
"""Q11, Q12, Q21, Q22"""


class ToolOrientation:
    """Orientations that one arm takes inside its limits. Immutable; safe in several threads.

    Postures are (k, 5): the shoulder joints, the elbow and the roll, 0 where the arm has no roll joint.
    """

    def __init__(
        self,
        chain: Chain,
        geometry: SphericalShoulder,
        limits: FloatArray,
        roll_limits: tuple[float, float] | None,
    ) -> None:
        self._chain, self._geometry, self._limits = chain, geometry, limits
        self._roll_limits = roll_limits

    def nearest(self, swivels: Sequence[Swivel], pose: FloatArray) -> FloatArray:
        """Every posture inside the limits that comes nearest to the rotation of a pose (4, 4), best first."""
        rotation = pose[:3, :3]
        forms = [self._bilinear(swivel, rotation) for swivel in swivels]
        best = [self._unhindered(swivel, form) for swivel, form in zip(swivels, forms, strict=True)]
        found = np.concatenate([np.empty((0, 5)), *(q for q, _ in best)])
        for swivel, form, (_, blind) in zip(swivels, forms, best, strict=True):
            # else nothing with this elbow angle comes as near, or only what was found
            if blind or self._misses(found, rotation).min(initial=math.inf) > _least_miss(*form) + _AS_NEAR:
                found = np.concatenate([found, self._hindered(swivel, rotation, form)])
        n = self._chain.n
        found[:, :n], misses = turned_onto(self._chain, self._limits, pose, found[:, :n])
        order = np.argsort(misses, kind="stable")
        return found[order[misses[order] <= misses.min(initial=math.inf) + _AS_NEAR]]

    def at_pitch(self, swivels: Sequence[Swivel], pitch: float, roll: float) -> FloatArray:
        """Postures inside the limits that hold the approach axis at a pitch, the roll joint at ``roll``."""
        found = [np.empty((0, 5))]
        for swivel in swivels:
            form = self._elevation(swivel, roll)
            phi = roots(form, math.sin(pitch), ROOT_TOLERANCE)
            phi = phi[np.isfinite(phi)]
            angles = swivel.at(phi)
            if math.hypot(*form[1:]) < _ALIKE or swivel.is_singular_at(phi) or len(angles) == 0:
                angles = np.concatenate([angles, swivel.landmarks()])
            found.append(_with_roll(swivel, angles, roll))
        q = np.concatenate(found)
        return q[np.abs(self.pitches(q) - elevation(pitch)) < _AS_GOOD]

    def pitch_ends(self, swivels: Sequence[Swivel], roll: float) -> FloatArray:
        """Postures among which are both ends of the pitches that the arm can hold."""
        found = [np.empty((0, 5))]
        for swivel in swivels:
            _, b, c = self._elevation(swivel, roll)
            top = np.arctan2(c, b)
            angles = np.concatenate([swivel.landmarks(), swivel.at(np.array([top, top + math.pi]))])
            found.append(_with_roll(swivel, angles, roll))
        return np.concatenate(found)

    def pitches(self, q: FloatArray) -> FloatArray:
        """Elevation (k,) [rad] of the approach axis in postures."""
        x, y, z = self._chain.forward(q[:, : self._chain.n])[:, :3, 2].T
        return np.arctan2(z, np.hypot(x, y))

    def _misses(self, q: FloatArray, rotation: FloatArray) -> FloatArray:
        """Angle (k,) [rad] between a rotation and that of the tool in postures."""
        tools = self._chain.forward(q[:, : self._chain.n])[:, :3, :3]
        return rotation_angle(np.swapaxes(tools, 1, 2) @ rotation)

    def _unhindered(self, swivel: Swivel, form: _Bilinear) -> tuple[FloatArray, bool]:
        """The best postures of one elbow angle inside the limits, and whether there may be more."""
        q11, q12, q21, q22 = form
        roll_limits = self._roll_limits
        if roll_limits is None or roll_limits[0] == roll_limits[1]:
            roll = 0.0 if roll_limits is None else roll_limits[0]
            along, across = _rolled(roll, q11, q12), _rolled(roll, q21, q22)
            phi, rolls, blind = 2.0 * math.atan2(across, along), [roll], math.hypot(along, across) < _ALIKE
        else:
            less, more = (q21 - q12, q11 + q22), (q21 + q12, q11 - q22)
            minus, plus = math.atan2(*less), math.atan2(*more)
            phi, rolls = minus + plus, images(plus - minus, *roll_limits)
            blind = min(math.hypot(*less), math.hypot(*more)) < _ALIKE
        angles = swivel.at(phi)
        best = [_with_roll(swivel, row[None], roll) for row in angles for roll in rolls]
        return np.concatenate([np.empty((0, 5)), *best]), blind or swivel.is_singular_at(phi)

    def _hindered(self, swivel: Swivel, rotation: FloatArray, form: _Bilinear) -> FloatArray:
        """Postures of one elbow angle that can be the best with a joint or the roll at a limit."""
        q11, q12, q21, q22 = form
        found = [np.empty((0, 5))]
        limits = self._roll_limits
        landmarks = _with_roll(swivel, swivel.landmarks(), 0.0)
        if limits is None:
            return landmarks
        for roll in (*limits, rest_angle(*limits)):
            half = math.atan2(_rolled(roll, q21, q22), _rolled(roll, q11, q12))
            found.append(_with_roll(swivel, swivel.at(2.0 * half), roll))
        # landmarks with the roll nearest to the rotation, or at its limits
        unrolled = self._chain.forward(landmarks)[:, :3, :3] @ self._geometry.tool.T
        left = np.swapaxes(unrolled, 1, 2) @ rotation @ self._geometry.tool.T
        for q, best in zip(landmarks, turn_about(left, self._geometry.axes[4]).tolist(), strict=True):
            found += [np.append(q[:4], roll)[None] for roll in images(best, *limits) or limits]
        return np.concatenate(found)

    def _bilinear(self, swivel: Swivel, rotation: FloatArray) -> _Bilinear:
        """Inner products of the quaternion asked for with the four that swivel and roll combine."""
        geometry = self._geometry
        wanted = quaternion_wxyz(rotation @ geometry.tool.T)
        arm = quaternion_wxyz(swivel.base @ geometry.beyond(swivel.elbow, 0.0))
        axis = geometry.axes[4] if len(geometry.axes) > 4 else np.zeros(3)
        roll = np.array([0.0, *axis])
        swung = quaternion_product(np.array([0.0, *swivel.aim]), arm)
        four = (arm, quaternion_product(arm, roll), swung, quaternion_product(swung, roll))
        q11, q12, q21, q22 = (float(wanted @ one) for one in four)
        return q11, q12, q21, q22

    def _elevation(self, swivel: Swivel, roll: float) -> Circle:
        """Sine of the pitch over the swivel angle as (A, B, C)."""
        approach = self._geometry.beyond(swivel.elbow, roll) @ self._geometry.tool[:, 2]
        return circle(swivel.aim, swivel.base @ approach, _UP)


def _with_roll(swivel: Swivel, angles: FloatArray, roll: float) -> FloatArray:
    """Shoulder joints (k, 3) with elbow and roll (k, 5)."""
    return np.column_stack([swivel.with_elbow(angles), np.full(len(angles), roll)])


def _rolled(roll: float, straight: float, rolled: float) -> float:
    """One half of the bilinear form at a roll angle [rad]."""
    return straight * math.cos(0.5 * roll) + rolled * math.sin(0.5 * roll)


def _least_miss(q11: float, q12: float, q21: float, q22: float) -> float:
    """The least angle from the rotation asked for that any swivel and any roll leave [rad]."""
    most = 0.5 * (math.hypot(q11 + q22, q21 - q12) + math.hypot(q11 - q22, q21 + q12))
    return 2.0 * math.acos(min(1.0, most))
