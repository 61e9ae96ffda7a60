"""The whole steps that a kind of board counts in, and what of a setpoint may become such steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings


@dataclass(frozen=True, slots=True)
class ChannelScale:
    """How a board names its outputs, and how finely it takes their setpoints."""

    noun: str
    """what the user calls an output of this board: channel, pin, axis"""
    unit: str
    """of setpoints"""
    steps: int = 1
    """of the board in one unit"""

    @property
    def step(self) -> float:
        """The smallest change of a setpoint, in the unit."""
        return 1 / self.steps

    def whole_range(self, settings: ChannelSettings) -> tuple[int, int]:
        """The first and the last whole step inside the range: rounding a setpoint must not lead out of it."""
        return math.ceil(settings.minimum * self.steps), math.floor(settings.maximum * self.steps)

    def admit(self, configured: Mapping[int, ChannelSettings], channel: int, value: float) -> int:
        """A setpoint in whole steps, as near as the range allows, if it may be sent at all.

        Args:
            configured: what each channel may do.
            channel: whose setpoint.
            value: in the unit.

        Raises:
            BoardError: not configured, not finite, or outside the range.
        """
        settings = configured.get(channel)
        if settings is None:
            known = ", ".join(map(str, sorted(configured))) or "none"
            raise BoardError(
                f"{self.noun} {channel} is not configured (configured: {known}); nothing was sent"
            )
        # Written so that a NaN, which compares false with everything, is refused too.
        if not settings.minimum <= value <= settings.maximum:
            raise BoardError(
                f"{self.noun} {channel}: {value:g} {self.unit} is outside "
                f"{settings.minimum:g} … {settings.maximum:g} {self.unit}; nothing was sent"
            )
        first, last = self.whole_range(settings)
        return min(last, max(first, round(value * self.steps)))
