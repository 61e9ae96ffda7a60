"""What the StandardFirmata sketch sends, as bytes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from armctl.hardware.firmata.codec import CAPABILITY_RESPONSE_PIN_END, Command, Sysex, split_14_bits


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
