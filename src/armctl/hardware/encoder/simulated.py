"""A simulated encoder board: the firmware's behaviour behind its serial line, byte for byte."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from armctl.errors import BoardProtocolError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.encoder import simulated_controller as requests
from armctl.hardware.encoder.axes import EncoderAxis
from armctl.hardware.encoder.messages import (
    FIRMWARE,
    LARGEST_SEQUENCE,
    LONGEST_REQUEST,
    PROTOCOL,
    Banner,
    BoardFlag,
    LineReader,
    Mode,
    Realtime,
    seal,
    unseal,
)
from armctl.hardware.encoder.simulated_axis import FIRMWARE_DEFAULTS, AxisPlant, SimulatedAxis, plant_of
from armctl.hardware.encoder.simulated_controller import (
    TICK_S,
    WATCHDOG_RANGE_MS,
    Refused,
    SimulatedController,
)

AXES = len(FIRMWARE_DEFAULTS)
VERSION = "1.1.0"

_TICKS_PER_STATUS = 4
_SLACK_S = 1e-9
_LONGEST_CATCH_UP = round(2.0 / TICK_S)  # nobody waits longer than that for bytes; motors are off by then
_REALTIME = frozenset(Realtime)


@dataclass(frozen=True, slots=True)
class ReceivedLine:
    """A line that the board executed or refused, and when."""

    time: float
    text: str


class SimulatedEncoderBoard:
    """An Arduino Mega with armctl's encoder firmware, and an arm on it.

    Args:
        plants: the mechanics by axis; a plain axis for those that are not named.
        boot_s: how long it is deaf and dumb after a start.
        protocol: what it says it speaks, to be taken for a board that was flashed long ago.
        log_length: how many received lines are kept.
    """

    def __init__(
        self,
        plants: Mapping[int, AxisPlant] | None = None,
        *,
        boot_s: float = 0.0,
        protocol: int = PROTOCOL,
        log_length: int = 10_000,
    ) -> None:
        plants = plants or {}
        self.axes = [
            SimulatedAxis(plants.get(axis, AxisPlant()), defaults)
            for axis, defaults in enumerate(FIRMWARE_DEFAULTS)
        ]
        self._boot_s = boot_s
        self._protocol = protocol
        self._log: deque[ReceivedLine] = deque(maxlen=log_length)
        self._now: float | None = None
        self._start("power")

    @property
    def log(self) -> tuple[ReceivedLine, ...]:
        """The lines taken, without those that were repeated, oldest first."""
        return tuple(self._log)

    @property
    def mode(self) -> Mode:
        """What the motors do."""
        return self._controller.mode

    def reset(self) -> None:
        """Start anew, as after a power cut. The arm stays where it is, the board no longer knows where."""
        self.restart("power")

    def restart(self, cause: str) -> None:
        """Start anew for ``cause``: power, external, brownout or watchdog."""
        for axis in self.axes:
            axis.restart()
        self._start(cause)

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
        self._run_ticks(self._now - self._started_at)
        return self._take_unsent()

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host and return what they bring about."""
        if not self._greeted:
            return b""
        text = bytearray()
        for byte in data:
            if byte in _REALTIME:
                self._take(bytes(text))
                text.clear()
                self._obey_at_once(Realtime(byte))
            else:
                text.append(byte)
        self._take(bytes(text))
        return self._take_unsent()

    def _start(self, cause: str) -> None:
        self._banner = Banner(FIRMWARE, VERSION, self._protocol, AXES, cause)
        flags = BoardFlag.BROWN_OUT if cause == "brownout" else BoardFlag(0)
        self._controller = SimulatedController(self.axes, flags)
        self._reader = LineReader(LONGEST_REQUEST)
        self._last: tuple[bytes, str] | None = None  # the last line and its answer
        self._started_at: float | None = None
        self._greeted = False
        self._unsent = bytearray()

    def _run_ticks(self, until_s: float) -> None:
        due = int((until_s + _SLACK_S) / TICK_S)
        controller = self._controller
        while controller.ticks < due:
            if not self.mode.powered and (missed := due - controller.ticks - _LONGEST_CATCH_UP) > 0:
                controller.sleep(missed)
            controller.tick()
            self._say_events()
            if controller.ticks % _TICKS_PER_STATUS == 0:
                self._say_status()

    def _obey_at_once(self, byte: Realtime) -> None:
        match byte:
            case Realtime.STATUS:
                self._say_status()
            case Realtime.HOLD:
                self._controller.hold()
            case Realtime.RELEASE_HOLD:
                self._controller.release_hold()
            case Realtime.MOTORS_OFF:
                self._controller.stop_at_once()
        self._say_events()

    def _take(self, data: bytes) -> None:
        for line in self._reader.feed(data):
            if line is None:
                self._controller.note_lost_line(lost=True)
                self._say("0 err LONG more than 96 bytes")
            elif line:
                self._take_line(line)

    def _take_line(self, line: bytes) -> None:
        try:
            text = unseal(line)
        except BoardProtocolError:
            self._say("0 err CRC line ignored")
            return
        sequence, _, rest = text.partition(" ")
        if not _is_sequence(sequence) or not rest:
            self._say("0 err SYNTAX seq 1 65535")
            return
        self._controller.feed_watchdog()
        if self._last is None or self._last[0] != line:
            self._log.append(ReceivedLine(self._now or 0.0, rest))
            self._last = line, f"{int(sequence)} {self._answer(rest)}"
        self._say(self._last[1])

    def _answer(self, text: str) -> str:
        command, *words = text.split(" ")
        try:
            said = self._execute(command, words)
        except Refused as refused:
            return f"err {refused}"
        return f"ok {said}" if said else "ok"

    def _execute(self, command: str, words: Sequence[str]) -> str:
        controller = self._controller
        match command, words:
            case "HELLO", []:
                return self._banner.encode()
            case "PING", []:
                pass
            case "GET", []:
                return controller.status().encode()
            case "CLR", []:
                controller.clear()
            case "EN", ["0"]:
                controller.switch_off()
            case "EN", ["1"]:
                controller.switch_on()
            case "WD", [ms]:
                controller.set_watchdog_ms(requests.number(ms, *WATCHDOG_RANGE_MS))
            case "HOME", _:
                controller.home(requests.homing_order(words, self.axes))
            case "P", _:
                counts, within_s = requests.setpoints(words, AXES)
                controller.check_not(Mode.TRIPPED, Mode.OFF, Mode.HOMING, Mode.HELD)
                requests.check_setpoints(counts, self.axes)
                controller.go(counts, within_s)
            case "PAIR", _:
                requests.check_pair(words, AXES)
                controller.check_off()  # the plant is in joint counts: which motors turn it does not matter
            case "CFG", [axis, *pairs]:
                changes = requests.settings(pairs)
                controller.configure(self.axes[requests.axis_number(axis, AXES)], changes)
            case "SHOW", [axis, ("1" | "2") as part]:
                return requests.shown(self.axes[requests.axis_number(axis, AXES)].settings, part)
            case (("HELLO" | "PING" | "GET" | "CLR" | "EN" | "WD" | "CFG" | "SHOW"), _):
                raise Refused("ARGS", f"{command} takes other arguments")
            case _:
                raise Refused("UNKNOWN", "command")
        return ""

    def _say_status(self) -> None:
        self._say(f"@ {self._controller.status().encode()}")
        self._controller.note_lost_line(lost=False)

    def _say_events(self) -> None:
        for event in self._controller.take_events():
            self._say(f"! {event}")

    def _say(self, text: str) -> None:
        self._unsent += seal(text)

    def _take_unsent(self) -> bytes:
        sent, self._unsent = bytes(self._unsent), bytearray()
        return sent


def _is_sequence(word: str) -> bool:
    return word.isascii() and word.isdecimal() and len(word) <= 5 and 1 <= int(word) <= LARGEST_SEQUENCE


def simulated_encoder_board(
    channels: Sequence[ChannelSettings], axes: Sequence[EncoderAxis]
) -> SimulatedEncoderBoard:
    """A board with an arm on it that fits these settings; axes without any are plain ones."""
    limits = {one.channel: one for one in channels}
    return SimulatedEncoderBoard(
        {one.axis: plant_of(limits[one.axis], one) for one in axes if one.axis in limits}
    )
