"""One motor with an encoder: how its axis is homed and controlled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
