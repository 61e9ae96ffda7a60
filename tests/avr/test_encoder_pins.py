"""Spare pins of the real encoder firmware as inputs and outputs: latency, pulses, what a lost host leaves."""

from __future__ import annotations

import os
from random import Random

import numpy as np
import pytest
from tests.avr.avr import Edge
from tests.avr.conftest import MakeArm
from tests.avr.encoder_arm import EncoderArm
from tests.avr.mega import PINS
from tests.avr.test_encoder_counts import spin
from tests.avr.test_encoder_driver import PERIOD_S, Session

from armctl.errors import BoardError, BoardTimeoutError
from armctl.hardware.driver import Readback
from armctl.robot.signals import Input, Output, Signals

BUTTON, DOOR = Input("button", "Button", 42, "pull-up"), Input("door", "Door", 43)
LAMP = Output("lamp", "Lamp", 45, at_fault="off")
PUMP = Output("pump", "Pump", 46, active_low=True, at_fault="off")
BELL = Output("bell", "Bell", 49)
SEEN_S, PULSE_S = 0.020, 0.005
EDGES = 1000 if os.environ.get("ARMCTL_LONG") else 60
_DDRL = 0x10A
"""which pins of port L are driven"""


class Rig:
    """The driver with an arm at home, ticked as the runtime does."""

    def __init__(self, arm: EncoderArm) -> None:
        self.avr = arm.avr
        self.session = Session(arm)
        self.driver = self.session.driver
        self.avr.set_pin(PINS[42], 1)
        self.avr.set_pin(PINS[43], 0)
        self.driver.use_signals(Signals((BUTTON, DOOR), (LAMP, PUMP, BELL)))
        self.tick()

    def tick(self) -> Readback:
        self.avr.run_for(PERIOD_S)
        return self.driver.read()

    def levels(self) -> list[int]:
        return [self.avr.pin(PINS[one.channel]) for one in (LAMP, PUMP, BELL)]


@pytest.fixture
def rig(make_arm: MakeArm) -> Rig:
    return Rig(make_arm())


def test_an_edge_is_told_within_20_ms_while_setpoints_are_streamed(make_arm: MakeArm) -> None:
    """From the pin to the host's end of the line, the arm homed and led all the while."""
    arm = make_arm()
    arm.home()
    arm.avr.set_pin(PINS[43], 0)
    assert arm.ask("PIN 43 in") == "ok"
    dice, took, level, due = Random(4), list[float](), 0, arm.avr.now
    for _ in range(EDGES):
        arm.run(dice.uniform(0.012, 0.05))
        seen = len(arm.events)
        level = 1 - level
        arm.avr.set_pin(PINS[43], level)
        began = arm.avr.now
        while len(arm.events) == seen:
            assert arm.avr.now - began < 0.1
            if arm.avr.now >= due:
                due += 0.02
                arm.post("P 100 - - - - - 30")
            arm.run(0.0005)
        took.append(arm.avr.now - began)
        assert arm.events[-1].startswith("pins ") and int(arm.events[-1][6], 16) % 2 == level
    told = 1000 * np.percentile(took, (50, 99, 100))
    assert told[1] <= 1000 * SEEN_S, told
    assert not arm.status[-1].flags


def test_an_input_that_bounces_costs_no_counts(make_arm: MakeArm) -> None:
    """News that waits to be told delays no encoder, however fast that is spun."""
    arm = make_arm()
    arm.avr.set_pin(PINS[43], 0)
    assert arm.ask("CFG 0 kp=0 ki=0 kd=100 brk=0 ferr=30000 inv=0 minv=0") == "ok"
    assert arm.ask("PIN 43 in") == "ok"
    assert arm.ask("EN 1") == "ok"
    every = round(0.003 * arm.avr.clock_hz)
    bounces = [Edge(arm.avr.cycle + every * k, PINS[43], k % 2) for k in range(1, 100)]
    arm.avr.schedule(sorted(spin(arm, 0, 40_000, 0.3) + bounces))
    arm.run(0.4)
    assert arm.now().counts[0] == 12_000
    assert sum(event.startswith("pins ") for event in arm.events) >= 20


