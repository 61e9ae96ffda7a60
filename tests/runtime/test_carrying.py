"""A part between the jaws in the runtime: named with the gripper, forgotten, heeded by all that moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.program.kit import program
from tests.runtime.kit import ROBOT, LateExecutor, Rig, fails, make_rig

from armctl.errors import InputError, MotionRefusedError
from armctl.kinematics import Target
from armctl.motion import Floor, PointToPoint
from armctl.motion.preflight import require_gaps
from armctl.motion.trajectory import RestOfTrajectory
from armctl.program import GripperStep, MoveStep
from armctl.protocol import (
    Cancel,
    Disconnect,
    Enable,
    FollowTarget,
    Jog,
    MoveGripper,
    MoveJoints,
    Release,
    RunProgram,
)
from armctl.robot import CarriedPart, load_robot
from armctl.runtime.joint_servo import KeepClear

CUBE = (30.0, 30.0, 30.0)
IN_THE_FLOOR = "the carried part: at .* below the floor"


def over(z_mm: float, y_mm: float = 0.0) -> np.ndarray:
    """The tool straight down over a place of the floor (n,) [rad]."""
    return ROBOT.inverse((0.2, y_mm / 1000, z_mm / 1000), math.radians(-90)).best("least-rotation")


HIGH, STANDS, LOW = over(60), over(15), over(12)


@pytest.fixture
def high() -> Rig:
    """Above the floor, with the jaws 30 % open."""
    return gripped(make_rig().enable(HIGH), None)


def gripped(rig: Rig, part_mm: tuple[float, float, float] | None, opening: float = 0.3) -> Rig:
    ticket = rig.do(MoveGripper(opening, part_mm))
    rig.until(lambda _: ticket.finished.done())
    ticket.result(0)
    return rig


def test_a_motion_is_planned_with_the_part_that_the_gripper_was_told_of(high: Rig) -> None:
    assert high.now.part_mm is None
    gripped(high, CUBE)
    assert high.now.part_mm == CUBE
    high.refuses(MoveJoints(LOW), IN_THE_FLOOR, MotionRefusedError)
    high.finishes(MoveJoints(STANDS))
    high.finishes(MoveJoints(HIGH))
    gripped(high, None, 1.0)
    assert high.now.part_mm is None
    high.finishes(MoveJoints(LOW))


def test_a_part_that_is_gripped_low_is_lifted_from_the_floor(high: Rig) -> None:
    high.finishes(MoveJoints(LOW))
    gripped(high, CUBE)
    high.finishes(MoveJoints(HIGH))


@pytest.mark.parametrize("part_mm", [(0.0, 30.0, 30.0), (30.0, math.nan, 30.0), (30.0, 30.0, 2000.0)])
def test_a_part_of_no_size_is_refused(high: Rig, part_mm: tuple[float, float, float]) -> None:
    high.refuses(MoveGripper(0.3, part_mm), "part_mm: the edge along . of the tool", InputError)
    assert high.now.part_mm is None


def test_it_stays_at_a_stop_and_is_forgotten_where_the_outputs_go_off(high: Rig) -> None:
    high.do(MoveGripper(1.0, CUBE))
    high.stops()
    assert high.now.part_mm == CUBE
    high.do(Release())
    assert high.now.part_mm is None
    high.finishes(Enable(HIGH))
    assert high.now.part_mm is None
    gripped(high, CUBE)
    high.do(Disconnect())
    assert high.now.part_mm is None


def test_a_program_begins_with_it_and_its_steps_pick_and_place(high: Rig) -> None:
    to = {
        name: MoveStep(joints_deg=tuple(np.degrees(q).tolist())) for name, q in (("low", LOW), ("high", HIGH))
    }
    gripped(high, CUBE)
    high.refuses(RunProgram(program(to["low"])), IN_THE_FLOOR, Exception)
    picked = GripperStep(open_percent=30, part_x_mm=20, part_y_mm=20, part_z_mm=20)
    high.finishes(RunProgram(program(GripperStep(open_percent=60), to["low"], picked, to["high"])))
    assert high.now.part_mm == (20.0, 20.0, 20.0)


def test_a_jog_stops_before_the_part_touches_the_floor(high: Rig) -> None:
    lowest: list[float] = []
    for part in (None, CUBE):
        gripped(high, part)
        for _ in range(100):
            high.do(Jog(np.array([0.0, -0.3, 0.0, 0.0, 0.0])))
        assert high.now.warnings == ("jog: the floor is in the way",)
        high.run(0.5)
        held = ROBOT.gripping(0.3).carrying(CarriedPart.of(part))
        lowest.append(float(Floor(held).clearance(high.now.q_command).min()))
        assert 0.0 <= lowest[-1] < 2e-3
        high.finishes(MoveJoints(HIGH))


def test_a_live_target_ends_before_the_part_touches_the_floor(high: Rig) -> None:
    gripped(high, CUBE)
    for _ in range(150):
        high.do(FollowTarget(Target.of((0.2, 0.0, 0.005), math.radians(-90)))).accepted.result(0)
    assert high.now.warnings == ("live target: the floor is in the way",)
    held = ROBOT.gripping(0.3).carrying(CarriedPart(CUBE))
    assert 0.0 <= Floor(held).clearance(high.now.q_command).min() < 6e-3


def test_while_a_part_is_not_looked_at_yet_a_jog_stands() -> None:
    rig = make_rig(executor := LateExecutor()).enable(HIGH)
    turn = Jog(np.array([0.2, 0.0, 0.0, 0.0, 0.0]))
    rig.do(turn)
    rig.do(turn)
    assert rig.now.q_command[0] != HIGH[0]
    rig.do(MoveGripper(0.4, CUBE))
    for _ in range(30):
        rig.do(turn)
    assert rig.now.warnings == ("jog: what the arm carries is not looked at yet",)
    assert not rig.now.velocity_command.any()
    executor.work()
    rig.do(turn)
    rig.do(turn)
    assert rig.now.velocity_command[0] > 0.0
    assert rig.now.warnings == ()


def test_the_jaws_count_where_they_are_and_between_two_commands_everywhere() -> None:
    """What is looked at follows the gripper; what is not looked at yet is what was, where that holds more."""
    robot = load_robot("so101")
    clear = KeepClear(robot)
    shut, opening, opened = robot.gripping(0.0), robot.gripping(0.0, 1.0), robot.gripping(1.0)
    assert robot.allows_for(shut) and opening.allows_for(opened) and not shut.allows_for(opened)
    assert not shut.allows_for(shut.carrying(CarriedPart(CUBE)))
    q = robot.pose("home")
    ways = np.linspace(q, robot.pose("rest"), 60)

    def stops(arm: KeepClear) -> int:
        found = arm.blocked(ways)
        return len(ways) if found is None else found[0]

    at: dict[str, int] = {}
    for name, arm in (("usual", robot), ("shut", shut), ("opened", opened)):
        clear.hold(arm)
        assert clear.outdated == (name != "usual")
        assert stops(clear) == stops(KeepClear(robot))
        clear.work_out()
        assert not clear.outdated
        at[name] = stops(clear)
    assert at["usual"] <= min(at["shut"], at["opened"])


@pytest.mark.parametrize("part_mm", [None, CUBE])
def test_a_gripper_command_waits_for_a_motion_that_is_being_planned(
    part_mm: tuple[float, float, float] | None,
) -> None:
    rig = make_rig(executor := LateExecutor()).enable(HIGH)
    moving, gripping = rig.do(MoveJoints(LOW)), rig.do(MoveGripper(0.3, part_mm))
    rig.run(0.2)
    assert not moving.accepted.done() and not gripping.accepted.done()
    executor.work()
    rig.tick()
    moving.accepted.result(0)
    assert not gripping.accepted.done()
    executor.work()
    rig.tick()
    if part_mm is None:
        gripping.accepted.result(0)
    else:
        fails(gripping.finished, IN_THE_FLOOR, MotionRefusedError)
    rig.rests()
    moving.result(0)


def test_a_gripper_command_that_waited_is_refused_where_a_program_has_begun() -> None:
    rig = make_rig(executor := LateExecutor()).enable(HIGH)
    rig.do(RunProgram(program(MoveStep(joints_deg=tuple(np.degrees(STANDS).tolist())))))
    gripping = rig.do(MoveGripper(0.3))
    executor.work()
    rig.tick()
    fails(gripping.finished, "the gripper is not free")


def test_what_the_gripper_is_told_while_the_arm_moves_is_checked_with_the_rest_of_the_motion(
    high: Rig,
) -> None:
    moving = high.do(MoveJoints(LOW, duration_s=2.0))
    high.run(0.5)
    high.refuses(
        MoveGripper(0.2, CUBE),
        f"the motion under way, with the gripper as it would be: {IN_THE_FLOOR}",
        MotionRefusedError,
    )
    assert high.now.part_mm is None
    assert high.now.gripper == 0.3
    smaller = high.do(MoveGripper(0.2, (20.0, 20.0, 10.0)))
    high.rests()
    moving.result(0)
    smaller.result(0)
    assert high.now.part_mm == (20.0, 20.0, 10.0)
    # what is behind it does not count: it has left the floor already
    high.finishes(MoveJoints(HIGH))
    gripped(high, None)
    high.finishes(MoveJoints(LOW))
    high.do(MoveJoints(HIGH, duration_s=2.0))
    high.run(1.5)
    high.do(MoveGripper(0.3, (60.0, 60.0, 60.0))).accepted.result(0)


@pytest.mark.parametrize("ends", ["stop", "newer", "cancel", "release"])
def test_a_gripper_command_that_is_being_checked_can_be_ended(ends: str) -> None:
    rig = gripped(make_rig(executor := LateExecutor()).enable(HIGH), None)
    rig.do(MoveJoints(STANDS, duration_s=2.0))
    executor.work()
    rig.run(0.2)
    waiting = rig.do(MoveGripper(1.0, motion="g"))
    rig.run(0.2)
    assert not waiting.accepted.done()
    assert rig.now.busy
    match ends:
        case "stop":
            rig.stops()
            words = "stopped by test"
        case "newer":
            rig.do(MoveGripper(0.5))
            words = "a newer gripper command took its place"
        case "cancel":
            rig.do(Cancel("g"))
            words = "cancelled by test"
        case _:
            rig.do(Release())
            words = "released"
    fails(waiting.finished, words)
    executor.work()
    rig.run(1.0)
    assert rig.now.gripper == {"newer": 0.5, "release": None}.get(ends, 0.3)


def test_the_rest_of_a_motion() -> None:
    whole = PointToPoint.plan(ROBOT, HIGH, LOW)
    rest = RestOfTrajectory(whole, 0.25)
    assert rest.duration == pytest.approx(whole.duration - 0.25)
    times = np.linspace(-0.1, whole.duration, 40)
    for name in ("q", "velocity", "acceleration"):
        expected = getattr(whole.sample(np.maximum(times, 0.0) + 0.25), name)
        np.testing.assert_array_equal(getattr(rest.sample(times), name), expected)
    np.testing.assert_array_equal(rest.start, whole.sample(0.25).q)
    assert RestOfTrajectory(whole, 99.0).duration == 0.0
    require_gaps(ROBOT.gripping(0.3), rest)
    with pytest.raises(MotionRefusedError, match=IN_THE_FLOOR):
        require_gaps(ROBOT.gripping(0.3).carrying(CarriedPart(CUBE)), rest)
