"""One axis of a simulated encoder board: the firmware's control of it, its homing, and its motor."""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping
from typing import Literal

from armctl.hardware.driver import ChannelSettings
from armctl.hardware.encoder.axes import WIRE, EncoderAxis
from armctl.hardware.encoder.messages import (
    COUNTS_OF_AN_EDGE,
    FaultKind,
    RefusedRequest,
    RequestWords,
    within,
)
from armctl.lazy_dataclass import dataclass

TICK_S = 0.005  # the firmware's control period
SWITCH_WIDTH = 200.0  # counts over which the home switch of a Scorbot stays closed
_LEAST_MARGIN = 60.0
_START_S = 1.0
_SLIP_EVERY = 1000.0  # counts of way

Trouble = Literal["stall", "torn", "slip"]
"""what may be wrong with an axis that has been homed: it jams, its encoder falls silent, or loses edges"""


@dataclass(frozen=True, slots=True)
class AxisPlant:
    """The mechanics of an axis, in the counts that it has once it is homed."""

    low: float = -1500.0  # hard stop, as the next
    high: float = 1500.0
    switch: tuple[float, float] | None = (0.0, SWITCH_WIDTH)
    """where the home switch is closed; None: there is none"""
    start: float = -400.0  # where it stands when it is built


def plant_of(limits: ChannelSettings, axis: EncoderAxis) -> AxisPlant:
    """An axis that fits its settings and starts where homing finds the switch within about a second."""
    span = limits.maximum - limits.minimum
    margin = max(_LEAST_MARGIN, 0.02 * span)
    low, high = min(0.0, limits.minimum) - margin, max(0.0, limits.maximum) + margin
    toward = axis.home_toward
    away = -toward * min(0.25 * span, axis.home_speed * _START_S)
    start = min(limits.maximum, max(limits.minimum, away))
    if axis.entry.home_by == "switch":
        return AxisPlant(low, high, (0.0, SWITCH_WIDTH) if toward > 0 else (-SWITCH_WIDTH, 0.0), start)
    return AxisPlant(0.0 if toward < 0 else low, 0.0 if toward > 0 else high, None, start)


# What the firmware assumes until a host configures it: a rebuilt Scorbot, by axis, in the order of WIRE,
# which is that of SHOW; firmware/encoder/settings.cpp has the same.
_SCORBOT = (
    (-22000, 22000, 2840, 11400, 1200, 2000, 16, 200, 600, 300, 1, 900, 0, 6, 0, 0, 0, 0, 255),
    (-8000, 10800, 2950, 11800, 1200, 2000, 16, 200, 600, 300, 1, 900, 0, 2, 0, 0, 0, 0, 255),
    (-25600, 4000, 2950, 11800, 1200, 2000, 16, 200, 600, 300, 1, 900, 0, 3, 0, 0, 0, 0, 255),
    (-3900, 3400, 2300, 9200, 2500, 4000, 26, 200, 400, 300, 1, 800, 0, 4, 0, 0, 0, 0, 255),
    (-5100, 5100, 2900, 11800, 2500, 4000, 26, 200, 400, 300, 1, 800, 0, 5, 0, 0, 0, 0, 255),
    (0, 1700, 1600, 8000, 1000, 1000, 13, 200, 400, 200, -1, 800, 0, 1, 1, 0, 0, 0, 255),
)
FIRMWARE_DEFAULTS: tuple[Mapping[str, int], ...] = tuple(
    dict(zip(WIRE, row, strict=True)) for row in _SCORBOT
)

_UNHOMING = ("inv", "minv", "hdir", "hpos", "hmode", "sinv")  # a change makes an earlier zero worthless
_FOLLOWED = 1.0 - math.exp(-TICK_S / 0.015)  # the part of its way that a motor makes good in a tick
_MOVED_COUNTS = 2.0

Homing = Generator[None, None, str]
"""goes on by a tick at each ``next``; returns why it failed, an empty string where it did not"""


