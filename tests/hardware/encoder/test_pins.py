"""Spare pins of an encoder board behind the driver, on the simulated board."""

from __future__ import annotations

import pytest
from tests.hardware.encoder.kit import PERIOD_S, Bench

from armctl.errors import BoardError
from armctl.hardware.encoder.pins import SparePins
from armctl.robot.signals import Input, Output, Signals

BUTTON, DOOR = Input("button", "Button", 42, "pull-up", active_low=True), Input("door", "Door", 43)
LAMP = Output("lamp", "Lamp", 45, at_fault="off")
PUMP = Output("pump", "Pump", 46, active_low=True, at_fault="off")
BELL = Output("bell", "Bell", 49, at_fault="on")
SIGNALS = Signals((BUTTON, DOOR), (LAMP, PUMP, BELL))


def test_the_board_is_told_what_its_pins_are_and_what_a_lost_host_leaves(bench: Bench) -> None:
    bench.driver.use_signals(SIGNALS)
    assert bench.executed()[-5:] == [
        "PIN 42 up", "PIN 43 in", "PIN 45 out low 0", "PIN 46 out high 1", "PIN 49 out high 0"
    ]  # fmt: skip
    assert bench.driver.read().inputs == {"button": 1.0, "door": 0.0}  # levels: the runtime turns them round
    bench.driver.set_output("lamp", 1.0)
    bench.clock.advance(PERIOD_S)
    assert bench.driver.read().outputs == {"lamp": 1.0, "pump": 1.0, "bell": 0.0}  # the pump is off
    sent = len(bench.executed())
    bench.driver.close()
    assert bench.executed()[sent:] == ["PIN 45 out keep", "PIN 46 out keep", "PIN 49 out keep"]


def test_a_pulse_between_two_readings_is_counted_also_where_lines_are_lost(bench: Bench) -> None:
    bench.driver.use_signals(SIGNALS)
    bench.driver.read()
    for level in (1.0, 0.0, 1.0):
        bench.board.levels[43] = level
        bench.clock.advance(0.005)
        bench.board.advance(bench.clock.now())
    bench.clock.advance(PERIOD_S)  # what was said of it meanwhile has reached nobody
    assert bench.driver.read().changes == {"button": 0, "door": 3}
    assert bench.driver.read().changes == {"button": 0, "door": 0}


def test_counts_go_round_and_a_board_that_starts_anew_begins_anew() -> None:
    pins = SparePins(Signals((DOOR,)))
    assert pins.read((0, 14, 0, 0, 0, 0, 0, 0), known=True)["changes"] == {}
    assert pins.read((0, 1, 0, 0, 0, 0, 0, 0), known=True)["changes"] == {"door": 3}
    lost = pins.read((0, 0, 0, 0, 0, 0, 0, 0), known=False)
    assert lost == {"inputs": {}, "outputs": {}, "changes": {}}
    assert pins.read((0, 1, 0, 0, 0, 0, 0, 0), known=True) == {
        "inputs": {"door": 1.0}, "outputs": {}, "changes": {}
    }  # fmt: skip


@pytest.mark.parametrize("pin", [41, 50, 13])
def test_other_pins_are_refused(bench: Bench, pin: int) -> None:
    with pytest.raises(BoardError, match=f"Horn is on pin {pin}: an encoder board has its pins 42 … 49 free"):
        bench.driver.use_signals(Signals((), (Output("horn", "Horn", pin),)))
