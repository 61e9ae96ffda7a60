"""Notices what the board did by itself, and goes on saying so until the user has taken note."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from armctl.errors import BoardProtocolError
from armctl.hardware.board_type import Introduction
from armctl.hardware.encoder.messages import (
    FIRMWARE,
    LONGEST_MESSAGE,
    Answer,
    Banner,
    BoardFlag,
    Event,
    LineReader,
    Message,
    Refusal,
    Status,
    decode,
    fault_words,
    flag_words,
)

_BAD_STARTS = ("brownout", "watchdog")
_HOMING_FAILURES = {
    "notfound": "the switch was not found, on either side",
    "stuck": "the switch stays closed",
    "timeout": "it took too long",
}
_RESETS = {
    "power": "its supply was interrupted",
    "external": "its port was opened by another program, or its reset button pressed",
    "brownout": "its supply voltage sagged",
    "watchdog": "its program hung",
}


class BoardWatch:
    """Compares what the board does with what it was told.

    Motors that the board has switched off by itself stay off, whatever is written, until ``acknowledge``.
    """

    def __init__(self) -> None:
        self.on = False
        """armctl has switched the motors on"""
        self._went_off = False
        self._details: dict[int, str] = {}
        self._faults: dict[int, str] = {}

    @property
    def went_off(self) -> bool:
        """The board has switched the motors off by itself, and nobody has taken note yet."""
        return self._went_off

    @property
    def faults(self) -> Mapping[int, str]:
        """What was wrong with which axis at the last reading, in words."""
        return self._faults

    def acknowledge(self, *, on: bool) -> None:
        """The user has taken note; the motors are ``on`` from now on, or off."""
        self.on, self._went_off = on, False
        self._details.clear()
        self._faults = {}

    def observe(self, status: Status, restarted: str | None, events: Sequence[Event]) -> tuple[str, ...]:
        """Take one reading, and say in words what is wrong with the board; ``faults`` tells of its axes.

        Args:
            status: of the board.
            restarted: why it has started anew, in the board's word; None: it has not.
            events: what happened since the last reading.
        """
        self._details.update(_failures(events))
        self._faults = {
            axis: fault_words(fault, self._details.get(axis, ""))
            for axis, fault in enumerate(status.faults)
            if fault
        }
        words = [restart_words(restarted)] if restarted is not None else []
        words += flag_words(status.flags)
        # A board that brakes because nobody spoke to it switches its motors off in a moment.
        goes_off = not status.mode.powered or BoardFlag.WATCHDOG in status.flags
        if self.on and (goes_off or restarted is not None):
            self.on, self._went_off = False, True
        if self._went_off and not words and not self._faults:
            words.append("the board switched its motors off by itself")
        return tuple(words)


def earlier_words(status: Status, reset: str) -> tuple[str, ...]:
    """What the first status shows of the time before armctl connected; ``reset``: why the board started."""
    words = list(flag_words(status.flags))
    words += [f"axis {axis}: {fault_words(fault)}" for axis, fault in enumerate(status.faults) if fault]
    if reset in _BAD_STARTS and not words:
        words.append(f"its last start was after a {reset} reset; check its supply")
    return tuple(f"before armctl connected, the board had reported: {one}" for one in words)


def restart_words(reset: str) -> str:
    """What a board that has started anew means to the user."""
    why = f" ({_RESETS[reset]})" if reset in _RESETS else ""
    return f"the board has started anew{why}: its motors are off and its zeros are lost; home again"


def _failures(events: Sequence[Event]) -> dict[int, str]:
    """What the board said to each axis that it could not home."""
    found: dict[int, str] = {}
    for event in events:
        match event.words:
            case ("home", "failed", axis, *reason) if axis.isdecimal():
                said = " ".join(reason)
                found[int(axis)] = _HOMING_FAILURES.get(said, said)
            case _:
                pass
    return found


# What an encoder board has said unasked: its newest status, its events, and that it has started anew.

_LONGEST_PRELUDE = 512
_MOST_EVENTS = 64
_CLOCK_WRAPS_MS = 1 << 32
_NEAR_WRAP_MS = 60_000


class Heard:
    """Takes apart what comes from a board; answers it hands on.

    Args:
        now: the clock [s].
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._reader = LineReader(LONGEST_MESSAGE)
        self._events: deque[Event] = deque(maxlen=_MOST_EVENTS)
        self._board_ms: int | None = None
        self._prelude: bytearray | None = bytearray()
        self.status: Status | None = None
        """the newest; None when there is none that counts"""
        self.status_at = now()
        """when it came [s]"""
        self.restarted: str | None = None
        """why the board has started anew, in its own word; None: it has not, or that is settled"""
        self.restarts = 0
        """how often it has since the session began"""
        self.spoken = False
        """whether a board has said anything that made sense, since somebody set this to False"""
        self.garbled = 0
        """lines that made no sense"""

    @property
    def prelude(self) -> bytes:
        """The first bytes that came before the session began, whoever sent them."""
        return bytes(self._prelude or b"")

    def begin(self) -> None:
        """The session begins now: what was said so far is forgotten."""
        self.restarted = self.status = self._board_ms = self._prelude = None
        self.restarts = self.garbled = 0
        self._events.clear()

    def take_events(self) -> tuple[Event, ...]:
        """What has happened on the board since this was last asked."""
        events = tuple(self._events)
        self._events.clear()
        return events

    def take(self, data: bytes) -> list[Answer | Refusal]:
        """Take in bytes, and return the answers among them."""
        if self._prelude is not None:
            self._prelude += data[: _LONGEST_PRELUDE - len(self._prelude)]
        answers: list[Answer | Refusal] = []
        for line in self._reader.feed(data):
            message = self._decoded(line)
            if isinstance(message, Answer | Refusal):
                answers.append(message)
            elif message is not None:
                self._accept(message)
        return answers

    def _decoded(self, line: bytes | None) -> Message | None:
        try:
            if line is not None:
                message = decode(line)
                self.spoken = True
                return message
        except BoardProtocolError:
            pass
        # Told with the next timeout; until then another attempt or the next status makes up for it.
        self.garbled += 1
        return None

    def _accept(self, message: Status | Event | Banner) -> None:
        match message:
            case Status():
                if self._clock_went_back(message.time_ms):
                    self._note_restart("unknown")
                self._board_ms = message.time_ms
                self.status, self.status_at = message, self._now()
            case Banner(reset=reset):
                self._note_restart(reset)
            case Event():
                self._events.append(message)

    def _clock_went_back(self, time_ms: int) -> bool:
        """Whether the board has started anew: this shows it also where its banner was lost."""
        before = self._board_ms
        if before is None or time_ms >= before:
            return False
        return not (before > _CLOCK_WRAPS_MS - _NEAR_WRAP_MS and time_ms < _NEAR_WRAP_MS)

    def _note_restart(self, reset: str) -> None:
        self.restarted = reset
        self.restarts += 1
        self.status = self._board_ms = None


# Who answers on a port, before a driver is opened there.


class EncoderEar:
    """Hears armctl's encoder firmware: its banner, or a status line where it has been running for long."""

    def __init__(self) -> None:
        self._reader = LineReader(LONGEST_MESSAGE)

    def feed(self, data: bytes) -> Introduction | None:
        """Take what came; a line counts only with the right checksum."""
        for line in self._reader.feed(data):
            if line is None:
                continue
            try:
                message = decode(line)
            except BoardProtocolError:  # noise, half a line, or another board
                continue
            if isinstance(message, Banner):
                details = (f"{message.axes} axes", f"last started by: {message.reset}")
                return Introduction(message.firmware, message.version, details)
            if isinstance(message, Status):
                return Introduction(FIRMWARE, details=(f"{len(message.counts)} axes",))
        return None
