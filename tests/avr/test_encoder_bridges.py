"""How the encoder firmware treats the H-bridges, to the register."""

from __future__ import annotations

import pytest
from tests.avr.conftest import MakeAvr
from tests.avr.encoder_arm import EncoderArm

BEGINNING_CYCLES = 20_000
ENABLE = "H6"
RUNS_TO_ICR = 0x10
"""WGMn3 in TCCRnB: in modes without it ICRn cannot be written (datasheet, 16-bit timers, ICRn)."""


@pytest.mark.parametrize("timer", [0x90, 0xA0], ids=["timer 3", "timer 4"])
def test_the_period_of_the_pwm_is_set_when_it_can_be(make_avr: MakeAvr, timer: int) -> None:
    """The simulator takes it at any time; a real timer would keep 0, and every duty would be full drive."""
    avr = make_avr("encoder")
    period = 0
    for _ in range(BEGINNING_CYCLES):
        before, mode = period, avr.data(timer + 1)
        avr.run_until(avr.cycle + 1)
        period = avr.data(timer + 6) | avr.data(timer + 7) << 8
        if period != before:
            assert mode & RUNS_TO_ICR
    assert period == 510


def test_a_bridge_turns_round_only_while_it_is_off(homed: EncoderArm) -> None:
    """The duty takes effect a PWM period late: turned at once, the old one would drive the wrong way."""
    for counts in ((-900, -700, -800, -300, 300, 900), (-100, -50, -100, -10, 10, 100)):
        assert homed.ask(homed.setpoints(counts, 1)) == "ok"
        homed.run_until(lambda counts=counts: abs(homed.now().counts[0] - counts[0]) <= 2, 3)
    homed.run(0.3)
    assert homed.now().mode == "N"
    assert homed.plant.hot_turns == 0


def test_nothing_is_driven_from_the_reset_to_the_first_command(make_avr: MakeAvr) -> None:
    avr = make_avr("encoder")
    avr.watch(ENABLE)
    avr.run_for(1.0)
    avr.reset()
    avr.run_for(1.0)
    assert avr.edges() == []
    assert avr.pin(ENABLE) == 0
    for timer in (0x90, 0xA0):
        assert [avr.data(timer + offset) for offset in range(8, 14)] == [0] * 6
