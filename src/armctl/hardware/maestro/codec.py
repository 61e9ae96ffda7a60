"""The Maestro's bytes (Pololu guide 0J40, 5.c to 5.e); targets in quarter µs, the rest in its own units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum, IntFlag

from armctl.errors import BoardProtocolError, InputError
from armctl.hardware.maestro import QUARTERS_PER_US
from armctl.lazy_dataclass import dataclass

# Units: µs, µs/s and µs/s² of a pulse, and the integers of the protocol.

SPEED_UNIT_US_PER_S = 25.0  # 0.25 µs in 10 ms
ACCELERATION_UNIT_US_PER_S2 = 312.5  # 0.25 µs in 10 ms, each 80 ms

MAX_TARGET = 0x3FFF  # quarter µs; all that 2 x 7 bits hold
MAX_SPEED = 0x3FFF
MAX_ACCELERATION = 255
MAX_CHANNEL = 23  # the largest board has 24

# 140 x 25.0 computed from degrees may come out as 3499.9999999: not a reason to lose a whole unit.
_ROUNDING_SLACK = 1e-6


def us_to_quarters(pulse_us: float) -> int:
    """The nearest quarter µs of a pulse width [µs]; ``InputError`` where the protocol cannot hold it."""
    if not math.isfinite(pulse_us) or not 0.0 < pulse_us <= MAX_TARGET / QUARTERS_PER_US:
        raise InputError(
            f"pulse width {pulse_us} µs cannot be sent; allowed is more than 0 up to "
            f"{MAX_TARGET / QUARTERS_PER_US} µs"
        )
    # At least 1: rounding to 0 would switch the pulses off, which is another command altogether.
    return max(1, round(pulse_us * QUARTERS_PER_US))


def speed_to_units(speed_us_per_s: float | None) -> int:
    """A speed limit [µs/s] as the board takes it; None is unlimited (0 on the wire).

    Rounds down, never above the limit, but to one unit (25 µs/s) at least, because 0 would mean *unlimited*,
    and to the largest value at most. ``InputError`` where it is not finite or not positive.
    """
    return _limit_to_units("speed", "µs/s", speed_us_per_s, SPEED_UNIT_US_PER_S, MAX_SPEED)


def acceleration_to_units(acceleration_us_per_s2: float | None) -> int:
    """The same for an acceleration limit [µs/s²]: never above 255 units (79 687.5 µs/s²)."""
    return _limit_to_units(
        "acceleration", "µs/s²", acceleration_us_per_s2, ACCELERATION_UNIT_US_PER_S2, MAX_ACCELERATION
    )


def _limit_to_units(what: str, unit: str, limit: float | None, size: float, largest: int) -> int:
    if limit is None:
        return 0
    if not math.isfinite(limit) or limit <= 0.0:
        raise InputError(
            f"{what} limit {limit} {unit} makes no sense; give a positive number, or None for no limit"
        )
    return min(largest, max(1, math.floor(limit / size + _ROUNDING_SLACK)))


class MaestroErrors(IntFlag):
    """Error bits of Get Errors (Pololu guide 0J40, section 4.e)."""

    SERIAL_SIGNAL = 1 << 0
    SERIAL_OVERRUN = 1 << 1
    SERIAL_BUFFER_FULL = 1 << 2
    SERIAL_CRC = 1 << 3
    SERIAL_PROTOCOL = 1 << 4
    SERIAL_TIMEOUT = 1 << 5
    SCRIPT_STACK = 1 << 6
    SCRIPT_CALL_STACK = 1 << 7
    SCRIPT_PROGRAM_COUNTER = 1 << 8


ALL_ERRORS = 0x01FF
_ERROR_WORDS = (
    "serial signal error: wrong baud rate or noise on the TTL line",
    "serial overrun: bytes came faster than the board's UART takes them",
    "serial buffer full: the board lost bytes",
    "serial CRC error: a damaged command, or only one side has CRC switched on",
    "serial protocol error: the board got an unknown command or half of one",
    "serial timeout: the board heard nothing for too long and went to its home",
    "script stack error in the board's own script",
    "script call stack error in the board's own script",
    "script program counter error in the board's own script",
)


def error_words(errors: MaestroErrors) -> tuple[str, ...]:
    """One phrase for each bit that is set, lowest bit first."""
    return tuple(words for bit, words in zip(MaestroErrors, _ERROR_WORDS, strict=True) if bit in errors)


# Commands in the compact form, and their answers.


class Opcode(IntEnum):
    """Command bytes of the compact form."""

    SET_TARGET = 0x84
    SET_SPEED = 0x87
    SET_ACCELERATION = 0x89
    SET_PWM = 0x8A  # Mini only
    GET_POSITION = 0x90
    GET_MOVING_STATE = 0x93
    SET_MULTIPLE_TARGETS = 0x9F
    GET_ERRORS = 0xA1
    GO_HOME = 0xA2
    STOP_SCRIPT = 0xA4
    RESTART_SCRIPT = 0xA7
    RESTART_SCRIPT_WITH_PARAMETER = 0xA8
    GET_SCRIPT_STATUS = 0xAE
    MINI_SSC = 0xFF


REPLY_LENGTH = 2
"""bytes of the answers to Get Position and Get Errors"""

_CRC_POLYNOMIAL = 0x91
_DATA_MASK = 0x7F


def crc7(data: bytes) -> int:
    """CRC-7 over a whole packet: least significant bit first, polynomial 0x91 (section 5.d)."""
    remainder = 0
    for byte in data:
        remainder ^= byte
        for _ in range(8):
            if remainder & 1:
                remainder ^= _CRC_POLYNOMIAL
            remainder >>= 1
    return remainder


_LARGEST = {
    Opcode.SET_TARGET: ("target", MAX_TARGET),
    Opcode.SET_SPEED: ("speed", MAX_SPEED),
    Opcode.SET_ACCELERATION: ("acceleration", MAX_ACCELERATION),
}


def command(opcode: Opcode, *values: int, crc: bool = False) -> bytes:
    """A command, with its channel and a value in the board's units (0: none) where it has them."""
    data: list[int] = []
    if values:
        _check("channel", values[0], MAX_CHANNEL)
        data.append(values[0])
    if len(values) > 1:
        what, largest = _LARGEST[opcode]
        _check(what, values[1], largest)
        data += _split(values[1])
    return _packet(crc, opcode, *data)


