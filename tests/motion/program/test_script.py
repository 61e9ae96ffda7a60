from __future__ import annotations

import ast
from unittest.mock import create_autospec, patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.motion.program.kit import programs

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
    kind_of,
    read_script,
    write_script,
)
from armctl.program.files.script import CALLS

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


def script(body: str, name: str = "'test'") -> str:
    lines = "\n".join(f"    {line}" for line in body.splitlines())
    return f"{name}\n\nimport armctl\n\nwith armctl.Arm.open('uzuner') as arm:\n    arm.enable()\n{lines}\n"


def read(body: str) -> tuple[Step, ...]:
    return read_script(script(body)).steps


@given(programs())
@settings(max_examples=200)
def test_writing_and_reading_is_the_identity(program: Program) -> None:
    text = write_script(program)
    compile(text, "script", "exec")
    assert read_script(text) == program
    assert read_script(text.replace("\n", "\r\n").encode()) == program


def test_it_reads_like_a_script() -> None:
    text = write_script(PROGRAM)
    assert text.endswith(SCRIPT)
    assert text.startswith("'pick'\n")
    assert read_script(text) == PROGRAM


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
    assert read_script(write_script(program)) == program
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
        expected.append(CALLS[kind_of(following[1])].name)
    assert [call[0] for call in arm.method_calls] == expected
    arm_class.open.assert_called_once_with(program.robot)


def test_as_deep_as_python_goes_and_no_deeper() -> None:
    def nested(depth: int) -> Program:
        steps = (*[RepeatStep(times=1)] * depth, WaitStep(seconds=1), *[EndStep()] * depth)
        return Program(robot="uzuner", steps=steps)

    text = write_script(nested(19))
    compile(text, "script", "exec")
    assert read_script(text) == nested(19)
    with pytest.raises(
        ProgramError, match="step 20: a Python script takes at most 19 repeats inside each other"
    ):
        write_script(nested(20))
    with pytest.raises(SyntaxError):
        compile(text.replace("arm.wait(1)", "for _ in range(1): arm.wait(1)"), "script", "exec")


def test_what_a_person_may_change() -> None:
    text = SCRIPT.replace("'uzuner')", '"uzuner", port="auto")')
    assert read_script(f'"pick"\nimport armctl\n{text}') == PROGRAM
    body = (
        'arm.wait(seconds=1)  # "quoted\n'
        "for _ in range(2):\n"
        "    arm.line(x_mm=1, y_mm=-2,\n"
        "        z_mm=+3\n"
        "    )"
    )
    with pytest.raises(ProgramError, match=r"line 10: arm.line: z_mm: '\+3' is not a plain number"):
        read(body)
    wait, begin, line, end = read(body.replace("+3", "3  # here"))
    assert (wait, begin, end) == (WaitStep(seconds=1, note='"quoted'), RepeatStep(times=2), EndStep())
    assert line == LineStep(x_mm=1, y_mm=-2, z_mm=3, note="here")


