"""The configured axes of an encoder board and what each may be sent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from armctl.errors import BoardError, InputError, StateError
from armctl.hardware.driver import ChannelScale, ChannelSettings
from armctl.hardware.encoder.session import EncoderSession
from armctl.robot import EncoderAxis

# The numbers that a configuration line may carry (firmware/README.md, CFG).

WIRE_RANGES: dict[str, tuple[int, int]] = {
    "min": (-1_000_000, 1_000_000),
    "max": (-1_000_000, 1_000_000),
    "hpos": (-1_000_000, 1_000_000),
    "vmax": (1, 20_000),
    "hv": (1, 20_000),
    "amax": (1, 65_535),
    "kp": (0, 32_767),
    "ki": (0, 32_767),
    "kd": (0, 32_767),
    "brk": (0, 255),
    "dmax": (1, 255),
    "ferr": (1, 30_000),
    "stall": (20, 5_000),
    "hord": (0, 6),
    "hdir": (-1, 1),
    "hmode": (0, 1),
    "inv": (0, 1),
    "minv": (0, 1),
    "sinv": (0, 1),
}


def check_wire(axis: int, name: str, value: float, key: str, per_unit: float = 1.0) -> None:
    """Refuse a value that does not fit its key.

    Args:
        axis: whose setting it is.
        name: what the user calls it.
        value: in the user's unit.
        key: how the board calls it.
        per_unit: board units in one of the user's.

    Raises:
        InputError: not finite, or outside what the board takes.
    """
    low, high = WIRE_RANGES[key]
    if not math.isfinite(value) or not low <= value * per_unit <= high:
        raise InputError(
            f"axis {axis}: {name} {value:g} is outside {low / per_unit:g} … {high / per_unit:g}, "
            "which is what an encoder board takes"
        )


# What a robot file says of a motor with an encoder, as the board is told.

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


_LEAVE = "-"
SCALE = ChannelScale("axis", "counts")


class AxisTable:
    """Limits by axis, checked once, and the last gate before the wire.

    Args:
        channels: what each axis may do, in counts; a channel is an axis.
        axes: how each is controlled and homed.
        differential: the two axes of a differential wrist, None without one.
        count: how many axes the board has.

    Raises:
        BoardError: an axis that the board has not, twice the same one, one without settings, or limits
            that the board cannot keep.
    """

    def __init__(
        self,
        channels: Sequence[ChannelSettings] = (),
        axes: Sequence[EncoderAxis] = (),
        differential: tuple[int, int] | None = None,
        count: int = 0,
    ) -> None:
        self._count = count
        self._differential = differential
        self._axes = {one.axis: one for one in axes}
        self._limits: dict[int, ChannelSettings] = {}
        for one in channels:
            self._add(one)

    @property
    def axes(self) -> tuple[int, ...]:
        """The configured axes, lowest first."""
        return tuple(sorted(self._limits))

    @property
    def homing_order(self) -> tuple[int, ...]:
        """The configured axes in the order in which they are homed."""
        return tuple(sorted(self._limits, key=lambda axis: (self._axes[axis].home_order, axis)))

    def configuration(self) -> tuple[str, ...]:
        """The lines that tell the board all of this."""
        places = sorted({self._axes[axis].home_order for axis in self._limits})
        lines = ["PAIR NONE" if self._differential is None else "PAIR {} {}".format(*self._differential)]
        for axis in range(self._count):
            if axis in self._limits:
                own = self._axes[axis]
                place = places.index(own.home_order) + 1  # the board counts to 6, a robot file may go further
                lines += [_limits_line(self._limits[axis]), control_line(own), homing_line(own, place)]
            else:
                lines.append(f"CFG {axis} hord=0")
        return tuple(lines)

    def setpoints_line(self, setpoints: Mapping[int, float], reach_ms: int) -> str:
        """The line for setpoints [joint counts] by axis, to be reached in ``reach_ms``; the others stay.

        Raises:
            BoardError: not configured, not finite, or outside the limits.
        """
        counts = {axis: SCALE.admit(self._limits, axis, value) for axis, value in setpoints.items()}
        fields = " ".join(str(counts.get(axis, _LEAVE)) for axis in range(self._count))
        return f"P {fields} {reach_ms}"

    def _add(self, one: ChannelSettings) -> None:
        if not 0 <= one.channel < self._count:
            raise BoardError(
                f"axis {one.channel}: the board has axes 0 … {self._count - 1}; change the robot file"
            )
        if one.channel in self._limits:
            raise BoardError(f"axis {one.channel} is configured twice; give each joint an axis of its own")
        own = self._axes.get(one.channel)
        if own is None:
            raise BoardError(
                f"axis {one.channel} has no encoder settings; give its joint some in the robot file"
            )
        if one.speed is None or one.acceleration is None:
            raise BoardError(f"axis {one.channel}: an encoder board needs a speed and an acceleration limit")
        try:
            check_axis(own)
            for name, value, key in (
                ("minimum", one.minimum, "min"),
                ("maximum", one.maximum, "max"),
                ("speed", one.speed, "vmax"),
                ("acceleration", one.acceleration, "amax"),
            ):
                check_wire(one.channel, name, value, key)
        except InputError as error:
            raise BoardError(str(error)) from error
        low, high = SCALE.whole_range(one)
        if not low < high:
            raise BoardError(f"axis {one.channel}: {one.minimum:g} … {one.maximum:g} counts is no range")
        self._limits[one.channel] = one


def _limits_line(limits: ChannelSettings) -> str:
    """The line that sets the board's own limits.

    They reach as far as count 0, where the axis stands after homing: a gripper's stop is beyond its range.
    """
    low, high = SCALE.whole_range(limits)
    # Rounded down: the board never runs faster than the limit; the range keeps both above 0.
    speed, acceleration = math.floor(limits.speed or 0.0), math.floor(limits.acceleration or 0.0)
    return f"CFG {limits.channel} min={min(low, 0)} max={max(high, 0)} vmax={speed} amax={acceleration}"


# What an encoder board has been told of its axes.

WATCHDOG_MS = 500
_OLDEST_STATUS_S = 0.05


class ToldSettings:
    """Sends settings where the board has not got them: it forgets all of them when it starts anew."""

    def __init__(self) -> None:
        self._lines: tuple[str, ...] | None = None
        """what the board has; None where that is not certain"""
        self._restarts = 0
        self._told = False

    def tell(self, session: EncoderSession, table: AxisTable) -> None:
        """Send what ``table`` says, unless the board has it.

        Raises:
            StateError: the motors are on with other settings.
            BoardError: the board refuses, or the line is gone.
        """
        session.drain()
        lines = table.configuration()
        if lines == self._lines and session.heard.restarts == self._restarts:
            return
        status = session.fresh_status(_OLDEST_STATUS_S)
        if status.mode.powered:
            raise StateError(
                f"{session.name}: the motors are on, and with other settings; release first, or wait half a "
                "second after another program has let go of the board"
            )
        if not self._told and status.latched:
            session.command("CLR")  # from before armctl connected; told in the identity
        restarts, self._lines, self._told = session.heard.restarts, None, True
        for line in (f"WD {WATCHDOG_MS}", *lines):
            session.command(line)
        self._lines, self._restarts = lines, restarts
