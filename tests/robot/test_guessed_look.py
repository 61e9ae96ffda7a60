"""The look of an arm that brings none: sound for any lengths, printed and read again, told to be a guess."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples
from tests.robot.urdf_kit import Step, written
from tests.sticks import of_sticks

import armctl
from armctl.arrays import FloatArray
from armctl.cli.main import run
from armctl.errors import RobotFileError
from armctl.motion.clearance import sources
from armctl.robot import Robot, load_robot, shipped_robots
from armctl.robot.body.arm_body import BODY_GUESSED
from armctl.robot.draft import BUILDS, Draft
from armctl.robot.look.rows import MAKES, PAINTS, AnyRow, paint
from armctl.robot.look.rows import written as as_written
from armctl.robot.look_guess import SOURCE, nearest_paint
from armctl.robot.look_sound import faults
from armctl.robot.parts import Hand, Look

NINE = ("ar4", "braccio", "mico", "open_manipulator_x", "parol6", "pincherx100", "so100", "so101", "ur5")
POSES = 150
_OF_NO_MATTER = ("below the floor", "above the floor", "nobody sees it")


def bare(robot: Robot | str, look: Look | None = None) -> Robot:
    robot = load_robot(robot) if isinstance(robot, str) else robot
    return replace(robot, look=look or Look())


def wrong(robot: Robot) -> list[str]:
    """What is wrong with the guess; where the floor is, and what lies in a drum, its lengths decide."""
    found = faults(replace(robot, look=robot.whole_look))
    return [
        fault.what for fault in found if not fault.what.endswith(_OF_NO_MATTER) and "floor" not in fault.what
    ]


@pytest.mark.parametrize("name", shipped_robots())
def test_a_shipped_arm_without_its_look_hangs_together(name: str) -> None:
    robot = bare(name)
    assert robot.body_is_guessed and robot.whole_look.source == SOURCE
    assert robot.collision.capsules and robot.undersides[-1].part == "the tool"
    if name != "humanoid":  # it hangs, on something that nobody knows
        assert wrong(robot) == []


lengths = st.floats(20, 300)


@settings(max_examples=examples(30))
@given(data=st.data())
def test_any_build_with_any_motors_and_hand_hangs_together(data: st.DataObject) -> None:
    build = data.draw(st.sampled_from(BUILDS))
    mm = {one.key: data.draw(lengths) for one in build.lengths}
    motors = data.draw(st.sampled_from([None, *MAKES]))
    hand = data.draw(st.sampled_from([None, *get_args(Hand)]))
    draft = Draft.of_build("mine", "Mine", build, mm).with_guess(motors, hand)
    robot = draft.robot()
    assert robot.body_is_guessed and robot.assumed[-1] == BODY_GUESSED
    assert [what for what in wrong(robot) if "floats" not in what] == []
    drawn = {row.make for row in robot.whole_look.rows if row.__struct_config__.tag == "motor"}
    assert drawn == (set() if motors is None else {motors})


@pytest.mark.parametrize("name", shipped_robots())
def test_rows_are_read_as_they_are_written(name: str, tmp_path: Path) -> None:
    for look in (load_robot(name).look, bare(name).whole_look):
        text = as_written(look.rows)
        read = msgspec.toml.decode(text.encode(), type=dict[str, tuple[AnyRow, ...]])["solids"]
        assert read == look.rows and as_written(read) == text


def hits(robot: Robot, q: FloatArray) -> FloatArray:
    arm = robot.gripping(0.3)
    links, found = arm.body_frames(q), np.zeros(len(q), dtype=np.bool_)
    for source in sources(arm):
        found |= (source.gaps(links) - source.closed[:, None] < -5e-4).any(axis=0)
    return found


def test_it_is_nearer_to_the_truth_than_sticks() -> None:
    """Of what is called clear fewer touch, and fewer clear poses are refused: the mean of nine arms."""
    missed, refused = list[list[float]](), list[list[float]]()
    for name in NINE:
        robot = load_robot(name)
        q = np.random.default_rng(4).uniform(*robot.limits.T, (POSES, robot.n))
        true = hits(robot, q)
        told = [hits(arm, q) for arm in (bare(robot), of_sticks(robot, Look()))]
        missed.append([float((true & ~one).sum() / max((~one).sum(), 1)) for one in told])
        refused.append([float((~true & one).sum() / max((~true).sum(), 1)) for one in told])
    assert np.mean(missed, axis=0) @ [1.0, -0.8] < 0.0
    assert np.mean(refused, axis=0) @ [1.0, -0.5] < 0.0
    assert np.max(refused) == np.max(refused, axis=0)[1] > 0.2 > np.max(refused, axis=0)[0]


def test_colours_and_width_of_an_older_file_are_kept_as_far_as_the_palette_has_them() -> None:
    wide = bare("uzuner", Look(links=((210, 45, 45), (30, 130, 215)), width=0.104)).whole_look
    usual = bare("uzuner").whole_look
    links = [row for row in wide.rows if getattr(row, "ends", "flat") == "round" and row.joint]
    assert {row.color for row in links if row.color != "black"} == {"red", "blue"}
    assert max(map(width, wide.rows)) == pytest.approx(2 * max(map(width, usual.rows)), abs=0.2)
    assert [nearest_paint(paint(name)) for name in PAINTS] == list(PAINTS)


def width(row: AnyRow) -> float:
    return float(np.max(getattr(row, "width_mm", 0.0)))


def test_a_urdf_arm_without_meshes_is_drawn_and_told_to_be_a_guess(tmp_path: Path) -> None:
    steps = [
        Step("turn", "revolute", "base", "tower"),
        Step("lift", "revolute", "tower", "upper", xyz="0 0 0.1", axis="0 -1 0"),
        Step("bend", "revolute", "upper", "fore", xyz="0.2 0 0", axis="0 -1 0"),
        Step("end", "fixed", "fore", "tool", xyz="0.1 0 0"),
    ]
    robot = load_robot(written(tmp_path / "arm.urdf", steps))
    assert robot.body_is_guessed and BODY_GUESSED in robot.assumed
    assert {piece.part for piece in robot.pieces} >= {"the base", "the link behind lift"}
    side = tmp_path / "arm.armctl.toml"
    solid = 'solid = "box", size_mm = [90, 90, 20], color = "red"'
    side.write_text(f'format = 1\n[look]\nsolids = [{{ joint = "nobody", {solid} }}]\n')
    with pytest.raises(RobotFileError, match=r"row 1 \(box\): joint: there is no joint 'nobody'"):
        load_robot(tmp_path / "arm.urdf")
    side.write_text(f"format = 1\n[look]\nsolids = [{{ {solid} }}]\n")
    robot = load_robot(tmp_path / "arm.urdf")
    assert not robot.body_is_guessed and BODY_GUESSED not in robot.assumed


def test_it_is_said_where_an_arm_is_opened_or_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(Draft.of_build("mine", "Mine", BUILDS[1], {}).text())
    assert run(["check", str(file)]) == 0
    assert f"assumed: {BODY_GUESSED}" in capsys.readouterr().out
    with caplog.at_level(logging.WARNING), armctl.Arm.open(file):
        assert f"Mine: {BODY_GUESSED}" in caplog.text


def test_the_guess_is_printed_to_go_on_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new", "mine", "--build", "pitch3", "--motors", "micro", "--hand", "cup", "--look"]) == 0
    look = capsys.readouterr().out
    assert "the suction cup" in look and 'make = "micro"' in look
    file = tmp_path / "mine.toml"
    file.write_text(Draft.of_build("mine", "Mine", BUILDS[1], {}).text() + look)
    robot = load_robot(file)
    guess = Draft.of_build("mine", "Mine", BUILDS[1], {}).with_guess("micro", "cup").robot()
    assert not robot.body_is_guessed and robot.look.rows == guess.whole_look.rows
