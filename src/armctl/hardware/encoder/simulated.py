"""A simulated encoder board: the firmware's behaviour behind its serial line, byte for byte."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence

from armctl.errors import BoardProtocolError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.encoder.axes import WIRE, EncoderAxis
from armctl.hardware.encoder.messages import (
    FIRMWARE,
    LARGEST_SEQUENCE,
    LONGEST_REQUEST,
    PROTOCOL,
    Banner,
    BoardFlag,
    FaultKind,
    LineReader,
    Mode,
    Realtime,
    Status,
    seal,
    unseal,
)
from armctl.hardware.encoder.simulated_axis import (
    FIRMWARE_DEFAULTS,
    TICK_S,
    AxisPlant,
    SimulatedAxis,
    plant_of,
)

AXES = len(FIRMWARE_DEFAULTS)
VERSION = "1.1.0"

_TICKS_PER_STATUS = 4
_SLACK_S = 1e-9
_LONGEST_CATCH_UP = round(2.0 / TICK_S)  # as long as a read may wait; motors are off by then
_LOG_LENGTH = 10_000
_REALTIME = re.compile(rb"([!?~\x18])")
_REQUEST = re.compile(r"(\d{1,5}) (.+)")
_WATCHDOG_RANGE_MS = (50, 500)
_LONGEST_BRAKING_S = 0.1
_REACH_MS = 20
_REACH_RANGE_MS = (1, 1000)
_MOST_COUNTS = 1 << 31
_COMMANDS = ("HELLO", "PING", "GET", "CLR", "EN", "WD", "HOME", "P", "PAIR", "CFG", "SHOW")
_REFUSALS = {Mode.TRIPPED: "FAULT", Mode.OFF: "OFF", Mode.HOMING: "BUSY", Mode.HELD: "HOLD"}


class _Refused(Exception):  # noqa: N818  not an error: what the board answers
    """The request has no effect; it is answered by ``err`` with this code and text."""


class SimulatedEncoderBoard:
    """An Arduino Mega with armctl's encoder firmware, and an arm on it.

    ``plants``: the mechanics by axis, plain ones for those not named; ``boot_s``: for how long it says and
    takes nothing after a start; ``protocol``: what it says it speaks, as a board flashed long ago would.
    """

    def __init__(
        self, plants: Mapping[int, AxisPlant] | None = None, *, boot_s: float = 0.0, protocol: int = PROTOCOL
    ) -> None:
        known = plants or {}
        self.axes = [
            SimulatedAxis(known.get(axis, AxisPlant()), defaults)
            for axis, defaults in enumerate(FIRMWARE_DEFAULTS)
        ]
        self.log: deque[str] = deque(maxlen=_LOG_LENGTH)
        """the lines that it executed or refused, without those that were repeated, oldest first"""
        self._boot_s = boot_s
        self._protocol = protocol
        self._now: float | None = None
        self.reset()

    def reset(self, cause: str = "power") -> None:
        """Start anew for ``cause``: power, external, brownout or watchdog. The arm stays where it is."""
        for axis in self.axes:
            axis.restart()
        self._banner = Banner(FIRMWARE, VERSION, self._protocol, AXES, cause)
        self.mode = Mode.OFF  # what the motors do
        self._flags = BoardFlag.BROWN_OUT if cause == "brownout" else BoardFlag(0)
        self._ticks = 0
        self._watchdog_s = _WATCHDOG_RANGE_MS[1] / 1000.0
        self._fed_s = 0.0
        self._off_at_s: float | None = None
        self._held_reported = False
        self._homing: Iterator[None] = iter(())
        self._to_home: list[int] = []
        self._reader = LineReader(LONGEST_REQUEST)
        self._last: tuple[bytes, str] | None = None  # the last line and its answer
        self._started_at: float | None = None
        self._greeted = False
        self._unsent = bytearray()

    def advance(self, now: float) -> bytes:
        """Let time pass up to ``now`` [s] and return status lines and events."""
        if self._now is None or now > self._now:
            self._now = now
        if self._started_at is None:
            self._started_at = self._now + self._boot_s
        if self._now < self._started_at:
            return b""
        if not self._greeted:
            self._greeted = True
            self._say(f"# {self._banner.encode()}")
        due = int((self._now - self._started_at + _SLACK_S) / TICK_S)
        while self._ticks < due:
            if not self.mode.powered:
                self._ticks = max(self._ticks, due - _LONGEST_CATCH_UP)
            self._ticks += 1
            if self.mode.powered:
                self._move()
                self._watch_host()
            if self._ticks % _TICKS_PER_STATUS == 0:
                self._say_status()
        return self._take_unsent()

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host and return what they bring about."""
        if not self._greeted:
            return b""
        for piece in _REALTIME.split(data):
            if _REALTIME.fullmatch(piece):
                self._obey_at_once(Realtime(piece[0]))
            else:
                self._take(piece)
        return self._take_unsent()

    # The line.

    def _take(self, data: bytes) -> None:
        for line in self._reader.feed(data):
            if line is None:
                self._flags |= BoardFlag.LINE_LOST
                self._say("0 err LONG more than 96 bytes")
            elif line:
                self._take_line(line)

    def _take_line(self, line: bytes) -> None:
        try:
            text = unseal(line)
        except BoardProtocolError:
            self._say("0 err CRC line ignored")
            return
        found = _REQUEST.fullmatch(text)
        if found is None or not 1 <= int(found[1]) <= LARGEST_SEQUENCE:
            self._say("0 err SYNTAX seq 1 65535")
            return
        self._fed_s = self._time_s
        if self._last is None or self._last[0] != line:
            self.log.append(found[2])
            command, *words = found[2].split(" ")
            try:
                answer = f"ok {self._execute(command, words)}".rstrip()
            except _Refused as refused:
                answer = f"err {refused}"
            self._last = line, f"{int(found[1])} {answer}"
        self._say(self._last[1])

    def _say_status(self) -> None:
        self._say(f"@ {self._status().encode()}")
        self._flags &= ~BoardFlag.LINE_LOST

    def _say(self, text: str) -> None:
        self._unsent += seal(text)

    def _take_unsent(self) -> bytes:
        sent, self._unsent = bytes(self._unsent), bytearray()
        return sent

    # Requests: taken apart and checked, before anything is done.

    def _execute(self, command: str, words: Sequence[str]) -> str:
        match command, words:
            case "HELLO", []:
                return self._banner.encode()
            case "PING", []:
                pass
            case "GET", []:
                return self._status().encode()
            case "CLR", []:
                for each in self.axes:
                    each.fault = FaultKind(0)
                self._flags = BoardFlag(0)
                if self.mode is Mode.TRIPPED:
                    self.mode = Mode.OFF
            case "EN", ["0"]:
                self._end(Mode.OFF)
            case "EN", ["1"]:
                self._refuse_in(Mode.TRIPPED, Mode.HOMING)
                if self._off_at_s is not None:
                    raise _Refused("HOLD braking")
                if self.mode is Mode.OFF:
                    self._begin(Mode.ON)
            case "WD", [ms]:
                self._watchdog_s = _number(ms, *_WATCHDOG_RANGE_MS) / 1000.0
            case "HOME", _:
                self._home(words)
            case "P", _ if len(words) in (AXES, AXES + 1):
                self._go(words)
            case "PAIR", ["NONE"]:
                self._refuse_when_on()
            case "PAIR", [first, second]:
                # The plant is in joint counts: which motors turn it does not matter.
                if self._axis(first) is self._axis(second):
                    raise _Refused("RANGE two axes")
                self._refuse_when_on()
            case "CFG", [axis, *pairs]:
                self._configure(axis, pairs)
            case "SHOW", [axis, ("1" | "2") as part]:
                shown = [f"{key}={value}" for key, value in self._axis(axis).settings.items()]
                half = len(shown) // 2
                return " ".join(shown[:half] if part == "1" else shown[half:])
            case _:
                known = command in _COMMANDS
                raise _Refused(f"ARGS {command} takes other arguments" if known else "UNKNOWN command")
        return ""

    def _home(self, words: Sequence[str]) -> None:
        """Look for the zeros of these axes, or of all, one after the other; unused ones are left out."""
        named = {_number(word, 0, AXES - 1) for word in words} or set(range(AXES))
        used = [axis for axis in sorted(named) if self.axes[axis].settings["hord"]]
        for axis in used:
            own = self.axes[axis].settings
            if not own["min"] <= own["hpos"] <= own["max"]:
                raise _Refused(f"RANGE hpos outside min max, axis {axis}")
        self._refuse_in(Mode.TRIPPED, Mode.HOMING, Mode.HELD)
        self._begin(Mode.HOMING)
        self._to_home = sorted(used, key=lambda axis: self.axes[axis].settings["hord"])
        for axis in used:
            self.axes[axis].homed = False
        self._homing = self._home_in_order()
        next(self._homing, None)

    def _go(self, words: Sequence[str]) -> None:
        """Take setpoints, all or none; a last word is the time [ms] in which to be there."""
        counts = {
            axis: _number(word, -_MOST_COUNTS, _MOST_COUNTS - 1)
            for axis, word in enumerate(words[:AXES])
            if word != "-"
        }
        reach_ms = _number(words[AXES], *_REACH_RANGE_MS) if len(words) > AXES else _REACH_MS
        self._refuse_in(Mode.TRIPPED, Mode.OFF, Mode.HOMING, Mode.HELD)
        for axis in counts:
            if not self.axes[axis].homed:
                raise _Refused(f"NOTHOMED {axis}")
        for axis, count in counts.items():
            low, high = self.axes[axis].settings["min"], self.axes[axis].settings["max"]
            if not low <= count <= high:
                raise _Refused(f"LIMIT {axis} {count} {low} {high}")
        for axis, count in counts.items():
            self.axes[axis].go(count, reach_ms / 1000.0)

    def _configure(self, axis: str, pairs: Sequence[str]) -> None:
        """Take the settings of a line, or none of them."""
        changes: dict[str, int] = {}
        for pair in pairs:
            key, equals, value = pair.partition("=")
            if not equals or key not in WIRE:
                raise _Refused(f"ARGS unknown key {key}")
            changes[key] = _number(value, WIRE[key].low, WIRE[key].high)
        if not changes:
            raise _Refused("ARGS nothing to set")
        own = self._axis(axis)
        self._refuse_when_on()
        settings = own.settings | changes
        if settings["min"] >= settings["max"]:
            raise _Refused("RANGE min not below max")
        own.configure(settings)

    def _axis(self, word: str) -> SimulatedAxis:
        return self.axes[_number(word, 0, AXES - 1)]

    def _refuse_when_on(self) -> None:
        if self.mode.powered:
            raise _Refused("MOVING motors are on")

    def _refuse_in(self, *modes: Mode) -> None:
        if self.mode in modes:
            raise _Refused(f"{_REFUSALS[self.mode]} not now")

    # What the motors do. Times count from the board's start.

    @property
    def _time_s(self) -> float:
        return self._ticks * TICK_S

    def _status(self) -> Status:
        return Status(
            time_ms=round(self._time_s * 1000),
            mode=self.mode,
            homed=tuple(axis.homed for axis in self.axes),
            switches=tuple(axis.switch_closed for axis in self.axes),
            flags=self._flags,
            faults=tuple(axis.fault for axis in self.axes),
            counts=tuple(axis.count for axis in self.axes),
        )

    def _obey_at_once(self, byte: Realtime) -> None:
        if byte is Realtime.STATUS:
            self._say_status()
        elif byte is Realtime.HOLD and self.mode in (Mode.ON, Mode.HOMING):
            self._hold()
        elif byte is Realtime.RELEASE_HOLD and self.mode is Mode.HELD and self._off_at_s is None:
            self.mode = Mode.ON  # nothing moves by this; the watchdog's braking is not undone
        elif byte is Realtime.MOTORS_OFF:
            self._flags |= BoardFlag.STOPPED
            self._end(Mode.OFF)
            self._say("! stopped")

    def _move(self) -> None:
        homing = self._to_home[0] if self._to_home else None
        for number, axis in enumerate(self.axes):
            if number != homing and (fault := axis.tick()):
                self._trip(number, fault)
                return
        if homing is not None:
            next(self._homing, None)
        elif self.mode is Mode.HOMING:
            self.mode = Mode.ON
            self._say("! home done")
        elif (
            self.mode is Mode.HELD and not self._held_reported and not any(axis.moving for axis in self.axes)
        ):
            self._held_reported = True
            self._say("! held")

    def _home_in_order(self) -> Iterator[None]:
        while self._to_home:
            number = self._to_home[0]
            failure = yield from self.axes[number].home()
            if failure:
                self._say(f"! home failed {number} {failure}")
                self._trip(number, FaultKind.HOMING)
                return
            self._say(f"! homed {number}")
            self._to_home.pop(0)

    def _watch_host(self) -> None:
        """Brake when the host has been silent for long, then switch off, whatever it says by then."""
        if self._off_at_s is None:
            limit_s = self._watchdog_s - min(_LONGEST_BRAKING_S, self._watchdog_s / 2)
            if self._time_s - self._fed_s < limit_s - _SLACK_S:
                return
            self._flags |= BoardFlag.WATCHDOG
            self._say("! watchdog")
            self._off_at_s = self._fed_s + self._watchdog_s
            self._hold()
        if self._time_s >= self._off_at_s - _SLACK_S:
            self._end(Mode.OFF)

    def _trip(self, number: int, fault: FaultKind) -> None:
        self.axes[number].fault |= fault
        if fault is FaultKind.ENCODER:
            self.axes[number].homed = False
        self._end(Mode.TRIPPED)
        self._say(f"! trip {number} {fault.name}")

    def _begin(self, mode: Mode) -> None:
        """Switch the motors on: the axes hold where they stand."""
        self._flags &= ~(BoardFlag.WATCHDOG | BoardFlag.STOPPED)
        if not self.mode.powered:
            for axis in self.axes:
                axis.switch_on()
        self.mode = mode

    def _end(self, mode: Mode) -> None:
        """Let the motors coast."""
        if self.mode is not Mode.TRIPPED:
            self.mode = mode
        self._off_at_s = None
        self._to_home.clear()

    def _hold(self) -> None:
        """Slow down and hold, until that is released."""
        self.mode = Mode.HELD
        self._held_reported = self._off_at_s is not None
        self._to_home.clear()
        for axis in self.axes:
            axis.halt()


def _number(word: str, low: int, high: int) -> int:
    """A decimal number within its range."""
    try:
        value = int(word)
    except ValueError:
        raise _Refused(f"ARGS {word} is no number") from None
    if not low <= value <= high:
        raise _Refused(f"RANGE {word} is outside {low} {high}")
    return value


def simulated_encoder_board(
    channels: Sequence[ChannelSettings], axes: Sequence[EncoderAxis]
) -> SimulatedEncoderBoard:
    """A board with an arm on it that fits these settings; axes without any are plain ones."""
    own = {one.entry.axis: one for one in axes}
    return SimulatedEncoderBoard(
        {one.channel: plant_of(one, own[one.channel]) for one in channels if one.channel in own}
    )
