"""Requests to a Firmata board and what it sends, over one transport, kept in step."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware.board_type import Introduction, listen
from armctl.hardware.driver import ChannelTable
from armctl.hardware.firmata import codec
from armctl.hardware.firmata.codec import (
    BAUD,
    HOW_TO_LOAD,
    CapabilityReport,
    FirmwareReport,
    Reply,
    ReplyParser,
    VersionReport,
)
from armctl.hardware.firmata.pins import Attacher, FirstPulse, PinWatch
from armctl.hardware.transport import Transport

_OPEN_S = 5.0
"""a Mega that restarts when its port is opened reports after 1.7 s and its bootloader's time"""
_ASK_AGAIN_S = 1.0
_ANSWER_S = 2.0
"""the capabilities of a Mega take 0.15 s on the line"""
_STEP_S = 0.05
_CHUNK = 4096
_HEARD = 512
"""how much of what somebody else says is kept to tell who it is"""

Wanted = TypeVar("Wanted")


@dataclass(frozen=True, slots=True)
class Identity:
    """What a board has said of itself."""

    firmware: FirmwareReport
    capabilities: CapabilityReport
    fresh: bool
    """whether it started while the line was open: it has driven no servo yet"""


class FirmataLine:
    """A transport with a Firmata board at the other end.

    A sysex that breaks off is finished by the next one, and a wrong value is executed. So a line on
    which a write failed, or whose board has started anew, takes nothing more: it has to be opened
    again, and there only a question that ends no sysex is asked until the board answers it.

    Args:
        transport: the open line; this object closes it.
        now: the clock [s].
    """

    def __init__(self, transport: Transport, now: Callable[[], float]) -> None:
        self._transport = transport
        self._now = now
        self._parser = ReplyParser()
        self._identified = False
        self._lost: str | None = None

    @property
    def name(self) -> str:
        """The line as the user named it."""
        return self._transport.name

    def close(self) -> None:
        """Close the transport; never raises."""
        self._transport.close()

    def identify(self, ask_after_s: float) -> Identity:
        """Wait until a Firmata sketch runs and answers; find out which and what its pins can do.

        Args:
            ask_after_s: how long to listen before asking: bytes sent to a bootloader keep it waiting.

        Raises:
            BoardTimeoutError: nobody answers; the message says how to load the sketch.
            BoardProtocolError: somebody answers, but not in Firmata.
        """
        self._transport.discard_input()
        fresh = self._await_version(ask_after_s)
        firmware = self._ask(codec.firmware_query(), FirmwareReport, "its firmware")
        # The board answers in order: whatever it said of itself while starting lies before this answer.
        capabilities = self._ask(codec.capability_query(), CapabilityReport, "its pins' capabilities")
        self._identified = True
        return Identity(firmware, capabilities, fresh)

    def send(self, data: bytes) -> None:
        """Write ``data`` in one go.

        Raises:
            BoardError: the line is gone, or was before.
        """
        self._check()
        try:
            self._transport.write(data)
        except BoardError as error:
            self._lost = (
                f"{self.name}: an earlier write broke off, and the board may have got half a message; "
                "connect again"
            )
            raise error

    def receive(self) -> list[Reply]:
        """What has come since the last call; never waits.

        Raises:
            BoardError: the board has started anew, or the line is gone.
        """
        self._check()
        return self._parse(self._transport.read(_CHUNK, 0.0))

    def lose(self, why: str) -> BoardError:
        """Let nothing more be sent; the error to raise now and from now on."""
        self._lost = f"{self.name}: {why}"
        return BoardError(self._lost)

    def listen(self, wait_s: float) -> Iterator[Reply]:
        """What comes within ``wait_s``; a caller that has what it waited for stops earlier.

        Raises:
            BoardError: the board has started anew, or the line is gone.
        """
        self._check()
        # A line that cannot wait returns at once: its silence is counted, or this would never end.
        deadline, silent_s, step_s = self._now() + wait_s, 0.0, min(_STEP_S, wait_s)
        while silent_s < wait_s and self._now() < deadline:
            data = self._read(step_s)
            silent_s += 0.0 if data else step_s
            yield from self._parse(data)

    def _await_version(self, ask_after_s: float) -> bool:
        """Return once a version report shows that the board's parser is between two messages.

        True where it came without having been asked for: the board has just started.
        """
        heard, asked = bytearray(), False
        # Lines that cannot wait return at once, so steps are counted and not only seconds.
        started, waited_s, ask_at = self._now(), 0.0, ask_after_s
        while max(waited_s, self._now() - started) < _OPEN_S:
            if max(waited_s, self._now() - started) >= ask_at:
                self.send(codec.version_query())
                asked = True
                ask_at += _ASK_AGAIN_S
            data = self._read(_STEP_S)
            waited_s += 0.0 if data else _STEP_S
            heard = (heard + data)[-_HEARD:]
            if any(isinstance(reply, VersionReport) for reply in self._parser.feed(data)):
                return not asked
        raise self._nobody(bytes(heard))

    def _ask(self, request: bytes, wanted: type[Wanted], what: str) -> Wanted:
        self.send(request)
        for reply in self.listen(_ANSWER_S):
            if isinstance(reply, wanted):
                return reply
        raise BoardTimeoutError(
            f"{self.name}: the board speaks Firmata but did not tell {what} within {_ANSWER_S:g} s; "
            f"{HOW_TO_LOAD}"
        )

    def _nobody(self, heard: bytes) -> BoardError:
        if not heard:
            return BoardTimeoutError(
                f"{self.name}: no answer within {_OPEN_S:g} s. Is it an Arduino with StandardFirmata? If "
                f"not, {HOW_TO_LOAD}. If it is, press its reset button and connect again"
            )
        if b"armctl-encoder" in heard:
            return BoardProtocolError(
                f"{self.name}: this board runs armctl's own firmware for arms with encoders, not Firmata; "
                f"choose a robot with encoders (board kind encoder), or {HOW_TO_LOAD}"
            )
        return BoardProtocolError(
            f"{self.name}: something answers, but not in Firmata at {codec.BAUD} baud (first bytes "
            f"{heard[:12].hex(' ')}); {HOW_TO_LOAD}"
        )

    def _read(self, wait_s: float) -> bytes:
        """What has come, after waiting for a first byte at most ``wait_s``."""
        first = self._transport.read(1, wait_s)
        return first + self._transport.read(_CHUNK, 0.0) if first else first

    def _parse(self, data: bytes) -> list[Reply]:
        replies = self._parser.feed(data)
        # The version is never asked for once the board is known; a board that starts tells it by itself.
        if self._identified and any(isinstance(reply, VersionReport) for reply in replies):
            self._lost = (
                f"{self.name}: the board has restarted (reset button, or its supply broke down): its servos "
                "are off and the arm may have dropped; check the supply, then connect again"
            )
            self._check()
        return replies

    def _check(self) -> None:
        if self._lost is not None:
            raise BoardError(self._lost)


