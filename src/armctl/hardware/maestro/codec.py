"""The Maestro's bytes, in both directions (Pololu guide 0J40, sections 5.c to 5.e).

Targets are quarter µs, speeds and accelerations the board's units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag

from armctl.errors import BoardProtocolError, InputError
from armctl.hardware.driver import ChannelScale

# The four boards of the family and how they differ.


class MaestroModel(Enum):
    """A member of the family: name, channels, USB product number."""

    MICRO_6 = ("Pololu Micro Maestro 6-channel", 6, 0x0089)
    MINI_12 = ("Pololu Mini Maestro 12-channel", 12, 0x008A)
    MINI_18 = ("Pololu Mini Maestro 18-channel", 18, 0x008B)
    MINI_24 = ("Pololu Mini Maestro 24-channel", 24, 0x008C)

    def __init__(self, label: str, channels: int, usb_product: int) -> None:
        self.label = label
        self.channels = channels
        self.usb_product = usb_product

    @property
    def has_multiple_targets(self) -> bool:
        """Whether it knows Set Multiple Targets; to the Micro that command is a protocol error."""
        return self is not MaestroModel.MICRO_6

    @classmethod
    def from_label(cls, label: str) -> MaestroModel | None:
        """The model of this name, None when there is none."""
        return next((model for model in cls if model.label == label), None)

    @classmethod
    def with_channels(cls, count: int) -> MaestroModel:
        """The smallest model with at least ``count`` channels (the largest if none has that many)."""
        return next((model for model in cls if model.channels >= count), cls.MINI_24)


# Between SI-like units of a pulse (µs, µs/s, µs/s²) and the integers of the Maestro's protocol.

QUARTERS_PER_US = 4
SCALE = ChannelScale("channel", "µs", QUARTERS_PER_US)
SPEED_UNIT_US_PER_S = 25.0  # 0.25 µs in 10 ms
ACCELERATION_UNIT_US_PER_S2 = 312.5  # 0.25 µs in 10 ms, each 80 ms

MAX_TARGET = 0x3FFF  # quarter µs; all that 2 x 7 bits hold
MAX_SPEED = 0x3FFF
MAX_ACCELERATION = 255

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


def quarters_to_us(quarters: int) -> float:
    """Quarter µs to µs."""
    return quarters / QUARTERS_PER_US


def speed_to_units(speed_us_per_s: float | None) -> int:
    """A speed limit [µs/s] as the board takes it; None is unlimited (0 on the wire).

    Rounds down, so that the board never runs faster than the limit. Below one unit (25 µs/s) it becomes one
    unit, because 0 would mean *unlimited*; above the field it becomes the largest value. ``InputError``
    where it is not finite or not positive.
    """
    return _limit_to_units("speed", "µs/s", speed_us_per_s, SPEED_UNIT_US_PER_S, MAX_SPEED)


def acceleration_to_units(acceleration_us_per_s2: float | None) -> int:
    """An acceleration limit [µs/s²] as the board takes it; None is unlimited (0 on the wire).

    Rounds like ``speed_to_units``: down, but never to 0 and never above 255 (79 687.5 µs/s²).
    """
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


# The board's error register in words.


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

_WORDS: dict[MaestroErrors, str] = {
    MaestroErrors.SERIAL_SIGNAL: "serial signal error: wrong baud rate or noise on the TTL line",
    MaestroErrors.SERIAL_OVERRUN: "serial overrun: bytes came faster than the board's UART takes them",
    MaestroErrors.SERIAL_BUFFER_FULL: "serial buffer full: the board lost bytes",
    MaestroErrors.SERIAL_CRC: "serial CRC error: a damaged command, or only one side has CRC switched on",
    MaestroErrors.SERIAL_PROTOCOL: "serial protocol error: the board got an unknown command or half of one",
    MaestroErrors.SERIAL_TIMEOUT: "serial timeout: the board heard nothing for too long and went to its home",
    MaestroErrors.SCRIPT_STACK: "script stack error in the board's own script",
    MaestroErrors.SCRIPT_CALL_STACK: "script call stack error in the board's own script",
    MaestroErrors.SCRIPT_PROGRAM_COUNTER: "script program counter error in the board's own script",
}


def error_words(errors: MaestroErrors) -> tuple[str, ...]:
    """One phrase for each bit that is set, lowest bit first."""
    return tuple(words for bit, words in _WORDS.items() if bit in errors)


SILENT_ADVICE = (
    'set the serial mode to "USB Dual Port" in the Maestro Control Center (Serial Settings): in the '
    'factory\'s "UART, detect baud rate" the board silently ignores commands over USB. Check also that this '
    "is the command port (…-if00)"
)
POLOLU_START = 0xAA
DEFAULT_DEVICE_NUMBER = 12
MAX_CHANNEL = 23  # the largest board has 24

POSITION_REPLY_LENGTH = 2
ERRORS_REPLY_LENGTH = 2

_CRC_POLYNOMIAL = 0x91
_DATA_MASK = 0x7F


class Opcode(IntEnum):
    """Command bytes of the compact form."""

    SET_TARGET = 0x84
    SET_SPEED = 0x87
    SET_ACCELERATION = 0x89
    GET_POSITION = 0x90
    GET_MOVING_STATE = 0x93
    SET_MULTIPLE_TARGETS = 0x9F
    GET_ERRORS = 0xA1
    GO_HOME = 0xA2
    MINI_SSC = 0xFF


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


@dataclass(frozen=True, slots=True)
class Framing:
    """How a command is wrapped: compact or Pololu form, with or without CRC-7.

    Args:
        device: device number for the Pololu form; None for the compact form.
        crc: append a CRC-7, as the board expects with "Enable CRC" ticked.
    """

    device: int | None = None
    crc: bool = False

    def __post_init__(self) -> None:
        """Refuse a device number that does not fit a data byte."""
        if self.device is not None:
            _check("device number", self.device, 0, _DATA_MASK)

    def wrap(self, opcode: Opcode, *data: int) -> bytes:
        """The packet of one command."""
        if self.device is None:
            packet = bytes((opcode, *data))
        else:
            packet = bytes((POLOLU_START, self.device, opcode & _DATA_MASK, *data))
        return packet + bytes((crc7(packet),)) if self.crc else packet


COMPACT = Framing()


def set_target(channel: int, quarters: int, framing: Framing = COMPACT) -> bytes:
    """Set Target; 0 switches the pulses off."""
    _check_channel(channel)
    _check("target", quarters, 0, MAX_TARGET)
    return framing.wrap(Opcode.SET_TARGET, channel, *_split(quarters))


def set_multiple_targets(first: int, quarters: Sequence[int], framing: Framing = COMPACT) -> bytes:
    """Set Multiple Targets for consecutive channels from ``first`` on; the Micro does not know it."""
    if not quarters:
        raise InputError("Set Multiple Targets needs at least one target")
    _check_channel(first)
    _check_channel(first + len(quarters) - 1)
    data: list[int] = []
    for target in quarters:
        _check("target", target, 0, MAX_TARGET)
        data += _split(target)
    return framing.wrap(Opcode.SET_MULTIPLE_TARGETS, len(quarters), first, *data)


def set_targets(quarters: Mapping[int, int], framing: Framing = COMPACT, *, multiple: bool = False) -> bytes:
    """The bytes for targets [quarter µs] of any channels, fewest possible.

    Args:
        quarters: target by channel; 0 switches the pulses off.
        framing: form of the commands.
        multiple: whether the board knows Set Multiple Targets, which then serves neighbouring channels.
    """
    packets: list[bytes] = []
    run: list[int] = []
    for channel in sorted(quarters):
        if run and (channel != run[-1] + 1 or not multiple):
            packets.append(_set_run(run, quarters, framing))
            run = []
        run.append(channel)
    if run:
        packets.append(_set_run(run, quarters, framing))
    return b"".join(packets)


def set_speed(channel: int, units: int, framing: Framing = COMPACT) -> bytes:
    """Set Speed in units of 0.25 µs / 10 ms; 0 is unlimited."""
    _check_channel(channel)
    _check("speed", units, 0, MAX_SPEED)
    return framing.wrap(Opcode.SET_SPEED, channel, *_split(units))


def set_acceleration(channel: int, units: int, framing: Framing = COMPACT) -> bytes:
    """Set Acceleration in units of 0.25 µs / 10 ms / 80 ms; 0 is unlimited."""
    _check_channel(channel)
    _check("acceleration", units, 0, MAX_ACCELERATION)
    return framing.wrap(Opcode.SET_ACCELERATION, channel, *_split(units))


def get_position(channel: int, framing: Framing = COMPACT) -> bytes:
    """Get Position: answered with two bytes, see ``decode_position``."""
    _check_channel(channel)
    return framing.wrap(Opcode.GET_POSITION, channel)


def get_errors(framing: Framing = COMPACT) -> bytes:
    """Get Errors: answered with two bytes, see ``decode_errors``; clears the register."""
    return framing.wrap(Opcode.GET_ERRORS)


def decode_position(reply: bytes) -> float | None:
    """The transmitted pulse width [µs] of a Get Position reply; None when the pulses are off.

    Raises:
        BoardProtocolError: no reply that a Maestro can give.
    """
    quarters = _word("Get Position", reply)
    if quarters > MAX_TARGET:
        raise BoardProtocolError(
            f"the board answered a position of {quarters_to_us(quarters)} µs ({reply.hex(' ')}), "
            f"which no Maestro can transmit; the line garbles bytes or this is no Maestro"
        )
    return quarters_to_us(quarters) if quarters else None


def decode_errors(reply: bytes) -> MaestroErrors:
    """The error bits of a Get Errors reply.

    Raises:
        BoardProtocolError: no reply that a Maestro can give.
    """
    bits = _word("Get Errors", reply)
    if bits & ~ALL_ERRORS:
        raise BoardProtocolError(
            f"the board answered error bits 0x{bits:04x}, of which a Maestro knows only 0x{ALL_ERRORS:04x}; "
            "the line garbles bytes or this is no Maestro"
        )
    return MaestroErrors(bits)


def _set_run(run: Sequence[int], quarters: Mapping[int, int], framing: Framing) -> bytes:
    if len(run) == 1:
        return set_target(run[0], quarters[run[0]], framing)
    return set_multiple_targets(run[0], [quarters[channel] for channel in run], framing)


def _split(value: int) -> tuple[int, int]:
    """14 bits as two data bytes, low one first."""
    return value & _DATA_MASK, value >> 7


def _word(command: str, reply: bytes) -> int:
    """Two full bytes, low one first: replies, unlike commands, use all 8 bits."""
    if len(reply) != 2:
        raise BoardProtocolError(f"{command} was answered by {len(reply)} bytes, not by 2")
    return int.from_bytes(reply, "little")


def _check_channel(channel: int) -> None:
    _check("channel", channel, 0, MAX_CHANNEL)


def _check(what: str, value: int, lowest: int, highest: int) -> None:
    if not lowest <= value <= highest:
        raise InputError(f"{what} {value} is outside {lowest} … {highest}")


# The receiving side: single bytes to commands and errors, as the board takes them.

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
