"""The simulator measures right and notices everything that goes wrong: checked with a known firmware."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.avr.avr import Avr, AvrError, Edge
from tests.avr.conftest import MakeAvr
from tests.avr.mega import PINS, PulseMeter, duty


@pytest.fixture
def avr(make_avr: MakeAvr) -> Avr:
    avr = make_avr("known")
    avr.run_for(0.01)
    return avr


def ask(avr: Avr, data: bytes, seconds: float = 0.01) -> bytes:
    avr.write(data)
    avr.run_for(seconds)
    return avr.read()


def test_a_pulse_is_measured_to_the_cycle(avr: Avr) -> None:
    avr.watch("B7", "L5")
    ask(avr, b"p")
    rise_b, fall_b, rise_l, fall_l = avr.edges()
    assert [edge.pin for edge in (rise_b, fall_b, rise_l, fall_l)] == ["B7", "B7", "L5", "L5"]
    assert fall_b.cycle - rise_b.cycle == 24_002
    assert fall_l.cycle - rise_l.cycle == 16_002


def test_pulse_meter_knows_arduino_pins_and_microseconds(avr: Avr) -> None:
    meter = PulseMeter(avr, (13, 44))
    ask(avr, b"pp")
    assert [(pulse.pin, pulse.width_us) for pulse in meter.take()] == [
        (13, 1500.125),
        (44, 1000.125),
        (13, 1500.125),
        (44, 1000.125),
    ]
    assert meter.take() == []


def test_a_pin_that_is_not_watched_leaves_no_edges(avr: Avr) -> None:
    ask(avr, b"p")
    assert avr.edges() == []


def test_serial_bytes_arrive_at_the_line_s_speed(avr: Avr) -> None:
    byte_s = 10 / 57_600
    avr.write(bytes(range(100)))
    avr.run_for(20 * byte_s)
    early = avr.read()
    assert 15 <= len(early) <= 20
    avr.run_for(90 * byte_s)
    assert early + avr.read() == bytes(range(1, 101))


def test_a_pin_is_set_from_outside(avr: Avr) -> None:
    for level in (1, 0, 1):
        avr.set_pin("A0", level)
        avr.set_pin("A1", 1 - level)
        assert avr.pin("A0") == level
        assert ask(avr, b"i") == str(level).encode()


def test_scheduled_levels_come_in_time_and_are_not_the_firmware_s_edges(avr: Avr) -> None:
    avr.watch("A0")
    avr.schedule([Edge(avr.cycle + avr.cycles(0.02), "A0", 1), Edge(avr.cycle + avr.cycles(0.04), "A0", 0)])
    answers = [ask(avr, b"i") for _ in range(6)]
    assert answers == [b"0", b"0", b"1", b"1", b"0", b"0"]
    assert avr.edges() == []


def test_phase_correct_pwm_is_read_from_the_timer(avr: Avr) -> None:
    assert duty(avr, 6) == 0.0
    ask(avr, b"w")
    assert duty(avr, 6) == 64 / 255
    assert PINS[6] == "H3"
    with pytest.raises(ValueError, match="pin 22 of a Mega has no timer"):
        duty(avr, 22)


def test_the_same_steps_give_the_same_edges(make_avr: MakeAvr) -> None:
    seen: list[list[Edge]] = []
    for step_s in (0.0001, 0.0001, 0.01):
        avr = make_avr("known")
        avr.watch("B7", "L5")
        avr.run_for(0.001)
        avr.write(b"ppp")
        for _ in range(round(0.02 / step_s)):
            avr.run_for(step_s)
        seen.append(avr.edges())
    assert seen[0] == seen[1]
    assert len(seen[0]) == 12
    assert [edge.pin for edge in seen[0]] == [edge.pin for edge in seen[2]]


def test_reset_starts_the_firmware_anew(avr: Avr) -> None:
    ask(avr, b"w")
    avr.reset()
    assert duty(avr, 6) == 0.0
    avr.run_for(0.001)
    assert ask(avr, b"a") == b"b"


@pytest.mark.parametrize(
    ("command", "words"),
    [(b"t", "crashed"), (b"j", "crashed"), (b"z", "switched its CPU off")],
)
def test_a_cpu_that_crashes_raises(avr: Avr, command: bytes, words: str) -> None:
    with pytest.raises(AvrError, match=rf"known\.hex: .*{words}.* at 0\.\d+ s, program counter 0x"):
        ask(avr, command)


def test_edges_that_nobody_fetches_are_not_lost_in_silence(avr: Avr) -> None:
    avr.watch("B7")
    with pytest.raises(AvrError, match="fetch them more often"):
        for _ in range(3):
            ask(avr, b"f", 0.1)


def test_an_image_that_is_none_is_refused(make_avr: MakeAvr, tmp_path: Path) -> None:
    image = tmp_path / "nothing.hex"
    image.write_text("no hex file\n")
    with pytest.raises(AvrError, match=r"nothing\.hex: not a hex file"):
        make_avr(image)