# How much the serial line can still carry: nothing may queue up in front of a setpoint.

_BITS_PER_BYTE = 10  # 8N1: start bit, eight data bits, stop bit
BYTE_S = _BITS_PER_BYTE / BAUD
_ROUNDING_SLACK = 1e-6


class LinePace:
    """Keeps account of the time that the bytes given to the line take on it.

    The operating system and the USB adapter take far more bytes than the line carries; whoever
    writes faster than it only makes the setpoints old.

    Args:
        period_s: what may be spent is reckoned per so many seconds.
        share: which part of them may be spent.
    """

    def __init__(self, period_s: float, share: float) -> None:
        self._allowed_s = period_s * share
        self._busy_until = 0.0

    def waiting(self, now: float) -> int:
        """How many of the bytes written so far have not gone out yet."""
        return math.ceil(self._backlog_s(now) / BYTE_S - _ROUNDING_SLACK)

    def room(self, now: float) -> int:
        """How many more bytes may be written now."""
        return max(0, math.floor((self._allowed_s - self._backlog_s(now)) / BYTE_S + _ROUNDING_SLACK))

    def charge(self, count: int, now: float) -> None:
        """Note that ``count`` bytes were written at ``now`` [s]."""
        self._busy_until = max(self._busy_until, now) + count * BYTE_S

    def _backlog_s(self, now: float) -> float:
        return max(0.0, self._busy_until - now)


# Setpoints and questions on their way to a Firmata board, no faster than the line carries them.

