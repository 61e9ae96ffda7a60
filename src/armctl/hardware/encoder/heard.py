"""What an encoder board has said unasked: its newest status, its events, and that it has started anew."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from armctl.errors import BoardProtocolError
from armctl.hardware.encoder.frame import LONGEST_MESSAGE
from armctl.hardware.encoder.line_reader import LineReader
from armctl.hardware.encoder.messages import Answer, Banner, Event, Message, Refusal, decode
from armctl.hardware.encoder.status import Status

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
