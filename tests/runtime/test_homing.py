"""A board with encoders that homes: it moves the arm by itself, and it must always be possible to stop it."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import TEST, RecordingDriver, Rig, fails, make_rig

from armctl.errors import ArmctlError, BoardError, BoardTimeoutError, StateError
from armctl.facts import State
from armctl.hardware import HomingState, Readback, Source
from armctl.protocol import (
    ClearFault,
    Command,
    Connect,
    Disconnect,
    Enable,
    HomeAxes,
    MoveGripper,
    MoveJoints,
    Pause,
    Release,
)
from armctl.robot import Robot, load_robot

SCORBOT = load_robot("scorbot")
REST = SCORBOT.pose("rest")
AXES = range(6)


class HomingDriver(RecordingDriver):
    """A board with encoders that finds zeros when a test says so."""

    def __init__(self, clock) -> None:
        super().__init__(clock)
        self.source = Source.MEASURED
        self.homed = dict.fromkeys(AXES, False)
        self.running: int | None = None
        self.on = False
        self.faults: dict[int, str] = {}
        self.counts = dict.fromkeys(AXES, 0.0)

    def write(self, setpoints) -> None:
        if self.running is not None:
            raise StateError("the board is homing; wait until it is done, or stop it")
        if self.faults:
            return  # lost on the way: the board takes no setpoint while a fault is latched
        super().write(setpoints)
        self.on = True
        self.counts.update(setpoints)

    def read(self) -> Readback:
        self._call("read")
        positions = {axis: self.counts[axis] if homed else None for axis, homed in self.homed.items()}
        homing = HomingState(dict(self.homed), self.running)
        return Readback(positions, self.source, self.errors, self.on, dict(self.faults), homing)

    def home(self) -> None:
        self._call("home")
        self.homed = dict.fromkeys(AXES, False)
        self.running = 5
        self.on = True

    def stop(self) -> None:
        super().stop()
        self.running = None

    def release(self) -> None:
        super().release()
        self.on = False
        self.faults.clear()

    def find(self, *axes: int, then: int | None = None) -> None:
        self.homed.update(dict.fromkeys(axes, True))
        self.running = then

    def trip(self, axis: int, words: str) -> None:
        self.faults[axis] = words
        self.on = False
        self.running = None


def make_homing_rig(robot: Robot = SCORBOT) -> Rig:
    """Connected, and not homed."""
    rig = make_rig(robot=robot)
    driver = HomingDriver(rig.clock)
    rig.driver = driver
    rig.controller._core._open_driver = lambda _: driver
    rig.do(Connect("sim")).result(0)
    return rig


def home(rig: Rig) -> Rig:
    """Let homing run through."""
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    rig.driver.find(*AXES)
    rig.run(0.1)
    ticket.result(0)
    return rig


@pytest.fixture
def rig() -> Rig:
    return make_homing_rig()


@pytest.fixture
def homed(rig: Rig) -> Rig:
    return home(rig)


@pytest.fixture
def homing(rig: Rig) -> Rig:
    rig.do(HomeAxes())
    rig.run(0.4)
    assert rig.now.state is State.MOVING
    return rig


def test_an_arm_that_was_not_homed_cannot_be_enabled(rig: Rig) -> None:
    assert [axis.homed for axis in rig.now.homing] == [False] * 6
    rig.refuses(Enable(), "does not know where it is yet; press Homing")
    rig.refuses(MoveJoints(REST), "a motion needs the arm holding, it is off; press Homing")
    rig.refuses(MoveGripper(0.5), "the gripper needs the arm enabled")
    assert rig.now.state is State.OFF
    assert rig.driver.writes == []


def test_homing_tells_how_far_it_is_and_ends_holding_where_it_ended(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    assert any("Gripper looks for its zero (1 of 6)" in text for text in rig.now.warnings)
    rig.driver.find(5, 1, then=2)
    rig.run(0.1)
    assert any("Elbow looks for its zero (3 of 6)" in text for text in rig.now.warnings)
    assert [axis.title for axis in rig.now.homing if axis.homed] == ["Shoulder", "Gripper"]
    assert [axis.title for axis in rig.now.homing if axis.running] == ["Elbow"]
    rig.driver.find(*AXES)
    rig.run(0.1)
    ticket.result(0)
    assert rig.now.state is State.HOLDING
    assert rig.now.q_command == pytest.approx(SCORBOT.pose("home"), abs=1e-9)
    assert rig.now.gripper == 0.0
    assert rig.now.warnings == ()
    told = [text.split()[1] for text in rig.texts if "looks for its zero" in text]
    assert told == ["Gripper", "Elbow"]  # each once, as it begins
    assert rig.driver.writes == []  # the board holds by itself


def coarse_at_its_limit() -> Robot:
    """A Scorbot whose waist has two counts a degree, and its home at its lower limit."""
    outputs, low = SCORBOT.output_map, SCORBOT.limits[0]
    per_rad, zero = outputs.per_rad.copy(), outputs.zero.copy()
    least, most = outputs.low.copy(), outputs.high.copy()
    per_rad[0] = np.degrees(2.0)
    zero[0], least[0], most[0] = -per_rad[0] * low[0], 0.0, per_rad[0] * (low[1] - low[0])
    return replace(SCORBOT, output_map=replace(outputs, per_rad=per_rad, zero=zero, low=least, high=most))


@pytest.mark.parametrize("noise", [-1.0, 0.0, 1.0])
def test_a_home_at_a_limit_may_waver_by_a_count(noise: float) -> None:
    robot = coarse_at_its_limit()
    rig = make_homing_rig(robot)
    rig.driver.counts[0] = noise  # half a degree
    home(rig)
    assert rig.now.state is State.HOLDING
    assert rig.now.q_command[0] == pytest.approx(robot.limits[0, 0] + max(noise, 0.0) / np.degrees(2.0))


def test_two_counts_between_two_readings_are_no_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = home(make_homing_rig(coarse_at_its_limit()))
    rig.do(Release()).result(0)
    read, counts = rig.driver.read, itertools.cycle([-1.0, 1.0])

    def wavering() -> Readback:
        rig.driver.counts[0] = next(counts)
        return read()

    monkeypatch.setattr(rig.driver, "read", wavering)
    rig.refuses(Enable(), "two readings of the board differ")


def test_a_doubtful_zero_from_before_does_not_end_homing(homed: Rig) -> None:
    homed.do(HomeAxes())
    homed.driver.find(*AXES)  # what a late status line of before would say
    homed.run(0.1)
    assert homed.now.state is State.MOVING


def test_an_axis_that_finds_no_switch_is_named(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    rig.driver.trip(1, "the home switch was not found")
    rig.run(0.1)
    fails(ticket.finished, "before every axis had its zero: Shoulder: the home switch", BoardError)
    assert rig.now.state is State.OFF


def test_an_arm_that_homing_leaves_outside_its_limits_is_off_and_says_so(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    rig.driver.counts[0] = 141.8888 * 160
    rig.driver.find(*AXES)
    rig.run(0.1)
    fails(ticket.finished, r"Waist stands at 160\.0°")
    assert rig.now.state is State.OFF
    assert "Waist stands at 160.0°" in rig.now.cause
    assert rig.do(HomeAxes()).accepted.done()


def test_a_trip_while_holding_is_a_fault_in_words_and_nothing_goes_on_by_itself(homed: Rig) -> None:
    homed.do(MoveJoints(REST))
    homed.run(0.3)
    homed.driver.trip(2, "it stalled: full drive without movement")
    homed.run(0.1)
    assert homed.now.state is State.FAULT
    assert "Elbow: it stalled" in homed.now.cause
    homed.sends_nothing(1.0)
    homed.do(ClearFault()).result(0)
    assert "release" in homed.driver.calls
    assert homed.now.state is State.OFF
    homed.do(Enable()).result(0)
    assert homed.now.state is State.HOLDING


def test_zeros_lost_while_holding_are_a_fault(homed: Rig) -> None:
    homed.driver.homed[2] = False
    homed.tick()
    assert homed.now.state is State.FAULT
    assert "Elbow" in homed.now.cause
    homed.do(ClearFault()).result(0)
    assert homed.now.state is State.OFF
    homed.refuses(Enable(), "press Homing")


def test_enable_keeps_the_arm_where_the_encoders_say_it_is_unless_that_is_outside(homed: Rig) -> None:
    homed.do(Release()).result(0)
    homed.driver.counts[0] = 141.8888 * 160
    homed.run(0.1)
    homed.refuses(Enable(), r"Waist stands at 160\.0°, outside .* or press Homing")
    homed.driver.counts[0] = 141.8888 * 7
    homed.do(Enable()).result(0)
    assert np.degrees(homed.now.q_command[0]) == pytest.approx(7.0)
    assert "encoders say where the arm is" in homed.now.cause


def test_servos_have_nothing_to_home(holding: Rig) -> None:
    assert holding.now.homing == ()
    holding.refuses(HomeAxes(), "nothing to home.*go_pose")
    assert holding.now.state is State.HOLDING


def test_homing_is_refused_while_the_arm_moves(homed: Rig) -> None:
    homed.do(MoveJoints(REST))
    homed.run(0.2)
    homed.refuses(HomeAxes(), "homing needs the arm off or holding, it is moving")


def test_a_board_that_does_not_begin_to_home_leaves_the_arm_as_it_was(homed: Rig) -> None:
    q = homed.now.q_command
    homed.driver.fail["home"] = StateError("the board is busy")
    homed.refuses(HomeAxes(), "busy")
    assert homed.now.state is State.HOLDING
    assert np.array_equal(homed.now.q_command, q)


def test_an_arm_that_stands_away_from_its_setpoint_is_told(homed: Rig) -> None:
    homed.driver.counts[1] += 2 * 113.5555
    homed.run(1.0)
    assert any("does not stand where it was told (Shoulder by 2.0°)" in text for text in homed.now.warnings)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (MoveGripper(0.5), "the gripper needs the arm enabled, it is moving"),
        (Enable(), r"enable needs the arm off, it is moving \(homing \(test\)\)"),
        (Pause(), "homing cannot be paused; press STOP"),
    ],
)
def test_what_is_refused_while_the_board_homes(homing: Rig, command: Command, words: str) -> None:
    homing.refuses(command, words)
    homing.run(0.1)
    assert homing.now.state is State.MOVING
    assert homing.driver.writes == []


def test_a_gripper_on_its_way_is_told_that_homing_took_its_place(homed: Rig) -> None:
    moving = homed.do(MoveGripper(1.0))
    homed.do(HomeAxes())
    fails(moving.finished, "the arm is being homed")
    homed.run(0.4)
    assert homed.now.state is State.MOVING


@pytest.mark.parametrize("confirms", [True, False])
def test_another_fault_ends_homing_and_a_board_that_goes_on_is_left_to_its_watchdog(
    homing: Rig, confirms: bool
) -> None:
    if not confirms:
        homing.driver.fail["stop"] = BoardTimeoutError("it does not hold")
    homing.controller._core.fault(ArmctlError("something broke"))
    homing.tick()
    assert homing.now.state is State.FAULT
    assert homing.now.cause == "something broke" + ("" if confirms else "; and it does not hold")
    assert (homing.driver.running is None) == confirms
    assert (homing.now.board is not None) == confirms  # else no host speaks to it: its motors go off


@pytest.mark.parametrize("trouble", ["readings fail", "the tick is late"])
def test_stop_reaches_the_board_whatever_else_is_wrong(homing: Rig, trouble: str) -> None:
    if trouble == "readings fail":
        homing.driver.fail["read"] = BoardTimeoutError("no status")
        homing.run(0.1)
        assert homing.now.state is State.MOVING
    homing.controller.stop(TEST)
    homing.tick(0.02 if trouble == "readings fail" else 0.3)
    assert homing.driver.running is None
    assert homing.driver.calls.count("stop") == 1


def test_a_stop_that_the_board_does_not_confirm_is_a_fault_and_is_answered(homing: Rig) -> None:
    homing.driver.fail["stop"] = BoardTimeoutError("it does not hold; cut the motors' power")
    first, second = homing.controller.stop(TEST), homing.controller.stop(TEST)
    homing.tick()
    first.result(0)
    second.result(0)
    assert homing.now.state is State.FAULT
    assert homing.now.cause == "it does not hold; cut the motors' power"
    assert homing.driver.calls.count("stop") == 1
    assert homing.driver.calls[-1] == "close"


@pytest.mark.parametrize("fails_to", [False, True])
def test_stop_ends_homing_that_somebody_else_began(rig: Rig, fails_to: bool) -> None:
    rig.driver.home()
    rig.tick()
    assert rig.now.state is State.OFF
    if fails_to:
        rig.driver.fail["stop"] = BoardTimeoutError("it does not hold")
    rig.controller.stop(TEST)
    rig.tick()
    assert rig.now.state is (State.FAULT if fails_to else State.OFF)
    assert (rig.driver.running is not None) == fails_to


def test_stop_says_nothing_to_a_board_that_stands(homed: Rig) -> None:
    homed.controller.stop(TEST)
    homed.run(0.1)
    assert "stop" not in homed.driver.calls


def test_release_ends_homing(homing: Rig) -> None:
    homing.do(Release()).result(0)
    homing.run(0.5)
    assert homing.now.state is State.OFF
    assert not homing.driver.on
    assert not homing.now.powered


def test_disconnect_waits_until_homing_has_ended(homing: Rig) -> None:
    ticket = homing.do(Disconnect())
    assert homing.driver.running is None
    homing.run(0.5)
    ticket.result(0)
    assert homing.now.state is State.DISCONNECTED
    assert homing.driver.calls.index("stop") < homing.driver.calls.index("close")


def test_release_while_a_disconnect_waits_for_the_arm(homing: Rig) -> None:
    leaving = homing.do(Disconnect())
    homing.do(Release()).result(0)
    leaving.result(0)
    assert homing.now.state is State.DISCONNECTED
    assert any("RELEASE (test): motors off" in text for text in homing.texts)
    assert not any("internal error" in text for text in homing.texts)


def test_a_late_tick_does_not_say_that_homing_was_halted(homing: Rig) -> None:
    homing.tick(elapsed=0.3)
    homing.run(0.1)
    assert not any("halted" in text for text in homing.now.warnings)


def test_clearing_a_fault_never_drops_an_arm_that_is_held() -> None:
    """The last reading may say that the pulses are off: one garbled answer is no proof."""
    rig = make_rig().enable()
    says_off = rig.driver

    def read() -> Readback:
        return Readback(dict(says_off.positions), Source.COMMANDED, powered=False)

    says_off.read = read  # type: ignore[method-assign]
    rig.tick()
    rig.controller._core.fault(StateError("something broke"))
    calls = len(says_off.calls)
    rig.do(ClearFault()).result(0)
    assert "release" not in says_off.calls[calls:]
    assert rig.now.state is State.HOLDING
