"""The chip's registers, and pulses as they stand in them (data sheet, section 7.3)."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum, IntFlag

from armctl.errors import BoardProtocolError
from armctl.hardware.pca9685 import CHANNELS, STEPS, Pca9685Options
from armctl.lazy_dataclass import dataclass

BYTES = 4
"""of a channel's registers: on and off, low byte first"""
_FULL = 0x10
"""bit of the high byte of *on* and of *off*: all the time, whatever the rest says"""
SMALLEST_PRESCALE, LARGEST_PRESCALE = 3, 255


class ChipRegister(IntEnum):
    """Where things stand."""

    MODE1 = 0x00
    MODE2 = 0x01
    SUBADR1 = 0x02
    SUBADR2 = 0x03
    SUBADR3 = 0x04
    ALLCALLADR = 0x05
    LED0 = 0x06
    ALL_LED = 0xFA
    PRE_SCALE = 0xFE


class Mode1(IntFlag):
    """Bits of MODE1; after power-up SLEEP and ALLCALL are set."""

    RESTART = 0x80
    """reads 1 where the chip went to sleep with pulses on; writing 1 brings them back"""
    EXTCLK = 0x40
    AUTO_INCREMENT = 0x20
    SLEEP = 0x10
    SUB1 = 0x08
    SUB2 = 0x04
    SUB3 = 0x02
    ALLCALL = 0x01


RUNNING = Mode1.AUTO_INCREMENT
"""MODE1 as armctl sets it: awake, and deaf for the addresses of several chips"""
ASLEEP = Mode1.AUTO_INCREMENT | Mode1.SLEEP
TOTEM_POLE = 0x04
"""MODE2 as after power-up: outputs are driven both ways, not inverted, and change at the end of a transfer"""
INVERTED = 0x10
"""bit of MODE2"""
FULL_OFF = bytes((0, 0, 0, _FULL))


def register_of(channel: int) -> int:
    """The first of a channel's four registers."""
    return ChipRegister.LED0 + BYTES * channel


def prescale(options: Pca9685Options) -> int:
    """What PRE_SCALE has to hold (section 7.3.5, eq. 1): round(clock / (4096 · frequency)) - 1."""
    wanted = round(1e6 * options.oscillator_mhz / (STEPS * options.frequency_hz)) - 1
    return min(LARGEST_PRESCALE, max(SMALLEST_PRESCALE, wanted))


def step_us(prescaled: int, oscillator_mhz: float) -> float:
    """The length of one step of a pulse [µs]."""
    return (prescaled + 1) / oscillator_mhz


def period_us(options: Pca9685Options) -> float:
    """The time from pulse to pulse [µs]."""
    return STEPS * step_us(prescale(options), options.oscillator_mhz)


def pulse(steps: int) -> bytes:
    """A pulse of so many steps from the start of the period; both ends in one transfer, or it may be cut."""
    return bytes((0, 0, steps & 0xFF, steps >> 8))


def decode(registers: bytes) -> int | None:
    """The steps of the pulse that a channel's four registers stand for; None: no pulse.

    An output that is high all the time is no pulse either.
    """
    on, off = registers[0] | registers[1] << 8, registers[2] | registers[3] << 8
    if off >> 8 & _FULL or on >> 8 & _FULL:
        return None
    return (off - on) % STEPS or None


def is_high(registers: bytes) -> bool:
    """Whether a channel is high all the time: a servo may go to its end for that."""
    return bool(registers[1] & _FULL) and not registers[3] & _FULL


@dataclass(frozen=True, slots=True)
class RegisterBlock:
    """Registers that are carried together."""

    register: int
    count: int

    @property
    def channels(self) -> range:
        """Those whose pulses they hold."""
        first = (self.register - ChipRegister.LED0) // BYTES
        return range(first, first + self.count // BYTES)


def blocks(channels: tuple[int, ...], most: int) -> list[RegisterBlock]:
    """What to read for the pulses of ``channels``, from the first to the last, ``most`` bytes at once."""
    if not channels:
        return []
    size = most // BYTES
    return [
        RegisterBlock(register_of(first), BYTES * min(size, channels[-1] + 1 - first))
        for first in range(channels[0], channels[-1] + 1, size)
    ]


def transfers(pulses: Mapping[int, bytes], most: int) -> list[tuple[int, bytes]]:
    """Registers by channel as (first register, bytes), neighbours together, ``most`` bytes at once."""
    runs: list[tuple[int, bytes]] = []
    before = -2
    for channel in sorted(pulses):
        if channel == before + 1 and len(runs[-1][1]) + BYTES <= most:
            runs[-1] = (runs[-1][0], runs[-1][1] + pulses[channel])
        else:
            runs.append((register_of(channel), pulses[channel]))
        before = channel
    return runs


def check_chip(where: str, found: Mapping[int, int]) -> None:
    """Refuse what cannot be a PCA9685 (``BoardProtocolError``): ``found`` by register, read one by one.

    Bits that can only read 0 are looked at; other chips answer at these addresses, too.
    """
    impossible = (
        found[ChipRegister.MODE2] & 0xE0
        or any(found[one] & 1 for one in range(ChipRegister.SUBADR1, ChipRegister.ALLCALLADR + 1))
        or found[ChipRegister.PRE_SCALE] < SMALLEST_PRESCALE
    )
    if impossible:
        seen = " ".join(f"{register:02x}={value:02x}" for register, value in found.items())
        raise BoardProtocolError(
            f"{where}: what answers is no PCA9685 (registers {seen}); is it another chip, such as a current "
            "sensor? Give the board another address with its solder bridges, and say it in the port"
        )


IDENTIFYING = (*range(ChipRegister.MODE1, ChipRegister.ALLCALLADR + 1), ChipRegister.PRE_SCALE)
"""what ``check_chip`` looks at"""
ALL_BLOCK = RegisterBlock(ChipRegister.LED0, BYTES * CHANNELS)
