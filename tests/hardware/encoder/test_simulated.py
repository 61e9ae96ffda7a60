"""The simulated board: held to the same bytes as the firmware; its arm, its time and its faults."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.avr.conformance import Check, ModelLine
from tests.avr.encoder_conformance import CONFORMANCE
from tests.hardware.encoder.kit import AXES, CHANNELS, Bench, encoder_axis
from tests.long import examples

from armctl.hardware import ChannelSettings, Setup
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.encoder.axes import EncoderSettings
from armctl.hardware.encoder.messages import Banner, FaultKind, Mode, Status, decode, seal
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard, simulated_encoder_board
from armctl.hardware.encoder.simulated_axis import (
    FIRMWARE_DEFAULTS,
    TICK_S,
    AxisPlant,
    SimulatedAxis,
    plant_of,
)
from armctl.robot import load_robot


@pytest.mark.parametrize("check", CONFORMANCE, ids=lambda check: check.__name__)
def test_conformance(check: Check) -> None:
    check(ModelLine(SimulatedEncoderBoard(), TICK_S))


def axis(**changes: int) -> SimulatedAxis:
    """At 0, homed."""
    axis = SimulatedAxis(AxisPlant(low=-10_000.0, high=10_000.0, start=0.0), FIRMWARE_DEFAULTS[0])
    axis.settings.update({"min": -9000, "max": 9000, "vmax": 1000, "amax": 5000, "ferr": 30000} | changes)
    axis.set_zero(0.0)
    return axis


def run(axis: SimulatedAxis, seconds: float) -> list[float]:
    """Its setpoint after each tick."""
    places = [axis._reference]
    for _ in range(round(seconds / TICK_S)):
        axis.tick()
        places.append(axis._reference)
    return places


@settings(max_examples=examples(30))
@given(st.integers(-1000, 1000), st.integers(200, 4000), st.integers(500, 60000), st.floats(0.02, 1.0))
def test_a_setpoint_is_reached_within_speed_and_acceleration(target, speed, acceleration, within):
    own = axis(vmax=speed, amax=acceleration)
    own.go(target, within)
    places = run(own, within + 1000 / speed + speed / acceleration + 1.0)
    speeds = np.diff(places, prepend=0.0) / TICK_S
    assert np.abs(speeds).max() <= speed * 1.0001
    assert np.abs(np.diff(speeds)).max() <= acceleration * TICK_S * 1.0001
    assert abs(own.count - target) <= 1


def test_it_goes_there_linearly_in_time():
    own = axis(vmax=5000, amax=65000)
    own.go(1000, 1.0)
    assert run(own, 1.0) == pytest.approx([5.0 * tick for tick in range(201)], abs=12.0)


def test_a_halt_keeps_to_the_acceleration():
    own = axis(vmax=1000, amax=2000)
    own.go(5000, 0.1)
    begun = run(own, 1.0)[-1]
    own.halt()
    assert run(own, 1.0)[-1] - begun == pytest.approx(1000**2 / (2 * 2000), rel=0.03)
    assert not own.moving


def test_a_hard_stop_is_hard():
    own = axis(max=20_000, vmax=6000)
    own.go(15_000, 0.1)
    run(own, 3.0)
    assert own.place == 10_000.0


@pytest.mark.parametrize(("largest", "fault"), [(255, FaultKind(0)), (100, FaultKind.STALL)])
def test_a_motor_that_may_not_push_harder_stalls_earlier(largest: int, fault: FaultKind):
    own = axis(kp=256, brk=0, dmax=largest)  # a step of drive a count
    own.go(300, 0.1)
    run(own, 0.1)
    own.jammed = True
    own.go(own.count + 150, 0.1)  # a drive of 150 would be called for
    assert {own.tick() for _ in range(200)} == {FaultKind(0), fault}


def test_the_plants_of_a_robot_can_be_homed():
    robot = load_robot("scorbot")
    channels = channel_settings(robot)
    board = simulated_encoder_board(channels, robot.board_settings.axes)
    for limits, own in zip(channels, robot.board_settings.axes, strict=True):
        plant = board.axes[own.entry.axis].plant
        if own.entry.home_by == "switch":
            assert plant.low < limits.minimum < limits.maximum < plant.high
        assert plant.low <= plant.start <= plant.high


def test_a_plant_whose_switch_is_at_the_end_of_its_range():
    plant = plant_of(ChannelSettings(0, 0.0, 1000.0, 100.0, 100.0), encoder_axis(0, home_toward=-1))
    assert plant == AxisPlant(low=-60.0, high=1060.0, switch=(-200.0, 0.0), start=250.0)


def test_a_long_absence_is_caught_up_with_at_once_and_time_never_goes_back():
    board = SimulatedEncoderBoard()
    board.advance(0.0)
    lines = [decode(line) for line in board.advance(86_400.0).splitlines()]
    assert 95 <= len(lines) <= 105
    last = lines[-1]
    assert isinstance(last, Status) and last.time_ms == 86_400_000
    assert board.advance(86_400.0) == board.advance(9.0) == b""


@pytest.mark.parametrize("cause", ["power", "external", "brownout", "watchdog", "unexpected"])
def test_a_restart_forgets_everything_but_where_the_arm_is(homed: Bench, cause):
    homed.stream({0: 200.0}, 0.5)
    board = homed.board
    board.reset(cause)
    said = [decode(line) for line in board.advance(homed.clock.now()).splitlines()]
    assert isinstance(said[0], Banner) and said[0].reset == cause
    assert board.mode is Mode.OFF
    assert board.axes[0].count == 0
    assert board.axes[0].place == pytest.approx(200.0, abs=0.5)
    assert not any(axis.homed for axis in board.axes)


@pytest.mark.parametrize("trouble", ["stall", "torn", "slip"])
def test_troubles_to_rehearse(trouble: str):
    """What `armctl simulate encoder` can be asked for strikes as soon as the axis is homed."""
    kind = board_type("encoder")
    assert trouble in [one.name for one in kind.simulator_options]
    board = kind.simulated(
        Setup(CHANNELS, EncoderSettings(AXES)), {"slip": 1, trouble: 2} if trouble != "slip" else {"slip": 2}
    )
    assert isinstance(board, SimulatedEncoderBoard)
    assert [one.trouble for one in board.axes[:3]] == [None, None if trouble == "slip" else "slip", trouble]
    axis = board.axes[2]
    assert (axis.jammed, axis.torn) == (False, False)
    axis.set_zero(axis.place)
    assert (axis.jammed, axis.torn) == (trouble == "stall", trouble == "torn")


def test_an_axis_that_slips_loses_an_edge_every_1000_counts():
    own = axis(vmax=6000, amax=20000)
    own.trouble = "slip"
    own.set_zero(0.0)
    own.go(3500, 1.0)
    run(own, 3.0)
    assert own.count == 3500 and own.lost >= 3
    assert own.place == pytest.approx(3500.0 + 2 * own.lost, abs=0.5)


def test_the_watchdog_brakes_before_it_switches_off(homed: Bench):
    homed.driver.write({0: 500.0})
    began = homed.clock.now()
    modes: dict[Mode, float] = {}
    for _ in range(120):
        homed.clock.advance(TICK_S)
        homed.board.advance(homed.clock.now())
        if homed.board.mode is Mode.HELD:
            assert b"HOLD braking" in homed.board.feed(seal("1 EN 1"))
        modes.setdefault(homed.board.mode, homed.clock.now() - began)
    assert list(modes) == [Mode.ON, Mode.HELD, Mode.OFF]
    assert modes[Mode.HELD] == pytest.approx(0.4, abs=0.011)
    assert modes[Mode.OFF] == pytest.approx(0.5, abs=0.011)
