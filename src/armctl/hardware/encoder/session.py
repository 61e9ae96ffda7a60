"""Requests to an encoder board and what it says, kept in step over one transport."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable

from armctl.errors import BoardProtocolError, BoardTimeoutError
from armctl.hardware.board_type import Introduction
from armctl.hardware.encoder import FLASH_IT, FLASHING
from armctl.hardware.encoder.messages import (
    FIRMWARE,
    LARGEST_SEQUENCE,
    LONGEST_MESSAGE,
    NO_CHANGES,
    PROTOCOL,
    Banner,
    LineReader,
    LineReply,
    Message,
    Realtime,
    Status,
    decode,
    decode_banner,
    decode_changes,
    request,
    unseal,
)
from armctl.hardware.transport import Transport, pieces
from armctl.lazy_dataclass import dataclass

UNKNOWN_RESET = "unknown"
"""the board has started anew, and the banner that says why was lost"""
_CHUNK = 4096
_MOST_CHUNKS = 64  # a board that floods the line must not keep the caller here for ever
_MOST_SUPERSEDED = 8
_ATTEMPTS = 3
_OLDEST_STATUS_S = 0.05
_LONGEST_PRELUDE = 512
_CLOCK_WRAPS_MS = 1 << 32
_NEAR_WRAP_MS = 60_000

_HELLO_S = 0.5
_START_S = 2.5  # a Mega that is reset by the opening of its port says nothing for 1.7 s
_LISTENING_ROUNDS = 2
_SPEAKING_ROUNDS = 10

_HOMING_FAILURES = {
    "notfound": "the switch was not found, on either side",
    "stuck": "the switch stays closed",
    "timeout": "it took too long",
}

_OLDER_STATUS = re.compile(r"@ \d+ [ONHBT](?: [0-9a-f]+){4}(?: -?\d+)+")

# Firmata's "report firmware", as a query and at the beginning of the answer.
_FIRMATA_QUERY = b"\xf0\x79\xf7"
_FIRMATA_REPORT = b"\xf0\x79"


@dataclass(slots=True)
class _InFlight:
    """The newest line, while the board has not answered it."""

    sequence: int
    text: str
    line: bytes
    awaited: bool
    reply: LineReply | None = None
    unreadable: bool = False


class EncoderSession:
    """A transport with an encoder board at the other end.

    Only the newest line is ever sent again, and as it was: the board answers a line that it has just
    executed from memory, so nothing is done twice. An answer may take ``timeout_s`` in all.
    """

    def __init__(self, transport: Transport, now: Callable[[], float], timeout_s: float) -> None:
        self.name = transport.name
        self._transport = transport
        self._now = now
        self._timeout_s = timeout_s
        self._reader = LineReader(LONGEST_MESSAGE)
        self._sequence = 0
        self._in_flight: _InFlight | None = None
        self._superseded: deque[int] = deque(maxlen=_MOST_SUPERSEDED)
        self._waiting_since = self._sent_at = self._status_at = now()
        self._refused: list[LineReply] = []
        self._greeting = True
        self._prelude = b""  # the first bytes that came before the board was known, whoever sent them
        self._board_ms: int | None = None
        self.status: Status | None = None
        """the newest; None where none shows yet what has just been asked for"""
        self.changes = NO_CHANGES
        """of the spare pins, as the board has told it last"""
        self.homing_failures: dict[int, str] = {}  # why homing failed, by axis
        self.restarted: str | None = None
        """why the board has started anew, in its own word; None: it has not, or that is settled"""
        self.restarts = 0  # how often it has started anew
        self.spoken = False  # whether the board has sent a valid line since the last one was sent to it
        self._garbled = 0  # lines
        self.asked = self.lost = 0
        """lines that were sent, and those that got no answer, since the caller set them to 0"""
        self.delay_s: float | None = None
        """the longest that an answer took, since the caller set it to None"""

    @property
    def idle_s(self) -> float:
        """How long ago the last line was sent [s]."""
        return self._now() - self._sent_at

    def greet(self, *, resets: bool) -> Banner:
        """Make sure that armctl's firmware answers, in the version that this armctl speaks.

        ``resets``: opening the line starts the board anew. Then nothing is sent until the board speaks: its
        boot loader would take it for an upload. ``BoardTimeoutError`` where nothing answers,
        ``BoardProtocolError`` where another board does, or in another version.
        """
        silence: BoardTimeoutError | None = None
        for _ in range(_LISTENING_ROUNDS if resets else _SPEAKING_ROUNDS):
            if resets:
                self.wait_until(lambda: self.spoken, _START_S)
            try:
                hello = self.command("HELLO", _HELLO_S)
            except BoardTimeoutError as error:
                silence = error
                continue
            banner = decode_banner(hello)
            if banner.firmware != FIRMWARE:
                raise BoardProtocolError(
                    f"{self.name}: {banner.firmware} answers, not {FIRMWARE}; {FLASH_IT}"
                )
            if banner.protocol != PROTOCOL:
                raise BoardProtocolError(
                    f"{self.name}: the board's firmware {banner.version} speaks protocol {banner.protocol}, "
                    f"this armctl needs protocol {PROTOCOL}; {protocol_advice(banner)}"
                )
            self._greeting = False
            self.restarted = self.status = self._board_ms = None
            self._garbled = 0
            self.homing_failures.clear()
            return banner
        raise self._wrong_board() from silence

    def acknowledge(self) -> None:
        """The user has taken note: restarts, refusals and failures from before are reported no more."""
        self.drain()
        self.restarted = None
        self.homing_failures.clear()
        self._superseded.clear()
        self._refused.clear()

    def close(self) -> None:
        """Close the transport; never raises."""
        self._transport.close()

    def command(self, text: str, timeout_s: float | None = None) -> str:
        """Ask for ``text``, wait for the answer and return what it says.

        The status from before counts no more: the next one shows what has come of it. ``BoardTimeoutError``
        without an answer; ``StateError`` where the board's state does not allow it.
        """
        timeout_s = self._timeout_s if timeout_s is None else timeout_s
        self.drain()
        sent = self._ask(text, awaited=True)
        for attempt in range(_ATTEMPTS):
            if attempt:
                self._send_again(sent)
            self.wait_until(lambda: sent.reply is not None or sent.unreadable, timeout_s / _ATTEMPTS)
            if sent.reply is not None:
                break
        self.status = None
        if sent.reply is None:
            raise self._unanswered(sent, timeout_s)
        if sent.reply.refusal:
            raise sent.reply.error(text)
        return sent.reply.text

    def post(self, text: str) -> None:
        """Send the line for ``text`` in place of a posted one; ``settle`` takes the answer."""
        self._ask(text, awaited=False)

    def settle(self) -> tuple[LineReply, ...]:
        """The refusals of posted lines; resends the newest if due. ``BoardTimeoutError`` if that fails."""
        self.drain()
        refused, self._refused = tuple(self._refused), []
        waiting = self._in_flight
        if waiting is None:
            return refused
        if self._now() - self._waiting_since > self._timeout_s:
            raise self._unanswered(waiting, self._timeout_s)
        if waiting.unreadable or self.idle_s >= self._timeout_s / _ATTEMPTS:
            self._send_again(waiting)
        return refused

    def realtime(self, byte: Realtime) -> None:
        """Send a byte that the board obeys at once; there is no answer, only the next status."""
        self._transport.write(bytes((byte,)))

    def fresh_status(self) -> Status:
        """A status of the last 50 ms, asked for if need be; ``BoardTimeoutError`` where none comes."""
        self.drain()
        if self.status is None or self._now() - self._status_at > _OLDEST_STATUS_S:
            self.status = None
            self.realtime(Realtime.STATUS)
            self.wait_until(lambda: self.status is not None, self._timeout_s)
        if self.status is None:
            raise BoardTimeoutError(
                f"{self.name}: the board has sent no status for {self._timeout_s * 1000:.0f} ms; "
                "check the cable and the board's power supply"
            )
        return self.status

    def wait_until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Take in what comes until ``done``; whether that was within ``timeout_s``."""
        self.drain()
        if done():
            return True
        for data in pieces(self._transport, timeout_s, self._now):
            self._take(data)
            if done():
                return True
        return False

    def drain(self) -> None:
        """Take in everything that is there."""
        for _ in range(_MOST_CHUNKS):
            data = self._transport.read(_CHUNK, 0.0)
            if not data:
                return
            self._take(data)

    def _ask(self, text: str, *, awaited: bool) -> _InFlight:
        before = self._in_flight
        self._sequence = self._sequence % LARGEST_SEQUENCE + 1
        self._in_flight = _InFlight(self._sequence, text, request(self._sequence, text), awaited)
        self._send(self._in_flight)
        if before is None:
            self._waiting_since = self._sent_at
        else:
            self._superseded.append(before.sequence)
        return self._in_flight

    def _send(self, sent: _InFlight) -> None:
        sent.unreadable = False
        self._sent_at = self._now()
        self.spoken = False
        self.asked += 1
        self._transport.write(sent.line)

    def _send_again(self, sent: _InFlight) -> None:
        self.lost += 1
        self._send(sent)

    def _unanswered(self, sent: _InFlight, timeout_s: float) -> BoardTimeoutError:
        self._in_flight = None
        garbled = f"; {self._garbled} lines from it were garbled" if self._garbled else ""
        return BoardTimeoutError(
            f"{self.name}: the board did not answer {sent.text!r} within {timeout_s * 1000:.0f} ms{garbled}; "
            "check the cable and the board's power supply"
        )

    def _take(self, data: bytes) -> None:
        if self._greeting:
            self._prelude = (self._prelude + data)[:_LONGEST_PRELUDE]
        for line in self._reader.feed(data):
            message = _decoded(line)
            if message is None:
                # Reported with the next timeout; until then another attempt or status makes up for it.
                self._garbled += 1
                continue
            self.spoken = True
            match message:
                case LineReply():
                    self._accept_answer(message)
                case Status():
                    # A clock that goes back shows a restart also where its banner was lost.
                    now, before = message.time_ms, self._board_ms
                    if (
                        before is not None
                        and now < before
                        and (now - before) % _CLOCK_WRAPS_MS > _NEAR_WRAP_MS
                    ):
                        self._note_restart(UNKNOWN_RESET)
                    self._board_ms = now
                    self.status, self._status_at = message, self._now()
                    self.changes = message.changes
                case Banner():
                    self._note_restart(message.reset)
                case ("pins", digits):
                    self.changes = decode_changes(digits)
                case ("home", "failed", axis, *reason) if axis.isdecimal():
                    said = " ".join(reason)
                    self.homing_failures[int(axis)] = _HOMING_FAILURES.get(said, said)
                case _:
                    pass

    def _accept_answer(self, answer: LineReply) -> None:
        sent = self._in_flight
        if sent is not None and answer.sequence == 0:
            sent.unreadable = True
            return
        if sent is not None and answer.sequence == sent.sequence:
            sent.reply = answer
            self.delay_s = max(self.delay_s or 0.0, self._now() - self._waiting_since)
            self._in_flight = None
            self._count_overtaken(len(self._superseded))
            if sent.awaited:
                return
        elif answer.sequence in self._superseded:
            self._count_overtaken(self._superseded.index(answer.sequence))
            self._superseded.popleft()
            self._waiting_since = self._now()  # it answers, if late
        else:
            return
        if answer.refusal:
            self._refused.append(answer)

    def _count_overtaken(self, count: int) -> None:
        """The oldest ``count`` lines get no answer any more: the board answers in order."""
        self.lost += count
        for _ in range(count):
            self._superseded.popleft()

    def _note_restart(self, reset: str) -> None:
        self.restarted = reset
        self.restarts += 1
        self.status = self._board_ms = None

    def _wrong_board(self) -> BoardProtocolError | BoardTimeoutError:
        """What to say when armctl's firmware does not answer."""
        if _FIRMATA_REPORT not in self._prelude:
            self._transport.write(_FIRMATA_QUERY)
            self.wait_until(lambda: _FIRMATA_REPORT in self._prelude, _HELLO_S)
        if _FIRMATA_REPORT in self._prelude:
            return BoardProtocolError(
                f"{self.name}: StandardFirmata is on this board, not armctl's encoder firmware; {FLASH_IT}"
                ", or choose the board firmata if the arm has servos"
            )
        if self.spoken:
            return BoardTimeoutError(
                f"{self.name}: an armctl encoder board sends, but does not answer; check the wire that "
                "leads to the board, and that nothing else uses the port"
            )
        if self._prelude:
            shown = self._prelude[:40].decode("ascii", "backslashreplace")
            return BoardProtocolError(
                f"{self.name}: something else answers there ({shown!r}); is it the right port, at 115200 "
                f"baud? If it is: {FLASH_IT}"
            )
        return BoardTimeoutError(
            f"{self.name}: no answer. Is this the port of the Arduino Mega, and is it powered? If it is "
            f"new: {FLASH_IT}"
        )


