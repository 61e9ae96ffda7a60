"""Requests to a Firmata board and what it sends, over one transport, kept in step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware.firmata import codec
from armctl.hardware.firmata.replies import (
    CapabilityReport,
    FirmwareReport,
    Reply,
    ReplyParser,
    VersionReport,
)
from armctl.hardware.transport import Transport

HOW_TO_LOAD = (
    "load the sketch: Arduino IDE, File > Examples > Firmata > StandardFirmata, Upload; then connect again"
)
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
