"""The axes of an encoder board: what a robot file says of them and what is sent to the board."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from armctl.decoding import did_you_mean
from armctl.errors import BoardError, Errors, out_of_range
from armctl.hardware.driver import ChannelSettings, ChannelTable
from armctl.hardware.encoder import SCALE
from armctl.lazy_dataclass import dataclass
from armctl.robot.board_entries import BoardPart
from armctl.robot.file import Name, NotNegative, Positive, Strict
from armctl.robot.outputs import OutputMap

_KEY = "encoder"


class AxisEntry(Strict, frozen=True):
    """A motor with an encoder on an encoder board; the defaults suit the gear motors of a small arm."""

    axis: Annotated[int, Meta(ge=0, le=5)]
    """of the board"""
    home_order: Annotated[int, Meta(ge=1, le=15)]
    """place in the homing order, from 1; those of one place follow each other by axis"""
    home_toward: Literal["+", "-"] = "-"
    """which way the switch (or the stop) is looked for first"""
    home_by: Literal["switch", "stall"] = "switch"
    """stall: against the stop, for an axis without a switch"""
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
    """the largest drive without movement for so long switches the motors off"""
    encoder_inverted: bool = False
    """a leading b counts down"""
    motor_inverted: bool = False
    """positive drive counts down"""
    switch_inverted: bool = False
    """the home switch is closed all the time and opens when it is pressed"""


class EncoderEntry(AxisEntry, frozen=True, kw_only=True):
    """The encoder of a joint: counts = counts_per_deg · (angle - home_deg)."""

    counts_per_deg: float
    """with its sign"""
    home_deg: float = 0.0
    """the angle where homing ends: at the edge of the switch"""
    home_speed_deg_s: Positive = 10.0
    """speed of homing"""
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


@dataclass(frozen=True, slots=True)
class EncoderAxis:
    """A motor of an encoder board: its entry, and what follows from that in counts."""

    entry: AxisEntry
    home_toward: Literal[-1, 1]
    """the direction, in counts, in which the switch (or the stop) is looked for first"""
    home_speed: float  # [counts/s]
    following_error: float  # distance from the setpoint that switches the motors off [counts]


@dataclass(frozen=True, slots=True)
class EncoderSettings:
    """What an encoder board must know of an arm besides the limits of its axes."""

    axes: tuple[EncoderAxis, ...] = ()  # the gripper's last
    differential: tuple[int, int] | None = None
    """axes of the joints that two motors drive together, by their sum and their difference"""


def read_entries(part: BoardPart) -> tuple[OutputMap | None, EncoderSettings]:
    """The map of the joints (None: none in the file) and the axes; ``RobotFileError`` for a contradiction."""
    errors, encoders = Errors(), list[EncoderEntry]()
    board, gripper = EncoderBoardEntry(), None
    with errors:
        board = part.board(EncoderBoardEntry)
    differential = None
    with errors:
        encoders = part.outputs(_KEY, EncoderEntry)
        differential = _differential(part, board, encoders)
    with errors:
        if encoders:
            gripper = part.gripper(_KEY, GripperEncoderEntry, "closed_counts", "open_counts")
        if gripper is not None:
            _check_drive(part, gripper, "gripper.encoder")
    with errors:
        part.check_channels([one.axis for one in encoders], gripper and gripper.axis, "encoders")
    for (name, limits), entry in zip(part.joints, encoders, strict=bool(encoders)):
        _check_joint(part, entry, limits, f"joints.{name}.encoder", errors)
    errors.raise_all()
    if not encoders:
        return None, EncoderSettings((), differential)
    axes: list[EncoderAxis] = []
    for entry in encoders:
        per_deg = abs(entry.counts_per_deg)
        toward = 1 if (entry.home_toward == "+") == (entry.counts_per_deg > 0) else -1
        axes.append(
            EncoderAxis(
                _axis_of(entry), toward, entry.home_speed_deg_s * per_deg, entry.following_error_deg * per_deg
            )
        )
    if gripper is not None:
        toward = 1 if gripper.home_toward == "+" else -1
        speed, error = gripper.home_speed_counts_s, gripper.following_error_counts
        axes.append(EncoderAxis(_axis_of(gripper), toward, speed, error))
    return _output_map(part, encoders, gripper), EncoderSettings(tuple(axes), differential)


def _axis_of(entry: AxisEntry) -> AxisEntry:
    """What an entry says of the axis itself, without the angles or the opening that it is for."""
    return AxisEntry(**{name: getattr(entry, name) for name in AxisEntry.__struct_fields__})


def _check_joint(
    part: BoardPart, entry: EncoderEntry, limits: tuple[float, float], where: str, errors: Errors
) -> None:
    with errors:
        part.check_scale(entry.counts_per_deg, f"{where}.counts_per_deg")
    with errors:
        _check_drive(part, entry, where)
    with errors:
        low, high = limits
        if not low <= entry.home_deg <= high:
            raise part.error(
                f"{where}.home_deg",
                f" = {entry.home_deg}° is outside the limits {low}° … {high}°: "
                "homing would end where the joint may not be",
            )


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
            hint = did_you_mean(name, axes)
            raise part.error("board.differential", f": {name!r} is no joint with an encoder{hint}")
    first, second = board.differential
    if first == second:
        raise part.error("board.differential", " names one joint twice; it takes two")
    return axes[first], axes[second]


def _check_drive(part: BoardPart, entry: AxisEntry, where: str) -> None:
    if entry.breakaway_percent > entry.max_drive_percent:
        raise part.error(
            f"{where}.breakaway_percent",
            f" = {entry.breakaway_percent:g} is above max_drive_percent = {entry.max_drive_percent:g}: "
            "the motor could not start; raise the one or lower the other",
        )


# The settings that the CFG lines of a board carry (firmware/README.md).

_FULL_DRIVE = 255
_GAIN_UNIT = _FULL_DRIVE * 256  # the board takes gains in 1/256 of a PWM step


@dataclass(frozen=True, slots=True)
class WireSetting:
    """A setting of an axis as the board takes it: a whole number from ``low`` to ``high``."""

    low: int
    high: int
    name: str = ""  # what the user calls it
    per_unit: float = 1.0  # board units in one of the user's
    whole: Callable[[float], int] = round  # limits are rounded so that the board never exceeds them


_FLAG = WireSetting(0, 1)
_FASTEST = 6_000  # counts/s: what the firmware counts on six axes at once and still controls them
WIRE: Mapping[str, WireSetting] = {
    "min": WireSetting(-1_000_000, 1_000_000, "minimum", whole=math.ceil),
    "max": WireSetting(-1_000_000, 1_000_000, "maximum", whole=math.floor),
    "vmax": WireSetting(1, _FASTEST, "speed", whole=math.floor),
    "amax": WireSetting(1, 65_535, "acceleration", whole=math.floor),
    "kp": WireSetting(0, 32_767, "gain p", _GAIN_UNIT),
    "ki": WireSetting(0, 32_767, "gain i", _GAIN_UNIT),
    "kd": WireSetting(0, 32_767, "gain d", _GAIN_UNIT),
    "brk": WireSetting(0, 255, "breakaway", _FULL_DRIVE),
    "ferr": WireSetting(1, 30_000, "following error"),
    "stall": WireSetting(20, 5_000, "stall time", 1000.0),
    "hdir": WireSetting(-1, 1),
    "hv": WireSetting(1, _FASTEST, "homing speed", whole=math.floor),
    "hpos": WireSetting(-1_000_000, 1_000_000),
    "hord": WireSetting(0, 6),
    "hmode": _FLAG,
    "inv": _FLAG,
    "minv": _FLAG,
    "sinv": _FLAG,
    "dmax": WireSetting(1, 255, "largest drive", _FULL_DRIVE, math.floor),
}
"""by the key on the wire"""
_LINES = (
    ("min", "max", "vmax", "amax"),
    ("kp", "ki", "kd", "brk", "dmax", "ferr", "stall"),
    ("hdir", "hv", "hpos", "hord", "hmode", "inv", "minv", "sinv"),
)


def _to_wire(axis: int, key: str, value: float) -> int:
    """A value in the user's unit as the board takes it; ``BoardError`` where it does not."""
    setting = WIRE[key]
    low, high, per_unit = setting.low, setting.high, setting.per_unit
    if not math.isfinite(value) or not low <= value * per_unit <= high:
        raise BoardError(
            f"axis {axis}: {setting.name} {out_of_range(value, low / per_unit, high / per_unit)}, "
            "which is what an encoder board takes"
        )
    return setting.whole(value * per_unit)


