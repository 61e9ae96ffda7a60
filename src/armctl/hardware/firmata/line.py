"""The line to a Firmata board: who answers there, and what may still be sent."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware.board_type import Introduction, listen
from armctl.hardware.firmata import BAUD, HOW_TO_LOAD, codec
from armctl.hardware.firmata.codec import (
    CapabilityReport,
    FirmwareReport,
    PinState,
    Reply,
    ReplyParser,
    VersionReport,
)
from armctl.hardware.transport import Transport, pieces
from armctl.lazy_dataclass import dataclass

_OPEN_S = 5.0
"""a Mega that restarts when its port is opened reports after 1.7 s and its bootloader's time"""
_ASK_AGAIN_S = 1.0
_ANSWER_S = 2.0
"""the capabilities of a Mega take 0.15 s on the line"""
_CHUNK = 4096
_KEPT = 512
"""how much of what came is kept to tell who it is"""

RESTARTED = (
    "the board has restarted (reset button, or its supply broke down): its servos are off and the arm may "
    "have dropped; check the supply, then connect again"
)

Wanted = TypeVar("Wanted")


@dataclass(frozen=True, slots=True)
class Identity:
    """What a board has said of itself."""

    firmware: FirmwareReport
    capabilities: CapabilityReport


class FirmataLine:
    """A transport with a Firmata board at the other end.

    A sysex that breaks off is finished by the next one, and a wrong value is executed. So a line on
    which a write failed, or whose board has started anew, takes nothing more: it has to be opened
    again, and there only a question that ends no sysex is asked until the board answers it.
    ``send``, ``receive`` and ``listen`` raise ``BoardError`` then, and where the line is gone.
    ``restarted``: what it means that the board has started anew.
    """

    def __init__(self, transport: Transport, now: Callable[[], float], restarted: str = RESTARTED) -> None:
        self.name = transport.name
        self._transport = transport
        self._now = now
        self._restarted = restarted
        self._parser = ReplyParser()
        self._version: VersionReport | None = None
        self._identified = False
        self._received = b""
        self._lost: str | None = None
        self._broken = False
        """whether a write broke off: the sketch may be in the middle of a message"""

    def identify(self, ask_after_s: float) -> Identity:
        """Wait until a Firmata sketch runs and answers; find out which and what its pins can do.

        Listens for ``ask_after_s`` before asking: bytes sent to a bootloader keep it waiting.
        ``BoardTimeoutError`` without an answer, ``BoardProtocolError`` where it is not in Firmata.
        """
        self._transport.discard_input()
        self._await_version(ask_after_s)
        firmware = self._ask(codec.FIRMWARE_QUERY, FirmwareReport, "its firmware")
        # The board answers in order: whatever it said of itself while starting lies before this answer.
        capabilities = self._ask(codec.CAPABILITY_QUERY, CapabilityReport, "its pins' capabilities")
        self._identified = True
        return Identity(firmware, capabilities)

    def pin_state(self, pin: int, wait_s: float) -> PinState:
        """Ask for the state of a pin; ``BoardTimeoutError`` where it does not come within ``wait_s``."""
        self.send(codec.pin_state_query(pin))
        for reply in self.listen(wait_s):
            if isinstance(reply, PinState) and reply.pin == pin:
                return reply
        raise BoardTimeoutError(
            f"{self.name}: the board did not tell the state of pin {pin} within {wait_s * 1000:.0f} ms"
        )

    def send(self, data: bytes) -> None:
        """Write ``data`` in one go."""
        self._check()
        try:
            self._transport.write(data)
        except BoardError as error:
            self._broken = True
            self.lose("an earlier write broke off, and the board may have got half a message; connect again")
            raise error

    def receive(self) -> list[Reply]:
        """What has come since the last call; never waits."""
        self._check()
        return self._parse(self._transport.read(_CHUNK, 0.0))

    def lose(self, why: str) -> BoardError:
        """Let nothing more be sent; the error to raise now and from now on."""
        self._lost = f"{self.name}: {why}"
        return BoardError(self._lost)

    @property
    def lost(self) -> bool:
        """Whether nothing more is sent."""
        return self._lost is not None

    def send_at_last(self, data: bytes) -> None:
        """Write whole messages to a line that was given up, as what is left to do before it is closed.

        ``BoardError``: a write broke off on it, now or earlier.
        """
        if self._broken:
            self._check()
        self._broken = True
        self._transport.write(data)
        self._broken = False

    def listen(self, wait_s: float) -> Iterator[Reply]:
        """What comes within ``wait_s``; a caller that has what it waited for stops earlier."""
        self._check()
        for data in pieces(self._transport, wait_s, self._now):
            yield from self._parse(data)

    def _await_version(self, ask_after_s: float) -> None:
        """Wait for a version report: the parser is between two messages then."""
        wait_s, left_s = ask_after_s, _OPEN_S
        while left_s > 0.0:
            for reply in self.listen(min(wait_s, left_s)):
                if isinstance(reply, VersionReport):
                    self._version = reply
                    return
            left_s -= wait_s
            if left_s > 0.0:
                self.send(codec.VERSION_QUERY)
                wait_s = _ASK_AGAIN_S
        if not self._received:
            raise BoardTimeoutError(
                f"{self.name}: no answer within {_OPEN_S:g} s. Is it an Arduino with StandardFirmata? If "
                f"not, {HOW_TO_LOAD}. If it is, press its reset button and connect again"
            )
        if b"armctl-encoder" in self._received:
            raise BoardProtocolError(
                f"{self.name}: this board runs armctl's own firmware for arms with encoders, not Firmata; "
                f"choose a robot with encoders (board kind encoder), or {HOW_TO_LOAD}"
            )
        raise BoardProtocolError(
            f"{self.name}: something answers, but not in Firmata at {BAUD} baud (first bytes "
            f"{self._received[:12].hex(' ')}); {HOW_TO_LOAD}"
        )

    def _ask(self, request: bytes, wanted: type[Wanted], what: str) -> Wanted:
        self.send(request)
        for reply in self.listen(_ANSWER_S):
            if isinstance(reply, wanted):
                return reply
        raise BoardTimeoutError(
            f"{self.name}: the board speaks Firmata but did not tell {what} within {_ANSWER_S:g} s; "
            f"{HOW_TO_LOAD}"
        )

    def _parse(self, data: bytes) -> list[Reply]:
        replies = self._parser.feed(data)
        if not self._identified:
            self._received = (self._received + data)[-_KEPT:]
        # The version is never asked for once the board is known; a board that starts tells it by itself.
        # Another one than before is a garbled message.
        elif self._version in replies:
            raise self.lose(self._restarted)
        return replies

    def _check(self) -> None:
        if self._lost is not None:
            raise BoardError(self._lost)


# Who answers on a port, before a driver is opened there.

_PROBE_S = 1.0


class FirmataListener:
    """Recognises a Firmata sketch: its name and version, which it tells when it starts and when asked."""

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
    listener = FirmataListener()
    line.write(codec.VERSION_QUERY)
    found, _ = listen(line, [listener], _PROBE_S, now, until=lambda: bool(listener.details))
    if found is None and listener.details:
        line.write(codec.FIRMWARE_QUERY)
        found, _ = listen(line, [listener], _PROBE_S, now)
    if found is not None:
        return found[1]
    return Introduction("Firmata", details=listener.details) if listener.details else None
