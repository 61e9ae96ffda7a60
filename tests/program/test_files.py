from __future__ import annotations

import ast
import math
import os
import re
import threading
import time
from pathlib import Path
from unittest.mock import create_autospec, patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples
from tests.program.kit import programs

import armctl
from armctl.arm import Arm
from armctl.errors import ProgramError
from armctl.process import heavy_work
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
    checked_program,
    decode_program,
    encode_program,
    load_program,
    read_csv,
    read_program,
    save_program,
    write_csv,
    write_script,
)
from armctl.program.draw_step import DrawStep
from armctl.program.steps import KINDS
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
GOOD = """\
format = 1
robot = "uzuner"
name = "pick"

[[steps]]
do = "move"
joints_deg = [0, 90, -80, -40, 0]

[[steps]]
do = "point"
x_mm = 200
y_mm = 0
z_mm = 85.5
note = "above"

[[steps]]
do = "wait"
seconds = 0.5

[[steps]]
do = "gripper"
open_percent = 20
"""


@given(programs())
@settings(max_examples=examples(150))
def test_saving_and_loading_is_the_identity(program: Program) -> None:
    assert decode_program(encode_program(program)) == program


def test_a_written_program_is_read(tmp_path: Path) -> None:
    path = tmp_path / "pick.toml"
    path.write_text(GOOD)
    assert load_program(path) == Program(
        robot="uzuner",
        name="pick",
        steps=(
            MoveStep(joints_deg=(0, 90, -80, -40, 0)),
            PointStep(x_mm=200, y_mm=0, z_mm=85.5, note="above"),
            WaitStep(seconds=0.5),
            GripperStep(open_percent=20),
        ),
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("seconds = 0.5", "seconds = -1"), "line 18, step 3, key seconds: must be 0 … 86400, not -1"),
        (("seconds = 0.5", "second = 1"), "line 18, step 3: unknown key 'second'; mistyped?"),
        (("x_mm = 200", 'x_mm = "far"'), "line 11, step 2, key x_mm: must be a number, not 'far'"),
        (("x_mm = 200", "x_mm = nan"), "line 11, step 2, key x_mm: nan is no number to use"),
        (("-80, -40", "-80, -inf"), r"line 7, step 1, key joints_deg\[3\]: -inf is no number to use"),
        (("open_percent = 20", ""), "line 20, step 4: the key 'open_percent' is missing"),
        (('do = "wait"', 'do = "sleep"'), "line 17, step 3, key do: must be one of 'move', .*, not 'sleep'"),
        (('name = "pick"', "speed = 3"), "line 3: unknown key 'speed'; mistyped?"),
        (('robot = "uzuner"', ""), "the key 'robot' is missing"),
        (("-80, -40", '-80, "x"'), r"line 7, step 1, key joints_deg\[3\]: must be a number, not 'x'"),
        (("x_mm = 200", "x_mm = 2e9\nblend_mm = -1"), "line 12, step 2, key blend_mm: must be 0 … 1000"),
        (
            ('note = "above"', 'note = """\n[[steps]]\nx_mm = 1\n"""\nz = 1'),
            "line 18, step 2: unknown key 'z'",
        ),
        (('note = "above"', "profile = 'fast' # [[steps]]"), "line 14, step 2, key profile: .* not 'fast'"),
        (("open_percent = 20", "open_percent ="), "line 22, column 15: invalid value"),
        (('do = "gripper"\nopen_percent = 20', 'do = "end"'), "line 20, step 4: 'end' without a 'repeat'"),
        (('do = "wait"\nseconds = 0.5', 'do = "repeat"\ntimes = 2'), "line 16, step 3: this 'repeat' has no"),
        (("seconds = 0.5", "seconds = 0.5\n[other]\nx = 1"), "line 19: unknown key 'other'; mistyped?"),
    ],
)
def test_what_is_wrong_is_told_with_file_line_step_and_key(
    tmp_path: Path, change: tuple[str, str], message: str
) -> None:
    path = tmp_path / "pick.toml"
    text = GOOD.replace(*change, 1)
    for newline in ("\n", "\r\n"):
        path.write_bytes(text.replace("\n", newline).encode())
        with pytest.raises(ProgramError, match=rf"pick\.toml: {message}"):
            load_program(path)


