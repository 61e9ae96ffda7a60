"""The step ``tool``: what comes after it is for that tool, on every path, in called programs, when run."""

from __future__ import annotations

import numpy as np
import pytest
from tests.program.kit import program
from tests.robot.test_tools import TOOLS, arm_with_tools
from tests.runtime.kit import make_rig

from armctl.errors import ProgramError
from armctl.facts import OnPath, PathTurn, ToolGripsNot, ToolHoldsPart, UnknownTool
from armctl.motion import Finding
from armctl.program import (
    CalledProgram,
    CallStep,
    ElseStep,
    EndStep,
    GripperStep,
    IfStep,
    LineStep,
    MoveStep,
    PickStep,
    PointStep,
    Program,
    RepeatStep,
    SetStep,
    Step,
    ToolStep,
    WaitStep,
    check_program,
    decode_program,
    encode_program,
    read_csv,
    write_csv,
    write_script,
)
from armctl.program.rehearsal import pose_after, rehearse
from armctl.protocol import RunProgram
from armctl.robot import Robot

PEN, JAWS, CUP, END = ToolStep(tool="pen"), ToolStep(tool="jaws"), ToolStep(tool="cup"), EndStep()
LOW = MoveStep(joints_deg=(0, 30, -70, -50, 0))
"""clear of the floor with jaws, not with the pen"""
HIGH = MoveStep(joints_deg=(0, 60, -40, -20, 0))
AT = PointStep(x_mm=210, y_mm=20, z_mm=60)
ALONG = LineStep(x_mm=210, y_mm=-20, z_mm=60)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Of a board without inputs and outputs."""
    tools = TOOLS.replace('output = "pump"\npart_input = "door"\n', "")
    return arm_with_tools(tmp_path_factory.mktemp("robots"), tools, "")


def errors(robot: Robot, *steps: Step, called: tuple[CalledProgram, ...] = ()) -> list[Finding]:
    whole = Program(robot=robot.name, name="pick", steps=steps, called=called)
    found = check_program(whole, robot, start=robot.pose("home"))
    return [one for one in found if one.severity == "error"]


def test_what_comes_after_it_is_for_that_tool(robot: Robot) -> None:
    assert not errors(robot, HIGH, LOW, HIGH)
    assert not errors(robot, HIGH, PEN, HIGH, JAWS, LOW)
    (one, *_) = errors(robot, HIGH, PEN, LOW, HIGH)
    assert one.step == 2 and one.kind == "floor" and "the felt pen" in str(one)


def test_each_path_has_its_tool(tmp_path_factory: pytest.TempPathFactory) -> None:
    arm = arm_with_tools(tmp_path_factory.mktemp("pins"))
    asked = IfStep(watch="button")
    (one, *_) = errors(arm, HIGH, asked, PEN, END, LOW, HIGH)
    assert one.step == 4 and isinstance(one.reason, OnPath) and one.reason.turns == (PathTurn(1, "then"),)
    assert not errors(arm, HIGH, asked, PEN, HIGH, ElseStep(), LOW, HIGH, END)
    # the pen is still on when the second pass begins
    (one, *_) = errors(arm, HIGH, RepeatStep(times=3), LOW, HIGH, PEN, END)
    assert one.step == 2 and isinstance(one.reason, OnPath) and one.reason.turns == (PathTurn(1, "pass", 2),)
    assert not errors(arm, HIGH, RepeatStep(times=3), JAWS, LOW, HIGH, PEN, END)


def test_a_tool_stays_on_behind_the_called_program_that_has_put_it_on(robot: Robot) -> None:
    inner = CalledProgram(file="take-pen.toml", robot="uzuner", steps=(PEN, HIGH))
    (one, *_) = errors(robot, HIGH, CallStep(program="take-pen"), LOW, called=(inner,))
    assert one.step == 2 and one.kind == "floor"
    assert not errors(robot, HIGH, CallStep(program="take-pen"), JAWS, LOW, called=(inner,))


def test_what_a_tool_cannot_do_is_found(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> None:
    (one,) = errors(robot, PEN, GripperStep(open_percent=50))
    assert one.step == 1 and one.reason == ToolGripsNot("pen")
    pick = PickStep(x_mm=280, y_mm=0, z_mm=120, pitch_deg=0)
    assert ToolGripsNot("pen") in [one.reason.reason for one in errors(robot, HIGH, PEN, pick)]  # type: ignore[attr-defined]
    assert not errors(robot, HIGH, JAWS, pick)
    holding = GripperStep(open_percent=30, part_x_mm=20, part_y_mm=20, part_z_mm=20)
    (one,) = errors(robot, HIGH, holding, PEN, HIGH)
    assert one.step == 2 and one.reason == ToolHoldsPart("20 × 20 × 20 mm")
    assert not errors(robot, HIGH, holding, JAWS, HIGH)  # it is on already
    (one,) = errors(robot, ToolStep(tool="saw"), HIGH)
    assert one.step == 0 and one.reason == UnknownTool("saw", ("jaws", "pen", "cup"))
    arm = arm_with_tools(tmp_path_factory.mktemp("pins"))
    (one,) = errors(arm, SetStep(output="pump", value=1))
    assert "output pump is the gripper's" in str(one)
    assert not errors(arm, CUP, GripperStep(open_percent=0), GripperStep(open_percent=100), JAWS)


def test_files_and_scripts_have_it(robot: Robot) -> None:
    whole = program(HIGH, PEN, AT)
    assert decode_program(encode_program(whole)).steps == whole.steps
    assert read_csv(write_csv(whole, robot), robot).steps == whole.steps
    assert 'arm.set_tool("pen")' in write_script(whole).replace("'", '"')


def test_a_rehearsal_leads_the_tip_that_is_on(robot: Robot) -> None:
    pen = robot.with_tool("pen")
    whole = program(HIGH, PEN, AT, ALONG, JAWS, AT)
    found = rehearse(robot, whole, robot.pose("home"))
    assert [one.tool for one in found.steps] == ["jaws", "pen", "pen", "pen", "jaws", "jaws"]
    ends = [one.trajectory.end for one in found.steps]
    assert pen.forward(ends[2])[:3, 3] == pytest.approx([0.21, 0.02, 0.06])
    assert pen.forward(ends[3])[:3, 3] == pytest.approx([0.21, -0.02, 0.06])
    assert robot.forward(ends[5])[:3, 3] == pytest.approx([0.21, 0.02, 0.06])
    line = found.steps[3]
    middle = found.tool_path(robot, 2001)[
        np.linspace(0, found.duration, 2001).searchsorted(line.begins + line.duration / 2)
    ]
    assert middle[0] == pytest.approx(0.21, abs=1e-4) and middle[2] == pytest.approx(0.06, abs=1e-4)
    led = pose_after(robot, whole, 3, robot.pose("home"))
    assert led is not None and pen.forward(led)[:3, 3] == pytest.approx([0.21, -0.02, 0.06])


def test_it_is_run_as_it_was_checked(robot: Robot) -> None:
    whole = program(HIGH, PEN, AT, ALONG, JAWS, AT, PEN)
    rig = make_rig(robot=robot).enable(robot.pose("home"))
    foretold = rehearse(robot, whole, rig.now.q_command)
    ticket = rig.do(RunProgram(whole, loops=2))
    rig.until(lambda _: ticket.finished.done())
    ticket.finished.result(0)
    tools = [snapshot.tool for snapshot in rig.history]
    changes = [k for k in range(1, len(tools)) if tools[k] != tools[k - 1]]
    assert [tools[k] for k in changes] == ["pen", "jaws", "pen", "jaws", "pen"]  # the second pass has it on
    stands = [rig.history[k].q_command for k in changes]
    pen = robot.with_tool("pen")
    assert pen.forward(stands[1])[:3, 3] == pytest.approx([0.21, -0.02, 0.06], abs=1e-6)
    assert robot.forward(stands[2])[:3, 3] == pytest.approx([0.21, 0.02, 0.06], abs=1e-6)
    took = rig.history[changes[2]].stamp - rig.history[0].stamp
    assert took == pytest.approx(foretold.duration, rel=0.02, abs=0.06)
    assert rig.now.tool == "pen" and "tool: pen (program 'pick')" in rig.texts  # it stays on


def test_a_stop_leaves_the_tool_that_is_on(robot: Robot) -> None:
    rig = make_rig(robot=robot).enable(robot.pose("home"))
    ticket = rig.do(RunProgram(program(PEN, WaitStep(seconds=5), JAWS, HIGH)))
    rig.run(1.0)
    rig.stops()
    rig.run(6.0)
    assert rig.now.tool == "pen" and ticket.finished.exception() is not None


def test_what_grips_not_is_refused_where_it_was_not_checked(robot: Robot) -> None:
    """A single step is planned as it is run."""
    rig = make_rig(robot=robot).enable(robot.pose("home"))
    ticket = rig.do(RunProgram(program(PEN, HIGH, GripperStep(open_percent=50), HIGH)))
    rig.until(lambda _: ticket.finished.done())
    with pytest.raises(ProgramError, match="step 3: nothing grips with the tool 'pen' on"):
        ticket.finished.result(0)
    assert rig.now.q_command == pytest.approx(np.radians(HIGH.joints_deg))
