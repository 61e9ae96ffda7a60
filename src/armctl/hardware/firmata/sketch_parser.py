"""The receiving side of StandardFirmata: single bytes to commands (FirmataParser.cpp)."""

from __future__ import annotations

from armctl.hardware.firmata.codec import MessageStart
from armctl.lazy_dataclass import dataclass

SYSEX_OBEYED = 32
"""data bytes of the longest sysex that is carried out; a longer one is dropped without a word"""
SYSEX_BUFFER = 64
"""data bytes that the sketch can keep; more of them crash old builds for the Mega"""

_COMMAND_BIT = 0x80
_DATA_BYTES: dict[int, int] = {
    MessageStart.ANALOG_MESSAGE: 2,
    MessageStart.DIGITAL_MESSAGE: 2,
    MessageStart.SET_PIN_MODE: 2,
    MessageStart.SET_DIGITAL_PIN: 2,
    MessageStart.REPORT_ANALOG: 1,
    MessageStart.REPORT_DIGITAL: 1,
    MessageStart.REPORT_VERSION: 0,
    MessageStart.SYSTEM_RESET: 0,
}


@dataclass(frozen=True, slots=True)
class SketchMessage:
    """A command and its data: of a sysex any bytes at all, for the sketch does not look at them."""

    command: MessageStart
    data: bytes = b""
    channel: int = 0  # of commands below F0


class SketchParser:
    """Takes bytes one at a time, with the sketch's own weaknesses.

    Inside a sysex every byte but F7 is data, the beginning of the next message too: a sysex that has
    lost its end swallows whatever follows, up to the next F7, and is then executed.
    """

    def __init__(self) -> None:
        self._sysex: bytearray | None = None
        self._command: MessageStart | None = None
        self._channel = 0
        self._data = bytearray()

    def push(self, byte: int) -> SketchMessage | None:
        """What this byte completes; a sysex too long comes with more data than the buffer holds."""
        if self._sysex is not None:
            return self._push_sysex(self._sysex, byte)
        if byte & _COMMAND_BIT:
            return self._begin(byte)
        # A command that comes in between does not end the wait for data: the sketch counts on.
        if self._command is None:
            return None
        self._data.append(byte)
        if len(self._data) < _DATA_BYTES[self._command]:
            return None
        message = SketchMessage(self._command, bytes(self._data), self._channel)
        self._command = None
        return message

    def _push_sysex(self, body: bytearray, byte: int) -> SketchMessage | None:
        if byte == MessageStart.END_SYSEX:
            self._sysex = None
        else:
            body.append(byte)
            if len(body) <= SYSEX_BUFFER:
                return None
        return SketchMessage(MessageStart.START_SYSEX, bytes(body))

    def _begin(self, byte: int) -> SketchMessage | None:
        channel = byte & 0x0F if byte < MessageStart.START_SYSEX else 0
        if byte == MessageStart.START_SYSEX:
            self._sysex = bytearray()
        length = _DATA_BYTES.get(byte - channel)
        if length is None:  # a sysex, or a command that the sketch does not know
            return None
        command = MessageStart(byte - channel)
        if length == 0:
            return SketchMessage(command)
        self._command, self._channel, self._data = command, channel, bytearray()
        return None
