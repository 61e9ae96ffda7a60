"""What a robot file says of a motor with an encoder, as the board is told."""

from __future__ import annotations

import math

from armctl.hardware.encoder.wire_range import check_wire
from armctl.robot import EncoderAxis

_FULL_DRIVE = 255
_GAIN_STEPS = 256  # the board takes gains in 1/256 of a PWM step
_GAIN_UNIT = _FULL_DRIVE * _GAIN_STEPS
_MS = 1000.0


def check_axis(axis: EncoderAxis) -> None:
    """Refuse what the board would refuse, before there is a board.

    Raises:
        InputError: a value that no encoder board takes; names the axis and the value.
    """
    number = axis.axis
    check_wire(number, "homing speed", axis.home_speed, "hv")
    check_wire(number, "following error", axis.following_error, "ferr")
    check_wire(number, "stall time", axis.stall_s, "stall", _MS)
    check_wire(number, "breakaway", axis.breakaway, "brk", _FULL_DRIVE)
    check_wire(number, "largest drive", axis.max_drive, "dmax", _FULL_DRIVE)
    for name, gain, key in (("p", axis.p, "kp"), ("i", axis.i, "ki"), ("d", axis.d, "kd")):
        check_wire(number, f"gain {name}", gain, key, _GAIN_UNIT)


def control_line(axis: EncoderAxis) -> str:
    """The line that sets gains, drive and trips."""
    kp, ki, kd = (round(gain * _GAIN_UNIT) for gain in (axis.p, axis.i, axis.d))
    largest = math.floor(axis.max_drive * _FULL_DRIVE)  # never more than it may be
    return (
        f"CFG {axis.axis} kp={kp} ki={ki} kd={kd} "
        f"brk={min(round(axis.breakaway * _FULL_DRIVE), largest)} dmax={largest} "
        f"ferr={round(axis.following_error)} stall={round(axis.stall_s * _MS)}"
    )


def homing_line(axis: EncoderAxis, order: int) -> str:
    """The line that sets how the axis is wired and homed; ``order`` is its place on the board, from 1.

    It counts 0 at the edge of its switch, or at its stop: which angle that is, the robot file says.
    """
    wiring = (axis.encoder_inverted, axis.motor_inverted, axis.switch_inverted)
    inv, minv, sinv = map(int, wiring)
    return (
        f"CFG {axis.axis} hdir={axis.home_toward} hv={math.floor(axis.home_speed)} hpos=0 hord={order} "
        f"hmode={int(axis.home_by == 'stall')} inv={inv} minv={minv} sinv={sinv}"
    )
