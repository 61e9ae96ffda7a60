"""Requests to an encoder board and what it says, kept in step over one transport."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from armctl.errors import BoardProtocolError, BoardTimeoutError
from armctl.hardware.encoder.messages import (
    FIRMWARE,
    FLASH_IT,
    FLASHING,
    LARGEST_SEQUENCE,
    PROTOCOL,
    Answer,
    Banner,
    Realtime,
    Refusal,
    Status,
    decode_banner,
    request,
)
from armctl.hardware.encoder.watch import Heard
from armctl.hardware.transport import Transport

_CHUNK = 4096
_MOST_CHUNKS = 64  # a board that floods the line must not keep the caller here for ever
_MOST_SUPERSEDED = 8
_ATTEMPTS = 3
_WAIT_S = 0.02  # time between two status lines


@dataclass(slots=True)
class _InFlight:
    """The newest line, while the board has not answered it."""

    sequence: int
    text: str
    line: bytes
    awaited: bool
    reply: Answer | Refusal | None = None
    unreadable: bool = False


class EncoderSession:
    """A transport with an encoder board at the other end.

    Only the newest line is ever sent again, and as it was: the board answers a line that it has just
    executed from memory, so nothing is done twice. Whatever the board says unasked is taken in on the way,
    and of the status lines only the newest is kept.

    Args:
        transport: the open line; this object closes it.
        now: the clock [s].
        timeout_s: how long an answer may take in all.
    """

    def __init__(self, transport: Transport, now: Callable[[], float], timeout_s: float) -> None:
        self._transport = transport
        self._now = now
        self._timeout_s = timeout_s
        self._sequence = 0
        self._in_flight: _InFlight | None = None
        self._superseded: deque[int] = deque(maxlen=_MOST_SUPERSEDED)
        self._waiting_since = self._sent_at = now()
        self._refused: list[Refusal] = []
        self.heard = Heard(now)
        """what the board has said unasked"""

    @property
    def name(self) -> str:
        """The line as the user named it."""
        return self._transport.name

    @property
    def idle_s(self) -> float:
        """How long ago the last line was sent [s]."""
        return self._now() - self._sent_at

    def turn_page(self) -> None:
        """The user has taken note: restarts, refusals and events from before are told no more."""
        self.drain()
        self.heard.restarted = None
        self.heard.take_events()
        self._superseded.clear()
        self._refused.clear()

    def close(self) -> None:
        """Close the transport; never raises."""
        self._transport.close()

    def command(self, text: str, timeout_s: float | None = None) -> str:
        """Ask for ``text``, wait for the answer and return what it says.

        The status from before counts no more: the next one shows what has come of it. The answer to a
        posted line is not waited for.

        Raises:
            BoardTimeoutError: no answer.
            StateError: the board's state does not allow it.
            BoardError: refused for another reason, or the line is gone.
        """
        timeout_s = self._timeout_s if timeout_s is None else timeout_s
        self.drain()
        sent = self._ask(text, awaited=True)
        reply = self._wait_for_answer(sent, timeout_s)
        self.heard.status = None
        if reply is None:
            self._in_flight = None
            raise self._unanswered(sent, timeout_s)
        if isinstance(reply, Refusal):
            raise reply.error(text)
        return reply.text

    def post(self, text: str) -> None:
        """Send the line for ``text`` and go on; ``settle`` sees to its answer.

        It takes the place of a posted line that is not answered yet.
        """
        self._ask(text, awaited=False)

    def settle(self) -> tuple[Refusal, ...]:
        """Take the answers to posted lines that are there, without waiting; send the newest again if due.

        Returns:
            the refusals among them.

        Raises:
            BoardTimeoutError: the board has not answered for too long, though the line was sent again.
            BoardError: the line is gone.
        """
        self.drain()
        refused, self._refused = tuple(self._refused), []
        waiting = self._in_flight
        if waiting is None:
            return refused
        if self._now() - self._waiting_since > self._timeout_s:
            self._in_flight = None
            raise self._unanswered(waiting, self._timeout_s)
        if waiting.unreadable or self.idle_s >= self._timeout_s / _ATTEMPTS:
            self._send_again(waiting)
        return refused

    def realtime(self, byte: Realtime) -> None:
        """Send a byte that the board obeys at once; there is no answer, only the next status."""
        self._transport.write(bytes((byte,)))

    def fresh_status(self, oldest_s: float) -> Status:
        """A status that came at most ``oldest_s`` ago, waited for if need be.

        Raises:
            BoardTimeoutError: the board says nothing.
            BoardError: the line is gone.
        """
        self.drain()
        known = self.heard.status
        if known is None or self._now() - self.heard.status_at > oldest_s:
            self.heard.status = None
            self.realtime(Realtime.STATUS)
            self.wait_until(lambda: self.heard.status is not None, self._timeout_s)
        if self.heard.status is None:
            raise BoardTimeoutError(
                f"{self.name}: the board has sent no status for {self._timeout_s * 1000:.0f} ms; "
                "check the cable and the board's power supply"
            )
        return self.heard.status

    def forget_status(self) -> None:
        """What was said until now does not show yet what has just been asked for."""
        self.drain()
        self.heard.status = None

    def wait_until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Take in what comes until ``done``; whether that was within ``timeout_s``."""
        deadline = self._now() + timeout_s
        # Waiting is counted as well as timed: while a status line comes every 20 ms no read waits long,
        # and the clock of a simulation may stand still while a real line is waited for.
        waited = 0.0
        self.drain()
        while not done():
            left = min(deadline - self._now(), timeout_s - waited)
            if left <= 0.0:
                return False
            step = min(left, _WAIT_S)
            if first := self._transport.read(1, step):
                self._take(first)
                self.drain()
            else:
                waited += step
        return True

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
        sent = _InFlight(self._sequence, text, request(self._sequence, text), awaited)
        self._in_flight = sent
        self._send(sent.line)
        if before is None:
            self._waiting_since = self._sent_at
        elif not before.awaited:
            self._superseded.append(before.sequence)
        return sent

    def _wait_for_answer(self, sent: _InFlight, timeout_s: float) -> Answer | Refusal | None:
        """The answer to the line in flight, which is sent again where none comes."""
        for attempt in range(_ATTEMPTS):
            if attempt:
                self._send_again(sent)
            self.wait_until(lambda: sent.reply is not None or sent.unreadable, timeout_s / _ATTEMPTS)
            if sent.reply is not None:
                break
        return sent.reply

    def _unanswered(self, sent: _InFlight, timeout_s: float) -> BoardTimeoutError:
        garbled = f"; {self.heard.garbled} lines from it were garbled" if self.heard.garbled else ""
        return BoardTimeoutError(
            f"{self.name}: the board did not answer {sent.text!r} within {timeout_s * 1000:.0f} ms{garbled}; "
            "check the cable and the board's power supply"
        )

    def _send_again(self, sent: _InFlight) -> None:
        sent.unreadable = False
        self._send(sent.line)

    def _send(self, line: bytes) -> None:
        self._sent_at = self._now()
        self.heard.spoken = False
        self._transport.write(line)

    def _take(self, data: bytes) -> None:
        for answer in self.heard.take(data):
            self._accept_answer(answer)

    def _accept_answer(self, answer: Answer | Refusal) -> None:
        sent = self._in_flight
        if sent is not None and answer.sequence == 0:
            sent.unreadable = True
            return
        if sent is not None and answer.sequence == sent.sequence:
            sent.reply = answer
            self._in_flight = None
            if sent.awaited:
                return
        elif answer.sequence in self._superseded:
            self._superseded.remove(answer.sequence)
            self._waiting_since = self._now()  # it answers, if late
        else:
            return
        if isinstance(answer, Refusal):
            self._refused.append(answer)