def test_comments_belong_to_the_block_that_they_are_indented_to() -> None:
    first = "for _ in range(2):\n    arm.wait(1)\n    # in\n# out\n"
    body = f"{first}arm.wait(2)\nfor _ in range(3):\n    # before\n    arm.wait(3)"
    assert [type(step).__name__.removesuffix("Step") for step in read(body)] == (
        "Repeat Wait Comment End Comment Wait Repeat Comment Wait End".split()
    )


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("import os", "line 7: 'import os' is not a step"),
        ("arm.wait(1)\n__import__('os').system('x')", r"line 8: .*is not a step; known are arm.go_joints"),
        ("arm.close()", r"line 7: 'arm.close'\(...\) is not a step"),
        ("print(1)", r"line 7: 'print'\(...\) is not a step"),
        ("x = 1", "line 7: 'x = 1' is not a step"),
        ("pass", "line 7: 'pass' is not a step"),
        ("while True:\n    arm.wait(1)", "line 7: 'while True:' is not a step"),
        ("if 1:\n    arm.wait(1)", "line 7: 'if 1:' is not a step"),
        ("arm.wait(1 + 1)", r"line 7: arm.wait: seconds: '1 \+ 1' is not a plain number"),
        ("arm.wait(seconds())", r"line 7: arm.wait: seconds: 'seconds\(\)' is not a plain number"),
        ("arm.wait(1e999)", "line 7: arm.wait: seconds: .* is too large"),
        ("arm.go(x_mm=-1e999, y_mm=0, z_mm=0)", "line 7: arm.go: x_mm: .* is too large"),
        (f"arm.go(x_mm={'9' * 400}, y_mm=0, z_mm=0)", "line 7: arm.go: x_mm: .* is too large"),
        ("arm.wait(-1)", "line 7: arm.wait: seconds: must be at least 0, not -1"),
        ("arm.wait(True)", "line 7: arm.wait: seconds: must be a number, not True"),
        ("arm.wait('1')", "line 7: arm.wait: seconds: must be a number, not '1'"),
        ("arm.wait()", "line 7: arm.wait: the key 'seconds' is missing"),
        ("arm.wait(1, 2)", "line 7: arm.wait takes 1 values without a name, not 2"),
        ("arm.wait(1, seconds=2)", "line 7: arm.wait: seconds is given twice"),
        ("arm.wait(*[1])", r"line 7: arm.wait: seconds: '\*\[1\]' is not a plain number"),
        ("arm.wait(**{})", r"line 7: arm.wait: there is no argument '\*\*'"),
        ("arm.wait(note='x', seconds=1)", "line 7: arm.wait: there is no argument 'note'"),
        ("arm.arc(via_mm=[1, 2], to_mm=[1, 2, 3])", "line 7: arm.arc: via_mm needs 3 numbers in brackets"),
        ("arm.arc(via_mm=3, to_mm=[1, 2, 3])", "line 7: arm.arc: via_mm needs 3 numbers in brackets"),
        (
            "arm.go_joints([1, 2], profile='fast')",
            "line 7: arm.go_joints: profile: must be one of 'cubic', .*, not 'fast'",
        ),
        ("for i in range(2):\n    arm.wait(1)", "line 7: a loop is 'for _ in range"),
        ("for _ in range(n):\n    arm.wait(1)", "line 7: a loop is 'for _ in range"),
        ("for _ in range(0):\n    arm.wait(1)", "line 7: repeats: must be at least 1"),
        ("for _ in range(2):\n    arm.wait(1)\nelse:\n    arm.wait(2)", "line 7: a loop is 'for _ in range"),
        ("arm.wait(1", r"line 7: not Python: '\(' was never closed"),
        ("arm.wait('''", "line 7: not Python: unterminated"),
    ],
)
def test_anything_else_is_refused_by_line(body: str, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        read(body)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: a script is the program's name as a text"),
        ("import armctl\n", "line 1: a script is the program's name"),
        (script("", name="import os"), "line 1: a script is the program's name"),
        (script("") + "import os\n", "line 1: a script is the program's name"),
        (script("").replace("armctl.Arm", "evil.Arm"), "line 5: write 'with armctl.Arm.open"),
        (script("").replace("'uzuner'", "'uzuner', port=x"), "line 5: write 'with armctl.Arm.open"),
        (script("").replace("'uzuner'", "input()"), "line 5: write 'with armctl.Arm.open"),
        (script("").replace("as arm", "as robot"), "line 5: write 'with armctl.Arm.open"),
        (script("").replace("arm.enable()", "arm.release()"), r"line 6: the first call is 'arm.enable\(\)'"),
        (script("arm.wait(1)").replace("'test'", "'te\x00st'"), "not Python: .*null"),
        ("(" * 5000, "not Python"),
        ("\t" * 200 + "x", "line 1: not Python: "),
        (b"\xff", "not a text file in UTF-8: byte 1 cannot be read"),
    ],
)
def test_another_frame_is_refused(text: str | bytes, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        read_script(text)