def test_a_program_has_so_many_steps_at_most() -> None:
    step = "{do='end'},"
    with pytest.raises(ProgramError, match="it has 20001 steps; a program has 20000 at most"):
        decode_program(f"robot='uzuner'\nsteps=[{step * 20_001}]")
    rows = "0,90,-80,-40,0\n" * 20_001
    with pytest.raises(ProgramError, match="a program has 20000 steps at most"):
        read_csv(f"base_deg,shoulder_deg,elbow_deg,wrist_pitch_deg,wrist_roll_deg\n{rows}", ROBOT)


def test_steps_as_an_array_are_read_and_named() -> None:
    text = 'robot = "uzuner"\nsteps = [\n  {do = "wait", seconds = 1},\n  {do = "wait", seconds = %s},\n]\n'
    assert decode_program(text % "2").steps == (WaitStep(seconds=1), WaitStep(seconds=2))
    with pytest.raises(ProgramError, match=r"^line 4, step 2, key seconds: must be a number, not 'x'"):
        decode_program(text % "'x'")


def test_what_else_cannot_be_a_program() -> None:
    with pytest.raises(ProgramError, match="line 1, key steps: must be a list, not 3"):
        decode_program('steps = 3\nrobot = "x"')
    with pytest.raises(ProgramError, match="key x_mm: "):
        decode_program(GOOD.replace("x_mm = 200", f"x_mm = {'9' * 400}"))


