"""Who answers on an I²C bus, and the check-up of a PCA9685. Neither changes a register."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from armctl.errors import BoardError, BoardTimeoutError
from armctl.facts.english_commands import numbered
from armctl.hardware.board_type import (
    ChannelsToCheck,
    CheckUp,
    Finding,
    Introduction,
    failed,
    not_checked,
    ok,
    round_trips,
    warning,
)
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.pca9685 import Pca9685Options, channel_table
from armctl.hardware.pca9685.chip import (
    ArduinoLine,
    ChipLine,
    I2cLine,
    fetch,
    identify,
    open_chip,
    who_answers,
)
from armctl.hardware.pca9685.i2c import bus_and_address, is_bus
from armctl.hardware.pca9685.registers import (
    BYTES,
    INVERTED,
    ChipRegister,
    Mode1,
    decode,
    is_high,
    period_us,
    prescale,
    register_of,
    step_us,
)
from armctl.hardware.transport import Transport

_ANSWER_S = 0.25
_ASSUMED_MHZ = Pca9685Options().oscillator_mhz


def introduce(line: Transport, now: Callable[[], float]) -> Introduction | None:
    """The PCA9685 at the address of an I²C bus, or the first on the bus. None: there is none, or no bus."""
    if not is_bus(line.name):
        return None
    chip = I2cLine(line, Pca9685Options().address, _ANSWER_S)
    _, named = bus_and_address(line.name)
    there = who_answers(chip, _ANSWER_S) if named is None else [named]
    details = (f"on this bus answer {', '.join(f'{one:#x}' for one in there)}",) * (len(there) > 1)
    for chip.address in there[:1]:
        try:
            identify(chip, _ANSWER_S)
        except BoardTimeoutError:
            return None
        return Introduction(f"PCA9685 at {chip.address:#x}", details=details)
    return None


def examine_pca9685(check_up: CheckUp, options: Pca9685Options) -> list[Finding]:
    """The findings of ``BoardType.examine``."""
    line = open_chip(check_up.line, options.address, check_up.now, _ANSWER_S, 0.0)
    found = identify(line, _ANSWER_S)
    mode = Mode1(found[ChipRegister.MODE1])
    asleep = bool(mode & Mode1.SLEEP)
    state = "asleep, as after power-up: all pulses are off" if asleep else "awake"
    findings = [ok("chip", f"a PCA9685 answers at {line.address:#x}; {state}")]
    if isinstance(line, ArduinoLine):
        findings.insert(0, ok("firmware", f"{line.firmware.name} carries I²C"))
    if found[ChipRegister.MODE2] & INVERTED:
        what = "its outputs are inverted: a servo gets gaps for pulses"
        findings.append(warning("outputs", what, "armctl sets that right while all channels are off"))
    return [
        *findings,
        _frequency(found[ChipRegister.PRE_SCALE], asleep, options),
        _clock(mode, options),
        *_channels(line, mode, found[ChipRegister.PRE_SCALE], check_up.needs, options),
        warning(
            "watchdog",
            "a PCA9685 has none: if this computer or the cable fails, it goes on sending the last pulses",
            "have a switch for the servos' supply, or for the chip's pin /OE, within reach",
        ),
        round_trips(lambda: fetch(line, ChipRegister.MODE1, 1, _ANSWER_S), check_up.now),
        not_checked(
            "supply",
            "a PCA9685 does not tell its servos' voltage",
            "feed the servos through the board's V+ terminals from a supply of their own, strong enough for "
            "all of them at once; V+ never comes from the Raspberry Pi's or the Arduino's 5 V pin",
        ),
    ]


def _frequency(had: int, asleep: bool, options: Pca9685Options) -> Finding:
    wanted = prescale(options)
    hz = 1e6 / (4096 * step_us(had, options.oscillator_mhz))
    if had == wanted or asleep:
        return ok("frequency", f"{options.frequency_hz:g} pulses a second, set when armctl connects")
    return warning(
        "frequency",
        f"another program has set {hz:.0f} pulses a second, the robot file wants {options.frequency_hz:g}",
        "armctl sets it once all channels are off; close the other program",
    )


def _clock(mode: Mode1, options: Pca9685Options) -> Finding:
    if mode & Mode1.EXTCLK:
        return warning(
            "clock",
            "the chip runs on an external clock, until its power is cut",
            "cut its power, or say that clock as oscillator_mhz in [board]",
        )
    if options.oscillator_mhz != _ASSUMED_MHZ:
        return ok("clock", f"{options.oscillator_mhz:g} MHz, as the robot file says")
    return not_checked(
        "clock",
        f"taken as {_ASSUMED_MHZ:g} MHz; it is off by several percent on most chips, and so is every pulse",
        "measure one pulse, and say oscillator_mhz in [board]: docs/boards/pca9685.md",
    )


def _channels(
    line: ChipLine, mode: Mode1, had: int, needs: ChannelsToCheck, options: Pca9685Options
) -> list[Finding]:
    """Whether the chip can send what the robot file wants, and what it sends now."""
    if not needs.channels:
        return [needs.not_known("channels")]
    if problems := _problems(needs.channels, options):
        return [failed("channels", "; ".join(problems), "change the channels or ranges in the robot file")]
    channels = sorted(one.channel for one in needs.channels)
    findings = [
        ok("channels", f"{numbered('channel', channels)}: the chip has them"),
        ok("ranges", "the robot file's ranges can be sent"),
    ]
    # One by one: the chip may not count its registers up.
    held = {
        channel: bytes(
            fetch(line, register, 1, _ANSWER_S)[0]
            for register in range(register_of(channel), register_of(channel) + BYTES)
        )
        for channel in channels
    }
    high = [channel for channel, registers in held.items() if is_high(registers)]
    if high and not mode & Mode1.SLEEP:
        seen = f"{numbered('channel', high)} high all the time, which is no pulse for a servo"
        findings.append(
            warning("outputs", seen, "another program did that; Release in armctl switches them off")
        )
    size_us = step_us(had, options.oscillator_mhz)
    pulses = {channel: decode(registers) for channel, registers in held.items()}
    on = ", ".join(f"{channel} at {steps * size_us:.0f} µs" for channel, steps in pulses.items() if steps)
    awake = on and not mode & Mode1.SLEEP
    findings.append(ok("outputs", f"on: {on}" if awake else "all pulses are off"))
    return findings


def _problems(channels: Sequence[ChannelSettings], options: Pca9685Options) -> list[str]:
    problems: list[str] = []
    for one in channels:
        try:
            channel_table([one], period_us(options))
        except BoardError as error:
            problems.append(str(error))
    return problems
