"""The controller on a simulated Feetech bus: taking over, sag, joints that a hand leads, and what is told."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from tests.faults.kit import PORT, Bench
from tests.hardware.bus_kit import LEAD_S
from tests.runtime.kit import TEST

from armctl.errors import EnableError, MotionRefusedError, StateError
from armctl.facts import State
from armctl.hardware import Source
from armctl.hardware.bus.packets import Instruction
from armctl.hardware.feetech.make import OVERLOAD, FeetechMake
from armctl.protocol import ClearFault, Connect, Enable, LimitTorque, MoveJoints, Release, SetSpeed
from armctl.runtime.releasing import LETTING_DOWN_S


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench("feetech")
    bench.does(Connect(PORT), State.OFF)
    yield bench
    bench.close()


@pytest.fixture
def holding(bench: Bench) -> Bench:
    bench.does(Enable(), State.HOLDING)
    return bench


def refused(bench: Bench, command: object) -> Exception:
    ticket = bench.controller.submit(command, TEST)  # type: ignore[arg-type]
    bench.run(0.2)
    error = ticket.finished.exception(0)
    assert error is not None
    return error


def lead(bench: Bench, joint: int, degrees: float) -> None:
    """A hand turns a joint within half a second, and holds it there."""
    one = bench.board.plant.joints[joint]
    one.hand = np.radians(degrees) / 0.5
    bench.run(0.5)
    one.hand = 0.0
    bench.run(0.1)


def test_the_arm_is_taken_over_where_it_is_measured(bench: Bench):
    before = [one.shaft for one in bench.board.servos]
    bench.does(Enable(), State.HOLDING)
    bench.run(1.0)
    assert [one.shaft for one in bench.board.servos] == pytest.approx(before, abs=3)
    assert bench.now.source is Source.MEASURED
    assert np.abs(bench.now.q - bench.now.q_command).max() < np.radians(0.5)
    assert bench.now.quantities["Elbow flex"].voltage_v == pytest.approx(12.0, abs=0.5)


def test_a_move_ends_where_it_was_sent_but_for_the_sag_which_is_no_fault(holding: Bench):
    goal = holding.robot.pose("home")
    holding.does(MoveJoints(goal), State.HOLDING)
    holding.run(2.0)
    assert np.abs(holding.now.q - goal).max() < np.radians(5.0)
    assert not [one for one in holding.now.warnings if "does not stand" in one]


def test_a_joint_that_torque_would_throw_is_named_and_the_arm_stays_limp():
    bench = Bench("feetech")
    bench.board.servo(2).put("lowest", 1500)
    bench.does(Connect(PORT), State.OFF)
    error = refused(bench, Enable())
    assert isinstance(error, EnableError)
    assert "Shoulder lift: servo 2 stands at" in str(error)
    assert not any(one.driven for one in bench.board.servos)
    assert bench.now.state is State.OFF
    bench.close()


def test_a_servo_that_is_missing_is_named_by_its_joint(bench: Bench):
    bench.board.loose = 4
    bench.run(1.0)
    error = refused(bench, Enable())
    assert "Wrist roll: servo 5 does not answer" in str(error)
    assert not any(one.driven for one in bench.board.servos)


def test_joints_that_a_hand_leads_are_recorded_where_they_stand(holding: Bench):
    holding.does(Release(("wrist_flex",)), State.HOLDING)
    lead(holding, 3, -20.0)
    now = holding.now
    assert now.limp == ("Wrist flex",)
    led = np.degrees(now.q_command[3])
    assert led == pytest.approx(np.degrees(holding.robot.pose("rest")[3]) - 20.0, abs=1.5)
    assert now.q_command[0] == pytest.approx(0.0, abs=np.radians(0.5))
    with pytest.raises(StateError):
        raise refused(holding, MoveJoints(holding.robot.pose("home")))
    holding.board.plant.joints[3].hand = None
    before = holding.board.servo(4).shaft
    holding.does(Enable(), State.HOLDING)
    holding.run(0.5)
    assert holding.now.limp == ()
    assert holding.board.servo(4).shaft == pytest.approx(before, abs=25)  # it sags from the hand


def test_torque_comes_back_only_where_the_led_arm_touches_nothing(
    holding: Bench, monkeypatch: pytest.MonkeyPatch
):
    holding.does(Release(("elbow_flex",)), State.HOLDING)
    lead(holding, 2, -5.0)
    from armctl.facts import Said

    monkeypatch.setattr("armctl.runtime.power.touching", lambda *_: Said("hand touches base"))
    error = refused(holding, Enable())
    assert isinstance(error, MotionRefusedError) and "hand touches base" in str(error)
    assert not holding.board.servo(3).driven


def test_a_supply_that_was_interrupted_leaves_the_arm_limp_until_it_is_enabled(holding: Bench):
    holding.line.reset()
    holding.run(1.0)
    assert holding.now.state is State.FAULT
    assert "their supply was interrupted" in holding.now.cause
    assert not any(one.driven for one in holding.board.servos)
    holding.does(ClearFault(), State.OFF)
    holding.does(Enable(), State.HOLDING)
    assert all(one.driven for one in holding.board.servos)


def test_a_torque_limit_outlives_a_power_cut(holding: Bench):
    holding.does(LimitTorque(0.4, ("wrist_roll",)), State.HOLDING)
    assert holding.board.servo(5).get("torque_limit") == 400
    holding.line.reset()
    holding.run(1.0)
    holding.does(ClearFault(), State.OFF)
    holding.does(Enable(), State.HOLDING)
    assert [holding.board.servo(one).get("torque_limit") for one in (1, 5)] == [1000, 400]


@pytest.mark.parametrize(("share", "most_deg"), [(1.0, 7.5), (0.4, 3.0)])
def test_a_killed_host_leaves_the_arm_at_its_last_goal(holding: Bench, share: float, most_deg: float):
    """No watchdog: the servos go on to the last goal that they were sent, which is a few degrees away."""
    holding.does(MoveJoints(np.radians([-85, -60, 60, 0, 0])), State.HOLDING)
    holding.does(SetSpeed(share), State.HOLDING, seconds=0.02)
    holding.ask(MoveJoints(np.radians([85, -60, 60, 0, 0]), profile="trapezoid"))
    holding.run(0.9 / share)
    pan, servo = holding.board.plant.joints[0], holding.board.servo(1)
    began, speed = pan.angle, pan.speed
    assert speed > 0.85 * share * float(holding.robot.speed_limits[0])
    holding.start()  # another process; nobody speaks to the board meanwhile
    holding.clock.advance(1.0)
    holding.board.advance(holding.clock.now())
    assert 0.0 < pan.angle - began < speed * LEAD_S
    assert np.degrees(pan.angle - began) < most_deg
    assert servo.shaft == pytest.approx(servo.get("goal_position"), abs=12)  # no farther: on its path
    assert all(one.driven for one in holding.board.servos)


def test_goals_are_sent_before_what_takes_milliseconds_is_read(holding: Bench):
    holding.ask(MoveJoints(holding.robot.pose("home")))
    holding.run(0.5)
    holding.board.heard.clear()
    holding.tick()
    assert [one.code for one in holding.board.heard] == [Instruction.SYNC_WRITE, Instruction.SYNC_READ]


def shares(bench: Bench) -> list[float]:
    """The shares of its torque that the arm had, one after the other."""
    return [given[0] for _, what, given in bench.log if what == "scale"]


def test_a_release_lets_the_arm_sink_within_a_second_then_its_torque_is_off_and_whole_again(holding: Bench):
    holding.does(MoveJoints(holding.robot.pose("home")), State.HOLDING)
    elbow, began = holding.board.plant.joints[2], holding.clock.now()
    ticket = holding.controller.submit(Release(), TEST)
    fastest = 0.0
    while not ticket.finished.done():
        assert any("support it" in one for one in holding.tick().warnings) or holding.now.state is State.OFF
        fastest = max(fastest, abs(elbow.speed))
    assert ticket.finished.exception(0) is None
    assert holding.clock.now() - began == pytest.approx(LETTING_DOWN_S, abs=0.1)
    assert (holding.now.state, holding.now.cause) == (State.OFF, f"released ({TEST.who})")
    assert shares(holding) == sorted(shares(holding), reverse=True) and min(shares(holding)) < 0.1
    assert not any(one.driven for one in holding.board.servos)
    assert [one.get("torque_limit") for one in holding.board.servos] == [1000] * 5 + [500]
    holding.does(Enable(), State.HOLDING)
    assert [one.get("torque_limit") for one in holding.board.servos] == [1000] * 5 + [500]


def test_one_joint_is_let_down_within_a_second_while_the_others_hold(holding: Bench):
    began, before = holding.clock.now(), holding.now.q_command.copy()
    ticket = holding.controller.submit(Release(("elbow_flex",)), TEST)
    holding.run(0.5)
    assert any("Elbow flex lets go: support it" in one for one in holding.now.warnings)
    limits = [one.get("torque_limit") for one in holding.board.servos]
    assert limits[2] < 600 and [*limits[:2], *limits[3:]] == [1000, 1000, 1000, 1000, 500]
    while not ticket.finished.done():
        holding.tick()
    assert ticket.finished.exception(0) is None
    assert holding.clock.now() - began == pytest.approx(LETTING_DOWN_S, abs=0.1)
    assert (holding.now.state, holding.now.limp) == (State.HOLDING, ("Elbow flex",))
    assert [one.driven for one in holding.board.servos] == [True, True, False, True, True, True]
    others = np.arange(5) != 2
    assert holding.now.q_command[others] == pytest.approx(before[others])
    holding.does(Enable(), State.HOLDING)
    assert [one.get("torque_limit") for one in holding.board.servos] == [1000] * 5 + [500]


def test_stop_catches_a_heavy_arm_where_it_is_and_does_not_throw_it_up(
    holding: Bench, monkeypatch: pytest.MonkeyPatch
):
    plant = holding.board.plant
    weight = plant._gravity
    monkeypatch.setattr(plant, "_gravity", lambda angles: 1.5 * weight(angles))
    for joint in plant.joints:
        monkeypatch.setattr(joint, "lies_at", None)
    holding.does(MoveJoints(np.zeros(5)), State.HOLDING)  # stretched out
    holding.run(1.0)
    shoulder = plant.joints[1]
    before = shoulder.angle
    holding.ask(Release())
    holding.run(LETTING_DOWN_S - 0.04)
    sunk = shoulder.angle
    assert abs(sunk - before) > np.radians(8.0)
    holding.controller.stop(TEST)
    fallen: list[float] = []
    for _ in range(60):
        holding.tick()
        fallen.append(abs(shoulder.angle - before))
    assert max(fallen) - fallen[-1] < np.radians(0.5)
    assert abs(fallen[-1] - abs(sunk - before)) < np.radians(9.0)
    assert abs(holding.now.q_command[1] - holding.now.q[1]) < np.radians(6.0)
    assert [one.get("torque_limit") for one in holding.board.servos] == [1000] * 5 + [500]


def test_stop_holds_a_joint_that_is_being_let_down(holding: Bench):
    released = holding.controller.submit(Release(("shoulder_lift",)), TEST)
    holding.run(0.9)
    others = np.arange(5) != 1
    before = holding.now.q_command.copy()
    holding.controller.stop(TEST)
    holding.run(1.0)
    assert isinstance(released.finished.exception(0), StateError)
    assert (holding.now.state, holding.now.limp) == (State.HOLDING, ())
    assert all(one.driven for one in holding.board.servos)
    assert holding.now.q_command[others] == pytest.approx(before[others])
    assert [one.get("torque_limit") for one in holding.board.servos] == [1000] * 5 + [500]


def test_a_release_of_all_ends_that_of_one_and_is_off_at_once(holding: Bench):
    first = holding.controller.submit(Release(("elbow_flex",)), TEST)
    holding.run(0.2)
    holding.does(Release(), State.OFF, seconds=0.05)
    assert first.finished.exception(0) is None
    assert not any(one.driven for one in holding.board.servos)


def test_joints_that_do_not_exist_are_not_released(holding: Bench):
    for names, words in (((), "None was named"), (("hip",), "no joint 'hip'")):
        assert words in str(refused(holding, Release(names)))
    assert all(one.driven for one in holding.board.servos)


def test_a_release_that_is_refused_leaves_the_one_that_runs_as_it_was(holding: Bench):
    first = holding.controller.submit(Release(("elbow_flex",)), TEST)
    holding.run(0.2)
    for names, words in (((), "None was named"), (("hip",), "no joint 'hip'")):
        assert words in str(refused(holding, Release(names)))
        assert not first.finished.done()
        assert all(one.driven for one in holding.board.servos)
    holding.run(LETTING_DOWN_S)
    assert first.finished.exception(0) is None
    assert [one.driven for one in holding.board.servos] == [True, True, False, True, True, True]


def test_a_second_release_is_off_at_once(holding: Bench):
    first = holding.controller.submit(Release(), TEST)
    holding.run(0.2)
    assert all(one.driven for one in holding.board.servos)
    holding.does(Release(), State.OFF, seconds=0.05)
    assert first.finished.exception(0) is None
    assert not any(one.driven for one in holding.board.servos)


def test_stop_holds_an_arm_that_is_being_let_down_where_it_has_sunk_to_and_it_goes_on(holding: Bench):
    holding.does(MoveJoints(holding.robot.pose("home")), State.HOLDING)
    holding.run(1.0)
    released = holding.controller.submit(Release(), TEST)
    holding.run(0.9)
    sunk = holding.now.q.copy()
    assert np.abs(sunk - holding.now.q_command).max() > np.radians(3.0)
    stopped = holding.controller.stop(TEST)
    holding.tick()
    assert all(one.driven for one in holding.board.servos)
    holding.run(1.0)
    assert stopped.finished.done() and holding.now.state is State.HOLDING
    assert isinstance(released.finished.exception(0), StateError)
    assert [one.get("torque_limit") for one in holding.board.servos] == [1000] * 5 + [500]
    assert np.abs(holding.now.q - sunk).max() < np.radians(5.0)
    holding.does(MoveJoints(holding.robot.pose("rest")), State.HOLDING)


def test_where_a_servo_takes_no_limit_the_release_is_at_once(holding: Bench, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(FeetechMake, "limit_torque", lambda *_: False)
    holding.does(Release(), State.OFF, seconds=0.3)
    assert any("did not confirm the torque limit" in one.text for one in holding.now.events)
    assert not any(one.driven for one in holding.board.servos)


def test_an_arm_that_gets_its_torque_back_only_in_part_holds_and_is_told(
    holding: Bench, monkeypatch: pytest.MonkeyPatch
):
    holding.ask(Release())
    holding.run(0.3)
    monkeypatch.setattr(FeetechMake, "limit_torque", lambda *_: False)
    holding.controller.stop(TEST)
    holding.run(0.5)
    assert holding.now.state is State.HOLDING and all(one.driven for one in holding.board.servos)
    assert any("some joints are weak. Release the arm" in one.text for one in holding.now.events)


def test_what_moves_or_is_in_fault_is_released_at_once(holding: Bench):
    holding.ask(MoveJoints(holding.robot.pose("home")))
    holding.run(0.3)
    holding.does(Release(), State.OFF, seconds=0.05)
    assert not any(one.driven for one in holding.board.servos)
    assert shares(holding) == []


def test_a_release_ends_with_the_power_off_though_the_board_reports_something(holding: Bench):
    holding.ask(Release())
    holding.board.servo(3).sensor_fails = True
    holding.run(LETTING_DOWN_S + 0.2)
    assert holding.now.state is State.OFF
    assert not any(one.driven for one in holding.board.servos)


def test_an_arm_that_does_not_answer_while_it_is_let_down_is_switched_off_at_once(holding: Bench):
    holding.ask(Release())
    holding.run(0.2)
    holding.board.spoilt = 1.0  # it hears what it is told
    holding.run(0.4)
    assert not any(one.driven for one in holding.board.servos)
    assert holding.now.state is State.FAULT
    assert "did not confirm that the torque is off; cut the power" in holding.now.cause


def test_a_load_above_its_limit_for_a_second_is_told_with_servo_joint_value_and_what_to_do(holding: Bench):
    assert holding.now.limits["Elbow flex"].load == pytest.approx(0.8)
    holding.board.servo(3).put("overload_torque", 100)  # it goes on pushing; the limit was read before
    holding.board.plant.joints[2].blocked = True
    goal = holding.robot.pose("rest")
    goal[2] -= np.radians(12.0)
    holding.ask(MoveJoints(goal))
    holding.run(0.9)
    assert holding.now.levels == ()
    holding.run(1.5)
    (level,) = holding.now.levels
    assert (level.part, level.output, level.quantity, level.level) == ("Elbow flex", "servo 3", "load", 0.8)
    assert level.value > 0.8
    (told,) = [one for one in holding.now.warnings if "servo 3: load" in one]
    assert told.startswith("Elbow flex: servo 3: load ") and "its limit is 80 %; take load off" in told
    assert [one.text for one in holding.now.events if one.text.startswith("Elbow flex: servo 3: load")]
    holding.board.plant.joints[2].blocked = False
    holding.run(8.0)
    assert holding.now.levels == () and not [one for one in holding.now.warnings if "servo 3" in one]


def test_heat_near_its_limit_and_a_low_supply_are_told_with_numbers(holding: Bench):
    holding.board.servo(2).heat = 62.0
    holding.board.supply.open_v = 10.5
    holding.run(0.2)
    found = {(one.part, one.quantity): one for one in holding.now.levels}
    heat = found[("Shoulder lift", "temperature")]
    assert (heat.value, heat.level, heat.reference) == (62.0, 60.0, 70.0)
    low = found[("Gripper", "voltage")]
    assert low.value == pytest.approx(10.5, abs=0.2) and low.reference == pytest.approx(12.0, abs=0.1)
    told = "\n".join(holding.now.warnings)
    assert "Shoulder lift: servo 2: 62 °C, it switches itself off at 70 °C; let the arm rest" in told
    assert "Gripper: servo 6: supply 10." in told


@pytest.mark.parametrize("what", ["heat", "voltage", "overload"])
def test_a_fault_names_servo_joint_value_limit_and_the_way_on(holding: Bench, what: str):
    servo = holding.board.servo(3)
    if what == "heat":
        servo.heat = 75.0
    elif what == "voltage":
        servo.put("least_voltage", 125)
    else:
        servo._latched = OVERLOAD  # pyright: ignore[reportPrivateUsage]
        servo.errors = lambda: OVERLOAD  # type: ignore[method-assign]
    holding.run(0.5)
    told = "\n".join(holding.now.warnings) + holding.now.cause
    assert "Elbow flex: servo 3" in told
    words = {"heat": "let it cool down", "voltage": "its supply", "overload": "clear the fault and enable"}
    assert words[what] in told
    assert "measured: load" in told and "its limits: load 80 %, 70 °C" in told
    if what == "heat":
        assert "75 °C" in told
    assert len([one for one in holding.now.events if words[what] in one.text]) <= 3


def test_a_wrist_that_spins_because_its_range_crosses_the_seam_gets_no_torque():
    """Another program has set an offset by which the joint's middle reads 0: there 4095 is followed by 0."""
    bench = Bench("feetech")
    bench.board.servo(5).put("offset", 2047)
    bench.does(Connect(PORT), State.OFF)
    places: list[int] = []
    for degrees in (0.0, -5.0, 10.0):  # a hand turns it to and fro over that place
        lead(bench, 4, degrees)
        error = refused(bench, Enable())
        assert "Wrist roll" in str(error)
        assert not any(one.driven for one in bench.board.servos)
        places.append(bench.board.servo(5).get("present_position"))
    assert min(places) < 100 and max(places) > 3900
    bench.board.servo(5).put("offset", 0)
    bench.run(0.2)
    bench.does(Enable(), State.HOLDING)
    before = bench.board.servo(5).shaft
    bench.run(1.0)
    assert bench.board.servo(5).shaft == pytest.approx(before, abs=3)
    bench.close()


