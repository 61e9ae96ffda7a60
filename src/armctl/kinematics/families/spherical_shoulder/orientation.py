"""Orientation along a swivel: the posture and roll nearest to a rotation, and postures at a given pitch.

With a half the swivel angle phi and b half the roll, the tool's quaternion is bilinear in (cos a, sin a) and
(cos b, sin b), and so is its inner product with the one asked for,

    ½ [(Q11 + Q22) cos(a - b) + (Q21 - Q12) sin(a - b) + (Q11 - Q22) cos(a + b) + (Q21 + Q12) sin(a + b)]

which is largest where each half of the sum is: exact. With the roll given only a is left. The approach
axis has the elevation ``sin(pitch) = A + B cos phi + C sin phi``: two roots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images, quaternion_product, quaternion_wxyz, rest_angle, rotation_angle
from armctl.kinematics.chain import Chain
from armctl.kinematics.families.spherical_shoulder.geometry import SphericalShoulder
from armctl.kinematics.families.spherical_shoulder.swivel import ROOT_TOLERANCE, Swivel, turn_about
from armctl.kinematics.families.whole_pose import turned_onto
from armctl.kinematics.geometry.subproblems import Circle, circle, roots
from armctl.kinematics.target import elevation

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