class SimulatedAxis:
    """A setpoint that moves within its limits, and a motor that follows it with a lag.

    Counts are joint counts: inverted encoders, inverted motors and the two motors of a differential
    wrist are taken to be wired as they are configured.
    """

    def __init__(self, plant: AxisPlant, defaults: Mapping[str, int]) -> None:
        self.plant = plant
        self._defaults = defaults
        self.place = plant.start  # where it really is, in the counts of a homed axis
        self.jammed = False
        self.torn = False  # the encoder's wire
        self.switch_stuck: bool | None = None
        self.trouble: Trouble | None = None
        self.restart()

    def restart(self) -> None:
        """The board has lost its memory; the axis stays where it is."""
        self.settings = dict(self._defaults)
        self.homed = False
        self.fault = FaultKind(0)
        self.lost = 0  # edges since homing, or since the start
        self._unslipped = 0.0  # counts
        self._origin = self.place  # where the count is 0
        self._count = 0.0
        self._from = self._to = self._left_s = self._whole_s = 0.0
        self.switch_on()

    @property
    def count(self) -> int:
        """What the encoder says."""
        return round(self._count)

    @property
    def switch_closed(self) -> bool:
        """What the home switch says."""
        if self.switch_stuck is not None:
            return self.switch_stuck
        switch = self.plant.switch
        return switch is not None and switch[0] <= self.place <= switch[1]

    @property
    def moving(self) -> bool:
        """Whether its setpoint still moves."""
        return self._speed != 0.0

    def configure(self, settings: Mapping[str, int]) -> None:
        """Take these settings; some make the zero worthless."""
        self.homed &= all(self.settings[key] == settings[key] for key in _UNHOMING) and settings["hord"] > 0
        self.settings = dict(settings)

    def shown_settings(self, words: RequestWords) -> str:
        """What a ``SHOW`` line is answered with, its first or second half."""
        part = 1
        if words.rest:
            part = within(words.number_or(words.take()), (1, 2), "RANGE part 1 2")
        words.end()
        shown = [f"{key}={value}" for key, value in self.settings.items()]
        half = len(shown) // 2
        return " ".join(shown[:half] if part == 1 else shown[half:])

    def asked_settings(self, words: RequestWords) -> dict[str, int]:
        """Its settings with the changes that a line asks for; refuses all of them where one is wrong."""
        changes: dict[str, int] = {}
        while (word := words.take()) is not None:
            key, equals, text = word.partition("=")
            if not equals or key not in WIRE:
                raise RefusedRequest("ARGS unknown key")
            value, (low, high) = words.checked(text), (WIRE[key].low, WIRE[key].high)
            if not low <= value <= high or (key == "hdir" and value == 0):
                raise RefusedRequest(f"RANGE {key} {value} {low} {high}")
            changes[key] = value
        if not changes:
            raise RefusedRequest("ARGS key=value missing")
        settings = self.settings | changes
        if settings["min"] >= settings["max"]:
            raise RefusedRequest("RANGE min not below max")
        return settings

    def lose_edges(self, count: int = 1) -> None:
        """Miss so many of the encoder's edges: the counts stay behind, and only their number is known."""
        self.lost += count
        self._origin += COUNTS_OF_AN_EDGE * count
        self._count = self.place - self._origin

    def switch_on(self) -> None:
        """Hold where the encoder says that it is."""
        self._reference, self._speed = self._count, 0.0
        self._moved = False
        self._seen_count, self._standing_s = self._count, 0.0
        self.halt()

    def halt(self) -> None:
        """Slow down and stay."""
        self._left_s = 0.0
        self._to = math.nan

    def go(self, count: int, within_s: float) -> None:
        """Be at ``count`` in ``within_s``."""
        self._from, self._to = self._reference, float(count)
        self._left_s = self._whole_s = within_s

    def tick(self) -> FaultKind:
        """Let a tick pass with the motor on, under control; return what went wrong."""
        self._advance_reference()
        self._follow()
        error = abs(self._reference - self._count)
        if error > self.settings["ferr"]:
            return FaultKind.FOLLOW
        drive = error * self.settings["kp"] / 256.0 + self.settings["brk"]
        if error < _MOVED_COUNTS or drive < self.settings["dmax"]:
            self._standing_s = 0.0
        elif self._stalled():
            return FaultKind.STALL if self._moved and not self.torn else FaultKind.ENCODER
        return FaultKind(0)

    def home(self) -> Homing:
        """Look for the switch, always from the far side, or for the stop; its count is ``hpos`` there."""
        self.homed = False
        toward, edge = self.settings["hdir"], None
        if self.settings["hmode"]:
            yield from self._creep(toward, closed=None)
        else:
            found = False
            while not found:
                if not (yield from self._creep(-toward, closed=False)):
                    return "stuck"
                found = yield from self._creep(toward, closed=True)
                # It may have stood beyond the switch: back over it, and once more from the right side.
                if not found and not (yield from self._creep(-toward, closed=True)):
                    return "notfound"
            edge = self.plant.switch and self.plant.switch[0 if toward > 0 else 1]
        self.set_zero(self.place if edge is None else edge)
        return ""

    def set_zero(self, place: float) -> None:
        """``place`` is where homing wants the axis to be."""
        self._origin = place - self.settings["hpos"]
        self._count = self.place - self._origin
        self.homed, self.lost, self._unslipped = True, 0, 0.0
        self.jammed, self.torn = self.jammed or self.trouble == "stall", self.torn or self.trouble == "torn"
        self.switch_on()
        self.go(self.settings["hpos"], 0.0)

    def _slip(self, way: float) -> None:
        self._unslipped += way if self.homed and self.trouble == "slip" else 0.0
        if self._unslipped >= _SLIP_EVERY:
            self._unslipped -= _SLIP_EVERY
            self.lose_edges()

    def _creep(self, direction: int, *, closed: bool | None) -> Generator[None, None, bool]:
        """Move until the switch says ``closed``; False where the axis stops before."""
        self.switch_on()
        while self.switch_closed is not closed:
            if self._stalled():
                return False
            yield
            self._reference = self._count + direction * float(self.settings["hv"]) * TICK_S / _FOLLOWED
            self._follow()
        return True

    def _stalled(self) -> bool:
        return self._standing_s >= self.settings["stall"] / 1000.0

    def _advance_reference(self) -> None:
        top, ramp = float(self.settings["vmax"]), self.settings["amax"] * TICK_S
        wanted = 0.0
        if not math.isnan(self._to):
            before = self._wanted_place()
            self._left_s = max(0.0, self._left_s - TICK_S)
            speed = (self._wanted_place() - before) / TICK_S
            away = self._wanted_place() - speed * TICK_S - self._reference
            most = math.sqrt(2.0 * self.settings["amax"] * abs(away))
            wanted = speed + math.copysign(min(most, abs(away) / TICK_S), away)
        wanted = min(top, max(-top, wanted))
        self._speed += min(ramp, max(-ramp, wanted - self._speed))
        self._reference += self._speed * TICK_S

    def _wanted_place(self) -> float:
        share = 1.0 - self._left_s / self._whole_s if self._whole_s else 1.0
        return self._from + share * (self._to - self._from)

    def _follow(self) -> None:
        error = self._reference - self._count
        if not self.jammed:
            before = self.place
            self.place = min(self.plant.high, max(self.plant.low, self.place + error * _FOLLOWED))
            self._slip(abs(self.place - before))
        if not self.torn:
            self._count = self.place - self._origin
        if abs(self._count - self._seen_count) >= _MOVED_COUNTS:
            self._seen_count, self._standing_s, self._moved = self._count, 0.0, True
        else:
            self._standing_s += TICK_S
