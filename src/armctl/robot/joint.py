"""What moves in an arm: its joints and its gripper."""

from __future__ import annotations

from dataclasses import dataclass

JERK_UP_S = 0.05
"""Where nothing else is written, a joint reaches its largest acceleration in this time."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint, in radians."""

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


@dataclass(frozen=True, slots=True)
class Gripper:
    """The gripper as an opening from 0 (closed) to 1 (open)."""

    title: str
    speed: float
    """largest speed [opening/s]"""