def set_targets(quarters: Mapping[int, int], *, crc: bool = False, multiple: bool = False) -> bytes:
    """Targets [quarter µs] by channel, 0: off; ``multiple``: the board knows Set Multiple Targets."""
    runs: list[list[int]] = []
    for channel in sorted(quarters):
        _check("channel", channel, MAX_CHANNEL)
        _check("target", quarters[channel], MAX_TARGET)
        if multiple and runs and runs[-1][-1] == channel - 1:
            runs[-1].append(channel)
        else:
            runs.append([channel])
    packets = b""
    for run in runs:
        data = [half for channel in run for half in _split(quarters[channel])]
        if len(run) == 1:
            packets += _packet(crc, Opcode.SET_TARGET, run[0], *data)
        else:
            packets += _packet(crc, Opcode.SET_MULTIPLE_TARGETS, len(run), run[0], *data)
    return packets


def _packet(crc: bool, opcode: Opcode, *data: int) -> bytes:
    packet = bytes((opcode, *data))
    return packet + bytes((crc7(packet),)) if crc else packet


def decode_position(reply: bytes) -> float | None:
    """The pulse width [µs] of a Get Position reply, None when off; ``BoardProtocolError`` if impossible."""
    quarters = _word("Get Position", reply)
    if quarters > MAX_TARGET:
        raise BoardProtocolError(
            f"the board answered a position of {quarters / QUARTERS_PER_US} µs ({reply.hex(' ')}), "
            f"which no Maestro can transmit; the line garbles bytes or this is no Maestro"
        )
    return quarters / QUARTERS_PER_US if quarters else None


def decode_errors(reply: bytes) -> MaestroErrors:
    """The error bits of a Get Errors reply; ``BoardProtocolError`` for what no Maestro can answer."""
    bits = _word("Get Errors", reply)
    if bits & ~ALL_ERRORS:
        raise BoardProtocolError(
            f"the board answered error bits 0x{bits:04x}, of which a Maestro knows only 0x{ALL_ERRORS:04x}; "
            "the line garbles bytes or this is no Maestro"
        )
    return MaestroErrors(bits)


def _split(value: int) -> tuple[int, int]:
    """14 bits as two data bytes, low one first."""
    return value & _DATA_MASK, value >> 7


