"""What goes wrong while the board moves the arm by itself: it must always be possible to stop it."""

from __future__ import annotations

import pytest
from tests.runtime.homing_kit import AXES, home, make_homing_rig
from tests.runtime.kit import TEST, Rig, make_rig

from armctl.errors import ArmctlError, BoardError, BoardTimeoutError, StateError
from armctl.hardware import Readback, Source
from armctl.runtime import (
    ClearFault,
    Disconnect,
    Enable,
    HomeAxes,
    MoveGripper,
    Pause,
    Release,
    State,
)


@pytest.fixture
def rig() -> Rig:
    return make_homing_rig()


@pytest.fixture
def homing(rig: Rig) -> Rig:
    rig.do(HomeAxes())
    rig.run(0.4)
    assert rig.now.state is State.MOVING
    return rig


def test_the_gripper_is_not_moved_while_the_board_homes(homing: Rig) -> None:
    homing.refuses(MoveGripper(0.5), "the gripper needs the arm enabled, it is moving")
    homing.run(0.1)
    assert homing.now.state is State.MOVING
    assert homing.driver.writes == []


def test_whatever_else_breaks_ends_homing_too(homing: Rig) -> None:
    homing.controller._core.fault(ArmctlError("something broke"))
    homing.tick()
    assert homing.now.state is State.FAULT
    assert homing.driver.running is None
    assert homing.driver.calls[-1] != "close"


def test_a_board_that_does_not_stop_in_a_fault_is_left_to_its_watchdog(homing: Rig) -> None:
    homing.driver.fail["stop"] = BoardTimeoutError("it does not hold")
    homing.controller._core.fault(ArmctlError("something broke"))
    homing.tick()
    assert homing.now.state is State.FAULT
    assert homing.now.cause == "something broke; and it does not hold"
    assert homing.now.board is None  # nobody talks to it any more: it switches its motors off


def test_stop_reaches_a_board_whose_readings_fail(homing: Rig) -> None:
    homing.driver.fail["read"] = BoardTimeoutError("no status")
    homing.run(0.1)
    assert homing.now.state is State.MOVING
    homing.controller.stop(TEST)
    homing.tick()
    assert homing.driver.running is None
    assert homing.driver.calls.count("stop") == 1


def test_stop_reaches_the_board_in_a_tick_that_is_late(homing: Rig) -> None:
    homing.controller.stop(TEST)
    homing.tick(elapsed=0.3)
    assert homing.driver.running is None


def test_a_stop_that_the_board_does_not_confirm_is_a_fault_and_is_answered(homing: Rig) -> None:
    homing.driver.fail["stop"] = BoardTimeoutError("it does not hold; cut the motors' power")
    first, second = homing.controller.stop(TEST), homing.controller.stop(TEST)
    homing.tick()
    first.finished.result(0)
    second.finished.result(0)
    assert homing.now.state is State.FAULT
    assert homing.now.cause == "it does not hold; cut the motors' power"
    assert homing.driver.calls.count("stop") == 1
    assert homing.driver.calls[-1] == "close"


def test_stop_ends_homing_that_somebody_else_began(rig: Rig) -> None:
    assert rig.now.state is State.OFF
    rig.driver.home()
    rig.tick()
    rig.controller.stop(TEST)
    rig.tick()
    assert rig.driver.running is None


def test_stop_says_nothing_to_a_board_that_stands(rig: Rig) -> None:
    home(rig)
    rig.controller.stop(TEST)
    rig.run(0.1)
    assert "stop" not in rig.driver.calls


def test_release_ends_homing(homing: Rig) -> None:
    ticket = homing.do(Release())
    ticket.finished.result(0)
    homing.run(0.5)
    assert homing.now.state is State.OFF
    assert not homing.driver.on
    assert not homing.now.powered


def test_disconnect_waits_until_homing_has_ended(homing: Rig) -> None:
    ticket = homing.do(Disconnect())
    assert homing.driver.running is None
    homing.run(0.5)
    ticket.finished.result(0)
    assert homing.now.state is State.DISCONNECTED
    assert homing.driver.calls.index("stop") < homing.driver.calls.index("close")


