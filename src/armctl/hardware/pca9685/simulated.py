"""A simulated PCA9685, on a bus of its own and behind a simulated Arduino."""

from __future__ import annotations

from collections.abc import Iterable

from armctl.errors import InputError
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.pca9685 import ALL_CHIPS, CHANNELS, LOWEST_ADDRESS
from armctl.hardware.pca9685.i2c import carried_out
from armctl.hardware.pca9685.registers import (
    ALL_BLOCK,
    BYTES,
    FULL_OFF,
    INVERTED,
    TOTEM_POLE,
    ChipRegister,
    Mode1,
    decode,
    register_of,
    step_us,
)

_REGISTERS = 256
_SUBADDRESSES = (0xE2, 0xE4, 0xE8, 0xE0)
_PRESCALE = 0x1E  # 200 Hz
_LAST_OF_CHANNELS = ALL_BLOCK.register + ALL_BLOCK.count - 1


class SimulatedPca9685:
    """The chip's registers and what its outputs do; its clock runs at ``oscillator_mhz``, as it may be built.

    Pulses change at the end of a transfer (MODE2 as armctl sets it). ``transfers`` keeps what was written, as
    (register, bytes). A chip without power acknowledges nothing.
    """

    def __init__(self, address: int = LOWEST_ADDRESS, oscillator_mhz: float = 25.0) -> None:
        self.address, self._oscillator_mhz = address, oscillator_mhz
        self.powered = True
        self.transfers: list[tuple[int, bytes]] = []
        self.power_up()

    def power_up(self) -> None:
        """Start anew, as after a power cut: asleep, every output off."""
        self._registers = bytearray(_REGISTERS)
        self._registers[ChipRegister.MODE1] = Mode1.SLEEP | Mode1.ALLCALL
        self._registers[ChipRegister.MODE2] = TOTEM_POLE
        self._registers[ChipRegister.SUBADR1 : ChipRegister.ALLCALLADR + 1] = bytes(_SUBADDRESSES)
        self._registers[ChipRegister.PRE_SCALE] = _PRESCALE
        for channel in range(CHANNELS):
            self._set(register_of(channel), FULL_OFF)
        self._pointer = 0

    def transfer(self, data: bytes, count: int) -> bytes:
        """Take what is written, the register first, and give what is read from where the pointer stands."""
        if data:
            self._pointer = data[0]
        if len(data) > 1:
            self.transfers.append((data[0], data[1:]))
            for value in data[1:]:
                self._write(self._pointer, value)
                self._next()
        read = bytearray()
        for _ in range(count):
            # The registers of all channels at once can only be written.
            written_only = ChipRegister.ALL_LED <= self._pointer < ChipRegister.ALL_LED + BYTES
            read.append(0 if written_only else self._registers[self._pointer])
            self._next()
        return bytes(read)

    @property
    def mode(self) -> Mode1:
        """MODE1."""
        return Mode1(self._registers[ChipRegister.MODE1])

    @property
    def listens_to_all(self) -> bool:
        """Whether it answers at the address of all chips."""
        return bool(self.mode & Mode1.ALLCALL)

    @property
    def frequency_hz(self) -> float:
        """Pulses a second, by its own clock."""
        return 1e6 / (4096 * step_us(self._registers[ChipRegister.PRE_SCALE], self._oscillator_mhz))

    def pulse_us(self, channel: int) -> float | None:
        """The true width [µs] of the pulses of a channel; None: there are none."""
        if not 0 <= channel < CHANNELS:
            raise InputError(f"channel {channel}: a PCA9685 has channels 0 … {CHANNELS - 1}")
        steps = self._steps(channel)
        runs = (
            self.powered
            and not self.mode & Mode1.SLEEP
            and not self._registers[ChipRegister.MODE2] & INVERTED
        )
        if steps is None or not runs:
            return None
        return steps * step_us(self._registers[ChipRegister.PRE_SCALE], self._oscillator_mhz)

    def _write(self, register: int, value: int) -> None:
        if register == ChipRegister.MODE1:
            self._write_mode(Mode1(value))
        elif register == ChipRegister.MODE2:
            self._registers[register] = value & 0x1F
        elif register == ChipRegister.PRE_SCALE:
            if self.mode & Mode1.SLEEP:  # writes are blocked while it runs
                self._registers[register] = max(3, value)
        elif ChipRegister.SUBADR1 <= register <= ChipRegister.ALLCALLADR:
            self._registers[register] = value & 0xFE
        elif ChipRegister.ALL_LED <= register < ChipRegister.ALL_LED + BYTES:
            for channel in range(CHANNELS):
                self._write(register_of(channel) + register - ChipRegister.ALL_LED, value)
        elif ChipRegister.LED0 <= register <= _LAST_OF_CHANNELS:
            high = (register - ChipRegister.LED0) % 2
            self._registers[register] = value & 0x1F if high else value
            self._registers[ChipRegister.MODE1] &= ~Mode1.RESTART

    def _write_mode(self, wanted: Mode1) -> None:
        before = self.mode
        kept = before & (Mode1.EXTCLK | Mode1.RESTART)
        if wanted & Mode1.RESTART and not before & Mode1.SLEEP:
            kept &= ~Mode1.RESTART
        if wanted & Mode1.SLEEP and not before & Mode1.SLEEP and self._any_on():
            kept |= Mode1.RESTART
        self._registers[ChipRegister.MODE1] = (wanted & ~Mode1.RESTART) | kept

    def _any_on(self) -> bool:
        return any(self._steps(channel) is not None for channel in range(CHANNELS))

    def _set(self, register: int, data: bytes) -> None:
        self._registers[register : register + len(data)] = data

    def _steps(self, channel: int) -> int | None:
        start = register_of(channel)
        return decode(bytes(self._registers[start : start + BYTES]))

    def _next(self) -> None:
        """Count the pointer up, where that is switched on."""
        if not self.mode & Mode1.AUTO_INCREMENT:
            return
        ends = self._pointer in (_LAST_OF_CHANNELS, ChipRegister.PRE_SCALE)
        self._pointer = 0 if ends else (self._pointer + 1) % _REGISTERS


