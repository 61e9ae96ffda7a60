"""A joint: its limits, and the owner of what its value means and how it is shown and read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.facts import AngleLimit
from armctl.kinematics.angles import LIMIT_TOLERANCE

MOST_JOINTS = 64
"""no arm has more: solvers and checks take time and memory for each"""
JERK_UP_S = 0.05
"""Where nothing else is written, a joint reaches its largest acceleration in this time."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint, which turns: its values are radians inside, and degrees wherever people read or write them.

    A joint that slides would differ here, and in the chain: whoever shows or reads a value asks the joint.
    """

    unit: ClassVar[str] = "°"
    """of its values, as people read them"""

    name: str
    title: str
    lower: float
    upper: float
    speed: float
    """largest speed [rad/s]"""
    acceleration: float
    """largest acceleration [rad/s²]"""
    jerk: float
    """largest jerk [rad/s³]; kept by the profiles that know one (s-curve, quintic)"""
    stall_torque: float | None
    """[N·m]; None where the source gives none"""
    torque_is_effort: bool = False
    """True: that is the ``effort`` of a URDF file, which often is a placeholder and forbids nothing"""

    def shown(self, value: float) -> float:
        """A value as people count it."""
        return math.degrees(value)

    def read(self, shown: float) -> float:
        """The value of a number as people count it."""
        return math.radians(shown)

    def said(self, value: float, digits: int = 2) -> str:
        """A value with its unit, such as ``−12.50°``."""
        return f"{self.shown(value):.{digits}f}{self.unit}"


def beyond_limits(joints: Sequence[Joint], q: FloatArray) -> tuple[AngleLimit, ...]:
    """Which of the values (n,) are outside their limits."""
    return tuple(
        AngleLimit(joint.title, value, joint.lower, joint.upper)
        for joint, value in zip(joints, q.tolist(), strict=True)
        if not joint.lower - LIMIT_TOLERANCE <= value <= joint.upper + LIMIT_TOLERANCE
    )


def shown_values(joints: Sequence[Joint], q: ArrayLike) -> FloatArray:
    """Values (..., n) of all joints, or how much they change, as people count them."""
    return np.degrees(q)


def read_values(joints: Sequence[Joint], shown: ArrayLike) -> FloatArray:
    """The values (..., n) of numbers as people count them."""
    return np.radians(shown)
