"""Maestro commands to bytes and replies to values (Pololu guide 0J40, sections 5.c to 5.e).

Pure functions. Targets are quarter µs, speeds and accelerations the board's units (see ``units``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

from armctl.errors import BoardProtocolError, InputError
from armctl.hardware.maestro.error_register import ALL_ERRORS, MaestroErrors
from armctl.hardware.maestro.units import MAX_ACCELERATION, MAX_SPEED, MAX_TARGET, quarters_to_us

POLOLU_START = 0xAA
DEFAULT_DEVICE_NUMBER = 12
MAX_CHANNEL = 23  # the largest board has 24

POSITION_REPLY_LENGTH = 2
ERRORS_REPLY_LENGTH = 2

_CRC_POLYNOMIAL = 0x91
_MINI_SSC_LARGEST = 254
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


def get_moving_state(framing: Framing = COMPACT) -> bytes:
    """Get Moving State: answered with one byte. A Micro may say 0 while it moves."""
    return framing.wrap(Opcode.GET_MOVING_STATE)


def get_errors(framing: Framing = COMPACT) -> bytes:
    """Get Errors: answered with two bytes, see ``decode_errors``; clears the register."""
    return framing.wrap(Opcode.GET_ERRORS)


def go_home(framing: Framing = COMPACT) -> bytes:
    """Go Home: every channel to what it does on an error (off, nothing, or its home)."""
    return framing.wrap(Opcode.GO_HOME)


def mini_ssc(servo: int, value: int) -> bytes:
    """Mini SSC: an 8-bit target, 127 is neutral. Its data bytes use all 8 bits and never carry a CRC."""
    _check("Mini SSC servo number", servo, 0, _MINI_SSC_LARGEST)
    _check("Mini SSC value", value, 0, _MINI_SSC_LARGEST)
    return bytes((Opcode.MINI_SSC, servo, value))


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


def decode_moving_state(reply: bytes) -> bool:
    """Whether any channel still moves to its target.

    Raises:
        BoardProtocolError: no reply that a Maestro can give.
    """
    if reply not in (b"\x00", b"\x01"):
        raise BoardProtocolError(
            f"Get Moving State was answered by {reply.hex(' ') or 'nothing'}, not by 00 or 01"
        )
    return reply == b"\x01"


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
