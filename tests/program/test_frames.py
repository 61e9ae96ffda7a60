"""User frames: taught by three touches; a program in a frame is that program where the frame is."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from unittest.mock import create_autospec, patch

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import LONG, examples
from tests.runtime.kit import make_rig

import armctl
from armctl.arm import Arm
from armctl.arrays import FloatArray
from armctl.errors import InputError, ProgramError
from armctl.facts import CellOutsideGrid, FrameNamedBase, UnknownFrame
from armctl.kinematics import rotation_from_rpy
from armctl.program import (
    ArcStep,
    CommentStep,
    Cursor,
    DrawStep,
    ElseStep,
    EndStep,
    FrameStep,
    GridStep,
    IfStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    Step,
    UserFrame,
    WaitStep,
    check_program,
    decode_program,
    encode_program,
    load_program,
    read_csv,
    save_program,
    write_csv,
    write_script,
)
from armctl.program.edit import PLACES, add, delete_frame, put_frame, rename_frame
from armctl.program.frames import LEAST_SINE, Placing, turn_errors
from armctl.program.rehearsal import pose_after, rehearse
from armctl.protocol import RunProgram
from armctl.robot import load_robot

UZUNER, UR5 = load_robot("uzuner"), load_robot("ur5")
END, HOME = EndStep(), MoveStep(joints_deg=(0, 90, -80, -40, 0))
TABLE = UserFrame(x_mm=200, y_mm=-20, z_mm=80, rz_deg=30)
IN, OUT = FrameStep(frame="table"), FrameStep()
AT = PointStep(x_mm=10, y_mm=20, z_mm=30)


def program(*steps: Step, robot: str = "uzuner", **frames: UserFrame) -> Program:
    return Program(robot=robot, name="pick", frames=frames or {"table": TABLE}, steps=steps)


def points(what: Program) -> list[tuple[int, float, float, float]]:
    """Index and point, in the base frame, of each step that has one, as they are run."""
    cursor, seen = Cursor(what), []
    while (found := cursor.next()) is not None:
        if isinstance(found[1], PointStep | LineStep | ArcStep):
            seen.append((found[0], *np.round((found[1].x_mm, found[1].y_mm, found[1].z_mm), 6).tolist()))
    return seen


def at(T: FloatArray, *point: float) -> tuple[float, ...]:
    return tuple(np.round(T[:3, :3] @ point + T[:3, 3], 6).tolist())


# Taught by three touches.


@given(
    st.tuples(*[st.floats(-500, 500)] * 3),
    st.tuples(*[st.floats(-180, 180)] * 3),
    st.floats(20, 400),
    st.floats(-300, 300),
    st.floats(50, 300),
)
@settings(max_examples=examples(100))
def test_three_touches_give_the_frame_that_was_touched(
    origin: tuple[float, ...], rpy: tuple[float, ...], on_x: float, along: float, beside: float
) -> None:
    R = rotation_from_rpy(*np.radians(rpy))
    touches = [np.add(origin, R @ point) for point in ([0, 0, 0], [on_x, 0, 0], [along, beside, 0])]
    T = UserFrame.taught(*touches).matrix
    np.testing.assert_allclose(T[:3, 3], origin, atol=1e-3)
    np.testing.assert_allclose(T[:3, :3], R, atol=2e-5)  # a thousandth of a degree


def test_how_far_off_touches_turn_it_is_what_noise_does() -> None:
    rng, sigma = np.random.default_rng(4), 0.5
    for corner in ((120.0, 0.0, 100.0), (60.0, 0.0, 40.0), (250.0, -30.0, 150.0)):
        a, b, h = corner
        R, origin = rotation_from_rpy(0.3, -0.2, 1.1), np.array([200.0, 30.0, 60.0])
        true = np.array([origin, origin + R @ [a, 0, 0], origin + R @ [b, h, 0]])
        turns = []
        for _ in range(2000):
            R_found = UserFrame.taught(*(true + rng.normal(scale=sigma, size=(3, 3)))).matrix[:3, :3]
            error = R.T @ R_found
            turns.append([error[2, 1], error[0, 2], error[1, 0]])
        np.testing.assert_allclose(np.std(turns, axis=0), turn_errors(*true, sigma), rtol=0.06)


@pytest.mark.parametrize(
    ("touches", "message"),
    [
        (
            [(0, 0, 0), (3, 0, 4 / 3), (0, 90, 0)],
            "the origin and the point on +x are 3.3 mm apart; at least 5 mm",
        ),
        (
            [(0, 0, 0), (100, 0, 0), (98, 2, 0)],
            "the point on +x and the point on the +y side are 2.8 mm apart",
        ),
        ([(0, 0, 0), (100, 0, 0), (200, 10, 0)], "lies 10.0 mm beside the x axis, 2.9° seen from the origin"),
        ([(0, 0, 0), (100, 0, 0), (50, float("nan"), 0)], "three points, X, Y, Z each"),
        ([(0, 0), (100, 0), (50, 9)], "three points, X, Y, Z each"),
    ],
)
def test_touches_that_give_no_frame_are_refused_with_figures(touches: Any, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        UserFrame.taught(*touches)
    with pytest.raises(InputError, match=re.escape(message)):
        turn_errors(*touches, 0.5)


def test_just_far_enough_aside_is_a_frame() -> None:
    flat = 100 * LEAST_SINE / np.sqrt(1 - LEAST_SINE**2)
    assert UserFrame.taught((0, 0, 0), (100, 0, 0), (100, flat + 0.01, 0)).rz_deg == 0
    with pytest.raises(InputError, match=r"5\.7°"):
        UserFrame.taught((0, 0, 0), (100, 0, 0), (100, flat - 0.01, 0))


# A program in a frame is the same program where the frame is.

_PLACE, _NEAR = st.floats(-300, 300), st.floats(-80, 80)
_FRAME = st.builds(
    UserFrame,
    x_mm=_PLACE, y_mm=_PLACE, z_mm=_PLACE,
    rx_deg=st.floats(-180, 180), ry_deg=st.floats(-89, 89), rz_deg=st.floats(-180, 180),
)  # fmt: skip
_TURN = st.floats(-60, 60)


def turned(T: FloatArray, rpy: tuple[float, float, float]) -> FloatArray:
    return T[:3, :3] @ rotation_from_rpy(*np.radians(rpy))


@given(_FRAME, st.tuples(_NEAR, _NEAR, _NEAR), st.tuples(_NEAR, _NEAR, _NEAR), st.tuples(_TURN, _TURN, _TURN))
@settings(max_examples=examples(60))
def test_points_lines_and_arcs_are_where_the_frame_puts_them(
    frame: UserFrame,
    end: tuple[float, float, float],
    via: tuple[float, float, float],
    rpy: tuple[float, float, float],
) -> None:
    xyz = dict(zip(("x_mm", "y_mm", "z_mm"), end, strict=True))
    over = dict(zip(("via_x_mm", "via_y_mm", "via_z_mm"), via, strict=True))
    angles = dict(zip(("rx_deg", "ry_deg", "rz_deg"), rpy, strict=True))
    steps = (
        PointStep(**xyz, **angles),
        LineStep(**xyz, orientation="interpolated", **angles),
        ArcStep(**over, **xyz, pitch="free"),
        PointStep(**xyz, pitch_deg=-30, roll_deg=10),
        DrawStep(file="name.svg", plane_mm=(*end, *via, 1.0, 2.0, 3.0)),
    )
    cursor, T = Cursor(program(IN, *steps, OUT, *steps, table=frame)), frame.matrix
    placed: list[Any] = []
    while (found := cursor.next()) is not None:
        placed.append(found[1])
    assert placed[5:] == list(steps)
    for step in placed[:4]:
        np.testing.assert_allclose((step.x_mm, step.y_mm, step.z_mm), T[:3, :3] @ end + T[:3, 3], atol=1e-9)
    for step in placed[:2]:
        R = rotation_from_rpy(*np.radians((step.rx_deg, step.ry_deg, step.rz_deg)))
        np.testing.assert_allclose(R, turned(T, rpy), atol=1e-9)
    arc = placed[2]
    np.testing.assert_allclose((arc.via_x_mm, arc.via_y_mm, arc.via_z_mm), at(T, *via), atol=1e-5)
    assert (placed[3].pitch_deg, placed[3].roll_deg) == (-30, 10)  # the arm's own
    np.testing.assert_allclose(placed[4].plane_mm[:3], at(T, *end), atol=1e-5)


@given(_FRAME, st.lists(st.tuples(_NEAR, _NEAR, _NEAR, _TURN, _TURN, _TURN), min_size=1, max_size=2))
@settings(max_examples=8 if LONG else 3, deadline=None)
def test_it_moves_as_the_program_that_was_moved_by_hand(
    frame: UserFrame, poses: list[tuple[float, ...]]
) -> None:
    """What the check finds, and every motion of it, is that of the same points given in the base frame."""
    T, home = frame.matrix, UR5.pose("home")
    inside, by_hand = list[Step](), list[Step]()
    for x, y, z, *rpy in poses:
        R = turned(T, (rpy[0], rpy[1], rpy[2]))
        angles = np.degrees(
            [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1, 1)), np.arctan2(R[1, 0], R[0, 0])]
        )
        inside.append(PointStep(x_mm=x, y_mm=y, z_mm=z, rx_deg=rpy[0], ry_deg=rpy[1], rz_deg=rpy[2]))
        bx, by, bz = (T[:3, :3] @ (x, y, z) + T[:3, 3]).tolist()
        rx, ry, rz = angles.tolist()
        by_hand.append(PointStep(x_mm=bx, y_mm=by, z_mm=bz, rx_deg=rx, ry_deg=ry, rz_deg=rz))
    one = check_program(program(CommentStep(), *by_hand, robot="ur5", table=frame), UR5, start=home)
    other = check_program(program(IN, *inside, robot="ur5", table=frame), UR5, start=home)
    assert [(f.step, f.kind, f.part) for f in one] == [(f.step, f.kind, f.part) for f in other]


def test_on_the_wire_it_is_the_program_that_was_moved_by_hand() -> None:
    """A path with a corner: what leaves the driver is the same, tick by tick."""
    T = TABLE.matrix
    inside = (PointStep(x_mm=0, y_mm=0, z_mm=30),
              LineStep(x_mm=20, y_mm=0, z_mm=10, pitch="free", blend_mm=3),
              LineStep(x_mm=20, y_mm=30, z_mm=10, pitch="free", speed_mm_s=60))  # fmt: skip
    by_hand = tuple(
        msgspec.structs.replace(step, **dict(zip(("x_mm", "y_mm", "z_mm"), at(T, *xyz), strict=True)))
        for step in inside
        for xyz in [(step.x_mm, step.y_mm, step.z_mm)]
    )
    sent = []
    for what in (program(HOME, IN, *inside, OUT, HOME), program(HOME, CommentStep(), *by_hand, HOME)):
        rig = make_rig().enable(UZUNER.pose("home"))
        rig.finishes(RunProgram(what))
        sent.append(rig.stream()[1])
    np.testing.assert_allclose(sent[0], sent[1], atol=2e-3)  # a step of the servo map
    assert len(sent[0]) > 100


def test_a_frame_that_is_moved_moves_its_program_and_the_check_sees_it() -> None:
    home, what = UZUNER.pose("home"), program(HOME, IN, AT, OUT, HOME)
    assert check_program(what, UZUNER, start=home) == []
    away = put_frame(what, "table", UserFrame(x_mm=200, y_mm=300, z_mm=300))
    assert away.steps == what.steps and away.content != what.content
    (found, *_) = check_program(away, UZUNER, start=home)
    assert (found.step, found.severity) == (2, "error")
    near = put_frame(what, "table", UserFrame(x_mm=190, y_mm=0, z_mm=90))
    for one in (what, near):
        q = pose_after(UZUNER, one, 2, home)
        assert q is not None
        tip = 1000 * UZUNER.forward(q)[:3, 3]
        np.testing.assert_allclose(tip, at(one.frames["table"].matrix, 10, 20, 30), atol=1e-3)
        assert any(
            np.allclose(1000 * UZUNER.forward(step.trajectory.end)[:3, 3], tip, atol=1e-3)
            for step in rehearse(UZUNER, one, home).steps
        )


# How far down the list a frame counts.


def test_it_counts_to_the_next_one_and_no_farther_than_its_block() -> None:
    shelf = UserFrame(x_mm=0, y_mm=0, z_mm=100)
    what = program(
        AT, RepeatStep(times=2), AT, IN, AT, FrameStep(frame="shelf"), AT, END, AT, IN, AT, OUT, AT,
        table=TABLE, shelf=shelf,
    )  # fmt: skip
    base, table, high = (10, 20, 30), at(TABLE.matrix, 10, 20, 30), (10, 20, 130)
    inside = [(2, *base), (4, *table), (6, *high)]  # also in the second pass
    assert points(what) == [(0, *base), *inside, *inside, (8, *base), (10, *table), (12, *base)]


def test_a_branch_does_not_leak_its_frame() -> None:
    what = program(IfStep(watch="button"), IN, AT, ElseStep(), AT, END, AT)
    names = Placing(what.steps, what.frames).names
    assert names == ["base", "table", "table", "base", "base", "base", "base"]
    for holds, seen in ((True, [at(TABLE.matrix, 10, 20, 30)]), (False, [(10, 20, 30)])):
        cursor = Cursor(what)
        assert cursor.next() == (0, what.steps[0])
        cursor.decide(holds)
        ran = [cursor.next(), cursor.next()]
        found = [
            (step.x_mm, step.y_mm, step.z_mm) for _, step in filter(None, ran) if isinstance(step, PointStep)
        ]
        np.testing.assert_allclose(found, [*seen, (10, 20, 30)], atol=1e-5)


def grid(**more: Any) -> GridStep:
    keys = dict(
        x_mm=0, y_mm=0, z_mm=0, row_x_mm=40, row_y_mm=0, row_z_mm=0, column_x_mm=0, column_y_mm=20,
        column_z_mm=0, rows=2, columns=2, layers=2, layer_mm=10,
    )  # fmt: skip
    return GridStep(**{**keys, **more})


@given(_FRAME)
@settings(max_examples=examples(20))
def test_a_grid_lies_in_the_frame_and_its_cells_have_its_axes(frame: UserFrame) -> None:
    above = PointStep(x_mm=1, y_mm=2, z_mm=30, frame="cell")
    what = program(IN, grid(), above, OUT, above, AT, END, table=frame)
    cells = [(x, y, z) for z in (0, 10) for y in (0, 20) for x in (0, 40)]
    expected = []
    for x, y, z in cells:
        cell = at(frame.matrix, x + 1, y + 2, z + 30)
        expected += [(2, *cell), (4, *cell), (5, 10, 20, 30)]
    np.testing.assert_allclose(points(what), expected, atol=2e-5)


def test_the_check_walks_the_cells_of_a_frame() -> None:
    above, home = PointStep(x_mm=0, y_mm=0, z_mm=30, frame="cell"), UZUNER.pose("home")
    what = program(HOME, IN, grid(), above, END, OUT, HOME)
    assert check_program(what, UZUNER, start=home) == []
    far = program(HOME, IN, grid(row_x_mm=400), above, END, OUT, HOME)
    (found, *_) = check_program(far, UZUNER, start=home)
    assert found.step == 3 and "cell 2" in str(found)
    (lost,) = check_program(program(HOME, IN, above), UZUNER, start=home)
    assert (lost.step, lost.reason) == (2, CellOutsideGrid())


# What is wrong.


def test_a_frame_that_the_program_has_not_is_found_once_at_the_step_that_names_it() -> None:
    what = program(HOME, FrameStep(frame="tabel"), AT, PointStep(x_mm=900, y_mm=0, z_mm=0), OUT, HOME)
    (found,) = check_program(what, UZUNER, start=UZUNER.pose("home"))
    assert (found.step, found.reason) == (1, UnknownFrame("tabel", ("table",)))
    assert "no frame 'tabel'; it has 'table', and 'base'" in str(found)
    with pytest.raises(ProgramError, match="no frame 'tabel'"):
        rehearse(UZUNER, what, UZUNER.pose("home"))


def test_base_is_no_name_for_one() -> None:
    what = Program(robot="uzuner", frames={"base": TABLE}, steps=(HOME,))
    assert [one.reason for one in check_program(what, UZUNER)] == [FrameNamedBase()]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x_mm = nan\ny_mm = 0\nz_mm = 0", "line 4, key frames.table.x_mm: must be"),
        ("x_mm = 0\ny_mm = 0", "line 3, key frames.table: the key 'z_mm' is missing"),
        ("x_mm = 0\ny_mm = 0\nz_mm = 2e5", "frames.table.z_mm: must be −100000 … 100000"),
        ("x_mm = 0\ny_mm = 0\nz_mm = 0\nyaw = 3", "unknown key 'yaw'"),
    ],
)
def test_a_file_with_a_wrong_frame_is_refused_with_its_line(text: str, message: str) -> None:
    with pytest.raises(ProgramError, match=re.escape(message.replace("−", "-"))):
        decode_program(f'format = 1\nrobot = "uzuner"\n[frames.table]\n{text}\n')


def test_one_made_in_python_is_checked_as_a_file_would_be() -> None:
    bad = UserFrame(x_mm=float("inf"), y_mm=0, z_mm=0)
    (found, *_) = check_program(program(IN, AT, table=bad), UZUNER)
    assert "frames" in str(found) and found.severity == "error"


# Files, tables, scripts.


def test_it_goes_through_files_and_tables(tmp_path: Path) -> None:
    shelf = UserFrame(x_mm=1.5, y_mm=0, z_mm=100, rx_deg=3, ry_deg=-4)
    what = program(IN, AT, FrameStep(frame="shelf"), AT, IN, AT, OUT, AT, table=TABLE, shelf=shelf)
    save_program(what, tmp_path / "pick.toml")
    assert load_program(tmp_path / "pick.toml") == what
    assert decode_program(encode_program(what)) == what
    assert read_csv(write_csv(what, UZUNER), UZUNER, "pick") == what
    assert "[frames.table]" in encode_program(what)
    assert "frames" not in encode_program(Program(robot="uzuner", steps=(AT,)))


def test_a_row_that_says_only_half_of_a_frame_is_refused_with_its_column() -> None:
    with pytest.raises(ProgramError, match="line 2, column z_mm: the cell is empty"):
        read_csv("do,frame,x_mm,y_mm,z_mm\nframe,table,1,2,\n", UZUNER)


def test_poses_as_points_are_given_in_the_frame_they_stand_in() -> None:
    """CSV X-Y-Z of a pose below a frame step leads to the same place."""
    home = UZUNER.pose("home")
    what = read_csv(write_csv(program(IN, HOME), UZUNER, "points"), UZUNER, "pick")
    q = pose_after(UZUNER, what, 1, home)
    assert q is not None
    np.testing.assert_allclose(UZUNER.forward(q)[:3, 3], UZUNER.forward(home)[:3, 3], atol=1e-6)


def test_a_step_recorded_below_a_frame_step_is_given_in_the_frame() -> None:
    what, here = program(IN, AT, OUT), PointStep(x_mm=210.5, y_mm=33.25, z_mm=120)
    changed, row = add(what, here, PLACES[2], 1)
    step = changed.steps[row]
    assert isinstance(step, PointStep) and (step.x_mm, step.y_mm) == (35.718, 40.866)
    np.testing.assert_allclose(points(changed)[1][1:], (210.5, 33.25, 120), atol=1e-3)
    assert add(what, here, PLACES[0], 0)[0].steps[-1] == here


def test_a_script_sets_the_frames_as_the_program_has_them() -> None:
    what = program(
        AT, RepeatStep(times=2), AT, IN, AT, END, AT, IN,
        LineStep(x_mm=1, y_mm=2, z_mm=3), OUT, WaitStep(seconds=1),
    )  # fmt: skip
    arm_class = create_autospec(Arm)
    with patch.object(armctl, "Arm", arm_class):
        exec(compile(write_script(what), "script", "exec"), {})
    calls = arm_class.open.return_value.__enter__.return_value.method_calls
    frame: list[UserFrame | None] = [None]
    seen = []
    for name, args, _ in calls:
        if name == "set_frame":
            frame = [*args, None][:1]
        elif name in ("go", "line"):
            seen.append(frame[0])
    assert seen == [None, None, TABLE, None, TABLE, None, TABLE]


def test_programs_can_be_kept_in_a_set() -> None:
    shelf = UserFrame(x_mm=0, y_mm=0, z_mm=100)
    one, other = program(AT, table=TABLE, shelf=shelf), program(AT, shelf=shelf, table=TABLE)
    assert {one, other} == {one} and one not in {program(AT), put_frame(one, "shelf", TABLE)}


# Names.


def test_frames_are_renamed_and_deleted_with_the_steps_that_choose_them() -> None:
    what = program(IN, AT, OUT)
    named = rename_frame(what, "table", "left table")
    assert named.frames == {"left table": TABLE} and named.steps[0] == FrameStep(frame="left table")
    assert points(named) == points(what)
    with pytest.raises(ProgramError, match="step 1 chooses the frame 'left table'; delete that step first"):
        delete_frame(named, "left table")
    assert delete_frame(program(AT), "table").frames == {}


@pytest.mark.parametrize(
    ("name", "message"),
    [("", "'' is no name"), ("a/b", "is no name"), (41 * "x", "is no name"), ("base", "frame of the arm"),
     ("table", "there is a frame 'table' already")],
)  # fmt: skip
def test_names_that_cannot_be_are_refused(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        rename_frame(program(AT), "table", name)
    full = program(AT, **{f"f{k}": TABLE for k in range(100)})
    with pytest.raises(InputError, match="100 frames at most"):
        put_frame(full, "one more", TABLE)
