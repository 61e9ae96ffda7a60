"""Robot files of one's own: from a usual build, from DH rows, from a shipped file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from armctl import load_robot, shipped_robots
from armctl.cli.main import cli
from armctl.errors import InputError, RobotFileError
from armctl.robot import hidden_robots, robot_title, robots_folder, user_robots
from armctl.robot.draft import BUILDS, Build, Draft, build_named


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    return tmp_path / "armctl" / "robots"


@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.name)
def test_a_build_is_a_sound_robot_with_its_lengths(build: Build, folder: Path) -> None:
    lengths = {one.key: 37.0 + 11.0 * k for k, one in enumerate(build.lengths)}
    draft = Draft.of_build("mine", "My arm", build, lengths)
    robot = draft.robot()
    stretched = robot.forward(np.zeros(robot.n))
    ahead = sum(lengths.get(key, 0.0) for key in ("ahead", "upper", "fore"))
    if build.name != "three-parallel":
        ahead += lengths.get("hand", 0.0) + lengths.get("tool", 0.0)
        down = lengths.get("drop", 0.0) - lengths.get("offset", 0.0)
        assert 1000 * stretched[:3, 3] == pytest.approx([ahead, 0.0, lengths["height"] - down])
    assert 1000 * stretched[0, 3] == pytest.approx(ahead)
    assert draft.save() == folder / "mine.toml"
    assert user_robots() == ("mine",)
    assert load_robot("mine") == robot


@pytest.mark.parametrize("name", shipped_robots())
def test_a_shipped_file_can_be_made_anew(name: str) -> None:
    """From its rows and its numbers, as somebody would enter them, and as a copy."""
    robot, whole = load_robot(name), Draft.of_file(robots_folder() / f"{name}.toml")
    table = whole.table
    entered = Draft.of_rows(name, robot.title, table["dh"]["convention"], table["dh"]["rows"], {})  # type: ignore[index]
    for joint in table["joints"]:  # type: ignore[attr-defined]
        entered = entered.with_joint(**joint)
    for pose, q in robot.poses.items():
        entered = entered.with_pose(pose, np.degrees(q))
    rest = {
        key: table.get(key)
        for key in ("source", "assumed", "no_board", "criterion", "board", "gripper", "bodies", "floor")
    }
    rest |= {key: table.get(key) for key in ("look", "payload_kg", "points", "capsules", "obstacles")}
    assert entered.changed(**rest).robot() == robot == whole.robot()


def test_a_shipped_name_means_the_shipped_robot_and_the_user_is_told(folder: Path) -> None:
    folder.mkdir(parents=True)
    own = folder / "scorbot.toml"
    own.write_text((robots_folder() / "scorbot.toml").read_text().replace('title = "', 'title = "My '))
    assert load_robot("scorbot").title == robot_title("scorbot") != load_robot(own).title
    assert load_robot(own).title == robot_title(str(own)) == f"My {load_robot('scorbot').title}"
    assert user_robots() == () and hidden_robots() == (own,)
    said = CliRunner().invoke(cli, ["robots"])
    assert said.exit_code == 0
    assert f"{own} has the name of a shipped robot: open it by its path, or rename it" in said.stderr


def test_what_is_wrong_is_said_and_nothing_is_saved(folder: Path) -> None:
    build = build_named("pitch3")
    draft = Draft.of_build("mine", "Mine", build, {})
    with pytest.raises(InputError, match=r"no build 'crane'.*pitch3-roll"):
        build_named("crane")
    with pytest.raises(InputError, match="no length 'boom'; it has height"):
        Draft.of_build("mine", "Mine", build, {"boom": 3.0})
    with pytest.raises(InputError, match="no joint 'tail'"):
        draft.with_joint("tail", title="Tail")
    for bad, said in (
        (draft.changed(name="My Arm"), "begins with a small letter"),
        (draft.changed(name="uzuner"), "a robot of armctl"),
        (draft.with_joint("elbow", limit_deg=[20, -20]), "the lower limit comes first"),
        (draft.with_pose("rest", [0, 0, 200, 0]), "outside"),
        (draft.with_joint("elbow", title=object()), "not TOML serializable"),
        (draft.with_servo("elbow", 3), "servo is missing; the other joints have one"),
    ):
        with pytest.raises(RobotFileError, match=said):
            bad.save()
    assert not folder.exists()


def test_a_name_is_taken_until_it_is_given_up(folder: Path) -> None:
    first = Draft.of_build("mine", "First", build_named("pitch2"), {})
    first.save()
    second = first.changed(title="Second")
    with pytest.raises(RobotFileError, match="already"):
        second.save()
    second.save(replace_old=True)
    assert load_robot("mine").title == "Second"
    assert "First" in (folder / "mine.toml~").read_text()


@pytest.mark.parametrize("taken", ["mine", "mine.armctl.toml"])
def test_the_name_of_an_urdf_arm_is_taken(folder: Path, taken: str) -> None:
    (folder / taken).mkdir(parents=True)
    for replace_old in (False, True):
        with pytest.raises(RobotFileError, match="there is a robot 'mine' already"):
            Draft.of_build("mine", "Mine", build_named("pitch3"), {}).save(replace_old=replace_old)
    assert not (folder / "mine.toml").exists()


def test_poses_that_nobody_chose_follow_new_limits() -> None:
    draft = Draft.of_build("mine", "Mine", build_named("pitch3-roll"), {})
    shoulder = draft.joints.index("shoulder")
    moved = draft.with_joint("shoulder", limit_deg=[10.0, 140.0])
    assert [pose[shoulder] for pose in moved.table["poses"].values()] == [10.0, 10.0]
    moved.robot()
    chosen = draft.with_pose("rest", [30.0] * len(draft.joints)).with_joint("shoulder", limit_deg=[40, 140])
    assert chosen.table["poses"]["rest"][shoulder] == 30.0  # somebody did: refused, and said
    with pytest.raises(RobotFileError, match="rest"):
        chosen.robot()
    draft.with_joint("shoulder", limit_deg=["x", 3])  # refused by ``robot``, as everything


def test_a_servo_channel_is_a_whole_number() -> None:
    draft = Draft.of_build("mine", "Mine", build_named("pitch3"), {})
    with pytest.raises(InputError, match=r"shoulder: 1\.9 is no whole number"):
        draft.with_servo("shoulder", 1.9)
    text = draft.with_servo("shoulder", 1.0).text()
    assert "channel = 1\n" in text


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "armctl").write_text("a file where a folder belongs")
    with pytest.raises(RobotFileError, match=r"mine\.toml: cannot be written"):
        Draft.of_build("mine", "Mine", build_named("pitch2"), {}).save()


def test_servos_gripper_and_an_entry_that_is_taken_out() -> None:
    draft = Draft.of_build("mine", "Mine", build_named("pitch2"), {})
    draft = draft.with_joint("elbow", limit_deg=[-90, 90])
    for channel, joint in enumerate(draft.joints):
        draft = draft.with_servo(joint, channel, us_per_deg=9.0)
    robot = draft.with_gripper(5).robot()
    assert robot.output_map is not None and robot.gripper is not None
    assert robot.output_map.channels == (0, 1, 2) and robot.output_map.gripper_channel == 5
    with pytest.raises(InputError, match=r"the gripper: 5\.5 is no whole number"):
        draft.with_gripper(5.5)
    assert robot.output_map.outputs(np.radians([10, 0, -10])) == pytest.approx({0: 1590, 1: 825, 2: 1410})
    bare = draft
    for joint in draft.joints:
        bare = bare.with_joint(joint, servo=None)
    assert bare.robot().output_map is None
