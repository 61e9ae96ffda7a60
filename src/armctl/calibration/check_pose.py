"""The pose for looking at the arm once it is calibrated: right angles that the eye can judge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.link_frames import LinkFrames
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_QUARTER = math.pi / 2
_CLEAR_M = 0.01
_MOST = 20_000
"""of the configurations that are looked at"""


@dataclass(frozen=True, slots=True)
class CheckPose:
    """A configuration to look at, and what must be seen."""

    title: str
    q: FloatArray
    """(n,) [rad]"""
    words: tuple[str, ...]
    """the angle of each joint and the place of the tool"""


def check_pose(robot: Robot) -> CheckPose:
    """The pose nearest to home with every joint at a multiple of 90°; home where there is none.

    It is inside the limits, clear of the floor, of the arm itself and of its obstacles; the way there is
    for pre-flight to judge.

    Args:
        robot: calibrated.
    """
    home = robot.pose("home")
    right = _right_angles(robot)
    clear = right[_clear(robot, right)] if len(right) else right
    if len(clear):
        away = np.abs(clear - home) / robot.speed_limits
        return _described(robot, "right angles", clear[int(np.argmin(away.sum(axis=1)))])
    return _described(robot, "home", home)


def _right_angles(robot: Robot) -> FloatArray:
    """Every configuration of quarter turns inside the limits: (k, n) [rad]; none where a joint has none."""
    choices: list[list[float]] = []
    for low, high in robot.limits.tolist():
        first, last = math.ceil(low / _QUARTER - 1e-9), math.floor(high / _QUARTER + 1e-9)
        choices.append([min(max(k * _QUARTER, low), high) for k in range(first, last + 1)])
    if not 0 < math.prod(map(len, choices)) <= _MOST:
        return np.empty((0, robot.n))
    return np.array(list(product(*choices)), dtype=np.float64)


def _clear(robot: Robot, q: FloatArray) -> NDArray[np.bool_]:
    """Which of the configurations (k, n) touch nothing."""
    above = robot.frames(q)[:, 1:, 2, 3].min(axis=1) > robot.floor_z + _CLEAR_M
    links = LinkFrames.at(robot.chain, q)
    for gaps in (robot.collision.gaps(links), robot.collision.gaps_to(robot.obstacles, links)):
        if gaps.size:
            above &= gaps.reshape(-1, len(q)).min(axis=0) > 0
    return above


def _described(robot: Robot, title: str, q: FloatArray) -> CheckPose:
    x, y, z = (1000 * robot.forward(q)[:3, 3]).tolist()
    words = [
        f"{joint.title} at {angle + 0.0:.1f}°"
        for joint, angle in zip(robot.joints, np.degrees(q).round(3).tolist(), strict=True)
    ]
    return CheckPose(title, q, (*words, f"the tool at x {x:.1f}, y {y:.1f}, z {z:.1f} mm from the base"))
