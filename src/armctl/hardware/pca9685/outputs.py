"""What each channel is to send, what was written to the chip for it, and what the chip holds."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field

from armctl.hardware.driver import ChannelSettings, ChannelTable
from armctl.lazy_dataclass import dataclass

_EXPIRES_S = 0.12
"""a setpoint that has not come through by then is dropped: later it would be one large step of the arm"""
_KEPT = 16
_LONGEST_S = 0.04
"""a tick that comes late counts for no more, where a channel is brought back"""


@dataclass(slots=True)
class _Channel:
    settings: ChannelSettings
    goal_us: float | None = None
    """what was asked for; None: nothing, or it was dropped"""
    goal: int | None = None
    """the same in steps"""
    sent: int | None = None
    """what was written to the chip and not dropped"""
    sent_at: float = -math.inf
    held: int | None = None
    """what the chip holds, as last read; None: no pulse"""
    seen_at: float = -math.inf
    """when the chip held what it had been sent"""
    before: deque[int | None] = field(default_factory=lambda: deque[int | None](maxlen=_KEPT))
    """what it was sent earlier, or held then: when it is found there again, something was lost"""
    slow: bool = False
    """it lost setpoints: it comes to its goal no faster than it may move"""


class Outputs:
    """The configured channels; steps are those of the chip, of ``step_us`` [µs]."""

    def __init__(self, table: ChannelTable, step_us: float, now: Callable[[], float]) -> None:
        self.table, self.step_us, self._now = table, step_us, now
        self._channels = {one.channel: _Channel(one) for one in table.settings}
        self._expired: set[int] = set()

    def take_over(self, before: Outputs, held: Mapping[int, int | None]) -> None:
        """Take over the pulses that the chip holds [steps]; what was known of channels that are on stays."""
        for number, one in self._channels.items():
            known = before._channels.get(number)
            if known is not None and before.step_us == self.step_us and held.get(number) is not None:
                self._channels[number] = known
                known.settings = one.settings
        self._expired |= before._expired
        self.read(held, {}, self._now())

    def put(self, setpoints: Mapping[int, float]) -> None:
        """Pulses [µs] by channel from now on; ``BoardError`` where one may not be sent."""
        for channel, pulse_us in setpoints.items():
            self.table.admit(channel, pulse_us)
        for channel, pulse_us in setpoints.items():
            one = self._channels[channel]
            one.goal_us, one.goal = pulse_us, self._steps(one.settings, pulse_us)

    def due(self) -> dict[int, int]:
        """Steps by channel that are to be written now; they count as written."""
        now = self._now()
        found: dict[int, int] = {}
        for number, one in self._channels.items():
            if one.goal is None or one.goal == one.sent:
                continue
            wanted = one.goal
            if one.slow and one.held is not None and one.settings.speed is not None:
                passed_s = min(_LONGEST_S, now - one.sent_at)
                far = max(1, int(one.settings.speed * passed_s / self.step_us))
                wanted = min(one.held + far, max(one.held - far, one.goal))
                if wanted == one.sent:  # not seen yet
                    continue
            if one.sent is None:
                one.seen_at = now
            one.before.append(one.held if one.sent is None else one.sent)
            found[number], one.sent, one.sent_at = wanted, wanted, now
        return found

    def sent(self) -> dict[int, int | None]:
        """What was written for each channel, to be compared with what the chip says later."""
        return {number: one.sent for number, one in self._channels.items()}

    def read(self, held: Mapping[int, int | None], sent: Mapping[int, int | None], asked_at: float) -> None:
        """What the chip held when it was asked, and what it had been ``sent`` by then.

        What got lost on its way is due again, no faster than the channel may move.
        """
        for number, steps in held.items():
            one = self._channels.get(number)
            if one is None:
                continue
            one.held = steps
            if one.sent is None or number not in sent:
                continue
            if steps == sent[number]:
                one.seen_at = asked_at
                one.slow &= steps != one.goal
            elif steps not in one.before:
                continue  # somebody else's: armctl's runtime sees that it is no setpoint
            elif asked_at - one.seen_at > _EXPIRES_S:
                self._expired.add(number)
                one.goal = one.goal_us = one.sent = None
                one.slow = steps is not None
            elif one.sent == sent[number]:
                one.sent, one.slow = steps, steps is not None

    def stop(self) -> None:
        """What is on its way to a goal stays where it is."""
        for one in self._channels.values():
            one.goal = one.sent
        self._expired.clear()

    def released(self, channels: Iterable[int]) -> None:
        """These have no pulses any more."""
        for number in channels:
            self._channels[number] = _Channel(self._channels[number].settings)

    def held(self, number: int) -> int | None:
        """What the chip holds for a channel [steps]."""
        return self._channels[number].held

    @property
    def on(self) -> dict[int, bool]:
        """Whether each channel has pulses."""
        return {number: one.held is not None for number, one in self._channels.items()}

    @property
    def positions(self) -> dict[int, float | None]:
        """The pulse [µs] of each channel: the setpoint, where the chip holds its nearest step."""
        return {number: self._pulse_us(one) for number, one in self._channels.items()}

    def take_expired(self) -> tuple[int, ...]:
        """The channels of which something was dropped since this was asked last."""
        expired, self._expired = tuple(sorted(self._expired)), set()
        return expired

    def _pulse_us(self, one: _Channel) -> float | None:
        if one.held is None:
            return None
        return one.goal_us if one.held == one.goal else one.held * self.step_us

    def _steps(self, settings: ChannelSettings, pulse_us: float) -> int:
        """The nearest step of the chip inside the channel's range."""
        first = math.ceil(settings.minimum / self.step_us)
        last = math.floor(settings.maximum / self.step_us)
        return min(last, max(first, round(pulse_us / self.step_us)))
