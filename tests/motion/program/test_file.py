from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armctl.errors import ProgramError
from armctl.motion import (
    GripperStep,
    MoveStep,
    PointStep,
    Program,
    WaitStep,
    decode_program,
    encode_program,
    load_program,
    save_program,
)

FLOATS = st.floats(-1e6, 1e6)
SECONDS = st.floats(0, 86_400)
NOTES = st.text(st.characters(blacklist_categories=("Cs",)), max_size=12)
STEPS = st.one_of(
    st.builds(
        MoveStep,
        joints_deg=st.lists(FLOATS, max_size=6).map(tuple),
        duration_s=st.none() | SECONDS,
        note=NOTES,
    ),
    st.builds(
        PointStep,
        x_mm=FLOATS,
        y_mm=FLOATS,
        z_mm=FLOATS,
        pitch_deg=st.none() | FLOATS,
        roll_deg=st.none() | FLOATS,
        choose=st.sampled_from(["least-rotation", "published"]),
        duration_s=st.none() | SECONDS,
        note=NOTES,
    ),
    st.builds(WaitStep, seconds=SECONDS, note=NOTES),
    st.builds(GripperStep, open_percent=st.floats(0, 100), note=NOTES),
)
PROGRAMS = st.builds(Program, robot=NOTES, name=NOTES, steps=st.lists(STEPS, max_size=6).map(tuple))

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


@given(PROGRAMS)
@settings(max_examples=150)
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
        (("seconds = 0.5", "seconds = -1"), r"pick\.toml: step 3, key seconds: Expected `float` >= 0"),
        (("seconds = 0.5", "second = 1"), r"pick\.toml: step 3: .*unknown field `second`"),
        (("x_mm = 200", 'x_mm = "far"'), r"pick\.toml: step 2, key x_mm: Expected `float`, got `str`"),
        (("open_percent = 20", ""), r"pick\.toml: step 4: .*missing required field `open_percent`"),
        (('do = "wait"', 'do = "sleep"'), r"pick\.toml: step 3, key do: Invalid value 'sleep'"),
        (('name = "pick"', "speed = 3"), r"pick\.toml: Object contains unknown field `speed`"),
        (("format = 1", "format = 2"), r"pick\.toml: key format: Invalid enum value 2"),
        (("-80, -40", '-80, "x"'), r"pick\.toml: step 1, key joints_deg\[3\]: Expected `float`"),
        (("[[steps]]", "[[steps]"), r"pick\.toml: "),
    ],
)
def test_what_is_wrong_is_told_with_file_step_and_key(
    tmp_path: Path, change: tuple[str, str], message: str
) -> None:
    path = tmp_path / "pick.toml"
    path.write_text(GOOD.replace(*change, 1))
    with pytest.raises(ProgramError, match=message):
        load_program(path)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r"none\.toml: cannot be read: No such file"):
        load_program(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ProgramError, match=r"binary\.toml: "):
        load_program(tmp_path / "binary.toml")


def test_saving_keeps_the_version_before_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "pick.toml"
    first, second, third = (Program(robot="uzuner", name=name) for name in ("one", "two", "three"))
    save_program(first, path)
    assert list(tmp_path.iterdir()) == [path]
    save_program(second, path)
    save_program(third, path)
    assert load_program(path) == third
    assert load_program(tmp_path / "pick.toml~") == second
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["pick.toml", "pick.toml~"]


def test_a_crash_while_writing_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "pick.toml"
    save_program(Program(robot="uzuner", name="old"), path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ProgramError, match="cannot be written: No space left"):
        save_program(Program(robot="uzuner", name="new"), path)
    assert load_program(path).name == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["pick.toml"]


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="cannot be written: No such file"):
        save_program(Program(robot="uzuner"), tmp_path / "none" / "pick.toml")


def test_what_could_not_be_read_again_is_not_saved(tmp_path: Path) -> None:
    path = tmp_path / "pick.toml"
    with pytest.raises(ProgramError, match="not saved, it could not be read again: step 1, key seconds"):
        save_program(Program(robot="uzuner", steps=(WaitStep(seconds=-1),)), path)
    with pytest.raises(ProgramError, match="not saved"):
        save_program(Program(robot="uzuner", steps=(WaitStep(seconds=float("nan")),)), path)
    assert list(tmp_path.iterdir()) == []