class SimulatedI2cBus:
    """An I²C bus with chips on it; as a byte model it takes transfers as ``i2c`` writes them."""

    def __init__(self, chips: Iterable[SimulatedPca9685]) -> None:
        self.chips = tuple(chips)
        self.works = True
        """False: a wire is off, and nobody acknowledges"""

    def transfer(self, address: int, data: bytes, count: int) -> bytes | None:
        """Carry out one transfer; None: nobody acknowledges."""
        there = [
            one
            for one in self.chips
            if self.works
            and one.powered
            and (one.address == address or (address == ALL_CHIPS and one.listens_to_all))
        ]
        answers = [one.transfer(data, count) for one in there]
        return answers[0] if answers else None

    def feed(self, data: bytes) -> bytes:
        """Carry out transfers."""
        return b"".join(carried_out(data, self.transfer))

    def advance(self, now: float) -> bytes:
        """A bus says nothing unasked."""
        return b""

    def reset(self) -> None:
        """Cut the power of every chip."""
        for chip in self.chips:
            chip.power_up()


class SimulatedPca9685Board:
    """A PCA9685 behind an Arduino with StandardFirmata, which feeds it: one power cut hits both."""

    def __init__(self, chip: SimulatedPca9685, boot_s: float = 0.0) -> None:
        self.chip = chip
        self.bus = SimulatedI2cBus([chip])
        self.arduino = SimulatedFirmata(boot_s, i2c=self.bus.transfer)

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host and return what the sketch answers."""
        return self.arduino.feed(data)

    def advance(self, now: float) -> bytes:
        """Let time pass; the sketch reports itself once it has started."""
        return self.arduino.advance(now)

    def reset(self) -> None:
        """Cut the power."""
        self.bus.reset()
        self.arduino.reset()
