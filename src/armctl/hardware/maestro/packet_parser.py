"""The receiving side of the Maestro's protocol: single bytes to commands and errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from armctl.hardware.maestro.codec import POLOLU_START, MaestroErrors, Opcode, crc7

# Data bytes of each command; None: counted by its own first data byte.
_MICRO_COMMANDS: dict[int, int | None] = {
    Opcode.SET_TARGET: 3,
    Opcode.SET_SPEED: 3,
    Opcode.SET_ACCELERATION: 3,
    Opcode.GET_POSITION: 1,
    Opcode.GET_MOVING_STATE: 0,
    Opcode.GET_ERRORS: 0,
    Opcode.GO_HOME: 0,
}
_MINI_COMMANDS: dict[int, int | None] = {**_MICRO_COMMANDS, Opcode.SET_MULTIPLE_TARGETS: None}

_COMMAND_BIT = 0x80
_MINI_SSC_LENGTH = 3


@dataclass(frozen=True, slots=True)
class Packet:
    """One complete command: its compact-form command byte, its data, and the bytes as they came."""

    opcode: Opcode
    data: bytes
    raw: bytes


class PacketParser:
    """Takes bytes one at a time, in all three sub-protocols mixed, as the board does.

    A byte with bit 7 set always begins a new command; one that comes before the last command was
    complete is a protocol error too. Data bytes that belong to nothing are a protocol error once,
    then skipped up to the next command byte. (The guide does not say what the board does with
    them; this is the stricter reading, so that a client that sends them is found out.)
    A Pololu-form command to another device number is skipped without an error.

    Args:
        device: the board's own device number.
        crc: whether the board wants a CRC-7 after each command (never after Mini SSC).
        multiple_targets: whether the board knows Set Multiple Targets.
    """

    def __init__(self, *, device: int, crc: bool, multiple_targets: bool) -> None:
        self._device = device
        self._crc = crc
        self._commands: Mapping[int, int | None] = _MINI_COMMANDS if multiple_targets else _MICRO_COMMANDS
        self._raw = bytearray()
        self._skipping = False

    def push(self, byte: int) -> list[Packet | MaestroErrors]:
        """What this byte brings about: nothing, an error, a complete command, or an error and a command."""
        if self._raw and self._raw[0] == Opcode.MINI_SSC and byte != Opcode.MINI_SSC:
            return self._push_mini_ssc(byte)
        events: list[Packet | MaestroErrors] = []
        if byte & _COMMAND_BIT:
            if self._raw:
                events.append(MaestroErrors.SERIAL_PROTOCOL)
            self._raw = bytearray((byte,))
            self._skipping = False
        elif self._raw:
            self._raw.append(byte)
        elif self._skipping:
            return events
        else:
            self._skipping = True
            return [MaestroErrors.SERIAL_PROTOCOL]
        return events + self._finish_if_complete()

    def _push_mini_ssc(self, byte: int) -> list[Packet | MaestroErrors]:
        self._raw.append(byte)
        if len(self._raw) < _MINI_SSC_LENGTH:
            return []
        return [self._take(Opcode.MINI_SSC, bytes(self._raw[1:]))]

    def _finish_if_complete(self) -> list[Packet | MaestroErrors]:
        raw = self._raw
        if raw[0] == Opcode.MINI_SSC:
            return []
        if raw[0] == POLOLU_START:
            if len(raw) > 1 and raw[1] != self._device:
                self._skip()
                return []
            if len(raw) < 3:
                return []
            command, data = raw[2] | _COMMAND_BIT, raw[3:]
        else:
            command, data = raw[0], raw[1:]
        if command not in self._commands:
            self._skip()
            return [MaestroErrors.SERIAL_PROTOCOL]
        length = self._commands[command]
        if length is None:
            if not data:
                return []
            length = 2 + 2 * data[0]
        if len(data) < length + self._crc:
            return []
        if self._crc and crc7(bytes(raw[:-1])) != raw[-1]:
            self._raw.clear()
            return [MaestroErrors.SERIAL_CRC]
        return [self._take(Opcode(command), bytes(data[:length]))]

    def _take(self, opcode: Opcode, data: bytes) -> Packet:
        packet = Packet(opcode, data, bytes(self._raw))
        self._raw.clear()
        return packet

    def _skip(self) -> None:
        self._raw.clear()
        self._skipping = True
