"""Two minutes of setpoints into a Mega with StandardFirmata, every pulse checked."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict

import pytest
from tests.avr.conftest import MakeAvr
from tests.avr.firmata_rig import FRAME_S, FirmataRig

PINS = (2, 3, 4, 5, 6, 7)
MINUTES = 2
START_FRAMES = 8

WIDTHS_US = range(800, 2300, 100)
"""far enough apart for a pulse to say which setpoint it is of, whatever interrupt disturbed it"""
WRITE_S = 6 * 11 * 272 / 16e6
"""a write of one pin on simavr's line: six bytes of eleven bits of 272 clock cycles (57600 baud)"""
DOUBT_S = (0.0, 0.5e-3)
"""when the sketch has obeyed a write, at the earliest and at the latest after its last byte"""


def width_us(number: int, pin: int) -> int:
    """The setpoint of a pin in the write of a given number: a new one every time."""
    return WIDTHS_US[(7 * number + pin) % len(WIDTHS_US)]


@pytest.mark.slow
def test_minutes_without_a_lost_or_an_extra_write(make_avr: MakeAvr) -> None:
    rig = FirmataRig(make_avr("firmata"), PINS)
    avr = rig.avr
    rig.stream({pin: width_us(0, pin) for pin in PINS}, START_FRAMES)
    written_at = [0.0]
    seen: dict[int, list[tuple[float, int]]] = defaultdict(list)
    next_cycle = avr.cycle
    for number in range(1, round(MINUTES * 60 / FRAME_S)):
        written_at.append(avr.now)
        rig.driver.write({pin: width_us(number, pin) for pin in PINS})
        assert rig.driver.read().errors == ()
        next_cycle += avr.cycles(FRAME_S)
        avr.run_until(next_cycle)
        for pulse in rig.meter.take():
            seen[pulse.pin].append((pulse.start_s, number_of(pulse.width_us, pulse.pin, number)))
    assert sorted(seen) == list(PINS)
    for place, pin in enumerate(PINS):
        check(seen[pin], [at + (place + 1) * WRITE_S for at in written_at])


def number_of(width: float, pin: int, latest: int) -> int:
    """The number of the write that a pulse is of: the last one with its width."""
    for number in range(latest, latest - len(WIDTHS_US), -1):
        if abs(width - width_us(number, pin)) < 50.0:
            return number
    raise AssertionError(f"pin {pin}: a pulse of {width:.1f} µs, which was never written")


def check(pulses: list[tuple[float, int]], arrived_at: list[float]) -> None:
    """Every pulse is of the write that had arrived last when it began: none lost, none invented."""
    doubtful = 0
    for start_s, number in pulses:
        newest, certain = (bisect_right(arrived_at, start_s - doubt) - 1 for doubt in DOUBT_S)
        assert certain <= number <= newest, f"at {start_s:.4f} s: {number}, not {certain} … {newest}"
        doubtful += newest != certain
    assert len(pulses) > 0.97 * len(arrived_at)
    assert doubtful < 0.2 * len(pulses)