def test_ten_times_as_many_steps_take_about_ten_times_as_long() -> None:
    point = PointStep(x_mm=200.25, y_mm=-10.5, z_mm=85.5, blend_mm=5)
    pose = MoveStep(joints_deg=(0.25, 90, -80.5, -40, 0))
    four = (pose, point, WaitStep(seconds=0.5), GripperStep(open_percent=20))

    def seconds(steps: int) -> float:
        program = Program(robot="uzuner", steps=four * (steps // 4))
        begin = time.thread_time()
        assert decode_program(encode_program(program)) == program
        return time.thread_time() - begin

    # a way through all steps for each of them would take a hundred times as long
    assert seconds(10_000) < 40 * min(seconds(1000) for _ in range(3))


def test_saving_keeps_the_version_before_and_leaves_nothing_else(tmp_path: Path) -> None:
    path, kept = tmp_path / "pick.toml", tmp_path / "pick.toml~"
    first, second, third = (Program(robot="uzuner", name=name) for name in ("one", "two", "three"))
    save_program(first, path)
    assert list(tmp_path.iterdir()) == [path]
    save_program(second, path)
    save_program(third, path)
    assert (load_program(path), load_program(kept)) == (third, second)
    kept.unlink()
    os.link(path, kept)  # the kept version becomes a file of its own
    save_program(first, path)
    assert not path.samefile(kept)
    assert (load_program(path), load_program(kept)) == (first, third)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["pick.toml", "pick.toml~"]


def test_a_crash_while_writing_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "pick.toml"
    save_program(Program(robot="uzuner", name="old"), path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ProgramError, match="cannot be written: No space left on device; free some space"):
        save_program(Program(robot="uzuner", name="new"), path)
    assert load_program(path).name == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["pick.toml"]


def test_what_could_not_be_read_again_is_not_saved(tmp_path: Path) -> None:
    path = tmp_path / "pick.toml"
    with pytest.raises(ProgramError, match="not saved, it could not be read again: step 1, key seconds"):
        save_program(Program(robot="uzuner", steps=(WaitStep(seconds=-1),)), path)
    with pytest.raises(ProgramError, match="not saved"):
        save_program(Program(robot="uzuner", steps=(WaitStep(seconds=float("nan")),)), path)
    assert list(tmp_path.iterdir()) == []


def test_saving_follows_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    real, link = tmp_path / "real" / "pick.toml", tmp_path / "pick.toml"
    save_program(Program(robot="uzuner", name="old"), real)
    link.symlink_to(real)
    save_program(Program(robot="uzuner", name="new"), link)
    assert link.is_symlink()
    assert load_program(real).name == "new"
    assert load_program(tmp_path / "real" / "pick.toml~").name == "old"


def test_saves_at_the_same_time_leave_whole_files(tmp_path: Path) -> None:
    path = tmp_path / "pick.toml"
    names = [f"n{k}" for k in range(6)]
    failures: list[BaseException] = []

    def save(name: str) -> None:
        try:
            for _ in range(8):
                save_program(Program(robot="uzuner", name=name, steps=(WaitStep(seconds=1),) * 50), path)
        except BaseException as failure:
            failures.append(failure)

    threads = [threading.Thread(target=save, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert {load_program(path).name, load_program(tmp_path / "pick.toml~").name} <= set(names)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["pick.toml", "pick.toml~"]


def test_the_folder_is_flushed_once_the_file_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pick.toml"
    flushed: list[tuple[bool, bool]] = []
    fsync = os.fsync

    def note(handle: int) -> None:
        is_folder = os.path.isdir(f"/proc/self/fd/{handle}")
        flushed.append((is_folder, path.exists()))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", note)
    save_program(Program(robot="uzuner"), path)
    assert flushed == [(False, False), (True, True)]


def test_what_is_no_place_for_a_file(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="cannot be written: No such file"):
        save_program(Program(robot="uzuner"), tmp_path / "none" / "pick.toml")
    folder = tmp_path / "pick.toml"
    folder.mkdir()
    with pytest.raises(ProgramError, match="cannot be written: it is a folder"):
        save_program(Program(robot="uzuner"), folder)
    assert list(tmp_path.iterdir()) == [folder]
    circle = tmp_path / "circle.toml"
    circle.symlink_to(circle)
    with pytest.raises(ProgramError, match=r"circle\.toml: cannot be written: "):
        save_program(Program(robot="uzuner"), circle)
    with pytest.raises(ProgramError, match="not saved"):
        save_program(Program(robot="uzuner", name="\ud800"), tmp_path / "x.toml")


def test_a_program_built_in_python_is_as_its_file_would_be_read() -> None:
    built = Program(
        robot="uzuner",
        steps=(
            MoveStep(joints_deg=np.array([0.0, 90.0, -80.0, -40.0, 0.0])),
            PointStep(x_mm=np.float64(200), y_mm=np.int64(0), z_mm=np.float32(85.5)),
        ),
    )
    plain = (
        MoveStep(joints_deg=(0.0, 90.0, -80.0, -40.0, 0.0)),
        PointStep(x_mm=200.0, y_mm=0.0, z_mm=85.5),
    )
    assert checked_program(built).steps == plain
    with pytest.raises(ProgramError, match="untitled: steps must be a list, not 3"):
        checked_program(Program(robot="uzuner", steps=3))
    assert decode_program(encode_program(built)).steps == plain


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (WaitStep(seconds=None), "step 1, key seconds: must be a number, not None"),
        (WaitStep(seconds=math.nan), "step 1, key seconds: "),
        (PointStep(x_mm=0, y_mm=0, z_mm=0, profile="fast"), "key profile: must be one of 'cubic', "),
        (RepeatStep(times=2.5), "step 1, key times: must be a whole number, not 2.5"),
        (RepeatStep(times=2), "step 1: this 'repeat' has no 'end'"),
        ("wait", "step 1: must be a table, not 'wait'"),
        (
            MoveStep(joints_deg={1.0}),
            "step 1, key joints_deg: {1.0} is neither a number, nor text, nor a list",
        ),
        (WaitStep(seconds=1, note=b"x"), "step 1, key note: b'x' is neither"),
        (MoveStep(joints_deg=(0, object())), "key joints_deg[1]: must be a number, not '<object"),
    ],
)
def test_what_python_lets_a_program_hold_is_told_before_it_is_used(step: Step, message: str) -> None:
    with pytest.raises(ProgramError, match=f"(?s)^trial: .*{re.escape(message)}"):
        checked_program(Program(robot="uzuner", name="trial", steps=(step,)))


READABLE = Program(robot="uzuner", name="pick", steps=(WaitStep(seconds=1),))


def test_every_form_that_is_read_is_told_by_its_name() -> None:
    assert read_program("a.TOML", encode_program(READABLE).encode(), ROBOT) == READABLE
    assert read_program("pick.csv", write_csv(READABLE, ROBOT).encode(), ROBOT) == READABLE


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", b"", r"^a\.txt: is none of \.toml, \.csv$"),
        ("a.toml", b"x\n", r"^a\.toml: line 1, column 2: "),
        ("a.csv", b"x,y\n", r"^a\.csv: line 1, column 'x' has no unit"),
        ("b/a.py", b"import os", r"^b/a\.py: is a Python script; run it with Python: python a\.py$"),
        ("a.toml", b" " * (1024 * 1024 + 1), r"^a\.toml: is larger than 1024 KiB"),
        (
            "a.toml",
            b'robot = "x"\nsteps = [' + 20_001 * b'{do="end"},' + b"]",
            r"it has 20001 steps; .* 20000 at",
        ),
    ],
)
def test_what_is_refused_names_the_file(name: str, content: bytes, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        read_program(name, content, ROBOT)


def test_a_long_file_is_read_apart_with_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def here(*_: object) -> Program:
        raise AssertionError("a long file is read in this process")

    long = Program(robot="uzuner", name="long", steps=(MoveStep(joints_deg=(10, 90, -80, -40, 0)),) * 4000)
    text = write_csv(long, ROBOT).encode()
    monkeypatch.setattr(heavy_work, "read_program", here)
    assert heavy_work.read_program_apart("long.csv", text, ROBOT) == long
    with pytest.raises(ProgramError, match=r"^long\.csv: 2 errors: line 4002, "):
        heavy_work.read_program_apart("long.csv", text + b"this,is,no,step\n", ROBOT)


# Python scripts.

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
SCRIPTED = Program(robot="uzuner", name="pick", steps=STEPS)
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


def test_it_reads_like_a_script() -> None:
    text = write_script(SCRIPTED)
    assert text.endswith(SCRIPT)
    assert text.startswith("'pick'\n")
    assert write_script(Program(robot="x", name="y")).endswith("    arm.enable()\n")


@given(programs())
@settings(max_examples=examples(100))
def test_texts_never_become_code(program: Program) -> None:
    """Whatever names and notes hold, the code is made of the calls that the steps are."""
    allowed = {"armctl", "arm", "Arm", "open", "enable", "range", "_", "arc"}
    allowed |= {kind.call[0] for kind in KINDS if kind.call}
    allowed |= {"run", "program", "Program", "robot", "name", "DrawStep"}  # no method of Arm draws
    tree = ast.parse(write_script(program))
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert names <= allowed
    calls = sum(isinstance(node, ast.Call) for node in ast.walk(tree))
    quiet = sum(isinstance(step, CommentStep | EndStep) for step in program.steps)
    drawn = sum(isinstance(step, DrawStep) for step in program.steps)
    assert calls == len(program.steps) - quiet + 2 * drawn + 2


@given(programs(times=st.integers(1, 3)))
@settings(max_examples=examples(50))
def test_run_as_a_script_it_calls_what_the_program_does(program: Program) -> None:
    arm_class = create_autospec(Arm)  # refuses arguments that the real methods do not have
    with patch.object(armctl, "Arm", arm_class):
        exec(compile(write_script(program), "script", "exec"), {})
    arm = arm_class.open.return_value.__enter__.return_value
    cursor, expected = Cursor(program), ["enable"]
    while (following := cursor.next()) is not None:
        drawn = isinstance(following[1], DrawStep)
        expected.append("run" if drawn else (following[1].call or ("arc",))[0])
    assert [call[0] for call in arm.method_calls] == expected
    arm_class.open.assert_called_once_with(program.robot)


def test_as_deep_as_python_goes_and_no_deeper() -> None:
    def nested(depth: int) -> Program:
        steps = (*[RepeatStep(times=1)] * depth, WaitStep(seconds=1), *[EndStep()] * depth)
        return Program(robot="uzuner", steps=steps)

    text = write_script(nested(19))
    compile(text, "script", "exec")
    with pytest.raises(
        ProgramError, match="step 20: a Python script takes at most 19 blocks inside each other"
    ):
        write_script(nested(20))
    with pytest.raises(SyntaxError):
        compile(text.replace("arm.wait(1)", "for _ in range(1): arm.wait(1)"), "script", "exec")


def test_a_step_that_no_call_does_is_named() -> None:
    class Odd(Step, frozen=True, kw_only=True, tag="odd"):
        """A kind of step that says nothing of scripts."""

    with pytest.raises(ProgramError, match="step 2: no call of Arm does what a 'odd' step does"):
        write_script(Program(robot="uzuner", steps=(WaitStep(seconds=1), Odd())))


# Steps in words.


def words(step: Step) -> tuple[str, str]:
    return step.title or step.kind, step.describe()


def test_steps_in_words() -> None:
    assert words(MoveStep(joints_deg=(0.0, 90.0, -80.256, -40.0, 0.0))) == ("pose", "0, 90, −80.26, −40, 0 °")
    assert words(MoveStep(joints_deg=(1.0,), duration_s=2)) == ("pose", "1 ° in 2 s")
    assert words(PointStep(x_mm=200.0, y_mm=-10.5, z_mm=100.0, pitch_deg=-30.0)) == (
        "point",
        "200, −10.5, 100 mm, pitch −30°",
    )
    assert words(WaitStep(seconds=1.5)) == ("wait", "1.5 s")
    assert words(GripperStep(open_percent=40)) == ("gripper", "40 % open")
    held = GripperStep(open_percent=40, part_x_mm=20, part_y_mm=30, part_z_mm=12.5)
    assert words(held) == ("gripper", "40 % open, round a part of 20 × 30 × 12.5 mm")
    assert held.script() == "gripper(40, part_mm=[20, 30, 12.5])"
    assert "part" not in encode_program(Program(robot="uzuner", steps=(GripperStep(open_percent=40),)))
    quick = PointStep(x_mm=1, y_mm=2, z_mm=3, roll_deg=5, profile="s-curve", blend_mm=4, duration_s=2)
    assert words(quick) == ("point", "1, 2, 3 mm, roll 5° in 2 s, s-curve, blend 4 mm")
    line = LineStep(x_mm=1, y_mm=2, z_mm=3, pitch="interpolated", pitch_deg=-45, speed_mm_s=20)
    assert words(line) == ("line", "1, 2, 3 mm, pitch interpolated to −45°, 20 mm/s")
    turned = LineStep(x_mm=1, y_mm=2, z_mm=3, orientation="interpolated", rx_deg=180, ry_deg=0, rz_deg=-45)
    assert words(turned) == ("line", "1, 2, 3 mm, orientation interpolated to Rx Ry Rz (180, 0, −45)°")
    assert turned.script() == (
        "line(x_mm=1, y_mm=2, z_mm=3, orientation='interpolated', rpy_deg=[180, 0, -45])"
    )
    assert words(PointStep(x_mm=1, y_mm=2, z_mm=3, rx_deg=1)) == (
        "point",
        "1, 2, 3 mm, Rx Ry Rz (1, ?, ?)°",
    )
    arc = ArcStep(via_x_mm=4, via_y_mm=5, via_z_mm=6, x_mm=1, y_mm=2, z_mm=3, blend_mm=1)
    assert words(arc) == ("arc", "1, 2, 3 mm via 4, 5, 6 mm, blend 1 mm")
    assert words(SpeedStep(percent=50)) == ("speed", "50 % from here on")
    assert words(RepeatStep(times=3)) == ("repeat", "3 times")
    assert words(EndStep()) == ("end", "of the block")
    assert words(CommentStep(note="x")) == ("comment", "")