def test_an_arm_that_stays_hot_is_told_before_its_servo_gives_up_and_goes_on_when_it_is_cool(
    holding: Bench, monkeypatch: pytest.MonkeyPatch
):
    """Something leans on a joint for a long time; here it warms up in 5 s, not in minutes."""
    monkeypatch.setattr("armctl.hardware.bus.simulated._WARM_S", 5.0)
    servo, elbow = holding.board.servo(3), holding.board.plant.joints[2]
    servo.put("overload_torque", 100)  # it goes on pushing
    elbow.blocked = True
    goal = holding.robot.pose("rest")
    goal[2] -= np.radians(12.0)
    holding.ask(MoveJoints(goal))
    run: list[tuple[float, bool]] = []
    while holding.now.state is not State.FAULT:
        assert len(run) < 60
        holding.run(0.14)
        warned = any(one.quantity == "temperature" for one in holding.now.levels)
        run.append((holding.now.quantities["Elbow flex"].temperature_c or 0.0, warned))
    degrees = [one for one, _ in run]
    assert degrees == sorted(degrees) and degrees[0] < 35.0 and degrees[-1] >= 70.0
    assert {warned for at, warned in run if 63.0 < at < 70.0} == {True}
    assert not any(warned for at, warned in run if at < 59.0)
    assert "Elbow flex: servo 3: it has let go: support the arm (it is too hot" in holding.now.cause
    elbow.blocked = False
    holding.run(4.0)
    assert servo.heat < 60.0
    stood = elbow.angle
    assert "servo 3: it has let go" in holding.now.cause  # cool again, it turns nowhere by itself
    assert abs(stood - goal[2]) > np.radians(7.0)
    assert all(one.driven for one in holding.board.servos)
    holding.does(ClearFault(), State.OFF)
    holding.does(Enable(), State.HOLDING)
    assert abs(elbow.angle - stood) < np.radians(2.0)
    holding.does(MoveJoints(holding.robot.pose("home")), State.HOLDING)
