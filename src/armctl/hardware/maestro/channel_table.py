"""The configured channels of a Maestro and what each may be sent."""

from __future__ import annotations

import math
from collections.abc import Sequence

from armctl.errors import BoardError
from armctl.hardware.channel_scale import ChannelScale
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.maestro.codec import MAX_CHANNEL
from armctl.hardware.maestro.units import MAX_TARGET, QUARTERS_PER_US
from armctl.hardware.maestro_models import MaestroModel

SCALE = ChannelScale("channel", "µs", QUARTERS_PER_US)


class ChannelTable:
    """Settings by channel, checked once, and the last gate before the wire.

    Args:
        settings: what each channel may do; pulse widths in µs.
        model: the board, None when unknown.

    Raises:
        BoardError: a channel that the board has not, twice the same one, or a range that cannot be.
    """

    def __init__(self, settings: Sequence[ChannelSettings], model: MaestroModel | None) -> None:
        last = model.channels - 1 if model is not None else MAX_CHANNEL
        board = f"a {model.label}" if model is not None else "the largest Maestro"
        self._settings: dict[int, ChannelSettings] = {}
        for one in settings:
            if not 0 <= one.channel <= last:
                raise BoardError(
                    f"channel {one.channel}: {board} has channels 0 … {last}; change the robot's servo map"
                )
            if one.channel in self._settings:
                raise BoardError(
                    f"channel {one.channel} is configured twice; give each joint a channel of its own"
                )
            _check_range(one)
            self._settings[one.channel] = one

    @property
    def settings(self) -> tuple[ChannelSettings, ...]:
        """The settings, by channel number."""
        return tuple(self._settings[channel] for channel in self.channels)

    @property
    def channels(self) -> tuple[int, ...]:
        """The configured channels, lowest first."""
        return tuple(sorted(self._settings))

    def admit(self, channel: int, pulse_us: float) -> int:
        """The setpoint [µs] in quarter µs, as near as the range allows, if it may be sent at all.

        Raises:
            BoardError: not configured, not finite, or outside the range.
        """
        return SCALE.admit(self._settings, channel, pulse_us)


def _check_range(settings: ChannelSettings) -> None:
    bounds = (settings.minimum, settings.maximum)
    if all(map(math.isfinite, bounds)) and 0.0 < settings.minimum:
        lowest, highest = SCALE.whole_range(settings)
        if lowest <= highest <= MAX_TARGET:
            return
    raise BoardError(
        f"channel {settings.channel}: {settings.minimum:g} … {settings.maximum:g} µs is no range for a "
        f"servo; it must lie within 0.25 … {MAX_TARGET / QUARTERS_PER_US:g} µs, the smaller number first"
    )