# Finding out who is at the other end of a line that has just been opened.

_HELLO_S = 0.5
_START_S = 2.5  # a Mega that is reset by the opening of its port says nothing for 1.7 s
_LISTENING_ROUNDS = 2
_SPEAKING_ROUNDS = 10

# Firmata's "report firmware", as a query and at the beginning of the answer.
_FIRMATA_QUERY = b"\xf0\x79\xf7"
_FIRMATA_REPORT = b"\xf0\x79"


def greet(session: EncoderSession, transport: Transport, *, resets: bool) -> Banner:
    """Make sure that armctl's firmware answers, in the version that this armctl speaks.

    Args:
        session: a new session over ``transport``; it begins with this.
        transport: the open line.
        resets: whether opening the line starts the board anew. Then nothing is sent until the board
            speaks: its boot loader would take it for an upload.

    Raises:
        BoardTimeoutError: nobody answers.
        BoardProtocolError: somebody else answers, or in another version.
    """
    silence: BoardTimeoutError | None = None
    for _ in range(_LISTENING_ROUNDS if resets else _SPEAKING_ROUNDS):
        if resets:
            session.wait_until(lambda: session.heard.spoken, _START_S)
        try:
            hello = session.command("HELLO", _HELLO_S)
        except BoardTimeoutError as error:
            silence = error
            continue
        banner = decode_banner(hello)
        _check(banner, transport.name)
        session.heard.begin()
        return banner
    raise _who_else(session, transport) from silence


def protocol_advice(banner: Banner) -> str:
    """What to do about a board that speaks another protocol than this armctl."""
    if banner.protocol < PROTOCOL:
        return f"flash the board again, with the firmware that comes with this armctl ({FLASHING})"
    return (
        "this armctl is older than the board's firmware: update armctl, or flash the board with the "
        f"firmware that comes with this one ({FLASHING})"
    )


def _check(banner: Banner, name: str) -> None:
    if banner.firmware != FIRMWARE:
        raise BoardProtocolError(f"{name}: {banner.firmware} answers, not {FIRMWARE}; {FLASH_IT}")
    if banner.protocol != PROTOCOL:
        raise BoardProtocolError(
            f"{name}: the board's firmware {banner.version} speaks protocol {banner.protocol}, this armctl "
            f"needs protocol {PROTOCOL}; {protocol_advice(banner)}"
        )


def _who_else(session: EncoderSession, transport: Transport) -> BoardProtocolError | BoardTimeoutError:
    """What to say when armctl's firmware does not answer."""
    if _FIRMATA_REPORT not in session.heard.prelude:
        transport.write(_FIRMATA_QUERY)
        session.wait_until(lambda: _FIRMATA_REPORT in session.heard.prelude, _HELLO_S)
    heard = session.heard.prelude
    if _FIRMATA_REPORT in heard:
        return BoardProtocolError(
            f"{transport.name}: StandardFirmata is on this board, not armctl's encoder firmware; {FLASH_IT}"
            ", or choose the board firmata if the arm has servos"
        )
    if session.heard.spoken:
        return BoardTimeoutError(
            f"{transport.name}: an armctl encoder board sends, but does not answer; check the wire that "
            "leads to the board, and that nothing else uses the port"
        )
    if heard:
        shown = heard[:40].decode("ascii", "backslashreplace")
        return BoardProtocolError(
            f"{transport.name}: something else answers there ({shown!r}); is it the right port, at 115200 "
            f"baud? If it is: {FLASH_IT}"
        )
    return BoardTimeoutError(
        f"{transport.name}: no answer. Is this the port of the Arduino Mega, and is it powered? If it is "
        f"new: {FLASH_IT}"
    )
