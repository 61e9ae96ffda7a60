"""Which tool is on, in the runtime: it counts in all that moves, and is changed only where the arm stands."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.program.kit import program
from tests.robot.test_tools import TOOLS, arm_with_tools
from tests.runtime.kit import ROBOT, TEST, LateExecutor, Rig, make_rig
from tests.runtime.signal_kit import PUMP, bench_of, high

from armctl.calibration import Calibration, JointDeflection, calibrated
from armctl.errors import EnableError, InputError, MotionRefusedError
from armctl.facts import State
from armctl.hardware import BoardIdentity
from armctl.kinematics import Target
from armctl.program import MoveStep, ToolStep, WaitStep
from armctl.protocol import (
    Connect,
    Disconnect,
    Enable,
    HomeAxes,
    JogTool,
    MoveGripper,
    MoveJoints,
    MoveTo,
    Pause,
    Resume,
    RunProgram,
    SetTool,
)
from armctl.robot import Robot
from armctl.runtime import PoseFolder
from armctl.runtime.joint_servo import KeepClear

SOFT = {"shoulder": JointDeflection(compliance=math.radians(2.0))}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Of a board without inputs and outputs."""
    tools = TOOLS.replace('output = "pump"\npart_input = "door"\n', "")
    return arm_with_tools(tmp_path_factory.mktemp("robots"), tools, "")


def over(robot: Robot, z_mm: float) -> np.ndarray:
    return robot.inverse((0.2, 0.0, z_mm / 1000), math.radians(-90)).best("least-rotation")


def test_targets_are_those_of_the_tip_that_is_on(robot: Robot) -> None:
    rig = make_rig(robot=robot).enable(over(robot, 120))
    assert rig.now.tool == "jaws" and not rig.now.tool_unconfirmed
    goal = Target.of([0.21, 0.02, 0.06])
    for name in ("pen", "cup", "jaws"):
        rig.do(SetTool(name)).result(0)
        assert rig.now.tool == name and f"tool: {name} (test)" in rig.texts[-1]
        arm = robot.with_tool(name)
        assert rig.controller.robot is arm
        rig.finishes(MoveTo(goal))
        assert arm.forward(rig.now.q_command)[:3, 3] == pytest.approx(goal.position, abs=1e-6)
    minute = rig.controller.black_box()
    known = minute.column("tool")
    assert minute.tools == ("jaws", "pen", "cup") and set(known.tolist()) == {0.0, 1.0, 2.0}
    assert known[0] == known[-1] == 0.0 and any(one.command == "SetTool" for one in minute.commands)


def test_its_body_counts_in_motions_and_in_jogs(robot: Robot) -> None:
    low, start = over(robot, 70), over(robot, 120)
    rig = make_rig(robot=robot).enable(start)
    rig.finishes(MoveJoints(low))
    rig.finishes(MoveJoints(start))
    rig.do(SetTool("pen")).result(0)
    rig.refuses(MoveJoints(low), "the felt pen: at .* below the floor", MotionRefusedError)
    tips: list[float] = []
    for _ in range(250):
        rig.do(JogTool(np.array([0.0, 0.0, -0.1]))).result(0)
        tips.append(float(robot.with_tool("pen").forward(rig.now.q_command)[2, 3]))
    assert min(tips) > robot.floor_z - 1e-3 and "jog: the floor is in the way" in rig.now.warnings
    assert tips[-1] < robot.floor_z + 0.01  # it went as far as the tip allows, not as the flange would


def test_jogs_are_prepared_for_every_tool(robot: Robot) -> None:
    late = LateExecutor()
    rig = make_rig(late, robot=robot).enable(over(robot, 120))
    rig.do(SetTool("pen")).result(0)
    late.waiting.clear()  # nobody has looked at anything since
    rig.do(JogTool(np.array([0.05, 0.0, 0.0]))).result(0)
    before = rig.now.q_command
    rig.do(JogTool(np.array([0.05, 0.0, 0.0]))).result(0)
    rig.do(JogTool(np.array([0.05, 0.0, 0.0]))).result(0)
    assert (rig.now.q_command != before).any()
    clear = KeepClear(robot)
    clear.hold(robot.with_tool("pen"))  # what is clear of jaws says nothing of a pen
    assert clear.blocked(np.stack([rig.now.q_command, rig.now.q_command])) is not None


