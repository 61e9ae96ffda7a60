"""What a Firmata board sends: single bytes to whole messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from armctl.hardware.firmata.codec import CAPABILITY_RESPONSE_PIN_END, Command, Sysex

_LONGEST_SYSEX = 8192
"""the capabilities of a Mega are about 700 bytes; anything this long is no Firmata"""
_SHORT_LENGTH = 3
_COMMAND_BIT = 0x80
_COMMAND_OF_CHANNEL = 0xF0


@dataclass(frozen=True, slots=True)
class VersionReport:
    """The protocol version: at boot unasked, later when asked."""

    major: int
    minor: int


@dataclass(frozen=True, slots=True)
class FirmwareReport:
    """The sketch's name and version: at boot unasked, later when asked."""

    major: int
    minor: int
    name: str


@dataclass(frozen=True, slots=True)
class CapabilityReport:
    """The modes that each pin knows, with their resolutions in bits, by pin number."""

    pins: tuple[dict[int, int], ...]

    def pins_with(self, mode: int) -> tuple[int, ...]:
        """The pins that know ``mode``, lowest first."""
        return tuple(pin for pin, modes in enumerate(self.pins) if mode in modes)


@dataclass(frozen=True, slots=True)
class PinState:
    """A pin's mode and the value last written to it."""

    pin: int
    mode: int
    value: int


@dataclass(frozen=True, slots=True)
class BoardText:
    """What the sketch says in words, mostly that it could not do something."""

    text: str


@dataclass(frozen=True, slots=True)
class Malformed:
    """A message that breaks off or makes no sense."""

    raw: bytes


Reply: TypeAlias = VersionReport | FirmwareReport | CapabilityReport | PinState | BoardText | Malformed


class ReplyParser:
    """Takes bytes as they come, in any pieces, and returns the messages that they complete.

    Reports of pins that nobody asked for (analog, digital) and sysexes of other sketches are left
    out. A message that is broken off by another one is ``Malformed``; the other one counts. Data
    bytes that belong to nothing are skipped and counted (``skipped``).
    """

    def __init__(self) -> None:
        self.skipped = 0
        """bytes so far that belonged to no message"""
        self._raw = bytearray()

    def feed(self, data: bytes) -> list[Reply]:
        """The messages that ``data`` completes, in order."""
        replies: list[Reply] = []
        for byte in data:
            if byte & _COMMAND_BIT:
                replies += self._push_command(byte)
            else:
                replies += self._push_data(byte)
        return replies

    def _push_command(self, byte: int) -> list[Reply]:
        raw = self._raw
        if byte == Command.END_SYSEX and raw and raw[0] == Command.START_SYSEX:
            self._raw = bytearray()
            return _decode(bytes(raw[1:]))
        broken: list[Reply] = [Malformed(bytes(raw))] if raw else []
        if byte == Command.START_SYSEX or _length(byte) is not None:
            self._raw = bytearray((byte,))
        else:
            self._raw = bytearray()
            self.skipped += 1
        return broken

    def _push_data(self, byte: int) -> list[Reply]:
        raw = self._raw
        if not raw:
            self.skipped += 1
            return []
        raw.append(byte)
        if raw[0] == Command.START_SYSEX:
            if len(raw) < _LONGEST_SYSEX:
                return []
            self._raw = bytearray()
            return [Malformed(bytes(raw))]
        if len(raw) != _length(raw[0]):
            return []
        self._raw = bytearray()
        return [VersionReport(raw[1], raw[2])] if raw[0] == Command.REPORT_VERSION else []


def _length(command: int) -> int | None:
    """Bytes of a message that is no sysex; None for a byte that begins none."""
    reported = command & _COMMAND_OF_CHANNEL in (Command.ANALOG_MESSAGE, Command.DIGITAL_MESSAGE)
    return _SHORT_LENGTH if reported or command == Command.REPORT_VERSION else None


def _decode(body: bytes) -> list[Reply]:
    """The message of a sysex without its frame; none for one that is of no use here."""
    if not body:
        return [Malformed(body)]
    data = body[1:]
    match body[0]:
        case Sysex.REPORT_FIRMWARE:
            decoded = _firmware(data)
        case Sysex.CAPABILITY_RESPONSE:
            decoded = _capabilities(data)
        case Sysex.PIN_STATE_RESPONSE:
            decoded = _pin_state(data)
        case Sysex.STRING_DATA:
            decoded = BoardText(_text(data)) if len(data) % 2 == 0 else None
        case _:
            return []
    return [decoded if decoded is not None else Malformed(body)]


def _firmware(data: bytes) -> FirmwareReport | None:
    if len(data) < 2 or len(data) % 2:
        return None
    return FirmwareReport(data[0], data[1], _text(data[2:]))


def _capabilities(data: bytes) -> CapabilityReport | None:
    if not data or data[-1] != CAPABILITY_RESPONSE_PIN_END:
        return None
    pins: list[dict[int, int]] = []
    for modes in data[:-1].split(bytes((CAPABILITY_RESPONSE_PIN_END,))):
        if len(modes) % 2:
            return None
        pins.append(dict(zip(modes[::2], modes[1::2], strict=True)))
    return CapabilityReport(tuple(pins))


def _pin_state(data: bytes) -> PinState | None:
    # Pin, mode, and the value in as many 7-bit bytes as it needs, low one first.
    if len(data) < 3:
        return None
    return PinState(data[0], data[1], sum(byte << 7 * place for place, byte in enumerate(data[2:])))


def _text(data: bytes) -> str:
    """Characters sent as two 7-bit bytes each."""
    codes = bytes((low | high << 7) & 0xFF for low, high in zip(data[::2], data[1::2], strict=True))
    return codes.decode("latin-1")
