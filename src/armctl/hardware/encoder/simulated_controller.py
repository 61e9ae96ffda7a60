"""What a simulated encoder board does with its motors: modes, homing, trips and the watchdog."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence

from armctl.hardware.encoder.axes import WIRE_RANGES
from armctl.hardware.encoder.messages import BoardFlag, FaultKind, Mode, Status
from armctl.hardware.encoder.simulated_axis import UNHOMING, SimulatedAxis

# How a simulated encoder board finds the zero of an axis.

NOT_FOUND = "notfound"
STUCK = "stuck"

Homing = Generator[None, float, str]
"""Takes the seconds of each tick; returns why it failed, an empty string where it did not."""


def home(axis: SimulatedAxis) -> Homing:
    """Look for the switch, or for the stop, as the axis is set up."""
    axis.homed = False
    axis.switch_on()
    if axis.settings["hmode"]:
        yield from _until_stopped(axis)
    else:
        failure = yield from _find_edge(axis)
        if failure:
            return failure
    axis.set_zero()
    return ""


def _until_stopped(axis: SimulatedAxis) -> Generator[None, float, None]:
    while not _stopped(axis):
        yield from _creep(axis, axis.settings["hdir"])


def _find_edge(axis: SimulatedAxis) -> Homing:
    """Meet the switch coming from the far side, so that it is always the same edge."""
    toward = axis.settings["hdir"]
    if not (yield from _go(axis, -toward, closed=False)):
        return STUCK
    if not (yield from _go(axis, toward, closed=True)):
        # It stood beyond the switch: back over it, and once more from the right side.
        if not (yield from _go(axis, -toward, closed=True)):
            return NOT_FOUND
        if not (yield from _go(axis, -toward, closed=False)):
            return STUCK
        yield from _go(axis, toward, closed=True)
    return ""


def _go(axis: SimulatedAxis, direction: int, *, closed: bool) -> Generator[None, float, bool]:
    """Creep until the switch says ``closed``; False where the axis stops before."""
    axis.switch_on()
    while axis.switch_closed is not closed:
        if _stopped(axis):
            return False
        yield from _creep(axis, direction)
    return True


def _creep(axis: SimulatedAxis, direction: int) -> Generator[None, float, None]:
    dt = yield
    axis.creep(direction * float(axis.settings["hv"]), dt)


def _stopped(axis: SimulatedAxis) -> bool:
    return axis.standing_s >= axis.settings["stall"] / 1000.0


class Refused(Exception):  # noqa: N818  not an error: what the board answers
    """The request is answered by ``err`` and has no effect."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(f"{code} {text}")


TICK_S = 0.005
WATCHDOG_RANGE_MS = (50, 500)

_SLACK_S = 1e-9
_LONGEST_BRAKING_S = 0.1
_TRIP_WORDS = {
    FaultKind.STALL: "STALL",
    FaultKind.FOLLOWING: "FOLLOW",
    FaultKind.ENCODER: "ENCODER",
    FaultKind.HOMING: "HOMING",
}
_REFUSALS = {Mode.TRIPPED: "FAULT", Mode.OFF: "OFF", Mode.HOMING: "BUSY", Mode.HELD: "HOLD"}