def test_it_is_changed_only_where_the_arm_stands_and_holds_nothing(robot: Robot) -> None:
    rig = make_rig(robot=robot).enable(over(robot, 120))
    rig.do(MoveJoints(over(robot, 80)))
    rig.run(0.2)
    rig.refuses(SetTool("pen"), r"only while the arm stands \(move \(test\)\)")
    rig.stops()
    gripping = rig.do(MoveGripper(0.3, (20.0, 20.0, 20.0)))
    rig.refuses(SetTool("pen"), "only while the arm stands")
    rig.until(lambda _: gripping.finished.done())
    rig.refuses(SetTool("pen"), "the gripper holds a part of 20 × 20 × 20 mm")
    rig.do(SetTool("jaws")).result(0)
    assert rig.now.tool == "jaws" and rig.now.part_mm is not None
    opening = rig.do(MoveGripper(1.0))
    rig.until(lambda _: opening.finished.done())
    rig.refuses(SetTool("saw"), "no tool 'saw'; it has 'jaws', 'pen', 'cup'", InputError)
    assert rig.now.tool == "jaws"
    rig.do(SetTool("pen")).result(0)


@pytest.mark.parametrize("name", ["", "saw"])
def test_a_name_that_is_no_tool_is_refused(robot: Robot, name: str) -> None:
    for arm in (robot, ROBOT):
        rig = make_rig(robot=arm).enable()
        rig.refuses(SetTool(name), f"no tool '{name}'", InputError)
        assert rig.now.state is State.HOLDING and rig.now.tool == arm.tool


@pytest.mark.parametrize("after", ["cup", "pen"])
def test_a_program_changes_the_tool_when_the_gripper_stands(tmp_path: Path, after: str) -> None:
    bench = bench_of(arm_with_tools(tmp_path))
    bench.do(MoveGripper(0.0))
    bench.run(3.0)
    opening = bench.do(MoveGripper(1.0))
    bench.run(0.1)
    running = bench.controller.submit(RunProgram(program(ToolStep(tool=after))), TEST)
    bench.run(0.1)
    assert bench.now.tool == "jaws" and 0.0 < (bench.now.gripper or 0.0) < 1.0
    bench.run(3.0)
    opening.result(0)
    running.result(0)
    assert bench.now.tool == after and not bench.now.busy
    assert high(bench, PUMP) == [False]  # on, as it was: nobody has asked the cup to let go
    bench.do(SetTool("jaws"))
    assert bench.now.gripper == pytest.approx(1.0, abs=0.01)


def test_a_heavy_tool_of_a_program_is_no_jerk_and_no_other_program(tmp_path: Path) -> None:
    heavy = TOOLS[: TOOLS.index('[[tools]]\nname = "cup"')].replace("0.04", "0.3")
    arm = calibrated(
        arm_with_tools(tmp_path, heavy, ""), Calibration("uzuner", "7", "µs", {}, deflection=SOFT)
    )
    start = over(arm, 120)
    rig = make_rig(robot=arm).enable(start)
    pen = arm.with_tool("pen").outputs
    shoulder, goal = pen.channels[1], pen.outputs(start)
    turned = MoveStep(joints_deg=tuple(np.degrees(start + np.radians([20, 0, 0, 0, 0])).tolist()))
    steps = WaitStep(seconds=1.0), ToolStep(tool="pen"), WaitStep(seconds=0.2), turned, WaitStep(seconds=1.0)
    running = rig.do(RunProgram(program(*steps)))
    before = rig.driver.positions[shoulder]
    rig.until(lambda now: now.tool == "pen")
    rig.do(Pause())
    rig.sends_nothing(1.0)  # a pause is one
    rig.do(Resume())
    rig.until(lambda _: running.finished.done())
    running.result(0)
    sent = [values[shoulder] for _, values in rig.driver.writes if shoulder in values]
    assert rig.driver.positions[shoulder] == pytest.approx(goal[shoulder])
    assert abs(goal[shoulder] - before) > 10  # µs
    assert np.abs(np.diff(sent)).max() < 0.6
    assert rig.now.state is State.HOLDING and not rig.now.warnings
    assert np.degrees(rig.now.q - start) == pytest.approx([20, 0, 0, 0, 0], abs=0.01)


def test_a_tool_that_is_named_while_the_line_is_opened_is_on(robot: Robot) -> None:
    arm = calibrated(robot, Calibration("uzuner", "7", "µs", {}, deflection=SOFT))
    late = LateExecutor()
    rig = make_rig(late, robot=arm)
    rig.controller.submit(Connect("sim"), TEST)
    rig.tick()
    rig.do(SetTool("pen")).result(0)
    late.work()
    rig.tick()
    start = over(robot, 120)
    rig.finishes(Enable(start))
    pen = arm.with_tool("pen").outputs.outputs(start)
    assert {k: rig.driver.positions[k] for k in pen} == pytest.approx(pen)


