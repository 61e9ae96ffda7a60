"""The base angle: which way the tool's vertical plane can face so that it passes through the target."""

from __future__ import annotations

import math
from dataclasses import dataclass

from armctl.kinematics.angles import images
from armctl.kinematics.yaw_pitch_roll import YawPitchRoll

AXIS_TOLERANCE = 1e-10
"""How far inside the cylinder about the base axis a target may lie by rounding [m]."""


@dataclass(frozen=True, slots=True)
class BaseBranch:
    """One way for the base to face."""

    front: bool
    """True: the target lies in front of the arm; False: the arm reaches over its back"""
    angle: float
    """θ1 [rad]"""
    r: float
    """forward coordinate of the target in the tool plane [m], negative at the back"""


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
        the tool plane does. On the base axis itself (d = 0) any angle serves and 0 and 180° are given.
    """
    d = geometry.lateral
    rho = math.hypot(x, y)
    if rho < abs(d) - AXIS_TOLERANCE:
        return []
    r = math.sqrt(max(0.0, (rho - abs(d)) * (rho + abs(d))))
    azimuth = math.atan2(y, x)
    branches: list[BaseBranch] = []
    for front in (True, False):
        if not front and r == 0.0 and d != 0.0:
            continue  # both branches are the same one
        signed = r if front else -r
        turn = geometry.yaw_sign * (azimuth - math.atan2(d, signed))
        if limits is None:
            branches.append(BaseBranch(front, math.remainder(turn, 2 * math.pi), signed))
        else:
            branches += [BaseBranch(front, angle, signed) for angle in images(turn, *limits)]
    return branches