class SimulatedController:
    """The part of the firmware behind its commands. Times count from the board's start.

    Args:
        axes: by number.
        flags: that the start has left behind.
    """

    def __init__(self, axes: Sequence[SimulatedAxis], flags: BoardFlag) -> None:
        self.axes = axes
        self.mode = Mode.OFF
        self._flags = flags
        self._ticks = 0
        self._watchdog_s = WATCHDOG_RANGE_MS[1] / 1000.0
        self._heard_s = 0.0
        self._off_at_s: float | None = None
        self._held_told = False
        self._homing: Homing | None = None
        self._to_home: list[int] = []
        self._events: list[str] = []

    @property
    def ticks(self) -> int:
        """Control periods since the start."""
        return self._ticks

    @property
    def time_s(self) -> float:
        """Since the start [s]."""
        return self._ticks * TICK_S

    def tick(self) -> None:
        """Let a control period pass."""
        self._ticks += 1
        if self.mode.powered:
            self._move()
            self._watch_host()

    def sleep(self, ticks: int) -> None:
        """Let control periods pass in which nothing can happen, for the motors are off."""
        self._ticks += ticks

    def status(self) -> Status:
        """What there is to say now."""
        return Status(
            time_ms=round(self.time_s * 1000),
            mode=self.mode,
            homed=tuple(axis.homed for axis in self.axes),
            switches=tuple(axis.switch_closed for axis in self.axes),
            flags=self._flags,
            faults=tuple(axis.fault for axis in self.axes),
            counts=tuple(axis.count for axis in self.axes),
        )

    def take_events(self) -> list[str]:
        """What has happened since this was last asked."""
        events, self._events = self._events, []
        return events

    def note_lost_line(self, *, lost: bool) -> None:
        """A line was too long; or the status has told that it was."""
        self._flags = self._flags | BoardFlag.LINE_LOST if lost else self._flags & ~BoardFlag.LINE_LOST

    def feed_watchdog(self) -> None:
        """The host has said something that makes sense."""
        self._heard_s = self.time_s

    def set_watchdog_ms(self, ms: int) -> None:
        """How long the host may be silent while motors are on."""
        self._watchdog_s = ms / 1000.0

    def switch_on(self) -> None:
        """Hold where the axes stand."""
        self.check_not(Mode.TRIPPED, Mode.HOMING)
        if self._off_at_s is not None:
            raise Refused("HOLD", "braking")
        if self.mode is Mode.OFF:
            self._begin(Mode.ON)

    def switch_off(self) -> None:
        """Let the motors coast."""
        self._end(Mode.OFF)

    def stop_at_once(self) -> None:
        """The emergency byte."""
        self._flags |= BoardFlag.STOPPED
        self._end(Mode.OFF)
        self._events.append("stopped")

    def hold(self) -> None:
        """Slow down and hold, until ``release_hold``."""
        if self.mode in (Mode.ON, Mode.HOMING):
            self._hold()

    def release_hold(self) -> None:
        """Take setpoints again. Nothing moves by this; the watchdog's braking is not undone."""
        if self.mode is Mode.HELD and self._off_at_s is None:
            self.mode = Mode.ON

    def clear(self) -> None:
        """Forget faults and flags; the motors stay off."""
        for axis in self.axes:
            axis.fault = FaultKind(0)
        self._flags = BoardFlag(0)
        if self.mode is Mode.TRIPPED:
            self.mode = Mode.OFF

    def home(self, order: Sequence[int]) -> None:
        """Look for the zeros of axes, one after the other."""
        self.check_not(Mode.TRIPPED, Mode.HOMING, Mode.HELD)
        self._begin(Mode.HOMING)
        self._to_home = list(order)
        for axis in order:
            self.axes[axis].homed = False

    def go(self, counts: Mapping[int, int], within_s: float) -> None:
        """Take setpoints that are allowed."""
        for axis, count in counts.items():
            self.axes[axis].go(count, within_s)

    def configure(self, axis: SimulatedAxis, changes: dict[str, int]) -> None:
        """Take the settings of a line, or none of them."""
        self.check_off()
        wanted = axis.settings | changes
        if wanted["min"] >= wanted["max"]:
            raise Refused("RANGE", "min not below max")
        if any(axis.settings[key] != wanted[key] for key in UNHOMING):
            axis.homed = False
        axis.settings = wanted

    def check_off(self) -> None:
        """Refuse what may only be done with the motors off."""
        if self.mode.powered:
            raise Refused("MOVING", "motors are on")

    def check_not(self, *modes: Mode) -> None:
        """Refuse what these modes do not allow."""
        if self.mode in modes:
            raise Refused(_REFUSALS[self.mode], "not now")

    def _move(self) -> None:
        homing = self._to_home[0] if self._to_home else None
        for number, axis in enumerate(self.axes):
            if number != homing and (fault := axis.tick(TICK_S)):
                self._trip(number, fault)
                return
        if homing is not None:
            self._home_on(homing)
        elif self.mode is Mode.HOMING:
            self.mode = Mode.ON
            self._events.append("home done")
        elif self.mode is Mode.HELD and not self._held_told and not any(axis.moving for axis in self.axes):
            self._held_told = True
            self._events.append("held")

    def _home_on(self, number: int) -> None:
        if self._homing is None:
            self._homing = home(self.axes[number])
            next(self._homing)
        try:
            self._homing.send(TICK_S)
        except StopIteration as ended:
            self._homing = None
            if ended.value:
                self._events.append(f"home failed {number} {ended.value}")
                self._trip(number, FaultKind.HOMING)
                return
            self._events.append(f"homed {number}")
            self._to_home.pop(0)

    def _watch_host(self) -> None:
        """Brake when the host has been silent for long, then switch off, whatever it says by then."""
        if self._off_at_s is None:
            limit_s = self._watchdog_s - min(_LONGEST_BRAKING_S, self._watchdog_s / 2)
            if self.time_s - self._heard_s < limit_s - _SLACK_S:
                return
            self._flags |= BoardFlag.WATCHDOG
            self._events.append("watchdog")
            self._off_at_s = self._heard_s + self._watchdog_s
            self._hold()
        if self.time_s >= self._off_at_s - _SLACK_S:
            self._end(Mode.OFF)

    def _trip(self, number: int, fault: FaultKind) -> None:
        axis = self.axes[number]
        axis.fault |= fault
        if fault is FaultKind.ENCODER:
            axis.homed = False
        self._end(Mode.TRIPPED)
        self._events.append(f"trip {number} {_TRIP_WORDS[fault]}")

    def _begin(self, mode: Mode) -> None:
        self._flags &= ~(BoardFlag.WATCHDOG | BoardFlag.STOPPED)
        if not self.mode.powered:
            for axis in self.axes:
                axis.switch_on()
        self.mode = mode

    def _end(self, mode: Mode) -> None:
        self.mode = Mode.TRIPPED if self.mode is Mode.TRIPPED else mode
        self._off_at_s = None
        self._homing = None
        self._to_home.clear()

    def _hold(self) -> None:
        self.mode = Mode.HELD
        self._held_told = self._off_at_s is not None
        self._homing = None
        self._to_home.clear()
        for axis in self.axes:
            axis.halt()