def protocol_advice(banner: Banner) -> str:
    """What to do about a board that speaks another protocol than this armctl."""
    if banner.protocol < PROTOCOL:
        return f"flash the board again, with the firmware that comes with this armctl ({FLASHING})"
    return (
        "this armctl is older than the board's firmware: update armctl, or flash the board with the "
        f"firmware that comes with this one ({FLASHING})"
    )


def _decoded(line: bytes | None) -> Message | None:
    """The message in a line; None where it was too long or makes no sense: noise, or another board."""
    try:
        return None if line is None else decode(line)
    except BoardProtocolError:
        return None


def _is_older_status(line: bytes) -> bool:
    """Whether this is the status line of a board that speaks an older protocol."""
    try:
        return _OLDER_STATUS.fullmatch(unseal(line)) is not None
    except BoardProtocolError:
        return False


class EncoderListener:
    """Recognises armctl's encoder firmware: its banner, or a status line where it has long been running."""

    def __init__(self) -> None:
        self._reader = LineReader(LONGEST_MESSAGE)

    def feed(self, data: bytes) -> Introduction | None:
        """Take what came; a line counts only with the right checksum."""
        for line in self._reader.feed(data):
            message = _decoded(line)
            if isinstance(message, Banner):
                details = (f"{message.axes} axes", f"last started by: {message.reset}")
                return Introduction(message.firmware, message.version, details)
            if isinstance(message, Status):
                return Introduction(FIRMWARE, details=(f"{len(message.counts)} axes",))
            if line is not None and message is None and _is_older_status(line):
                return Introduction(FIRMWARE)
        return None
