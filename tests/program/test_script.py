from __future__ import annotations

import ast
from unittest.mock import create_autospec, patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.program.kit import programs

import armctl
from armctl.arm import Arm
from armctl.errors import ProgramError
from armctl.program import (
    ArcStep,
    CommentStep,
    Cursor,
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
    write_script,
)

STEPS: tuple[Step, ...] = (
    CommentStep(note="pick"),
    MoveStep(joints_deg=(0, 90, -80.5, -40, 0), duration_s=2, note="home"),
    PointStep(x_mm=200, y_mm=0, z_mm=85, pitch_deg=-30, blend_mm=5),
    RepeatStep(times=3, note="thrice"),
    LineStep(x_mm=200, y_mm=50, z_mm=85, pitch="interpolated", pitch_deg=-45, speed_mm_s=20),
    ArcStep(via_x_mm=1, via_y_mm=2, via_z_mm=3, x_mm=4, y_mm=5, z_mm=6),
    WaitStep(seconds=0.5),
    EndStep(),
    CommentStep(note="after it"),
    SpeedStep(percent=50),
    GripperStep(open_percent=20),
)
PROGRAM = Program(robot="uzuner", name="pick", steps=STEPS)
SCRIPT = """\
with armctl.Arm.open('uzuner') as arm:
    arm.enable()
    # pick
    arm.go_joints([0, 90, -80.5, -40, 0], duration_s=2)  # home
    arm.go(x_mm=200, y_mm=0, z_mm=85, pitch_deg=-30, blend_mm=5)
    for _ in range(3):  # thrice
        arm.line(x_mm=200, y_mm=50, z_mm=85, pitch='interpolated', pitch_deg=-45, speed_mm_s=20)
        arm.arc(via_mm=(1, 2, 3), to_mm=(4, 5, 6))
        arm.wait(0.5)
    # after it
    arm.set_speed(50)
    arm.gripper(20)
"""


CALLS = {
    MoveStep: "go_joints",
    PointStep: "go",
    LineStep: "line",
    ArcStep: "arc",
    WaitStep: "wait",
    GripperStep: "gripper",
    SpeedStep: "set_speed",
}


def test_it_reads_like_a_script() -> None:
    text = write_script(PROGRAM)
    assert text.endswith(SCRIPT)
    assert text.startswith("'pick'\n")
    assert write_script(Program(robot="x", name="y")).endswith("    arm.enable()\n")


@given(programs())
@settings(max_examples=100)
def test_texts_never_become_code(program: Program) -> None:
    """Whatever names and notes hold, the code is made of the calls that the steps are."""
    allowed = {
        "armctl",
        "arm",
        "Arm",
        "open",
        "enable",
        "range",
        "_",
        "go_joints",
        "go",
        "line",
        "arc",
        "wait",
    }
    allowed |= {"gripper", "set_speed"}
    tree = ast.parse(write_script(program))
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert names <= allowed
    calls = sum(isinstance(node, ast.Call) for node in ast.walk(tree))
    quiet = sum(isinstance(step, CommentStep | EndStep) for step in program.steps)
    assert calls == len(program.steps) - quiet + 2


@pytest.mark.parametrize(
    "text", ["'\nimport os\nos.system('x')\n'", '"""', "\\", "\u2028x", "a\x0cb", "#}{", "\r\n"]
)
def test_hostile_names_and_notes(text: str) -> None:
    steps = (
        CommentStep(note=text),
        RepeatStep(times=2, note=text),
        WaitStep(seconds=1, note=text),
        EndStep(note=text),
    )
    program = Program(robot=text, name=text, steps=steps)
    assert not any(
        isinstance(node, ast.Import) and node.names[0].name == "os"
        for node in ast.walk(ast.parse(write_script(program)))
    )


@given(programs(times=st.integers(1, 3)))
@settings(max_examples=50)
def test_run_as_a_script_it_calls_what_the_program_does(program: Program) -> None:
    arm_class = create_autospec(Arm)  # refuses arguments that the real methods do not have
    with patch.object(armctl, "Arm", arm_class):
        exec(compile(write_script(program), "script", "exec"), {})
    arm = arm_class.open.return_value.__enter__.return_value
    cursor, expected = Cursor(program), ["enable"]
    while (following := cursor.next()) is not None:
        expected.append(CALLS[type(following[1])])
    assert [call[0] for call in arm.method_calls] == expected
    arm_class.open.assert_called_once_with(program.robot)


def test_as_deep_as_python_goes_and_no_deeper() -> None:
    def nested(depth: int) -> Program:
        steps = (*[RepeatStep(times=1)] * depth, WaitStep(seconds=1), *[EndStep()] * depth)
        return Program(robot="uzuner", steps=steps)

    text = write_script(nested(19))
    compile(text, "script", "exec")
    with pytest.raises(
        ProgramError, match="step 20: a Python script takes at most 19 repeats inside each other"
    ):
        write_script(nested(20))
    with pytest.raises(SyntaxError):
        compile(text.replace("arm.wait(1)", "for _ in range(1): arm.wait(1)"), "script", "exec")


def test_a_step_that_no_call_does_is_named() -> None:
    class Odd(Step, frozen=True, kw_only=True, tag="odd"):
        """A kind of step that says nothing of scripts."""

    with pytest.raises(ProgramError, match="step 2: no call of Arm does what a 'odd' step does"):
        write_script(Program(robot="uzuner", steps=(WaitStep(seconds=1), Odd())))
