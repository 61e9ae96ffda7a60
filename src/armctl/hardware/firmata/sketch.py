"""The receiving side of the StandardFirmata sketch: single bytes to commands (FirmataParser.cpp)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from armctl.hardware.firmata.codec import CAPABILITY_RESPONSE_PIN_END, Command, Sysex, split_14_bits

SYSEX_BUFFER = 64
"""data bytes that the sketch can keep"""

_COMMAND_BIT = 0x80
_CHANNEL_BITS = 0x0F
_TWO_DATA_BYTES = (
    Command.ANALOG_MESSAGE,
    Command.DIGITAL_MESSAGE,
    Command.SET_PIN_MODE,
    Command.SET_DIGITAL_PIN,
)
_ONE_DATA_BYTE = (Command.REPORT_ANALOG, Command.REPORT_DIGITAL)


@dataclass(frozen=True, slots=True)
class ShortMessage:
    """A command of up to three bytes. Those from F0 on have no channel (0)."""

    command: Command
    channel: int
    data: bytes


@dataclass(frozen=True, slots=True)
class SysexMessage:
    """What stood between F0 and F7: any bytes at all, for the sketch does not look at them."""

    body: bytes


@dataclass(frozen=True, slots=True)
class Overflow:
    """A sysex longer than the buffer: old builds for the Mega crash here."""


SketchMessage: TypeAlias = ShortMessage | SysexMessage | Overflow


class SketchParser:
    """Takes bytes one at a time, with the sketch's own weaknesses.

    Inside a sysex every byte but F7 is data, the beginning of the next message too: a sysex that has
    lost its end swallows whatever follows, up to the next F7, and is then executed.
    """

    def __init__(self) -> None:
        self._sysex: bytearray | None = None
        self._command: Command | None = None
        self._channel = 0
        self._data = bytearray()

    def push(self, byte: int) -> SketchMessage | None:
        """What this byte completes."""
        if self._sysex is not None:
            return self._push_sysex(self._sysex, byte)
        if not byte & _COMMAND_BIT:
            return self._push_data(byte)
        channel = byte & _CHANNEL_BITS if byte < Command.START_SYSEX else 0
        try:
            command = Command(byte - channel)
        except ValueError:  # a command that the sketch does not know is passed over
            return None
        if command is Command.START_SYSEX:
            self._sysex = bytearray()
        elif command in _TWO_DATA_BYTES or command in _ONE_DATA_BYTE:
            self._command, self._channel, self._data = command, channel, bytearray()
        elif command in (Command.REPORT_VERSION, Command.SYSTEM_RESET):
            return ShortMessage(command, 0, b"")
        return None

    def _push_sysex(self, sysex: bytearray, byte: int) -> SketchMessage | None:
        if byte == Command.END_SYSEX:
            self._sysex = None
            return SysexMessage(bytes(sysex))
        sysex.append(byte)
        return Overflow() if len(sysex) > SYSEX_BUFFER else None

    def _push_data(self, byte: int) -> SketchMessage | None:
        # A command that comes in between does not end the wait for data: the sketch counts on.
        if self._command is None:
            return None
        self._data.append(byte)
        if len(self._data) < (1 if self._command in _ONE_DATA_BYTE else 2):
            return None
        message = ShortMessage(self._command, self._channel, bytes(self._data))
        self._command = None
        return message


# What the StandardFirmata sketch sends, as bytes.


def version_report(major: int, minor: int) -> bytes:
    """The protocol version."""
    return bytes((Command.REPORT_VERSION, major, minor))


def firmware_report(major: int, minor: int, name: str) -> bytes:
    """The sketch's version and name."""
    return _sysex(Sysex.REPORT_FIRMWARE, bytes((major, minor)) + _characters(name))


def capability_response(pins: Iterable[Mapping[int, int]]) -> bytes:
    """The modes that each pin knows, with their resolutions in bits."""
    data = bytearray()
    for modes in pins:
        for mode, resolution in modes.items():
            data += bytes((mode, resolution))
        data.append(CAPABILITY_RESPONSE_PIN_END)
    return _sysex(Sysex.CAPABILITY_RESPONSE, data)


def pin_state_response(pin: int, mode: int, value: int) -> bytes:
    """A pin's mode and value (16 bits with sign), in as many bytes of 7 bits as it needs."""
    data = bytearray((pin, mode, value & 0x7F))
    if value & 0xFF80:
        data.append(value >> 7 & 0x7F)
    if value & 0xC000:
        data.append(value >> 14 & 0x7F)
    return _sysex(Sysex.PIN_STATE_RESPONSE, data)


def unknown_pin_state_response(pin: int) -> bytes:
    """The answer for a pin that the board has not: nothing but its number."""
    return _sysex(Sysex.PIN_STATE_RESPONSE, bytes((pin,)))


def text_message(text: str) -> bytes:
    """A text for people."""
    return _sysex(Sysex.STRING_DATA, _characters(text))


def _sysex(kind: Sysex, data: bytes | bytearray) -> bytes:
    return bytes((Command.START_SYSEX, kind, *data, Command.END_SYSEX))


def _characters(text: str) -> bytes:
    return bytes(half for code in text.encode("ascii") for half in split_14_bits(code))