def _word(command: str, reply: bytes) -> int:
    """Two full bytes, low one first: replies, unlike commands, use all 8 bits."""
    if len(reply) != REPLY_LENGTH:
        raise BoardProtocolError(f"{command} was answered by {len(reply)} bytes, not by 2")
    return int.from_bytes(reply, "little")


def _check(what: str, value: int, highest: int) -> None:
    if not 0 <= value <= highest:
        raise InputError(f"{what} {value} is outside 0 … {highest}")


# The receiving side: single bytes to commands and errors, as the board takes them.

POLOLU_START = 0xAA
_COMMAND_BIT = 0x80
_DATA_BYTES: dict[int, int] = {
    Opcode.SET_TARGET: 3,
    Opcode.SET_SPEED: 3,
    Opcode.SET_ACCELERATION: 3,
    Opcode.GET_POSITION: 1,
    Opcode.GET_MOVING_STATE: 0,
    Opcode.GET_ERRORS: 0,
    Opcode.GO_HOME: 0,
    Opcode.STOP_SCRIPT: 0,
    Opcode.RESTART_SCRIPT: 1,
    Opcode.RESTART_SCRIPT_WITH_PARAMETER: 3,
    Opcode.GET_SCRIPT_STATUS: 0,
}


@dataclass(frozen=True, slots=True)
class Packet:
    """One complete command: its compact-form command byte, its data, and the bytes as they came."""

    opcode: Opcode
    data: bytes
    raw: bytes
    time: float = 0.0  # when a simulated board took it [s]


class PacketParser:
    """Takes bytes one at a time, in all three sub-protocols mixed, as the board does.

    A byte with bit 7 set always begins a new command; one that comes before the last command was
    complete is a protocol error too. Data bytes that belong to nothing are a protocol error once,
    then skipped up to the next command byte. (The guide does not say what the board does with
    them; this is the stricter reading, so that a client that sends them is found out.)
    A Pololu-form command to another device number is skipped without an error.

    ``device`` is the board's own device number; ``crc``: it wants a CRC-7 after each command (never after
    Mini SSC); ``mini``: it knows Set Multiple Targets and Set PWM.
    """

    def __init__(self, *, device: int, crc: bool, mini: bool) -> None:
        self._device = device
        self._crc = crc
        self._mini = mini
        self._raw = bytearray()
        self._skipping = False

    def push(self, byte: int) -> list[Packet | MaestroErrors]:
        """What this byte brings about: nothing, an error, a complete command, or an error and a command."""
        events: list[Packet | MaestroErrors] = []
        mini_ssc = bool(self._raw) and self._raw[0] == Opcode.MINI_SSC and byte != Opcode.MINI_SSC
        if byte & _COMMAND_BIT and not mini_ssc:
            if self._raw:
                events.append(MaestroErrors.SERIAL_PROTOCOL)
            self._raw.clear()
            self._skipping = False
        elif not self._raw:
            if self._skipping:
                return events
            self._skipping = True
            return [MaestroErrors.SERIAL_PROTOCOL]
        self._raw.append(byte)
        finished = self._finish()
        return events if finished is None else [*events, finished]

    def _finish(self) -> Packet | MaestroErrors | None:
        """The command that is complete now, or the error that ends it; None: it goes on, or is skipped."""
        raw, crc = self._raw, self._crc
        command, data = raw[0], raw[1:]
        if command == POLOLU_START:
            if data and data[0] != self._device:
                self._skip()
                return None
            if len(data) < 2:
                return None
            command, data = data[1] | _COMMAND_BIT, data[2:]
            length = self._length(command, data)
        elif command == Opcode.MINI_SSC:
            length, crc = 2, False
        else:
            length = self._length(command, data)
        if length is None:
            self._skip()
            return MaestroErrors.SERIAL_PROTOCOL
        if len(data) < length + crc:
            return None
        whole = bytes(raw)
        raw.clear()
        if crc and crc7(whole[:-1]) != whole[-1]:
            return MaestroErrors.SERIAL_CRC
        return Packet(Opcode(command), bytes(data[:length]), whole)

    def _length(self, command: int, data: bytearray) -> int | None:
        """Data bytes of a command; Set Multiple Targets counts its own. None: the board has no such one."""
        if command == Opcode.SET_MULTIPLE_TARGETS and self._mini:
            return 2 + 2 * data[0] if data else 1
        if command == Opcode.SET_PWM and self._mini:
            return 4
        return _DATA_BYTES.get(command)

    def _skip(self) -> None:
        self._raw.clear()
        self._skipping = True
