from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, Rig, fails, make_rig

from armctl.errors import BoardError, BoardTimeoutError, InputError, MotionRefusedError, PortError
from armctl.facts import Quantities, State
from armctl.hardware import BoardIdentity, Readback, Source
from armctl.protocol import Connect, Disconnect, Enable, MoveGripper, MoveJoints, Release
from armctl.robot import load_robot
from armctl.robot.parts import Obstacle
from armctl.runtime.power import _links_turned_back

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")


def pulses(q: np.ndarray) -> dict[int, float]:
    return ROBOT.output_map.outputs(q)


def connected(rig: Rig, positions: dict[int, float]) -> Rig:
    """To a board that sends these pulses."""
    rig.driver.positions = positions
    rig.do(Connect("sim")).result(0)
    return rig


def test_connecting_moves_nothing_and_sets_the_channels(rig: Rig) -> None:
    assert rig.now.state is State.DISCONNECTED
    assert np.array_equal(rig.now.q_command, REST)
    assert np.isnan(rig.now.q).all()
    assert not rig.now.powered
    rig.do(Connect("sim")).result(0)
    assert rig.now.state is State.OFF
    assert rig.now.cause == "connected; pulses are off"
    said = [event.text for event in rig.now.events]
    assert "connected to simulated recording board at sim (test)" in said
    assert rig.driver.writes == []
    base, gripper = rig.driver.settings[0], rig.driver.settings[5]
    assert (base.channel, base.minimum, base.maximum) == (0, 554, 2446)
    assert base.speed == pytest.approx(1.5 * 60 * 9)  # µs/s: half as fast again as the joint may turn
    assert base.acceleration is None
    assert (gripper.channel, gripper.minimum, gripper.maximum) == (5, 1000, 2000)
    assert gripper.speed == pytest.approx(1.5 * 2.0 * 1000)


@pytest.mark.parametrize(("wanted", "sent"), [(None, REST), (HOME, HOME)])
def test_enable_sends_the_pose_once(rig: Rig, wanted: np.ndarray | None, sent: np.ndarray) -> None:
    rig.enable(wanted)
    assert rig.now.state is State.HOLDING
    assert rig.now.powered
    rig.run(1)
    rig.do(Enable()).result(0)
    assert [values for _, values in rig.driver.writes] == [pulses(sent)]
    np.testing.assert_allclose(rig.now.q, sent, atol=1e-12)
    assert rig.now.source is Source.TRANSMITTED


@pytest.mark.parametrize(
    ("q", "error", "message"),
    [
        (np.radians([0, 90, -91.2, 0, 0]), MotionRefusedError, "Elbow: -91.20° is outside"),
        (np.radians([0, -3, -60, -20, 0]), MotionRefusedError, "the left jaw: .* mm below the floor"),
        (np.full(5, np.nan), InputError, "finite"),
        (np.zeros(3), InputError, "5 joint angles"),
    ],
)
def test_enable_in_an_impossible_pose_is_refused(
    rig: Rig, q: np.ndarray, error: type[Exception], message: str
) -> None:
    connected(rig, {}).refuses(Enable(q), message, error)
    assert rig.driver.writes == []
    assert rig.now.state is State.OFF


def test_pulses_that_are_on_already_are_taken_over_without_a_jump(rig: Rig) -> None:
    connected(rig, {**pulses(HOME), 5: 1500.0})
    assert rig.now.powered
    assert "its pulses are on already: Enable takes the arm over" in rig.now.cause
    rig.do(Enable()).result(0)
    np.testing.assert_allclose(rig.now.q_command, HOME, atol=1e-12)
    assert [values for _, values in rig.driver.writes] == [pytest.approx(pulses(HOME))]
    assert rig.now.gripper == pytest.approx(0.5)
    assert "the arm is, it stays there" in rig.now.cause


def test_where_only_some_are_on_these_stay_and_the_others_come_on(rig: Rig) -> None:
    home = pulses(HOME)
    connected(rig, {0: home[0], 1: home[1]}).finishes(Enable())
    np.testing.assert_allclose(rig.now.q_command, [*HOME[:2], *REST[2:]], atol=1e-12)
    assert any("Base, Shoulder stay, the others come on" in text for text in rig.texts)


def test_enabled_where_it_stands_and_not_in_the_pose_asked_for_is_a_warning(rig: Rig) -> None:
    connected(rig, pulses(HOME)).finishes(Enable(REST))
    np.testing.assert_allclose(rig.now.q_command, HOME, atol=1e-12)
    assert any("enabled where the arm stands" in text for text in rig.texts)


