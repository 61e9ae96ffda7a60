"""What comes out of the pins of a Mega with StandardFirmata when armctl drives it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random

import pytest
from tests.avr.conftest import MakeAvr
from tests.avr.firmata_rig import ALL_OVER, FRAME_S, HIGHEST_US, LOWEST_US, ONE_TIMER, FirmataRig
from tests.avr.mega import PINS

TOLERANCE_US = 4.0
ATTACHING = 8
"""frames within which the driver has switched twelve pins on, and each has sent a pulse"""
BUSY_US = 60.0
"""how much other interrupts (serial line, clock, three other servo timers) change a single pulse at most"""

MakeRig = Callable[[Sequence[int]], FirmataRig]


@pytest.fixture
def make_rig(make_avr: MakeAvr) -> MakeRig:
    return lambda pins: FirmataRig(make_avr("firmata"), pins)


@pytest.mark.parametrize(
    "pins",
    [ONE_TIMER, tuple(range(14, 26)), (38, 44, 49), *((pin,) for pin in ALL_OVER)],
    ids=lambda pins: f"pins {pins[0]} to {pins[-1]}",
)
def test_every_width_comes_out_of_every_pin(make_rig: MakeRig, pins: Sequence[int]) -> None:
    rig = make_rig(pins)
    span = HIGHEST_US - LOWEST_US
    widths = [*range(0, span, 59), span]
    for turn, width in enumerate(widths):
        wanted = {pin: LOWEST_US + (width + 311 * place) % (span + 1) for place, pin in enumerate(pins)}
        rig.stream(wanted, frames=ATTACHING if turn == 0 else 1)
        assert rig.settled_us() == pytest.approx(wanted, abs=TOLERANCE_US)


def test_pins_of_several_timers_disturb_each_other_by_microseconds_only(make_rig: MakeRig) -> None:
    """A timer waits while another one's interrupt switches its pins; the longer the more there are."""
    rig = make_rig(ALL_OVER)
    span = HIGHEST_US - LOWEST_US + 1
    rig.stream(dict.fromkeys(ALL_OVER, LOWEST_US), ATTACHING)
    for step in range(0, span, 59):
        wanted = {pin: LOWEST_US + (step + 311 * place) % span for place, pin in enumerate(ALL_OVER)}
        rig.stream(wanted, frames=3)
        for pulse in rig.stream(wanted, frames=3):
            assert pulse.width_us == pytest.approx(wanted[pulse.pin], abs=BUSY_US)


def test_the_first_pulse_after_the_board_s_start_is_right(make_rig: MakeRig) -> None:
    random = Random(1)
    for pins in (ALL_OVER, ONE_TIMER, (2, 3, 4, 5, 6, 7), (44,)):
        rig = make_rig(pins)
        rig.avr.run_for(random.uniform(0.0, 2 * FRAME_S))
        wanted = {pin: random.randint(LOWEST_US, HIGHEST_US) for pin in pins}
        pulses = rig.stream(wanted, ATTACHING)
        assert {pulse.pin for pulse in pulses} == set(pins)
        for pulse in pulses:
            assert pulse.width_us == pytest.approx(wanted[pulse.pin], abs=BUSY_US)


def test_release_ends_the_pulses_and_the_next_attach_goes_on_where_it_was(make_rig: MakeRig) -> None:
    random = Random(2)
    rig = make_rig(ONE_TIMER)
    wanted = {pin: random.randint(LOWEST_US, HIGHEST_US) for pin in rig.pins}
    for _ in range(40):
        # The library's frames go on after a release: attaching meets every phase of them.
        pulses = rig.stream(wanted, ATTACHING)
        assert {pulse.pin for pulse in pulses} == set(rig.pins)
        for pulse in pulses:
            assert pulse.width_us == pytest.approx(wanted[pulse.pin], abs=BUSY_US)
        rig.driver.release()
        rig.meter.take()
        assert rig.pulses_of(random.uniform(3, 5) * FRAME_S) == []
        assert [rig.avr.pin(PINS[pin]) for pin in rig.pins] == [0] * len(rig.pins)


def test_an_attach_with_another_width_hardly_ever_sends_the_old_one(make_rig: MakeRig) -> None:
    """The sketch attaches with what the pin had last, and a frame may begin before the new width is there.

    Nothing that a host can send rules that out; once, then, and for few pins in a hundred.
    """
    random = Random(3)
    rig = make_rig(ONE_TIMER)
    old: dict[int, int] = {}
    wrong = 0
    for _ in range(50):
        new = {pin: random.randint(LOWEST_US, HIGHEST_US) for pin in rig.pins}
        met: set[int] = set()
        for pulse in rig.stream(new, ATTACHING):
            if pulse.width_us != pytest.approx(new[pulse.pin], abs=BUSY_US):
                assert pulse.width_us == pytest.approx(old[pulse.pin], abs=BUSY_US)
                assert pulse.pin not in met
                met.add(pulse.pin)
        wrong += len(met)
        rig.driver.release()
        rig.avr.run_for(random.uniform(0.0, 2 * FRAME_S))
        old = new
    assert wrong / (50 * len(rig.pins)) <= 0.01


@pytest.mark.parametrize("pins", [(7,), ALL_OVER, ONE_TIMER], ids=["one", "all over", "twelve"])
def test_a_setpoint_is_on_its_pin_within_two_servo_frames(make_rig: MakeRig, pins: Sequence[int]) -> None:
    random = Random(4)
    rig = make_rig(pins)
    rig.stream(dict.fromkeys(pins, 800), ATTACHING)
    for turn in range(40):
        width = (1500, 800)[turn % 2]  # twelve longer ones would not fit into a frame
        rig.avr.run_for(random.uniform(1.0, 2.0) * FRAME_S)
        rig.meter.take()
        sent_at = rig.avr.now
        rig.driver.write(dict.fromkeys(pins, width))
        first: dict[int, float] = {}
        for pulse in rig.pulses_of(3 * FRAME_S):
            if pulse.width_us == pytest.approx(width, abs=BUSY_US):
                first.setdefault(pulse.pin, pulse.start_s - sent_at)
        assert set(first) == set(pins)
        assert max(first.values()) <= 2 * FRAME_S


def test_a_stop_and_a_closed_line_leave_the_pulses_as_they_are(make_rig: MakeRig) -> None:
    rig = make_rig((2, 44))
    rig.stream({2: 700, 44: 2300}, ATTACHING)
    rig.driver.stop()
    assert rig.settled_us() == pytest.approx({2: 700, 44: 2300}, abs=TOLERANCE_US)
    rig.driver.close()
    assert rig.settled_us() == pytest.approx({2: 700, 44: 2300}, abs=TOLERANCE_US)
