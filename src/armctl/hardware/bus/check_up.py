"""The check-up of a servo bus: who answers, what stands in the way, and how long answers take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from armctl.errors import BoardTimeoutError
from armctl.facts.english_commands import numbered
from armctl.hardware.access import latency_timer_ms
from armctl.hardware.board_type import CheckUp, Finding, failed, ok, round_trips, warning
from armctl.hardware.bus import EEPROM_ADVICE
from armctl.hardware.bus.line import BusLine
from armctl.hardware.bus.make import ServoMake
from armctl.hardware.bus.who import missing_words, nobody_words
from armctl.hardware.driver import ChannelSettings

_LONG_WAIT_MS = 1.0
"""that servos may wait before their answers, all together"""


def examine_bus(make: ServoMake, check_up: CheckUp, timeout_s: float, baud: int) -> list[Finding]:
    """The findings of ``BoardType.examine``; reads only."""
    line = BusLine(check_up.line, make.form, check_up.now, timeout_s, baud)
    needs = check_up.needs
    first = needs.channels[0].channel if needs.channels else 1
    came = line.look_for_echo(first, make.table["model"].address)
    findings = [*_latency(line.name)]
    if line.echoes:
        findings.append(ok("echo", "the adapter sends back what it is sent; armctl drops that"))
    if not needs.channels:
        return [*findings, needs.not_known("channels")]
    found = [one for one in needs.channels if line.ping(one.channel) is not None]
    if not found:
        ids = [one.channel for one in needs.channels]
        return [*findings, failed("channels", nobody_words(line, ids, came=came))]
    ids = [one.channel for one in found]
    return [
        *findings,
        *_channels(needs.channels, ids),
        *_settings(make, line, found),
        _errors(make, line, ids),
        *_eeprom(make, line, ids),
        *_delays(make, line, ids),
        _watchdog(make),
        round_trips(lambda: _all_answer(make, line, ids), check_up.now),
    ]


def _latency(port: str) -> Iterator[Finding]:
    """Whether an FTDI adapter holds answers back."""
    held_ms = latency_timer_ms(port)
    if held_ms is None:
        return
    if held_ms <= 1:
        yield ok("latency timer", "1 ms: the adapter passes answers on at once")
        return
    yield warning(
        "latency timer",
        f"{held_ms} ms: the adapter holds each answer back for so long, though armctl asked it not to",
        f"write 1 into /sys/bus/usb-serial/devices/{port.rpartition('/')[2]}/latency_timer, as administrator",
    )


def _channels(wanted: Sequence[ChannelSettings], found: Sequence[int]) -> list[Finding]:
    if missing := missing_words([one.channel for one in wanted], found):
        return [failed("channels", words) for words in missing]
    return [ok("channels", f"{numbered('servo', found)}: all answer")]


def _settings(make: ServoMake, line: BusLine, found: Sequence[ChannelSettings]) -> Iterator[Finding]:
    """What their EEPROMs hold that is in the way, or unusual."""
    told = 0
    for needs in found:
        servo, own = needs.channel, make.settings(line, needs.channel)
        cut_off = needs.minimum < own.lowest or needs.maximum > own.highest
        if own.unfit is not None:
            yield failed("settings", f"servo {servo}: {own.unfit}", EEPROM_ADVICE)
        elif cut_off:
            limits = f"its limits {own.lowest} … {own.highest} cut off a part of the robot file's"
            yield warning("settings", f"servo {servo}: {limits}", EEPROM_ADVICE)
        for words in own.findings:
            yield warning("settings", f"servo {servo}: {words}")
        told += own.unfit is not None or cut_off or bool(own.findings)
    if not told:
        yield ok("settings", "mode, limits and status level are as the arm needs them")


def _errors(make: ServoMake, line: BusLine, ids: Sequence[int]) -> Finding:
    blocks = (make.telemetry, *make.in_turn)
    wrong: list[str] = []
    for servo in ids:
        for block in blocks:
            seen = make.understood(line.read(servo, block.address, block.size), block)
            wrong += (f"servo {servo}: {words}" for words in seen.wrong)
            if seen.gave_way:
                wrong.append(f"servo {servo}: overload")
    return warning("error register", "; ".join(wrong)) if wrong else ok("error register", "no servo has one")


def _eeprom(make: ServoMake, line: BusLine, ids: Sequence[int]) -> Iterator[Finding]:
    if "lock" not in make.table or not make.wakes_locked:
        return
    lock = make.table["lock"]
    unlocked = [one for one in ids if line.read(one, lock.address, lock.size, more=True).data == b"\0"]
    if not unlocked:
        yield ok("EEPROM lock", "all are locked")
        return
    yield warning(
        "EEPROM lock",
        f"that of {numbered('servo', unlocked)} is open: what is written there by mistake stays",
        "some programs leave it so; a cut of the servos' power, or any setting that armctl writes, locks it",
    )


def _delays(make: ServoMake, line: BusLine, ids: Sequence[int]) -> Iterator[Finding]:
    """How long servos wait by their own settings before they answer."""
    if make.delay_register is None:
        return
    register = make.table[make.delay_register]
    waits_ms = {
        servo: make.table.value(register.name, line.read(servo, register.address, register.size).data) / 1000
        for servo in ids
    }
    total_ms = sum(waits_ms.values())
    seen = f"servos wait {total_ms:.2g} ms in all before they answer, at each reading"
    if total_ms <= _LONG_WAIT_MS:
        yield ok("return delay", seen)
        return
    slow = [servo for servo, wait_ms in waits_ms.items() if wait_ms > 0.0]
    yield warning(
        "return delay",
        seen,
        f"write 0 as {register.name} of {numbered('servo', slow)}: `armctl servos … write {slow[0]} "
        f"{register.name} 0`",
    )


def _watchdog(make: ServoMake) -> Finding:
    if make.watchdog_ms is None:
        return warning(
            "watchdog",
            "these servos have none: if this computer or the cable fails, they hold their last goal",
            "have a switch for the servos' supply within reach",
        )
    return ok("watchdog", f"set to {make.watchdog_ms / 1000:g} s whenever torque is switched on")


def _all_answer(make: ServoMake, line: BusLine, ids: Sequence[int]) -> None:
    block = make.telemetry
    silent = set(ids) - set(line.read_all(ids, block.address, block.size))
    if silent:
        raise BoardTimeoutError(f"{numbered('servo', sorted(silent))} did not answer")
