"""What is fixed to a motor of a simulated encoder board: an axis with stops, a switch and a place."""

from __future__ import annotations

from dataclasses import dataclass

from armctl.hardware.driver import ChannelSettings
from armctl.robot import EncoderAxis

SWITCH_WIDTH = 200.0  # counts over which the home switch of a Scorbot stays closed
_LEAST_MARGIN = 60.0
_START_S = 1.0


@dataclass(frozen=True, slots=True)
class AxisPlant:
    """The mechanics of an axis, in the counts that it has once it is homed.

    Args:
        low: lower hard stop.
        high: upper hard stop.
        switch: where the home switch is closed; None: there is none.
        start: where it stands when it is built.
    """

    low: float = -1500.0
    high: float = 1500.0
    switch: tuple[float, float] | None = (0.0, SWITCH_WIDTH)
    start: float = -400.0


def plant_of(limits: ChannelSettings, axis: EncoderAxis) -> AxisPlant:
    """An axis that fits its settings: stops a little outside the limits, the switch where it is looked for.

    It stands where homing finds the switch within about a second.
    """
    span = limits.maximum - limits.minimum
    margin = max(_LEAST_MARGIN, 0.02 * span)
    low, high = min(0.0, limits.minimum) - margin, max(0.0, limits.maximum) + margin
    toward = axis.home_toward
    away = -toward * min(0.25 * span, axis.home_speed * _START_S)
    start = min(limits.maximum, max(limits.minimum, away))
    if axis.home_by == "stall":
        return AxisPlant(
            low=0.0 if toward < 0 else low, high=0.0 if toward > 0 else high, switch=None, start=start
        )
    switch = (0.0, SWITCH_WIDTH) if toward > 0 else (-SWITCH_WIDTH, 0.0)
    return AxisPlant(low, high, switch, start)
