"""A board of somebody else's that can do more, and a step that waits for a load: both from outside armctl."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from pathlib import Path
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
import pytest
from msgspec import Meta
from tests.architecture.toy_board import able_board
from tests.runtime.board_bench import BoardBench
from tests.runtime.kit import TEST, LateExecutor, make_rig

from armctl.errors import EnableError, InputError, ProgramError, RobotFileError, StateError
from armctl.facts import NotNow, State
from armctl.hardware.board_type import Setup
from armctl.hardware.boards import board_type
from armctl.hardware.transport import Connection
from armctl.program import Effect, Program, Senses, Step, Until, load_program, save_program
from armctl.program import steps as registry
from armctl.program.base_steps import Field
from armctl.protocol import (
    Connect,
    Enable,
    LimitTorque,
    MoveGripper,
    MoveJoints,
    Release,
    RunProgram,
    SetOutput,
)
from armctl.robot import Robot, load_robot
from armctl.robot.record import robot_of, robot_record

SHOULDER, OTHER_SIDE = 1, 11
"""channels of the two servos of one joint"""


class LoadStep(Step, frozen=True, kw_only=True, tag="wait-load"):
    """Wait until a joint is loaded by more than a share of what its motor can do."""

    words: ClassVar = "load of {0.joint} > {0.percent:g} %"

    joint: Annotated[str, Field("Joint")] = "Shoulder"
    percent: Annotated[float, Meta(gt=0, le=100), Field("Load %")] = 40.0
    longest_s: Annotated[float, Meta(gt=0, le=60), Field("At most s")] = 2.0

    @property
    def effect(self) -> Effect:
        """Look at the load once a tick."""

        def holds(senses: Senses) -> bool:
            seen = senses.quantities.get(self.joint)
            return seen is not None and seen.load is not None and seen.load > self.percent / 100

        return Effect(until=Until(f"a load of {self.joint} above {self.percent:g} %", holds, self.longest_s))


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    monkeypatch.setattr(registry, "KINDS", (*registry.KINDS, LoadStep))
    with able_board(tmp_path) as robot_file:
        yield load_robot(robot_file)


@pytest.fixture
def bench(arm: Robot) -> BoardBench[Any]:
    """The arm holds at home."""
    return held(arm)


def held(arm: Robot, planner: Executor | None = None) -> BoardBench[Any]:
    kind, setup = board_type("able"), Setup()
    board = kind.simulated(setup, {})
    bench = BoardBench.of(
        arm,
        board,
        lambda line, now: kind.driver(setup, Connection(line, now, simulated=True)),
        planner=planner,
    )
    bench.controller.submit(Connect("sim"), TEST)
    bench.run(0.02)
    if isinstance(planner, LateExecutor):
        planner.work()
        bench.run(0.02)
    bench.do(Enable(arm.pose("home")))
    bench.until(State.HOLDING)
    return bench


def refused(bench: BoardBench[Any], command: Any, error: type[Exception], match: str) -> Exception:
    ticket = bench.controller.submit(command, TEST)
    bench.run(0.02)
    with pytest.raises(error, match=match) as refusal:
        ticket.finished.result(0)
    return refusal.value


def test_two_servos_turn_one_joint_against_each_other(bench: BoardBench[Any], arm: Robot) -> None:
    bench.do(MoveJoints(arm.pose("home") + np.radians([0, 12, 0, 0, 0])))
    apart = []
    while bench.run(0.02).state is State.MOVING:
        outputs = bench.board.outputs
        apart.append(outputs[SHOULDER] + outputs[OTHER_SIDE] - (781.795 + 3218))
    assert max(np.abs(apart)) <= 1.0  # a rounding each
    assert bench.now.q == pytest.approx(bench.now.q_command, abs=np.radians(0.06))
    assert bench.now.warnings == ()


def test_servos_that_work_against_each_other_are_told(bench: BoardBench[Any]) -> None:
    bench.board.outputs[OTHER_SIDE] += 30
    [warning] = bench.run(0.1).warnings
    assert warning.startswith("the two motors of Shoulder stand apart and work against each other")


def test_nothing_is_enabled_whose_two_motors_stand_apart(bench: BoardBench[Any]) -> None:
    bench.do(Release())
    bench.board.outputs[OTHER_SIDE] += 900
    before = dict(bench.board.outputs)
    refused(
        bench, Enable(), EnableError, "the two motors of Shoulder stand apart, one of them would be driven"
    )
    assert bench.run(0.2).state is State.OFF and bench.board.outputs == before and not bench.board.on


def test_a_robot_that_crosses_keeps_its_second_servo(arm: Robot) -> None:
    assert robot_of(msgspec.json.decode(msgspec.json.encode(robot_record(arm)))).outputs == arm.outputs
    assert (arm.outputs.low[1], arm.outputs.high[1]) == (749, pytest.approx(2250.795))


def test_the_range_of_a_joint_is_inside_those_of_both_its_servos(tmp_path: Path) -> None:
    with able_board(tmp_path) as path:
        path.write_text(path.read_text().replace("range_steps = [749, 2251]", "range_steps = [700, 2300]"))
        outputs = load_robot(path).outputs
        assert (outputs.low[1], outputs.high[1]) == pytest.approx((748.795, 2250.795))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("channel = 11", "channel = 3", r"joints.shoulder: two servos are on the same channel"),
        ("[1749, 3251]", "[1749, 2900]", r"joints.shoulder.servo.also\[0\]: the limits .* need pulses of"),
        ("steps_per_deg = -10", "steps_per_deg = 0", r"also\[0\].steps_per_deg is 0: the joint would not"),
        ("channel = 11", "chanel = 11", r"servo.also\[0\]: unknown key 'chanel'"),
    ],
)
def test_a_second_servo_that_cannot_be_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    with able_board(tmp_path) as path:
        path.write_text(path.read_text().replace(old, new))
        with pytest.raises(RobotFileError, match=said):
            load_robot(path)


def test_one_joint_is_released_and_taken_back_where_it_stands(bench: BoardBench[Any], arm: Robot) -> None:
    before = dict(bench.board.outputs)
    bench.do(Release(("shoulder",)))
    bench.run(0.5)
    assert bench.now.state is State.HOLDING and bench.now.limp == ("Shoulder",)
    assert {SHOULDER, OTHER_SIDE} & bench.board.on == set() and len(bench.board.on) == len(before) - 2
    bench.board.outputs[SHOULDER] += 100  # somebody turns it by hand
    bench.board.outputs[OTHER_SIDE] -= 100
    assert bench.run(1.0).state is State.HOLDING
    assert bench.now.q[1] == pytest.approx(arm.pose("home")[1] + np.radians(10), abs=1e-3)
    refusal = refused(
        bench, MoveJoints(arm.pose("rest")), StateError, "holding without Shoulder; enable first"
    )
    assert isinstance(refusal.reason, NotNow) and refusal.reason.limp == ("Shoulder",)
    bench.do(Enable())
    assert bench.now.limp == () and bench.board.on == set(before)
    assert bench.now.q_command[1] == pytest.approx(arm.pose("home")[1] + np.radians(10), abs=1e-3)
    assert bench.board.outputs[SHOULDER] == before[SHOULDER] + 100
    bench.do(MoveJoints(arm.pose("home")))
    bench.until(State.HOLDING)
    assert bench.board.outputs == before


def test_a_motion_that_is_being_planned_does_not_begin_without_a_joint(arm: Robot) -> None:
    planner = LateExecutor()
    bench = held(arm, planner)
    motion = bench.controller.submit(MoveJoints(arm.pose("rest")), TEST)
    bench.run(0.02)
    bench.do(Release(("shoulder",)))
    planner.work()
    assert bench.run(0.1).state is State.HOLDING
    with pytest.raises(StateError, match="joints were released"):
        motion.finished.result(0)


def test_a_gripper_that_moves_is_stopped_and_taken_over_with_the_rest(bench: BoardBench[Any]) -> None:
    bench.do(Release(("shoulder",)))
    closing = bench.do(MoveGripper(0.0))
    bench.do(Enable())
    assert bench.run(0.2).state is State.HOLDING and bench.now.limp == ()
    assert closing.finished.done()
    bench.do(Release())
    bench.do(Enable())
    assert bench.now.state is State.HOLDING and 5 in bench.board.on  # the gripper's, too


def test_an_enable_that_the_board_does_not_confirm_leaves_a_way_on(bench: BoardBench[Any]) -> None:
    bench.do(Release(("shoulder",)))
    bench.board.stuck = True
    refused(bench, Enable(), EnableError, "the board has not confirmed")
    assert bench.run(0.1).state is State.OFF and len(bench.board.on) == len(bench.board.outputs) - 2
    bench.board.stuck = False
    bench.do(Enable())
    assert bench.run(0.1).state is State.HOLDING and bench.now.limp == ()


def test_joints_that_nobody_knows_and_boards_that_cannot_are_told(bench: BoardBench[Any]) -> None:
    refused(bench, Release(("hip",)), InputError, "there is no joint 'hip'; there are base, shoulder")
    bench.do(MoveJoints(bench.now.q_command + np.radians([20, 0, 0, 0, 0])))
    refused(bench, Release(("shoulder",)), StateError, "a release of joints needs the arm holding")
    plain = make_rig().enable()
    plain.refuses(Release(("base",)), "switches its outputs off all at once only")
    assert plain.now.state is State.HOLDING


def test_loads_are_waited_for(bench: BoardBench[Any], tmp_path: Path) -> None:
    program = Program(robot="able_arm", name="press", steps=(LoadStep(longest_s=5), LoadStep(joint="Elbow")))
    save_program(program, tmp_path / "press.toml")
    assert load_program(tmp_path / "press.toml") == program
    ticket = bench.do(RunProgram(program))
    bench.board.load[SHOULDER] = 0.4
    assert bench.run(1.0).program is not None and bench.now.program.step == 0  # type: ignore[union-attr]
    assert bench.now.warnings == ("waiting for a load of Shoulder above 40 %",)
    bench.board.load[SHOULDER] = 0.41
    assert bench.run(0.06).program is not None and bench.now.program.step == 1  # type: ignore[union-attr]
    assert bench.now.quantities["Shoulder"].load == 0.41
    bench.run(2.1)
    with pytest.raises(
        Exception, match="press: step 2: waited 2 s for a load of Elbow above 40 %, which did"
    ):
        ticket.finished.result(0)
    assert bench.now.state is State.HOLDING


def test_a_step_that_cannot_look_ends_its_program_and_nothing_else(bench: BoardBench[Any]) -> None:
    class Broken(LoadStep, frozen=True, kw_only=True, tag="broken"):
        @property
        def effect(self) -> Effect:
            return Effect(until=Until("a miracle", lambda senses: senses.inputs["window"] > 0, 1.0))

    ticket = bench.do(RunProgram(Program(robot="able_arm", name="p", steps=(Broken(),))))
    bench.run(0.2)
    with pytest.raises(ProgramError, match="p: step 1: cannot look for a miracle: KeyError: 'window'"):
        ticket.finished.result(0)
    assert bench.now.state is State.HOLDING
    with pytest.raises(ProgramError, match="0 s is no time"):
        Until("it", lambda _: True, 0.0)


def test_stop_ends_a_wait(bench: BoardBench[Any]) -> None:
    bench.do(RunProgram(Program(robot="able_arm", name="press", steps=(LoadStep(longest_s=60),))))
    bench.controller.stop(TEST)
    assert bench.run(0.04).state is State.HOLDING


def test_pins_and_torque(bench: BoardBench[Any]) -> None:
    bench.board.door = 1.0
    bench.do(SetOutput("lamp", 1.0))
    assert bench.run(0.06).inputs == {"door": 1.0} and bench.now.outputs == {"lamp": 1.0}
    refused(bench, SetOutput("siren", 1.0), InputError, "there is no output 'siren'; there are lamp")
    refused(bench, SetOutput("lamp", 2.0), InputError, "output lamp: 2 .* outside 0")
    bench.do(LimitTorque(0.5, ("shoulder",)))
    assert bench.board.torque == {SHOULDER: 0.5, OTHER_SIDE: 0.5}
    refused(bench, LimitTorque(1.5), InputError, "torque limit of 150")
    refused(bench, LimitTorque(0.0), InputError, "torque limit of 0")
    bench.board.outputs[0] += 100  # it sags
    bench.run(0.1)
    refused(bench, LimitTorque(1.0), StateError, "Base: away from where it was told to be; release the arm")
    refused(bench, Release(()), InputError, "which joints are to be released")
    board = bench.now.board
    assert board is not None
    assert board.abilities == ("release_channels", "limit_torque", "set_output")
    plain = make_rig().enable()
    assert plain.now.board is not None and plain.now.board.abilities == ()
    plain.refuses(SetOutput("lamp", 1.0), "no outputs beside those of the joints")
    plain.refuses(LimitTorque(0.5), "cannot limit the torque")
    assert plain.now.state is State.HOLDING
