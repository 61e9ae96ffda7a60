"""What the driver of a bus knows of each servo, and what it says of one that is not as it should be."""

from __future__ import annotations

import math
from dataclasses import field, replace

from armctl.facts import Quantities, QuantityLimits
from armctl.hardware.bus.make import Telemetry
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.servos import ServoSettings
from armctl.lazy_dataclass import dataclass

DOUBTED = 3
"""readings in a row without an answer after which a servo is sent no more goals"""
_OVERLOAD = (
    "overload: it has given way and holds where it stands. Take away what is in its way or too heavy, then "
    "clear the fault and enable"
)
_LET_GO = "it has let go: support the arm ({}). Then clear the fault and enable"
_TOLD_S = 5.0
_JUMP_STEPS = 60
"""by which a position may differ from the one before beyond what the speed explains"""
_LIMIT_STEP = 0.002


@dataclass
class KnownServo:
    """What the driver knows of one servo."""

    id: int
    settings: ServoSettings | None = None
    seen: Telemetry = field(default_factory=Telemetry)
    seen_at: float = 0.0
    missed: int = 0
    gone: bool = False
    """whether it has not answered for some time"""
    asked_at: float = 0.0
    """when it was looked for last, where it is gone"""
    restarts_until: float = 0.0
    """so long it may be gone because it was told to start anew"""
    doubted: int | None = None
    """a position that is too far from the one before to be believed without another"""
    on: bool = False
    """whether armctl has switched it on, or found it on"""
    goal: int | None = None
    """the last goal that was sent [steps]"""
    wanted: int | None = None
    """the goal that it is on its way to [steps]"""
    sent_at: float = 0.0
    torque: float = 1.0
    """how strong it may be, a share of its full torque"""
    eased: float = 1.0
    """the share of that which it has, on the way to a release"""
    maybe: tuple[tuple[float, float], ...] = ()
    """what ``torque`` and ``eased`` may be instead: it was told so, and did not confirm it"""
    supply_v: float | None = None
    """without load [V]: as the robot file says, or the highest that it has measured"""
    went_off: bool = False
    """whether its torque went off by itself"""
    gave_way: bool = False
    """whether it gave way to an overload, or let go, and is to stay where it stands now"""
    why_so: str = ""
    """why it gave way, in words"""
    yielded_at: float = -math.inf
    """when a gripper did so last, which goes on"""
    wrong: tuple[tuple[str, ...], bool, bool] = ((), False, False)
    """what was wrong at the last answer: in words, gone off, given way"""
    measured: str = ""
    """what it measured when that began, and its limits, in words"""
    _limits: tuple[tuple[object, ...], QuantityLimits] | None = None
    """what it may come to, and what follows from what"""

    @property
    def let_go(self) -> bool:
        """Whether it does not hold any more what it was told to."""
        return self.went_off or self.gave_way or bool(self.seen.refuses)

    @property
    def takes_goals(self) -> bool:
        """Whether a goal would only move it: it would switch on one that is limp, or has started anew."""
        return self.on and not (self.went_off or self.seen.refuses or self.gone) and self.missed < DOUBTED

    def believes(self, position: int | None, now: float, steps_per_turn: float) -> bool:
        """Whether a position is near enough to the one before; else the next one decides."""
        before = self.seen.position
        if position is not None and before is not None and now - self.seen_at < 1.0:
            room = _JUMP_STEPS + steps_per_turn * (now - self.seen_at)  # a turn a second and more
            if abs(position - before) > room and (
                self.doubted is None or abs(position - self.doubted) > room
            ):
                self.doubted, self.missed = position, self.missed + 1
                return False
        self.doubted = None
        return True

    def gives_way(self, now: float, *, grips: bool) -> int | None:
        """Where it has given way, the place that is its goal from now on [steps]; None: it has not.

        Its next goal ends an overload. One that has let go, for heat or for want of voltage, sinks, and would
        turn back to its old goal by itself: it is followed. One that ``grips`` goes on after an overload.
        """
        seen = self.seen
        if not self.on or self.went_off or seen.position is None:
            return None
        if not seen.unloaded and (self.let_go or not seen.gave_way):
            return None
        self.goal = self.wanted = seen.position
        self.sent_at = self.yielded_at = now
        if seen.unloaded or not grips:
            self.why_so = _LET_GO.format("; ".join(seen.wrong)) if seen.unloaded else self.why_so or _OVERLOAD
            self.gave_way = True
        return seen.position

    @property
    def weak(self) -> bool:
        """Whether it has, or may have, a part of its torque only, on the way to a release."""
        return any(eased != 1.0 for eased in (self.eased, *(eased for _, eased in self.maybe)))

    def limited(self, torque: float, eased: float) -> None:
        """It is known to have this share of its full torque, and that share of this."""
        self.torque, self.eased, self.maybe = torque, eased, ()
        self.seen = Telemetry(torque_limit=torque * eased).after(self.seen)

    def has_limit(self, limit: float) -> bool:
        """Whether a limit that it tells is one that it was told; then that is known to be the one."""
        for torque, eased in ((self.torque, self.eased), *self.maybe):
            if abs(limit - torque * eased) <= _LIMIT_STEP:
                self.torque, self.eased, self.maybe = torque, eased, ()
                return True
        return False

    @property
    def quantities(self) -> Quantities:
        """What it measures besides its position."""
        seen = self.seen
        return Quantities(seen.load, seen.temperature, seen.voltage, seen.current)

    def limits(self, *, grips: bool) -> QuantityLimits:
        """What it may come to. Where it has less torque than at which it protects itself, that is the limit.

        Not for one that ``grips``: it presses with all the torque that it may have, for as long as it holds.
        """
        known = self.settings, self.torque, self.supply_v, grips
        if self._limits is None or self._limits[0] != known:
            self._limits = known, self._limits_now(grips=grips)
        return self._limits[1]

    def _limits_now(self, *, grips: bool) -> QuantityLimits:
        own = QuantityLimits() if self.settings is None else self.settings.limits
        load = own.load if grips else min(self.torque, 1.0 if own.load is None else own.load)
        return replace(own, load=load, supply_v=self.supply_v)

    def note(self, *, grips: bool) -> None:
        """Note what it measures at the moment at which something becomes wrong."""
        wrong = self.seen.wrong, self.went_off, self.gave_way
        if wrong == self.wrong:
            return
        self.wrong = wrong
        limits = self.limits(grips=grips)
        told = str(Quantities(limits.load, limits.temperature_c, None, limits.current_a))
        if limits.voltage_v is not None:
            told += f"{', ' if told else ''}at least {limits.voltage_v:.1f} V"
        self.measured = f" (measured: {self.quantities}" + (f"; its limits: {told})" if told else ")")

    def fault(self, now: float) -> str | None:
        """What is wrong with it, in words with numbers; None: nothing is."""
        seen = self.seen
        if not (self.gone or self.went_off or self.gave_way or seen.faults or seen.latched):
            return None
        words = "; ".join(seen.wrong)
        if self.gone and now < self.restarts_until:
            return f"servo {self.id} starts anew, its fault was cleared; wait for a second"
        if self.gone:
            return f"servo {self.id} does not answer; look at its plug and its power"
        if self.went_off:
            why = words or "it has started anew, or another program switched it off"
            return f"servo {self.id} has switched its torque off ({why}){self.measured}"
        if self.gave_way:
            return f"servo {self.id}: {self.why_so}{self.measured}"
        return f"servo {self.id}: {words}{self.measured}" if words else None

    def warning(self, needs: ChannelSettings, now: float, *, grips: bool) -> str | None:
        """What is to be watched, in words; None: nothing. ``needs``: what the robot needs of it [steps]."""
        if grips and now - self.yielded_at < _TOLD_S:
            return f"servo {self.id} was stopped by something and holds it where it is"
        own = self.settings
        if own is not None and (needs.minimum < own.lowest or needs.maximum > own.highest):
            return (
                f"servo {self.id}: the limits {own.lowest} … {own.highest} of its own EEPROM cut off a "
                f"part of the {needs.minimum:g} … {needs.maximum:g} steps of the robot file"
            )
        return None
