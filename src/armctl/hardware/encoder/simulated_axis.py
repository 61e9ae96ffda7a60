"""One axis of a simulated encoder board: the firmware's control of it, and its motor."""

from __future__ import annotations

import math
from collections.abc import Mapping

from armctl.hardware.encoder.axis_fault import FaultKind
from armctl.hardware.encoder.axis_plant import AxisPlant

UNHOMING = frozenset({"inv", "minv", "hdir", "hpos", "hmode", "sinv"})
"""Keys whose change makes an earlier zero worthless."""

_GAIN_STEPS = 256.0
_LAG_S = 0.015
_MOVED_COUNTS = 2.0


class SimulatedAxis:
    """A setpoint that moves within its limits, and a motor that follows it with a lag.

    Counts are joint counts: inverted encoders, inverted motors and the two motors of a differential
    wrist are taken to be wired as they are configured.

    Args:
        plant: the mechanics.
        defaults: its settings until it is told others.
    """

    def __init__(self, plant: AxisPlant, defaults: Mapping[str, int]) -> None:
        self.plant = plant
        self._defaults = defaults
        self.place = plant.start
        """where it really is, in the counts of a homed axis"""
        self.jammed = False
        self.torn = False
        self.switch_stuck: bool | None = None
        self.restart()

    def restart(self) -> None:
        """The board has lost its memory; the axis stays where it is."""
        self.settings = dict(self._defaults)
        self.homed = False
        self.fault = FaultKind(0)
        self._origin = self.place  # where the count is 0
        self._count = 0.0
        self._reference = self._speed = 0.0
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

    @property
    def standing_s(self) -> float:
        """How long the encoder has not moved [s]."""
        return self._standing_s

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

    def tick(self, dt: float) -> FaultKind:
        """Let ``dt`` [s] pass with the motor on, under control; return what went wrong."""
        self._advance_reference(dt)
        self._follow(dt)
        return self._supervise()

    def creep(self, speed: float, dt: float) -> None:
        """Let ``dt`` [s] pass with the motor turning at ``speed`` [counts/s], as in homing."""
        self._reference = self._count + speed * dt / _followed_share(dt)
        self._follow(dt)

    def set_zero(self) -> None:
        """The axis is where homing wants it to be: at the switch's edge, or at the stop."""
        edge = self.place
        if not self.settings["hmode"] and self.plant.switch is not None:
            edge = self.plant.switch[0 if self.settings["hdir"] > 0 else 1]
        self._origin = edge - self.settings["hpos"]
        self._count = self.place - self._origin
        self.homed = True
        self.switch_on()
        self.go(self.settings["hpos"], 0.0)

    def _advance_reference(self, dt: float) -> None:
        top, ramp = float(self.settings["vmax"]), self.settings["amax"] * dt
        target_speed = 0.0
        if math.isnan(self._to):
            wanted = 0.0
        else:
            before = self._wanted_place()
            self._left_s = max(0.0, self._left_s - dt)
            wanted_place = self._wanted_place()
            target_speed = (wanted_place - before) / dt
            away = wanted_place - target_speed * dt - self._reference
            most = math.sqrt(2.0 * self.settings["amax"] * abs(away))
            wanted = target_speed + math.copysign(min(most, abs(away) / dt), away)
        wanted = min(top, max(-top, wanted))
        self._speed += min(ramp, max(-ramp, wanted - self._speed))
        self._reference += self._speed * dt

    def _wanted_place(self) -> float:
        share = 1.0 - self._left_s / self._whole_s if self._whole_s else 1.0
        return self._from + share * (self._to - self._from)

    def _follow(self, dt: float) -> None:
        error = self._reference - self._count
        if not self.jammed:
            moved = self.place + error * _followed_share(dt)
            self.place = min(self.plant.high, max(self.plant.low, moved))
        if not self.torn:
            self._count = self.place - self._origin
        if abs(self._count - self._seen_count) >= _MOVED_COUNTS:
            self._seen_count, self._standing_s, self._moved = self._count, 0.0, True
        else:
            self._standing_s += dt

    def _supervise(self) -> FaultKind:
        error = abs(self._reference - self._count)
        if error > self.settings["ferr"]:
            return FaultKind.FOLLOWING
        drive = error * self.settings["kp"] / _GAIN_STEPS + self.settings["brk"]
        if error < _MOVED_COUNTS or drive < self.settings["dmax"]:
            self._standing_s = 0.0
        elif self._standing_s >= self.settings["stall"] / 1000.0:
            return FaultKind.STALL if self._moved and not self.torn else FaultKind.ENCODER
        return FaultKind(0)


def _followed_share(dt: float) -> float:
    """The part of its distance from the setpoint that a motor makes good in ``dt`` [s]."""
    return 1.0 - math.exp(-dt / _LAG_S)
