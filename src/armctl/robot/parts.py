"""What moves in an arm: its joints and its gripper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

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


# How an arm is drawn.

Color = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Look:
    """Colours (red, green, blue 0..255) and proportions; the links themselves come from the DH rows."""

    links: tuple[Color, ...] = (
        (52, 73, 94),
        (41, 128, 185),
        (230, 126, 34),
        (39, 174, 96),
        (142, 68, 173),
    )
    """one a joint, used over and over where there are more joints"""
    joints: Color = (60, 60, 65)
    shape: Literal["round", "square"] = "round"
    """cross-section of the links"""
    width: float = 0.052
    """width of the links as a fraction of the arm's reach"""


# Things around the arm that it must stay out of.

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A box along the axes of the base frame: a table, a wall, a conveyor."""

    title: str
    low: FloatArray
    """(3,) its lower corner, base frame [m]"""
    high: FloatArray
    """(3,) its upper corner [m]"""


# One motor with an encoder: how its axis is homed and controlled.

HomeBy = Literal["switch", "stall"]


@dataclass(frozen=True, slots=True)
class EncoderAxis:
    """An axis of an encoder board, in counts and seconds."""

    axis: int
    home_order: int
    """place in the homing order, from 1; those of one place follow each other by axis"""
    home_toward: Literal[-1, 1]
    """the direction, in counts, in which the switch (or the stop) is looked for first"""
    home_by: HomeBy
    home_speed: float
    """[counts/s]"""
    p: float
    """gain of the position error [fraction of full drive a count]"""
    i: float
    """gain of its integral [fraction a count·s]"""
    d: float
    """gain of the velocity error [fraction a count/s]"""
    breakaway: float
    """drive below which a motor that stands does not move, 0..1"""
    following_error: float
    """distance from the setpoint that switches the motors off [counts]"""
    stall_s: float
    """the largest drive without movement for so long switches the motors off [s]"""
    encoder_inverted: bool
    motor_inverted: bool
    switch_inverted: bool = False
    """the home switch is closed all the time and opens when it is pressed"""
    max_drive: float = 1.0
    """the largest drive that the motor is given, 0..1; what it can push with"""
