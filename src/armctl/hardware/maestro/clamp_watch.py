"""Notices channels that the board itself keeps from where they were sent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# Half a quarter µs: positions and targets are whole quarters, so less than one is no difference.
_SAME_US = 0.125


@dataclass(frozen=True, slots=True)
class Clamped:
    """A channel that stands still, but not where it was sent."""

    channel: int
    target_us: float
    transmitted_us: float

    def __str__(self) -> str:
        """The finding in words for the user."""
        return (
            f"channel {self.channel}: {self.target_us:g} µs was asked for, but the board stays at "
            f"{self.transmitted_us:g} µs; its Min and Max for this channel are narrower: "
            "widen them in the Maestro Control Center, or narrow the calibration"
        )


class ClampWatch:
    """Compares targets with transmitted positions over several readings.

    A channel on a slow ramp also differs from its target, but it moves; one that the board clamps
    stands still. It counts as clamped when it differs and has not moved for ``patience_s``.

    Args:
        patience_s: long enough for the slowest ramp to show (2 periods for 0.25 µs at the smallest
            acceleration, 20 ms each), and for a target that was just written.
    """

    def __init__(self, patience_s: float = 0.2) -> None:
        self._patience_s = patience_s
        self._still_since: dict[int, tuple[float, float, float]] = {}  # target, position, time

    def observe(
        self, targets: Mapping[int, float], positions: Mapping[int, float | None], now: float
    ) -> tuple[Clamped, ...]:
        """Take one reading [µs] at time ``now`` [s] and name the channels that are clamped."""
        found: list[Clamped] = []
        for channel, target in targets.items():
            position = positions.get(channel)
            if position is None or abs(position - target) < _SAME_US:
                self._still_since.pop(channel, None)
                continue
            before = self._still_since.get(channel)
            if before is None or before[:2] != (target, position):
                self._still_since[channel] = (target, position, now)
            elif now - before[2] >= self._patience_s:
                found.append(Clamped(channel, target, position))
        return tuple(found)

    def forget(self) -> None:
        """Start anew, as when the pulses have been switched off."""
        self._still_since.clear()