SERVO_FRAME_S = 0.020
_LINE_SHARE = 0.9
_QUERY_BYTES = len(codec.pin_state_query(0))
_MOST_QUERIES = 8
"""their answers of 7 bytes fit into the board's 64-byte transmit buffer: it never has to wait for it"""
_ROUND_S = 0.75 * SERVO_FRAME_S
"""shortest time between two rounds of questions; a loop of 20 ms is now and then early"""


class SetpointStream:
    """Keeps the newest setpoints until the line is free for them.

    Args:
        send: writes to the line.
        now: the clock [s].
        attacher: switches pins on.
    """

    def __init__(self, send: Callable[[bytes], None], now: Callable[[], float], attacher: Attacher) -> None:
        self._send_bytes, self._now, self._attacher = send, now, attacher
        self._pace = LinePace(SERVO_FRAME_S, _LINE_SHARE)
        self._pending: dict[int, int] = {}
        self._asked_at = -_ROUND_S

    def put(self, pulses: Mapping[int, int]) -> None:
        """Have pulse widths [µs] by pin sent with the next ``flush``."""
        self._pending.update(pulses)

    def clear(self) -> None:
        """Forget what has not been sent."""
        self._pending.clear()

    def send(self, data: bytes, answer_length: int = 0) -> None:
        """Send at once, on the line's account."""
        self._send_bytes(data)
        # Both directions of the line work at once: the longer one counts.
        self._pace.charge(max(len(data), answer_length), self._now())

    def flush(self, table: ChannelTable, watch: PinWatch) -> None:
        """Send the newest setpoints that the board has not got, once the line is free for them."""
        # A round of questions may be in front of them, or reading before writing would cost a frame.
        if self._pace.waiting(self._now()) > _MOST_QUERIES * _QUERY_BYTES:
            return
        wanted = watch.to_repeat() | self._pending
        due = {pin: pulse for pin, pulse in sorted(wanted.items()) if watch.needs(pin, pulse)}
        setpoints = {pin: pulse for pin, pulse in due.items() if watch.is_on(pin)}
        off = [pin for pin in due if pin not in setpoints]
        first, later = off[: self._attacher.most_at_once], off[self._attacher.most_at_once :]
        self._pending = {pin: due[pin] for pin in later}
        request, answer_length = b"".join(itertools.starmap(codec.servo_write, setpoints.items())), 0
        if first:
            servos = [FirstPulse(pin, due[pin], table.whole_range(pin)) for pin in first]
            burst = self._attacher.burst(servos)
            request, answer_length = request + burst.request, burst.answer_length
        if request:
            self.send(request, answer_length)
            watch.sent(setpoints | {pin: due[pin] for pin in first})

    def ask_next(self, watch: PinWatch) -> None:
        """Ask for as many pin states as the line has room for in this servo frame, in turn."""
        now = self._now()
        if now - self._asked_at < _ROUND_S:
            return
        count = min(_MOST_QUERIES, self._pace.room(now) // _QUERY_BYTES)
        pins = watch.ask(count, now)
        if pins:
            self._asked_at = now
            self.send(b"".join(map(codec.pin_state_query, pins)))


# Who answers on a port, before a driver is opened there.

_PROBE_S = 1.0


class FirmataEar:
    """Hears a Firmata sketch: its name and version, which it tells when it starts and when asked."""

    def __init__(self) -> None:
        self._parser = ReplyParser()
        self.details: tuple[str, ...] = ()
        """the protocol version, where it was told, in words"""

    def feed(self, data: bytes) -> Introduction | None:
        """Take what came; the sketch's name counts, since a version alone may be noise."""
        for reply in self._parser.feed(data):
            if isinstance(reply, VersionReport):
                self.details = (f"Firmata protocol {reply.major}.{reply.minor}",)
            elif isinstance(reply, FirmwareReport):
                name = reply.name.removesuffix(".ino").removesuffix(".cpp")
                return Introduction(name, f"{reply.major}.{reply.minor}", self.details)
        return None


def ask_firmata(line: Transport, now: Callable[[], float]) -> Introduction | None:
    """First ask for the version: in a sketch that was left in the middle of a message it ends nothing."""
    ear = FirmataEar()
    line.write(codec.version_query())
    found, _ = listen(line, [ear], _PROBE_S, now, until=lambda: bool(ear.details))
    if found is None and ear.details:
        line.write(codec.firmware_query())
        found, _ = listen(line, [ear], _PROBE_S, now)
    if found is not None:
        return found[1]
    return Introduction("Firmata", details=ear.details) if ear.details else None
