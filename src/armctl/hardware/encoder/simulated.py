"""A simulated encoder board: the firmware's behaviour behind its serial line, byte for byte."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence

from armctl.hardware.board_type import SimulatedPins
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.encoder.axes import EncoderAxis
from armctl.hardware.encoder.messages import (
    FIRMWARE,
    LARGEST_SEQUENCE,
    LONGEST_REQUEST,
    MOST_LOST_EDGES,
    PROTOCOL,
    RESET_FLAGS,
    Banner,
    BoardFlag,
    FaultKind,
    LineReader,
    Mode,
    Realtime,
    RefusedRequest,
    RequestWords,
    Status,
    crc16,
    seal,
    within,
)
from armctl.hardware.encoder.simulated_axis import (
    FIRMWARE_DEFAULTS,
    TICK_S,
    AxisPlant,
    SimulatedAxis,
    Trouble,
    plant_of,
)
from armctl.hardware.encoder.simulated_pins import SpareBank

AXES = len(FIRMWARE_DEFAULTS)
VERSION = "1.3.0"

_TICKS_PER_STATUS = 4
_SLACK_S = 1e-9
_LONGEST_CATCH_UP = round(2.0 / TICK_S)  # as long as a read may wait; motors are off by then
_LOG_LENGTH = 10_000
_REALTIME = re.compile(rb"([!?~\x18])")
_SEALED = re.compile(rb"(.*)\*([0-9A-F]{4})", re.DOTALL)

_WATCHDOG_RANGE_MS = (50, 500)
_LONGEST_BRAKING_S = 0.1
_REACH_MS = 20
_REACH_RANGE_MS = (1, 1000)
_MOST_LOST_SHOWN = 15
_PAIR = (3, 4)  # axes of the differential pair until a host says otherwise
_KEPT_FLAGS = BoardFlag.BROWN_OUT | BoardFlag.INTERRUPTED
_REFUSALS = {Mode.TRIPPED: "FAULT latched", Mode.OFF: "OFF", Mode.HOMING: "BUSY homing", Mode.HELD: "HOLD"}


class SimulatedEncoderBoard(SimulatedPins):
    """An Arduino Mega with armctl's encoder firmware, and an arm on it.

    ``plants``: the mechanics by axis, plain ones for those not named; ``boot_s``: for how long it says and
    takes nothing after a start; ``protocol``: what it says it speaks, as a board flashed long ago would.
    """

    def __init__(
        self, plants: Mapping[int, AxisPlant] | None = None, *, boot_s: float = 0.0, protocol: int = PROTOCOL
    ) -> None:
        super().__init__()
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
        self._flags = BoardFlag(0)
        self.reset("power")

    def reset(self, cause: str | None = None) -> None:
        """Start anew for ``cause``: power, external, brownout, watchdog or unexpected (while a host worked).

        None: what the firmware takes a reset for behind a Mega's boot loader, which erases the cause. The arm
        stays where it is.
        """
        if cause is None:
            works = self._last is not None and self._time_s - self._fed_s < _WATCHDOG_RANGE_MS[1] / 1000.0
            cause = "unexpected" if self.mode.powered or works else "external"
        for axis in self.axes:
            axis.restart()
        self._banner = Banner(FIRMWARE, VERSION, self._protocol, AXES, cause)
        self.mode = Mode.OFF  # what the motors do
        self.pins = SpareBank(self.levels)
        self._pair: tuple[int, ...] = _PAIR
        kept = BoardFlag(0) if cause == "power" else self._flags & _KEPT_FLAGS
        self._flags = kept | RESET_FLAGS.get(cause, BoardFlag(0))
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
            if self.pins.sample(lost=self._time_s - self._fed_s >= self._watchdog_s - _SLACK_S):
                self._say(f"! pins {self.pins}")
            for number, axis in enumerate(self.axes):
                if axis.homed and axis.lost > MOST_LOST_EDGES:
                    self._trip(number, FaultKind.LOST)
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
                continue
            for line in self._reader.feed(piece):
                if line is None:
                    self._flags |= BoardFlag.LINE_LOST
                    self._say("0 err LONG more than 96 bytes")
                elif line:
                    self._take_line(line)
        return self._take_unsent()

    # The line.

    def _take_line(self, line: bytes) -> None:
        found = _SEALED.fullmatch(line)
        if found is None or int(found[2], 16) != crc16(found[1]):
            self._say("0 err CRC line ignored")
            return
        self._fed_s = self._time_s
        words = RequestWords(found[1].decode("latin-1"))
        sequence = words.number_or(words.take())
        if sequence is None or not 1 <= sequence <= LARGEST_SEQUENCE:
            self._say("0 err SYNTAX seq 1 65535")
            return
        if self._last is None or self._last[0] != line:
            self.log.append(" ".join(words.rest))
            try:
                answer = f"ok {self._execute(words)}".rstrip()
            except RefusedRequest as refused:
                answer = f"err {refused}"
            self._last = line, f"{sequence} {answer}"
        self._say(self._last[1])

    def _say_status(self) -> None:
        self._say(f"@ {self._told_status()}")

    def _say(self, text: str) -> None:
        self._unsent += seal(text)

    def _take_unsent(self) -> bytes:
        sent, self._unsent = bytes(self._unsent), bytearray()
        return sent

    # Requests: taken apart and checked word by word as the firmware does, before anything is done.

    def _execute(self, words: RequestWords) -> str:
        command = words.take()
        if command is None:
            raise RefusedRequest("UNKNOWN no command")
        match command:
            case "HELLO" | "PING" | "GET" | "CLR":
                words.end()
                return self._simple(command)
            case "EN":
                self._enable(words)
            case "WD":
                ms = words.number("ARGS ms missing")
                words.end()
                self._watchdog_s = within(ms, _WATCHDOG_RANGE_MS, "RANGE ms 50 500") / 1000.0
            case "HOME":
                self._home(words)
            case "P":
                self._go(words)
            case "PAIR":
                self._set_pair(words)
            case "CFG":
                self._configure(words)
            case "SHOW":
                return self.axes[self._axis_number(words)].shown_settings(words)
            case "PIN" | "SET":
                self.pins.obey(command, words)
            case _:
                raise RefusedRequest("UNKNOWN command")
        return ""

    def _simple(self, command: str) -> str:
        if command == "HELLO":
            return self._banner.encode()
        if command == "GET":
            return self._told_status()
        if command == "CLR":
            for axis in self.axes:
                axis.fault = FaultKind(0)
            self._flags = BoardFlag(0)
            if self.mode is Mode.TRIPPED:
                self.mode = Mode.OFF
        return ""

    def _enable(self, words: RequestWords) -> None:
        on = words.number("ARGS 0 or 1 missing")
        words.end()
        if not within(on, (0, 1), "RANGE 0 1"):
            self._end(Mode.OFF)
            return
        self._refuse_in(Mode.TRIPPED, Mode.HOMING)
        if self._off_at_s is not None:
            raise RefusedRequest("HOLD braking")
        if self.mode is Mode.OFF:
            self._begin(Mode.ON)

    def _home(self, words: RequestWords) -> None:
        """Look for the zeros of these axes, or of all, one after the other; unused ones are left out."""
        named = {self._axis_number(words) for _ in tuple(words.rest)} or set(range(AXES))
        self._refuse_in(Mode.TRIPPED, Mode.HOMING, Mode.HELD)
        used = [axis for axis in sorted(named) if self.axes[axis].settings["hord"]]
        for axis in used:
            own = self.axes[axis].settings
            if not own["min"] <= own["hpos"] <= own["max"]:
                raise RefusedRequest(f"RANGE hpos outside min max, axis {axis}")
        self._begin(Mode.HOMING)
        self._to_home = sorted(used, key=lambda axis: self.axes[axis].settings["hord"])
        for axis in used:
            self.axes[axis].homed = False
        self._homing = self._home_in_order()
        next(self._homing, None)

    def _go(self, words: RequestWords) -> None:
        """Take setpoints, all or none; a last word is the time [ms] in which to be there."""
        counts: dict[int, int] = {}
        for axis in range(AXES):
            word = words.take()
            if word is None:
                raise RefusedRequest("ARGS six counts or -")
            if word != "-":
                counts[axis] = words.checked(word)
        reach_ms = _REACH_MS
        if words.rest:
            reach_ms = within(words.checked(words.take()), _REACH_RANGE_MS, "RANGE ms 1 1000")
        words.end()
        self._refuse_in(Mode.TRIPPED, Mode.OFF, Mode.HOMING, Mode.HELD)
        for axis in counts:
            if not self.axes[axis].homed:
                raise RefusedRequest(f"NOTHOMED {axis}")
        for axis, count in counts.items():
            low, high = self.axes[axis].settings["min"], self.axes[axis].settings["max"]
            if not low <= count <= high:
                raise RefusedRequest(f"LIMIT {axis} {count} {low} {high}")
        for axis, count in counts.items():
            self.axes[axis].go(count, reach_ms / 1000.0)

    def _set_pair(self, words: RequestWords) -> None:
        """Which joints two motors turn: the plant is in joint counts, so only their homes are concerned."""
        pair: tuple[int, ...] = ()
        if words.rest[:1] == ["NONE"]:
            words.take()
        else:
            pair = self._axis_number(words), self._axis_number(words)
        words.end()
        if len(pair) == 2 and pair[0] == pair[1]:
            raise RefusedRequest("RANGE two axes")
        self._refuse_when_on()
        if pair != self._pair:
            for axis in (*self._pair, *pair):
                self.axes[axis].homed = False
        self._pair = pair

    def _configure(self, words: RequestWords) -> None:
        """Take the settings of a line, or none of them."""
        number = self._axis_number(words)
        own = self.axes[number]
        self._refuse_when_on()
        settings = own.asked_settings(words)
        if number in self._pair and any(own.settings[key] != settings[key] for key in ("inv", "minv")):
            for axis in self._pair:
                self.axes[axis].homed = False
        own.configure(settings)

    def _axis_number(self, words: RequestWords) -> int:
        return within(words.number("ARGS axis missing"), (0, AXES - 1), "RANGE axis 0 5")

    def _refuse_when_on(self) -> None:
        if self.mode.powered:
            raise RefusedRequest("MOVING motors are on")

    def _refuse_in(self, *modes: Mode) -> None:
        if self.mode in modes:
            raise RefusedRequest(_REFUSALS[self.mode])

    # What the motors do. Times count from the board's start.

    @property
    def _time_s(self) -> float:
        return self._ticks * TICK_S

    def _told_status(self) -> str:
        """The fields of a status; what was lost on the line is told once."""
        told = Status(
            time_ms=round(self._time_s * 1000),
            mode=self.mode,
            homed=tuple(axis.homed for axis in self.axes),
            switches=tuple(axis.switch_closed for axis in self.axes),
            flags=self._flags,
            faults=tuple(axis.fault for axis in self.axes),
            lost=tuple(min(axis.lost, _MOST_LOST_SHOWN) for axis in self.axes),
            counts=tuple(axis.count for axis in self.axes),
            changes=self.pins.changes,
        )
        self._flags &= ~BoardFlag.LINE_LOST
        return told.encode()

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
        if fault in (FaultKind.ENCODER, FaultKind.LOST):
            for axis in self._pair if number in self._pair else (number,):
                self.axes[axis].homed = False
        self._end(Mode.TRIPPED)
        self._say(f"! trip {number} {fault.name}")

    def _begin(self, mode: Mode) -> None:
        """Switch the motors on: the axes hold where they stand."""
        self._flags &= ~(BoardFlag.WATCHDOG | BoardFlag.STOPPED | BoardFlag.LATE)
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


def simulated_encoder_board(
    channels: Sequence[ChannelSettings],
    axes: Sequence[EncoderAxis],
    troubles: Mapping[int, Trouble] | None = None,
) -> SimulatedEncoderBoard:
    """A board with an arm on it that fits these settings; axes without any are plain ones.

    ``troubles``: what goes wrong, by axis, as soon as it is homed.
    """
    own = {one.entry.axis: one for one in axes}
    board = SimulatedEncoderBoard(
        {one.channel: plant_of(one, own[one.channel]) for one in channels if one.channel in own}
    )
    for axis, trouble in (troubles or {}).items():
        board.axes[axis].trouble = trouble
    return board
