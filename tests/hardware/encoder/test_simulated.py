"""What the simulated board does beyond the bytes: its arm, its time and its faults."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.hardware.encoder.kit import Bench, encoder_axis

from armctl.hardware import ChannelSettings
from armctl.hardware.encoder.messages import Banner, FaultKind, Mode, Status, decode
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard, simulated_encoder_board
from armctl.hardware.encoder.simulated_axis import (
    FIRMWARE_DEFAULTS,
    TICK_S,
    AxisPlant,
    SimulatedAxis,
    plant_of,
)
from armctl.robot import load_robot
from armctl.runtime import channel_settings


def axis_at(count: int, **changes: int) -> SimulatedAxis:
    axis = SimulatedAxis(AxisPlant(low=-10_000.0, high=10_000.0, start=float(count)), FIRMWARE_DEFAULTS[0])
    axis.settings.update({"min": -9000, "max": 9000, "vmax": 1000, "amax": 5000, "ferr": 30000} | changes)
    axis.set_zero(0.0)
    return axis


@settings(max_examples=30)
@given(st.integers(-1000, 1000), st.integers(200, 4000), st.integers(500, 60000), st.floats(0.02, 1.0))
def test_a_setpoint_is_reached_within_speed_and_acceleration(target, speed, acceleration, within):
    axis = axis_at(0, vmax=speed, amax=acceleration)
    axis.go(target, within)
    before, velocity = axis._reference, 0.0
    for _ in range(round((within + 1000 / speed + speed / acceleration + 1.0) / TICK_S)):
        axis.tick()
        now = (axis._reference - before) / TICK_S
        assert abs(now) <= speed * 1.0001
        assert abs(now - velocity) <= acceleration * TICK_S * 1.0001
        before, velocity = axis._reference, now
    assert abs(axis.count - target) <= 1


def test_it_goes_there_linearly_in_time():
    axis = axis_at(0, vmax=5000, amax=65000)
    axis.go(1000, 1.0)
    axis._reference = 0.0
    for tick in range(200):
        axis.tick()
        assert axis._reference == pytest.approx(1000 * (tick + 1) / 200, abs=12.0)


def test_a_halt_keeps_to_the_acceleration():
    axis = axis_at(0, vmax=1000, amax=2000)
    axis.go(5000, 0.1)
    for _ in range(200):
        axis.tick()
    begun = axis._reference
    axis.halt()
    for _ in range(200):
        axis.tick()
    assert axis._reference - begun == pytest.approx(1000**2 / (2 * 2000), rel=0.03)
    assert not axis.moving


def test_a_hard_stop_is_hard():
    axis = axis_at(0, max=20_000, vmax=20_000)
    axis.go(15_000, 0.1)
    for _ in range(600):
        axis.tick()
    assert axis.place == 10_000.0


@pytest.mark.parametrize(("largest", "fault"), [(255, FaultKind(0)), (100, FaultKind.STALL)])
def test_a_motor_that_may_not_push_harder_stalls_earlier(largest: int, fault: FaultKind):
    axis = axis_at(0, kp=256, brk=0, dmax=largest)  # a step of drive a count
    axis.go(300, 0.1)
    for _ in range(20):
        assert not axis.tick()
    axis.jammed = True
    axis.go(axis.count + 150, 0.1)  # a drive of 150 would be called for
    faults = {axis.tick() for _ in range(200)}
    assert faults == {FaultKind(0), fault}


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


def test_motors_that_are_off_stay_where_they_are(bench: Bench):
    places = [axis.place for axis in bench.board.axes]
    bench.wait(1.0)
    assert [axis.place for axis in bench.board.axes] == places


def test_a_long_absence_is_caught_up_with_at_once():
    board = SimulatedEncoderBoard()
    board.advance(0.0)
    said = board.advance(86_400.0)
    lines = [decode(line) for line in said.splitlines()]
    assert 95 <= len(lines) <= 105
    last = lines[-1]
    assert isinstance(last, Status) and last.time_ms == 86_400_000


def test_time_that_goes_back_or_stands_still_does_nothing():
    board = SimulatedEncoderBoard()
    board.advance(10.0)
    assert board.advance(10.0) == board.advance(9.0) == b""


def test_the_board_is_deaf_and_dumb_while_it_starts():
    board = SimulatedEncoderBoard(boot_s=1.7)
    assert board.advance(0.0) == board.advance(1.6) == b""
    assert board.feed(b"????") == b""
    (banner,) = [decode(line) for line in board.advance(1.7).splitlines()]
    assert banner == Banner("armctl-encoder", "1.1.0", 2, 6, "power")


@pytest.mark.parametrize("cause", ["power", "external", "brownout", "watchdog"])
def test_a_restart_forgets_everything_but_where_the_arm_is(homed: Bench, cause):
    homed.stream({0: 200.0}, 0.5)
    board = homed.board
    board.restart(cause)
    said = [decode(line) for line in board.advance(homed.clock.now()).splitlines()]
    assert isinstance(said[0], Banner) and said[0].reset == cause
    assert board.mode is Mode.OFF
    assert board.axes[0].count == 0
    assert board.axes[0].place == pytest.approx(200.0, abs=0.5)
    assert not any(axis.homed for axis in board.axes)


def test_the_watchdog_brakes_before_it_switches_off(homed: Bench):
    homed.driver.write({0: 500.0})
    began = homed.clock.now()
    modes: dict[Mode, float] = {}
    for _ in range(120):
        homed.clock.advance(TICK_S)
        homed.board.advance(homed.clock.now())
        modes.setdefault(homed.board.mode, homed.clock.now() - began)
    assert list(modes) == [Mode.ON, Mode.HELD, Mode.OFF]
    assert modes[Mode.HELD] == pytest.approx(0.4, abs=0.011)
    assert modes[Mode.OFF] == pytest.approx(0.5, abs=0.011)


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_no_noise_moves_anything(bursts):
    board = SimulatedEncoderBoard()
    now = 1.0
    board.advance(now)
    places = [axis.place for axis in board.axes]
    for burst in bursts:
        board.feed(burst)
        now += 0.02
        board.advance(now)
    assert not board.mode.powered
    assert [axis.place for axis in board.axes] == places
    assert not board.log
