"""armctl's Firmata driver on a Mega with the image that others built: every pulse on its pins."""

from __future__ import annotations

import os
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from random import Random

import pytest
from tests.avr.avr import Avr, AvrError
from tests.avr.conftest import MakeAvr
from tests.avr.mega import PINS, Pulse, PulseMeter
from tests.avr.serve import OwnTime, stepped_line
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardError, BoardTimeoutError
from armctl.hardware.driver import ChannelSettings, Source
from armctl.hardware.faults import FaultyModel, trouble
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.transport import Connection

FRAME_S = 0.020
"""what the Servo library takes from one pulse on a pin to the next"""
LOWEST_US, HIGHEST_US = 544, 2400

ONE_TIMER = tuple(range(2, 14))
"""pins whose pulses the library makes with one timer; with 14, 26 and 38 begin the next dozens"""
ALL_OVER = (2, 5, 13, 14, 22, 44, 49)
"""pins below and above 15, of three of the four timers"""


class FirmataRig:
    """The driver, connected and configured, and the meter on its pins; all in simulated time."""

    def __init__(self, avr: Avr, pins: Sequence[int]) -> None:
        self.avr = avr
        self.pins = tuple(pins)
        self.driver = FirmataDriver(Connection(stepped_line(avr), lambda: avr.now))
        self.identity = self.driver.open()
        self.driver.configure([ChannelSettings(pin, LOWEST_US, HIGHEST_US) for pin in pins])
        self.meter = PulseMeter(avr, self.pins)

    def stream(self, setpoints: Mapping[int, int], frames: int) -> list[Pulse]:
        """Write and read as the runtime does, every 20 ms, and return the pulses that ended meanwhile.

        (The driver switches pins on a few at a time.)
        """
        self.meter.take()
        for _ in range(frames):
            self.driver.write(setpoints)
            readback = self.driver.read()
            assert readback.errors == ()
            self.avr.run_for(FRAME_S)
        return self.meter.take()

    def pulses_of(self, seconds: float) -> list[Pulse]:
        """Let time pass and return the pulses that ended in it."""
        self.meter.take()
        self.avr.run_for(seconds)
        return self.meter.take()

    def settled_us(self, frames: int = 5) -> dict[int, float]:
        """The median width of the next pulses on each pin, with nothing under way on the line.

        (A single pulse is longer or shorter by as long as the CPU is busy with another interrupt.)
        """
        self.avr.run_for(2 * FRAME_S)
        widths: dict[int, list[float]] = {pin: [] for pin in self.pins}
        for pulse in self.pulses_of(frames * FRAME_S):
            widths[pulse.pin].append(pulse.width_us)
        return {pin: sorted(seen)[len(seen) // 2] for pin, seen in widths.items() if seen}


# The driver, and boards that are not what it hopes for.


def driver_of(avr: Avr) -> FirmataDriver:
    return FirmataDriver(Connection(stepped_line(avr), lambda: avr.now))


def test_the_sketch_is_recognised_when_it_has_long_been_running(make_avr: MakeAvr) -> None:
    avr = make_avr("firmata")
    avr.run_for(5.0)
    avr.read()
    assert driver_of(avr).open().kind == "Arduino with StandardFirmata 2.3"


def test_positions_read_back_are_the_commanded_ones(make_avr: MakeAvr) -> None:
    rig = FirmataRig(make_avr("firmata"), (2, 44))
    assert rig.driver.read().positions == {2: None, 44: None}
    rig.stream({2: 1234, 44: 2345}, frames=20)
    readback = rig.driver.read()
    assert readback.positions == {2: 1234, 44: 2345}
    assert readback.source is Source.COMMANDED


def test_release_between_questions_leaves_none_unanswered(make_avr: MakeAvr) -> None:
    rig = FirmataRig(make_avr("firmata"), (2, 5, 13, 14))
    for _ in range(10):
        rig.stream(dict.fromkeys(rig.pins, 1000), frames=5)
        rig.driver.release()
    rig.avr.run_for(1.0)
    assert rig.driver.read().positions == dict.fromkeys(rig.pins)


def test_configuring_anew_takes_no_earlier_answer_for_its_own(make_avr: MakeAvr) -> None:
    """The runtime configures again after a reading that failed, while the arm moves."""
    pins = (2, 3, 4, 5, 6, 7)
    rig = FirmataRig(make_avr("firmata"), pins)
    rig.stream(dict.fromkeys(pins, 1000), frames=10)
    for turn in range(20):
        rig.stream(dict.fromkeys(pins, 1000 + turn), frames=2)
        assert rig.driver.read().errors == ()  # which asks, and what it asks is not answered yet
        rig.driver.configure([ChannelSettings(pin, LOWEST_US, HIGHEST_US) for pin in pins])
        rig.avr.run_for(0.001 * turn)
        rig.stream(dict.fromkeys(pins, 1500 + turn), frames=2)
    assert rig.settled_us() == pytest.approx(dict.fromkeys(pins, 1519), abs=4)


def test_the_reset_button_is_noticed(make_avr: MakeAvr) -> None:
    rig = FirmataRig(make_avr("firmata"), (2, 44))
    rig.stream({2: 1000, 44: 2000}, frames=5)
    rig.avr.reset()
    rig.avr.run_for(2.0)
    with pytest.raises(BoardError, match="restarted"):
        rig.driver.read()
    with pytest.raises(BoardError, match="connect again"):
        rig.driver.write({2: 1001})
    assert rig.pulses_of(0.2) == []


@pytest.mark.parametrize("image", ["known", "encoder", "idle"])
def test_other_boards_are_told_from_firmata(make_avr: MakeAvr, tmp_path: Path, image: str) -> None:
    """Every byte plus one; armctl's other firmware; nothing at all."""
    idle = tmp_path / "idle.hex"
    idle.write_text(":02000000FFCF30\n:00000001FF\n")  # rjmp .-2
    with pytest.raises(BoardTimeoutError if image == "idle" else BoardError, match="Firmata"):
        driver_of(make_avr(idle if image == "idle" else image)).open()


def test_a_blank_mega_crashes_the_simulator_and_so_the_test(make_avr: MakeAvr, tmp_path: Path) -> None:
    image = tmp_path / "blank.hex"
    image.write_text(":02000000FFFF00\n:00000001FF\n")  # the CPU runs off the end of its flash
    with pytest.raises(AvrError, match=r"blank\.hex: the simulated CPU crashed"):
        driver_of(make_avr(image)).open()


# What comes out of the pins.

TOLERANCE_US = 4.0
ATTACHING = 30
"""frames within which the driver has switched twelve pins on, and each has sent a pulse"""
ATTACHES = int(os.environ.get("ARMCTL_ENABLES", "25"))
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


def test_an_attach_with_another_width_never_sends_the_old_one(make_rig: MakeRig) -> None:
    """The sketch attaches with the width that it keeps for the pin, and that is the right one by then."""
    random = Random(3)
    rig = make_rig(ONE_TIMER)
    for _ in range(ATTACHES):
        new = {pin: random.randint(LOWEST_US, HIGHEST_US) for pin in rig.pins}
        pulses = rig.stream(new, ATTACHING)
        assert {pulse.pin for pulse in pulses} == set(rig.pins)
        for pulse in pulses:
            assert pulse.width_us == pytest.approx(new[pulse.pin], abs=BUSY_US)
        rig.driver.release()
        rig.avr.run_for(random.uniform(0.0, 2 * FRAME_S))


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


# A line on which every burst comes up to 60 ms late, and then often several together.

STEP_S = 0.001
ON_WITHIN_S = 3.0
ENABLES = int(os.environ.get("ARMCTL_ENABLES", "8"))  # a long run: 200


def on_a_late_line(avr: Avr, seed: int) -> tuple[FirmataDriver, Callable[[float], None]]:
    """A driver that was opened and configured, and what lets time pass on its line."""
    late = FaultyModel(OwnTime(avr), seed, [trouble("delay=0.06:1")])
    line = LoopTransport(late, lambda: avr.now, avr.run_for)

    def run_for(seconds: float) -> None:
        ends = avr.now + seconds
        while avr.now < ends:
            avr.run_for(STEP_S)
            line.read(0, 0.0)  # late bytes go on their way, and what has come waits to be read

    driver = FirmataDriver(Connection(lambda: line, lambda: avr.now))
    driver.open()
    driver.configure([ChannelSettings(pin, LOWEST_US, HIGHEST_US) for pin in ONE_TIMER])
    return driver, run_for


def test_no_enable_fails_on_a_line_that_is_late(make_avr: MakeAvr) -> None:
    random = Random(5)
    avr = make_avr("firmata")
    avr.run_for(2.0)
    avr.read()
    driver, run_for = on_a_late_line(avr, seed=5)
    meter = PulseMeter(avr, ONE_TIMER)
    for _ in range(ENABLES):
        wanted = {pin: random.randint(LOWEST_US, HIGHEST_US) for pin in ONE_TIMER}
        ends = avr.now + ON_WITHIN_S
        seen: dict[int, float] = {}
        while seen.keys() != wanted.keys() and avr.now < ends:
            driver.write(wanted)
            assert driver.read().errors == ()
            run_for(FRAME_S)
            for pulse in meter.take():
                assert pulse.width_us == pytest.approx(wanted[pulse.pin], abs=BUSY_US)
                seen[pulse.pin] = pulse.width_us
        run_for(0.2)
        meter.take()
        run_for(2 * FRAME_S)
        seen = {pulse.pin: pulse.width_us for pulse in meter.take()}
        assert seen == pytest.approx(wanted, abs=BUSY_US)
        driver.release()
        run_for(random.uniform(0.0, 2 * FRAME_S))
        meter.take()


# Two minutes of setpoints, every pulse checked.

STREAMED = (2, 3, 4, 5, 6, 7)
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
    rig = FirmataRig(make_avr("firmata"), STREAMED)
    avr = rig.avr
    rig.stream({pin: width_us(0, pin) for pin in STREAMED}, START_FRAMES)
    written_at = [0.0]
    seen: dict[int, list[tuple[float, int]]] = defaultdict(list)
    next_cycle = avr.cycle
    for number in range(1, round(MINUTES * 60 / FRAME_S)):
        written_at.append(avr.now)
        rig.driver.write({pin: width_us(number, pin) for pin in STREAMED})
        assert rig.driver.read().errors == ()
        next_cycle += avr.cycles(FRAME_S)
        avr.run_until(next_cycle)
        for pulse in rig.meter.take():
            seen[pulse.pin].append((pulse.start_s, number_of(pulse.width_us, pulse.pin, number)))
    assert sorted(seen) == list(STREAMED)
    for place, pin in enumerate(STREAMED):
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