def _axis_lines(limits: ChannelSettings, own: EncoderAxis, order: int) -> list[str]:
    """The lines that tell the board of an axis; ``order`` is its place in homing, from 1."""
    entry, axis = own.entry, limits.channel
    if limits.speed is None or limits.acceleration is None:
        raise BoardError(f"axis {axis}: an encoder board needs a speed and an acceleration limit")
    values = {
        "hv": own.home_speed,
        "ferr": own.following_error,
        "stall": entry.stall_s,
        "brk": entry.breakaway_percent * 0.01,
        "dmax": entry.max_drive_percent * 0.01,
        "kp": entry.p_percent * 0.01,
        "ki": entry.i_percent_s * 0.01,
        "kd": entry.d_percent * 0.01,
        "min": limits.minimum,
        "max": limits.maximum,
        "vmax": limits.speed,
        "amax": limits.acceleration,
        "hdir": own.home_toward,
        "hpos": 0,  # the count at the edge of the switch or at the stop: the robot file says its angle
        "hord": order,
        "hmode": entry.home_by == "stall",
        "inv": entry.encoder_inverted,
        "minv": entry.motor_inverted,
        "sinv": entry.switch_inverted,
    }
    wire = {key: _to_wire(axis, key, value) for key, value in values.items()}
    if not wire["min"] < wire["max"]:
        raise BoardError(f"axis {axis}: {limits.minimum:g} … {limits.maximum:g} counts is no range")
    # The limits reach as far as count 0, where homing ends: a gripper's stop is beyond its range.
    wire |= {"min": min(wire["min"], 0), "max": max(wire["max"], 0), "brk": min(wire["brk"], wire["dmax"])}
    return [f"CFG {axis} {' '.join(f'{key}={wire[key]}' for key in keys)}" for keys in _LINES]