# Requests: taken apart and checked, before anything is done.

_REACH_MS = 20
_REACH_RANGE_MS = (1, 1000)
_MOST_COUNTS = 1 << 31


def number(word: str, low: int, high: int) -> int:
    """A decimal number within its range."""
    try:
        value = int(word)
    except ValueError:
        raise Refused("ARGS", f"{word} is no number") from None
    if not low <= value <= high:
        raise Refused("RANGE", f"{word} is outside {low} {high}")
    return value


def axis_number(word: str, axes: int) -> int:
    """The number of an axis that there is."""
    return number(word, 0, axes - 1)


def settings(words: Sequence[str]) -> dict[str, int]:
    """The ``key=value`` pairs of a CFG line."""
    found: dict[str, int] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key not in WIRE_RANGES:
            raise Refused("ARGS", f"unknown key {key}")
        found[key] = number(value, *WIRE_RANGES[key])
    if not found:
        raise Refused("ARGS", "nothing to set")
    return found


def setpoints(words: Sequence[str], axes: int) -> tuple[dict[int, int], float]:
    """The counts by axis of a P line, and the seconds in which to be there."""
    if len(words) not in (axes, axes + 1):
        raise Refused("ARGS", f"P takes {axes} setpoints and a time")
    counts = {
        axis: number(word, -_MOST_COUNTS, _MOST_COUNTS - 1)
        for axis, word in enumerate(words[:axes])
        if word != "-"
    }
    reach_ms = number(words[axes], *_REACH_RANGE_MS) if len(words) > axes else _REACH_MS
    return counts, reach_ms / 1000.0


def check_setpoints(counts: dict[int, int], axes: Sequence[SimulatedAxis]) -> None:
    """Refuse all of them where one may not be."""
    for axis in counts:
        if not axes[axis].homed:
            raise Refused("NOTHOMED", str(axis))
    for axis, count in counts.items():
        low, high = axes[axis].settings["min"], axes[axis].settings["max"]
        if not low <= count <= high:
            raise Refused("LIMIT", f"{axis} {count} {low} {high}")


def homing_order(words: Sequence[str], axes: Sequence[SimulatedAxis]) -> list[int]:
    """The axes that a HOME line is about, in the order in which they are homed; unused ones are left out."""
    named = {axis_number(word, len(axes)) for word in words} or set(range(len(axes)))
    used = [axis for axis in named if axes[axis].settings["hord"]]
    for axis in used:
        own = axes[axis].settings
        if not own["min"] <= own["hpos"] <= own["max"]:
            raise Refused("RANGE", f"hpos outside min max, axis {axis}")
    return sorted(used, key=lambda axis: (axes[axis].settings["hord"], axis))


def check_pair(words: Sequence[str], axes: int) -> None:
    """Refuse what is neither two axes nor NONE."""
    if list(words) == ["NONE"]:
        return
    if len(words) != 2:
        raise Refused("ARGS", "PAIR takes two axes or NONE")
    first, second = (axis_number(word, axes) for word in words)
    if first == second:
        raise Refused("RANGE", "two axes")


def shown(values: Mapping[str, int], part: str) -> str:
    """The first or the second half of an axis's settings, as SHOW tells them."""
    keys = list(values)
    half = len(keys) // 2
    return " ".join(f"{key}={values[key]}" for key in (keys[:half] if part == "1" else keys[half:]))
