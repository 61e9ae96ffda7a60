"""The axes of an encoder board: what a robot file says of them and what the board is told."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from armctl.errors import BoardError, InputError, RobotFileError
from armctl.hardware.driver import ChannelScale, ChannelSettings, ChannelTable
from armctl.robot.file import Name, NotNegative, Positive, Strict
from armctl.robot.outputs import OutputMap
from armctl.robot.outputs_of_file import BoardPart

SCALE = ChannelScale("axis", "counts")
_KEY = "encoder"
_PERCENT = 0.01
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


@dataclass(frozen=True, slots=True)
class EncoderSettings:
    """What an encoder board must know of an arm besides the limits of its axes."""

    axes: tuple[EncoderAxis, ...] = ()
    """the gripper's last"""
    differential: tuple[int, int] | None = None
    """axes of the joints that two motors drive together, by their sum and their difference"""


class AxisEntry(Strict, frozen=True):
    """A motor with an encoder on an encoder board; the defaults suit the gear motors of a small arm."""

    axis: Annotated[int, Meta(ge=0, le=5)]
    home_order: Annotated[int, Meta(ge=1, le=15)]
    """place in the homing order"""
    home_toward: Literal["+", "-"] = "-"
    """which way the switch is looked for first"""
    home_by: HomeBy = "switch"
    p_percent: NotNegative = 1.8
    """drive for a position error of one count [% of full drive]"""
    i_percent_s: NotNegative = 3.0
    """[% of full drive for a count and a second]"""
    d_percent: NotNegative = 0.025
    """[% of full drive for a count a second]"""
    breakaway_percent: Annotated[float, Meta(ge=0, le=100)] = 35.0
    """drive below which a motor that stands does not move"""
    max_drive_percent: Annotated[float, Meta(gt=0, le=100)] = 100.0
    """the largest drive that the motor is given; what it can push with"""
    stall_s: Annotated[float, Meta(gt=0, le=5)] = 0.5
    encoder_inverted: bool = False
    motor_inverted: bool = False
    switch_inverted: bool = False
    """the home switch is closed all the time and opens when it is pressed"""


class EncoderEntry(AxisEntry, frozen=True, kw_only=True):
    """The encoder of a joint: counts = counts_per_deg · (angle - home_deg)."""

    counts_per_deg: float
    home_deg: float = 0.0
    """the angle where homing ends: at the edge of the switch"""
    home_speed_deg_s: Positive = 10.0
    following_error_deg: Positive = 5.0
    """this far from its setpoint the motors are switched off"""


class GripperEncoderEntry(AxisEntry, frozen=True, kw_only=True):
    """The gripper's encoder: its position closed and open, counted from where homing ends."""

    closed_counts: float
    open_counts: float
    home_speed_counts_s: Positive = 500.0
    following_error_counts: Positive = 2000.0


class EncoderBoardEntry(Strict, frozen=True):
    """``[board]`` of an encoder board."""

    differential: tuple[Name, Name] | None = None
    """two joints that two motors drive together: the sum, and the difference"""


class EncoderEntries:
    """Reads ``encoder`` tables, and ``differential`` in ``[board]``."""

    def read(self, part: BoardPart) -> tuple[OutputMap | None, EncoderSettings]:
        """The map of the joints, None where the file has none, and the axes behind it.

        Raises:
            RobotFileError: only some joints have an encoder, two share an axis, homing would end outside the
                limits, or a differential names no two joints.
        """
        board = part.board(EncoderBoardEntry)
        encoders = part.outputs(_KEY, EncoderEntry)
        if not encoders:
            return None, EncoderSettings((), _differential(part, board, encoders))
        gripper = part.gripper(_KEY, GripperEncoderEntry, "closed_counts", "open_counts")
        if gripper is not None:
            _check_drive(gripper, f"{part.path}: gripper.encoder")
        part.check_channels([one.axis for one in encoders], gripper and gripper.axis, "encoders")
        for (name, (low, high)), encoder in zip(part.joints, encoders, strict=True):
            part.check_scale(encoder.counts_per_deg, f"joints.{name}.encoder.counts_per_deg")
            _check_drive(encoder, f"{part.path}: joints.{name}.encoder")
            if not low <= encoder.home_deg <= high:
                raise RobotFileError(
                    f"{part.path}: joints.{name}.encoder.home_deg = {encoder.home_deg}° is outside the "
                    f"limits {low}° … {high}°: homing would end where the joint may not be"
                )
        axes = [_joint_axis(encoder) for encoder in encoders]
        if gripper is not None:
            axes.append(_axis(gripper, 1, gripper.home_speed_counts_s, gripper.following_error_counts))
        settings = EncoderSettings(tuple(axes), _differential(part, board, encoders))
        return _output_map(part, encoders, gripper), settings