def test_the_gripper_is_that_of_the_tool(tmp_path: Path) -> None:
    bench = bench_of(arm_with_tools(tmp_path))
    bench.do(MoveGripper(0.5))
    bench.run(2.0)
    assert bench.now.gripper == 0.5
    bench.do(SetTool("pen"))
    with pytest.raises(Exception, match="uzuner has no gripper with the tool 'pen' on"):
        bench.do(MoveGripper(1.0)).result(0)
    bench.do(SetTool("cup"))
    assert bench.now.gripper == 0.0 and high(bench, PUMP) == [False]  # on: this pin is active low
    bench.do(MoveGripper(1.0))
    bench.run(1.0)
    assert bench.now.gripper == 1.0 and high(bench, PUMP) == [True]
    bench.do(SetTool("jaws"))
    assert bench.now.gripper == pytest.approx(0.5)  # the servo has held it meanwhile
    bench.do(MoveGripper(0.0))
    bench.run(2.0)
    assert bench.now.gripper == 0.0 and bench.now.state is State.HOLDING


def test_a_soft_arm_stays_where_it_is_when_somebody_says_that_a_heavier_tool_is_on(robot: Robot) -> None:
    arm = calibrated(robot, Calibration("uzuner", "7", "µs", {}, deflection=SOFT))
    rig = make_rig(robot=arm).enable(over(robot, 120))
    q, told = rig.now.q_command, dict(rig.driver.positions)
    rig.do(SetTool("pen")).result(0)
    rig.run(1.0)
    assert rig.driver.positions == told and len(rig.driver.writes) == 1  # that of Enable
    pen = arm.with_tool("pen").outputs
    assert pen.outputs(rig.now.q_command) == pytest.approx({k: told[k] for k in pen.channels}, abs=1e-3)
    sinks = np.degrees(q - rig.now.q_command)
    assert 0.02 < sinks[1] < 1.0 and np.abs(np.delete(sinks, 1)).max() < 1e-6
    assert rig.now.state is State.HOLDING and not rig.now.warnings
    # a program goes on from where its last motion ended: there it lifts what the tool weighs down
    q = rig.now.q_command
    rig.finishes(RunProgram(program(ToolStep(tool="jaws"), WaitStep(seconds=0.5))))
    assert rig.now.q_command == pytest.approx(q)
    light = arm.with_tool("jaws").outputs.outputs(q)
    assert {k: rig.driver.positions[k] for k in light} == pytest.approx(light) and not rig.now.warnings


def on_a_real_board(folder: Path, robot: Robot) -> Rig:
    rig = make_rig(robot=robot, poses=PoseFolder(folder, robot))
    identity = BoardIdentity("board", "/dev/ttyACM0", "A1", simulated=False)
    rig.driver.open = lambda: identity  # type: ignore[method-assign]
    rig.do(Connect("/dev/ttyACM0")).result(0)
    return rig


def test_a_real_board_is_enabled_once_somebody_has_said_which_tool_is_on(
    tmp_path: Path, robot: Robot
) -> None:
    rig = on_a_real_board(tmp_path, robot)
    start = over(robot, 120)
    assert rig.now.tool == "jaws" and rig.now.tool_unconfirmed
    words = "nobody has said since the board was connected which tool is on; it was 'jaws' last"
    for command in (Enable(start, 0.5), HomeAxes()):
        ticket = rig.do(command)
        error = ticket.finished.exception()
        assert error is not None
        if isinstance(command, Enable):
            assert (
                isinstance(error, EnableError)
                and words in str(error)
                and "'jaws', 'pen', 'cup'" in str(error)
            )
    assert rig.now.state is State.OFF and not rig.driver.writes
    rig.do(SetTool("pen")).result(0)
    assert not rig.now.tool_unconfirmed
    rig.finishes(Enable(start, 0.5))
    rig.tick()
    rig.do(Disconnect()).result(0)
    rig.poses.close()  # type: ignore[union-attr]

    again = on_a_real_board(tmp_path, robot)
    again.tick()
    assert again.now.tool == "pen" and again.now.tool_unconfirmed  # as it was last: to be confirmed
    assert again.now.last_pose is not None and "with the tool pen" in str(again.now.last_pose)
    again.refuses(Enable(start, 0.5), "it was 'pen' last", EnableError)
    again.do(SetTool("cup")).result(0)
    again.do(Disconnect()).result(0)
    again.do(Connect("/dev/ttyACM0")).result(0)
    again.tick()
    assert again.now.tool == "cup" and again.now.tool_unconfirmed  # what was said is newer than the last pose
    again.do(SetTool("pen")).result(0)
    again.finishes(Enable(start, 0.5))


def test_an_arm_with_one_tool_or_none_asks_nobody(tmp_path: Path) -> None:
    one = arm_with_tools(tmp_path, '[[tools]]\nname = "jaws"\ngripper = true\n', "")
    rig = on_a_real_board(tmp_path / "poses", one)
    rig.finishes(Enable(over(one, 120), 0.5))
    assert rig.now.tool == "jaws"