def test_release_while_a_disconnect_waits_for_the_arm(homing: Rig) -> None:
    leaving = homing.do(Disconnect())
    homing.do(Release()).finished.result(0)
    leaving.finished.result(0)
    assert homing.now.state is State.DISCONNECTED
    assert any("RELEASE (test): motors off" in text for text in homing.texts)
    assert not any("internal error" in text for text in homing.texts)


def test_closing_the_controller_ends_homing(homing: Rig) -> None:
    homing.controller.stop(TEST)  # as the thread does when it is told to close
    homing.run(0.4)
    homing.controller.close()
    assert homing.driver.running is None
    assert homing.now.state is State.DISCONNECTED


def test_enable_says_that_the_arm_is_being_homed(homing: Rig) -> None:
    with pytest.raises(StateError, match=r"enable needs the state off, it is moving \(homing \(test\)\)"):
        homing.do(Enable()).finished.result(0)


def test_homing_cannot_be_paused_and_says_so(homing: Rig) -> None:
    homing.refuses(Pause(), "homing cannot be paused; press STOP")


def test_a_gripper_on_its_way_hears_that_homing_took_its_place(rig: Rig) -> None:
    home(rig)
    moving = rig.do(MoveGripper(1.0))
    rig.do(HomeAxes())
    with pytest.raises(StateError, match="the arm is being homed"):
        moving.finished.result(0)
    rig.run(0.4)
    assert rig.now.state is State.MOVING


def test_an_arm_that_homing_leaves_outside_its_limits_is_off_and_says_so(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    rig.driver.counts[0] = 141.8888 * 160
    rig.driver.find(*AXES, then=None)
    rig.run(0.1)
    with pytest.raises(StateError, match=r"Waist stands at 160\.0°"):
        ticket.finished.result(0)
    assert rig.now.state is State.OFF
    assert "Waist stands at 160.0°" in rig.now.cause
    home_again = rig.do(HomeAxes())
    assert home_again.accepted.done()


def test_zeros_lost_while_holding_are_a_fault(rig: Rig) -> None:
    home(rig)
    rig.driver.homed[2] = False
    rig.tick()
    assert rig.now.state is State.FAULT
    assert "Elbow" in rig.now.cause
    rig.do(ClearFault()).finished.result(0)
    assert rig.now.state is State.OFF
    rig.refuses(Enable(), "press Homing")


def test_a_late_tick_does_not_say_that_homing_was_halted(homing: Rig) -> None:
    homing.tick(elapsed=0.3)
    homing.run(0.1)
    assert not any("halted" in text for text in homing.now.warnings)


def test_clearing_a_fault_never_drops_an_arm_that_is_held() -> None:
    """The last reading may be from before Enable, and say that the pulses are off."""
    rig = make_rig()
    says_off = rig.driver

    def read() -> Readback:
        return Readback(dict(says_off.positions), Source.COMMANDED, powered=False)

    says_off.read = read  # type: ignore[method-assign]
    rig.enable()
    rig.controller._core.fault(StateError("something broke"))
    calls = len(says_off.calls)
    rig.do(ClearFault()).finished.result(0)
    assert "release" not in says_off.calls[calls:]
    assert rig.now.state is State.HOLDING


def test_the_board_is_lost_while_it_homes(homing: Rig) -> None:
    homing.driver.fail["read"] = BoardTimeoutError("no status")
    homing.run(2.0)
    assert homing.now.state is State.FAULT
    assert "lost the board" in homing.now.cause
    assert homing.driver.calls[-1] == "close"


def test_a_board_that_resets_while_it_homes_is_told(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    rig.run(0.2)
    rig.driver.on, rig.driver.running = False, None
    rig.driver.errors = ("the board has started anew",)
    rig.run(0.2)
    with pytest.raises(BoardError, match="homing ended before every axis had its zero"):
        ticket.finished.result(0)
    assert rig.now.state is State.OFF