def test_pulses_of_5_ms_are_counted_whenever_they_come(rig: Rig) -> None:
    dice, pulses, counted = Random(5), 60, 0
    for _ in range(pulses):
        rig.avr.run_for(dice.uniform(0.0, 0.012))
        rig.avr.set_pin(PINS[43], 1)
        rig.avr.run_for(PULSE_S)
        rig.avr.set_pin(PINS[43], 0)
        back = rig.tick()
        assert back.inputs["door"] == 0.0
        counted += back.changes["door"]
    assert counted == 2 * pulses


def test_levels_are_those_of_the_pins_and_a_pull_up_holds_one_high(rig: Rig) -> None:
    assert rig.tick().inputs == {"button": 1.0, "door": 0.0}
    rig.avr.set_pin(PINS[42], 0)
    rig.avr.set_pin(PINS[43], 1)
    back = rig.tick()
    assert back.inputs == {"button": 0.0, "door": 1.0} and back.changes == {"button": 1, "door": 1}
    assert rig.tick().changes == {"button": 0, "door": 0}


def test_outputs_are_switched_also_while_the_arm_moves_and_read_back(rig: Rig) -> None:
    rig.session.home()
    for name, value in (("lamp", 1.0), ("pump", 1.0), ("bell", 1.0), ("bell", 0.0)):
        rig.driver.write({1: 50.0})
        rig.driver.set_output(name, value)
        back = rig.tick()
        assert back.outputs[name] == value and not back.errors
    assert rig.levels() == [1, 1, 0]
    rig.driver.stop()
    rig.driver.release()
    assert rig.levels() == [1, 1, 0]  # what they do then the runtime says
    with pytest.raises(BoardError, match="no output 'horn'"):
        rig.driver.set_output("horn", 1.0)
    with pytest.raises(BoardError, match="Horn is on pin 30: an encoder board has its pins 42 … 49 free"):
        rig.driver.use_signals(Signals((), (Output("horn", "Horn", 30),)))


def test_a_lost_host_leaves_outputs_as_at_a_fault_and_a_host_that_leaves_as_they_are(rig: Rig) -> None:
    assert rig.levels() == [0, 1, 0]  # the pump is on where its pin is low
    for name, level in (("lamp", 1.0), ("bell", 1.0), ("pump", 0.0)):
        rig.driver.set_output(name, level)
    rig.avr.run_for(0.45)
    assert rig.levels() == [1, 0, 1]
    rig.avr.run_for(0.1)
    assert rig.levels() == [0, 1, 1]  # off; of the pump that is high; the bell keeps
    rig.driver.read()
    rig.driver.set_output("lamp", 1.0)
    rig.driver.close()
    rig.avr.run_for(1.0)
    assert rig.levels() == [1, 1, 1]


def test_after_a_reset_pins_let_go_until_they_are_named_again(make_arm: MakeArm) -> None:
    arm = make_arm()
    rig = Rig(arm)
    rig.driver.set_output("lamp", 1.0)
    rig.tick()
    arm.avr.reset()
    for _ in range(20):
        back = rig.tick()
    assert back.errors and back.inputs == {} and not rig.avr.data(_DDRL)
    rig.driver.set_output("bell", 1.0)
    for level in (0, 1):  # the simulator has forgotten what is connected
        rig.avr.set_pin(PINS[42], level)
        back = rig.tick()
    assert back.inputs == {"button": 1.0, "door": 0.0}
    assert back.outputs == {"lamp": 0.0, "pump": 1.0, "bell": 1.0}  # off, off, on


def test_a_board_that_does_not_answer_is_a_fault(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig.avr, "write", lambda *_, **__: None)
    with pytest.raises(BoardTimeoutError, match="did not answer 'SET 45 1'"):
        rig.driver.set_output("lamp", 1.0)
