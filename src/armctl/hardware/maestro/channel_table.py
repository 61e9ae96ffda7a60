"""The configured channels of a Maestro and what each may be sent."""

from __future__ import annotations

import math
from collections.abc import Sequence

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.maestro.codec import MAX_CHANNEL
from armctl.hardware.maestro.units import MAX_TARGET, QUARTERS_PER_US
from armctl.hardware.maestro_models import MaestroModel


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
        settings = self._settings.get(channel)
        if settings is None:
            known = ", ".join(map(str, self.channels)) or "none"
            raise BoardError(f"channel {channel} is not configured (configured: {known}); nothing was sent")
        # Written so that a NaN, which compares false with everything, is refused too.
        if not settings.minimum <= pulse_us <= settings.maximum:
            raise BoardError(
                f"channel {channel}: {pulse_us:g} µs is outside "
                f"{settings.minimum:g} … {settings.maximum:g} µs; nothing was sent"
            )
        lowest, highest = _quarter_range(settings)
        return min(highest, max(lowest, round(pulse_us * QUARTERS_PER_US)))


def _check_range(settings: ChannelSettings) -> None:
    bounds = (settings.minimum, settings.maximum)
    if all(map(math.isfinite, bounds)) and 0.0 < settings.minimum:
        lowest, highest = _quarter_range(settings)
        if lowest <= highest <= MAX_TARGET:
            return
    raise BoardError(
        f"channel {settings.channel}: {settings.minimum:g} … {settings.maximum:g} µs is no range for a "
        f"servo; it must lie within 0.25 … {MAX_TARGET / QUARTERS_PER_US:g} µs, the smaller number first"
    )


def _quarter_range(settings: ChannelSettings) -> tuple[int, int]:
    """The whole quarter µs inside the range: rounding a setpoint must not lead out of it."""
    return math.ceil(settings.minimum * QUARTERS_PER_US), math.floor(settings.maximum * QUARTERS_PER_US)