class AxisTable:
    """Limits by axis [counts], checked once, and the last gate before the wire; a channel is an axis."""

    def __init__(self, channels: Sequence[ChannelSettings], arm: EncoderSettings, count: int) -> None:
        self._count = count
        self._table = ChannelTable(SCALE, channels)
        self.axes = self._table.channels  # the configured axes, lowest first
        known = {one.entry.axis: one for one in arm.axes}
        for axis in self.axes:
            if not 0 <= axis < count:
                raise BoardError(f"axis {axis}: the board has axes 0 … {count - 1}; change the robot file")
            if axis not in known:
                raise BoardError(
                    f"axis {axis} has no encoder settings; give its joint some in the robot file"
                )
        order = {axis: known[axis].entry.home_order for axis in self.axes}
        self.homing_order = tuple(sorted(self.axes, key=lambda axis: (order[axis], axis)))
        """the configured axes in the order in which they are homed"""
        places = sorted(set(order.values()))  # the board counts to 6, a robot file may go further
        lines = ["PAIR NONE" if arm.differential is None else "PAIR {} {}".format(*arm.differential)]
        limits = dict(zip(self.axes, self._table.settings, strict=True))
        for axis in range(count):
            if axis in limits:
                lines += _axis_lines(limits[axis], known[axis], places.index(order[axis]) + 1)
            else:
                lines.append(f"CFG {axis} hord=0")
        self.configuration = tuple(lines)  # the lines that configure the board

    def setpoints_line(self, setpoints: Mapping[int, float], reach_ms: int) -> str:
        """The line for setpoints [joint counts] by axis, to be reached in ``reach_ms``; the others stay."""
        counts = {axis: self._table.admit(axis, value) for axis, value in setpoints.items()}
        fields = " ".join(str(counts.get(axis, "-")) for axis in range(self._count))
        return f"P {fields} {reach_ms}"
