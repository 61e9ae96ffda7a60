"""The base angle: which way the tool's vertical plane can face so that it passes through the target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import images, rest_angle, wrap
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import into_limits

FloatArray = NDArray[np.float64]

AXIS_TOLERANCE = 1e-10
"""How far inside the cylinder about the base axis a target may lie by rounding [m]."""
_TOUCHING = 1e-15
"""How far outside it a target still lies on it [m]. The forward coordinate is a square root there: rounding
of 1e-17 m would put a joint that stands on its limit 1e-9 rad outside."""


class BaseBranch(NamedTuple):
    """One way for the base to face."""

    front: bool
    """True: the target lies in front of the arm; False: the arm reaches over its back"""
    angle: float
    """θ1 [rad]"""
    r: float
    """forward coordinate of the target in the tool plane [m], negative at the back"""


def is_on_axis(geometry: YawPitchRoll, x: float, y: float) -> bool:
    """True when any base angle serves: the target and the tool plane both lie on the base axis."""
    return abs(geometry.lateral) <= AXIS_TOLERANCE and math.hypot(x, y) <= AXIS_TOLERANCE


def base_branches(
    geometry: YawPitchRoll, x: float, y: float, limits: tuple[float, float] | None
) -> list[BaseBranch]:
    """Solve ``x + i y = exp(i s1 θ1) (r + i d)``.

    Args:
        geometry: the arm.
        x: target, forward of the base axis [m].
        y: target, left of the base axis [m].
        limits: of θ1 [rad]; None: any angle, one each way.

    Returns:
        The front branch before the back branch; none when the target lies closer to the base axis than
        the tool plane does. Where any angle serves, the one inside the limits that is nearest to zero is
        given, and its opposite.
    """
    d = geometry.lateral
    rho, aside = math.hypot(x, y), abs(d)
    gap = rho - aside
    if gap <= AXIS_TOLERANCE:
        if gap < -AXIS_TOLERANCE:
            return []
        if is_on_axis(geometry, x, y):
            straight = 0.0 if limits is None else rest_angle(*limits)
            return axis_branches((straight, straight + math.pi), limits)
    r = math.sqrt(gap * (rho + aside)) if gap > _TOUCHING else 0.0
    azimuth, lean, sign = math.atan2(y, x), math.atan2(d, r) if d else 0.0, geometry.yaw_sign
    branches = [BaseBranch(True, angle, r) for angle in _inside(sign * (azimuth - lean), limits)]
    if r:  # else both branches are the same one
        back = sign * (azimuth + lean - math.pi)
        branches += [BaseBranch(False, angle, -r) for angle in _inside(back, limits)]
    return branches


def axis_branches(turns: Sequence[float], limits: tuple[float, float] | None) -> list[BaseBranch]:
    """Branches for a target on the base axis, at the angles wanted [rad]: the first in front, others not."""
    return [BaseBranch(i == 0, angle, 0.0) for i, turn in enumerate(turns) for angle in _inside(turn, limits)]


def _inside(turn: float, limits: tuple[float, float] | None) -> list[float]:
    if limits is None:
        return [wrap(turn)]
    low, high = limits
    return images(turn, low, high)


def base_angles(
    geometry: YawPitchRoll, x: FloatArray, y: FloatArray, limits: tuple[float, float]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """``base_branches`` of many targets: the image inside the limits that is nearest to zero.

    Args:
        geometry: the arm.
        x: (k,) targets, forward of the base axis [m].
        y: (k,) targets, left of the base axis [m].
        limits: of θ1 [rad].

    Returns:
        θ1 [rad] in front and at the back (2, k); forward coordinates in the tool plane [m] (2, k); and
        where there is such a branch (2, k).
    """
    d = geometry.lateral
    square = x * x + y * y - d * d
    r = np.sqrt(np.where(square > 2.0 * _TOUCHING * abs(d), square, 0.0))
    azimuth = np.arctan2(y, x)
    aside = np.arctan2(d, r) if d else 0.0
    yaw = np.stack([azimuth - aside, azimuth + aside - math.pi])
    if geometry.yaw_sign < 0:
        np.negative(yaw, out=yaw)
    on_axis = np.flatnonzero(r <= AXIS_TOLERANCE)
    if abs(d) <= AXIS_TOLERANCE and len(on_axis):
        yaw[0, on_axis] = rest_angle(*limits)
        yaw[1, on_axis] = yaw[0, on_axis] + math.pi
    inside = into_limits(yaw, *limits)
    if d:  # closer to the axis than the tool plane; or both branches the same one
        inside &= square >= -2.0 * AXIS_TOLERANCE * abs(d)
        inside[1] &= r > 0.0
    return yaw, np.stack([r, -r]), inside