def _output_map(
    part: BoardPart, encoders: list[EncoderEntry], gripper: GripperEncoderEntry | None
) -> OutputMap:
    per_deg = np.array([encoder.counts_per_deg for encoder in encoders])
    zero = -per_deg * np.array([encoder.home_deg for encoder in encoders])
    ends = zero[:, None] + per_deg[:, None] * np.array([limits for _, limits in part.joints])
    return OutputMap(
        unit="counts",
        channels=tuple(encoder.axis for encoder in encoders),
        zero=zero,
        per_rad=per_deg * (180 / math.pi),
        low=ends.min(axis=1),
        high=ends.max(axis=1),
        gripper_channel=None if gripper is None else gripper.axis,
        gripper_closed=0.0 if gripper is None else gripper.closed_counts,
        gripper_open=0.0 if gripper is None else gripper.open_counts,
        homed=True,
        table=_KEY,
        key="counts",
    )


def _differential(
    part: BoardPart, board: EncoderBoardEntry, encoders: list[EncoderEntry]
) -> tuple[int, int] | None:
    """Axes of the two joints that are driven by the sum and the difference of two motors."""
    if board.differential is None:
        return None
    axes = {name: encoder.axis for (name, _), encoder in zip(part.joints, encoders, strict=False)}
    for name in board.differential:
        if name not in axes:
            raise RobotFileError(f"{part.path}: board.differential: {name!r} is no joint with an encoder")
    first, second = board.differential
    if first == second:
        raise RobotFileError(f"{part.path}: board.differential names one joint twice; it takes two")
    return axes[first], axes[second]


def _check_drive(entry: AxisEntry, where: str) -> None:
    if entry.breakaway_percent > entry.max_drive_percent:
        raise RobotFileError(
            f"{where}.breakaway_percent = {entry.breakaway_percent:g} is above max_drive_percent = "
            f"{entry.max_drive_percent:g}: the motor could not start; raise the one or lower the other"
        )


def _joint_axis(entry: EncoderEntry) -> EncoderAxis:
    per_deg = abs(entry.counts_per_deg)
    turn = 1 if entry.counts_per_deg > 0 else -1
    return _axis(entry, turn, entry.home_speed_deg_s * per_deg, entry.following_error_deg * per_deg)


def _axis(entry: AxisEntry, turn: int, home_speed: float, following_error: float) -> EncoderAxis:
    """``turn``: -1 where the joint's angle grows against the counts."""
    return EncoderAxis(
        axis=entry.axis,
        home_order=entry.home_order,
        home_toward=1 if (entry.home_toward == "+") == (turn > 0) else -1,
        home_by=entry.home_by,
        home_speed=home_speed,
        p=entry.p_percent * _PERCENT,
        i=entry.i_percent_s * _PERCENT,
        d=entry.d_percent * _PERCENT,
        breakaway=entry.breakaway_percent * _PERCENT,
        following_error=following_error,
        stall_s=entry.stall_s,
        encoder_inverted=entry.encoder_inverted,
        motor_inverted=entry.motor_inverted,
        switch_inverted=entry.switch_inverted,
        max_drive=entry.max_drive_percent * _PERCENT,
    )


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
        self._table = ChannelTable(SCALE, channels, self._check)

    @property
    def axes(self) -> tuple[int, ...]:
        """The configured axes, lowest first."""
        return self._table.channels

    @property
    def homing_order(self) -> tuple[int, ...]:
        """The configured axes in the order in which they are homed."""
        return tuple(sorted(self.axes, key=lambda axis: (self._axes[axis].home_order, axis)))

    def configuration(self) -> tuple[str, ...]:
        """The lines that tell the board all of this."""
        places = sorted({self._axes[axis].home_order for axis in self.axes})
        lines = ["PAIR NONE" if self._differential is None else "PAIR {} {}".format(*self._differential)]
        limits = dict(zip(self.axes, self._table.settings, strict=True))
        for axis in range(self._count):
            if axis in limits:
                own = self._axes[axis]
                place = places.index(own.home_order) + 1  # the board counts to 6, a robot file may go further
                lines += [_limits_line(limits[axis]), control_line(own), homing_line(own, place)]
            else:
                lines.append(f"CFG {axis} hord=0")
        return tuple(lines)

    def setpoints_line(self, setpoints: Mapping[int, float], reach_ms: int) -> str:
        """The line for setpoints [joint counts] by axis, to be reached in ``reach_ms``; the others stay.

        Raises:
            BoardError: not configured, not finite, or outside the limits.
        """
        counts = {axis: self._table.admit(axis, value) for axis, value in setpoints.items()}
        fields = " ".join(str(counts.get(axis, _LEAVE)) for axis in range(self._count))
        return f"P {fields} {reach_ms}"

    def _check(self, one: ChannelSettings) -> None:
        if not 0 <= one.channel < self._count:
            raise BoardError(
                f"axis {one.channel}: the board has axes 0 … {self._count - 1}; change the robot file"
            )
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


def _limits_line(limits: ChannelSettings) -> str:
    """The line that sets the board's own limits.

    They reach as far as count 0, where the axis stands after homing: a gripper's stop is beyond its range.
    """
    low, high = SCALE.whole_range(limits)
    # Rounded down: the board never runs faster than the limit; the range keeps both above 0.
    speed, acceleration = math.floor(limits.speed or 0.0), math.floor(limits.acceleration or 0.0)
    return f"CFG {limits.channel} min={min(low, 0)} max={max(high, 0)} vmax={speed} amax={acceleration}"
