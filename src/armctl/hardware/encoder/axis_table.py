"""The configured axes of an encoder board and what each may be sent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from armctl.errors import BoardError, InputError
from armctl.hardware.channel_scale import ChannelScale
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.encoder.axis_lines import check_axis, control_line, homing_line
from armctl.hardware.encoder.wire_range import check_wire
from armctl.robot import EncoderAxis

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