def test_a_joint_that_stands_outside_its_limits_is_not_taken_over(rig: Rig) -> None:
    connected(rig, {**pulses(HOME), 2: 602.0 - 20})
    rig.refuses(Enable(), r"Elbow stands at -86\.4°, outside -84\.4° … 95\.1°; support")
    assert rig.driver.writes == []


def test_joints_do_not_jump_to_below_the_floor_under_those_that_stay(rig: Rig) -> None:
    low = np.radians([0, -3, -60, -20, 0])
    connected(rig, {channel: pulse for channel, pulse in pulses(low).items() if channel < 3})
    rig.refuses(Enable(np.where([1, 1, 1, 0, 0], HOME, low)), "mm below the floor", MotionRefusedError)
    assert rig.driver.writes == []


def test_joints_do_not_jump_into_an_obstacle() -> None:
    tip = ROBOT.forward(HOME)[:3, 3]
    post = Obstacle("the post", tip - 0.02, tip + 0.02)
    rig = connected(make_rig(robot=replace(ROBOT, obstacles=(post,))), {})
    rig.refuses(Enable(HOME), r"mm inside the post; choose another pose to enable in", MotionRefusedError)
    assert rig.driver.writes == []


def test_two_readings_that_differ_are_not_taken_over(rig: Rig) -> None:
    connected(rig, pulses(HOME))
    readings = iter([pulses(REST), pulses(HOME)])
    rig.driver.read = lambda: Readback(next(readings), Source.TRANSMITTED)  # type: ignore[method-assign]
    ticket = rig.controller.submit(Enable())
    rig.controller.tick()
    fails(ticket.finished, r"two readings of the board differ \(Shoulder, Wrist pitch\)")
    assert rig.driver.writes == []
    assert rig.now.state is State.OFF


def test_enable_on_a_board_that_is_silent_for_once_may_be_tried_again(rig: Rig) -> None:
    rig.driver.fail["read"] = BoardTimeoutError("no answer")
    connected(rig, pulses(HOME))
    assert rig.now.cause.endswith("it has not said yet whether its pulses are on")
    rig.refuses(Enable(), "did not answer where it is; try again")
    rig.driver.fail.clear()
    rig.finishes(Enable())
    assert rig.now.state is State.HOLDING


def test_a_gripper_that_stands_beyond_its_range_is_taken_over(rig: Rig) -> None:
    connected(rig, {**pulses(HOME), 5: 2100.0}).do(Enable()).result(0)
    assert rig.now.gripper == 1.0
    rig.do(MoveGripper(0.5))
    rig.run(1)
    assert rig.now.state is State.HOLDING
    assert rig.now.gripper == 0.5


def test_release_drops_the_arm_at_once_even_while_it_moves(holding: Rig) -> None:
    motion = holding.do(MoveJoints(HOME))
    holding.run(0.2)
    count = len(holding.driver.writes)
    holding.do(Release()).result(0)
    assert holding.now.state is State.OFF
    assert not holding.now.powered
    assert holding.driver.positions == {}
    assert len(holding.driver.writes) <= count + 1
    fails(motion.finished, r"released \(test\)")
    holding.run(1)
    assert holding.now.state is State.OFF
    holding.finishes(Enable())


def test_pulses_that_go_on_after_a_release_are_told(holding: Rig) -> None:
    holding.driver.release = lambda: None  # type: ignore[method-assign]  # lost on the line
    holding.do(Release())
    holding.run(0.1)
    assert holding.now.state is State.OFF
    assert holding.now.powered
    (warning,) = holding.now.warnings
    on = "the board's outputs are still on (Base, Shoulder, Elbow, Wrist pitch, Wrist roll)"
    assert warning.startswith(on)
    holding.driver.positions.clear()
    holding.tick()
    assert holding.now.warnings == ()


def test_disconnecting_leaves_the_outputs_on(holding: Rig) -> None:
    holding.do(Disconnect()).result(0)
    assert holding.now.state is State.DISCONNECTED
    assert holding.driver.calls[-1] == "close"
    assert "release" not in holding.driver.calls
    holding.enable()
    assert "it stays there" in holding.now.cause


def test_disconnecting_while_moving_waits_for_a_standstill(holding: Rig) -> None:
    motion = holding.do(MoveJoints(HOME))
    holding.run(0.4)
    leaving = holding.do(Disconnect())
    assert not leaving.finished.done()
    holding.refuses(MoveGripper(1.0), "disconnecting")
    holding.until(lambda s: s.state is State.DISCONNECTED, seconds=1)
    leaving.result(0)
    fails(motion.finished, "stopped by disconnect")


def test_a_port_that_is_not_there(rig: Rig) -> None:
    rig.driver.fail["open"] = PortError("/dev/ttyACM0: no such port")
    rig.refuses(Connect("/dev/ttyACM0"), "no such port", PortError)
    assert rig.now.state is State.DISCONNECTED
    assert rig.now.cause == "/dev/ttyACM0: no such port"
    assert rig.driver.calls[-1] == "close"
    rig.driver.fail.clear()
    rig.enable()


def test_what_is_no_armctl_error_is_translated_with_its_cause(rig: Rig) -> None:
    rig.driver.fail["configure"] = OSError(5, "Input/output error")
    error = rig.do(Connect("sim")).finished.exception(0)
    assert isinstance(error, BoardError) and isinstance(error.__cause__, OSError)
    assert str(error).startswith("setting the channels: OSError: [Errno 5]")
    assert rig.now.board is None


def test_an_arm_without_a_servo_map_is_driven_on_a_simulated_board_only() -> None:
    rig = make_rig(robot=replace(ROBOT, output_map=None, gripper=None)).enable()
    assert rig.now.state is State.HOLDING
    assert rig.now.board is not None and rig.now.board.title == "simulated board"  # of no kind
    rig.do(Disconnect())
    rig.driver.open = lambda: BoardIdentity("real board", "/dev/ttyACM0")  # type: ignore[method-assign]
    rig.refuses(Connect("/dev/ttyACM0"), r"uzuner has no servo map: .* only the simulated board")
    assert rig.now.state is State.DISCONNECTED
    assert rig.driver.calls[-1] == "close"


def test_what_a_board_measures_beside_the_positions_is_shown_by_joint(rig: Rig) -> None:
    heat = {0: 41.2, 1: 40.0}
    back = Readback({}, Source.MEASURED, load={0: -0.123}, temperature=heat, voltage={1: 7.44})
    rig.driver.read = lambda: back  # type: ignore[method-assign]
    rig.do(Connect("sim")).result(0)
    assert rig.now.measured == {"Base": "load −12 %, 41 °C", "Shoulder": "40 °C, 7.4 V"}
    assert rig.now.quantities["Base"] == Quantities(load=-0.123, temperature_c=41.2)
    back = Readback({}, Source.MEASURED, temperature={0: None, 1: 40.0}, faults=None)  # type: ignore[arg-type]
    rig.run(0.5)
    assert (rig.now.measured, rig.now.state) == ({"Shoulder": "40 °C"}, State.OFF)


def test_positions_that_are_no_numbers_are_refused_as_the_boards(rig: Rig) -> None:
    rig.driver.read = lambda: Readback({0: "x"}, Source.MEASURED)  # type: ignore
    rig.refuses(Connect("sim"), "reading back: ", BoardError)
    assert rig.driver.calls[-1] == "close"


def test_what_is_known_of_a_board_is_no_warning_what_it_had_reported_is(rig: Rig) -> None:
    identity = BoardIdentity(
        "recording board", "sim", simulated=True, notes=("it has no watchdog",), earlier=("it had sagged",)
    )
    rig.driver.open = lambda: identity  # type: ignore[method-assign]
    rig.do(Connect("sim")).result(0)
    levels = {event.text: event.level for event in rig.now.events}
    assert (levels["it has no watchdog"], levels["it had sagged"]) == ("info", "warning")


def test_readings_hardly_beyond_an_angle_between_links_are_taken_for_the_limit() -> None:
    chain = load_robot("mearm").chain
    (limit,) = chain.turn_limits
    row = chain.turns(np.eye(chain.n)).T[limit.link]
    tolerance = np.full(chain.n, np.radians(0.25))
    for beyond_deg, taken in ((0.1, True), (0.4, True), (2.0, False)):
        for turn in (limit.lower - np.radians(beyond_deg), limit.upper + np.radians(beyond_deg)):
            q = turn * row / (row @ row)
            back = _links_turned_back(chain, q, tolerance)
            assert bool(chain.keeps_turns(back)) is taken
            assert np.abs(back - q).max() <= np.radians(beyond_deg)
