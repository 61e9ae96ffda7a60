from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armctl.errors import RobotFileError
from armctl.robot import load_robot, robots_folder

SCORBOT = (robots_folder() / "scorbot.toml").read_text(encoding="utf-8")


def loaded(tmp_path: Path, old: str = "", new: str = "") -> object:
    assert old in SCORBOT
    path = tmp_path / "arm.toml"
    path.write_text(SCORBOT.replace(old, new, 1), encoding="utf-8")
    return load_robot(path)


def test_counts_there_and_back() -> None:
    robot = load_robot("scorbot")
    outputs = robot.output_map
    assert outputs is not None
    assert outputs.unit == "counts"
    q = np.radians([10, -50, 85, -90, 30])
    counts = outputs.outputs(q)
    assert counts[0] == pytest.approx(1418.888)
    assert counts[1] == pytest.approx(113.5555 * 10)
    assert counts[3] == pytest.approx(-279.0)
    assert outputs.angles(counts) == pytest.approx(q)


def test_homing_ends_in_the_first_pose() -> None:
    robot = load_robot("scorbot")
    assert robot.first_pose == pytest.approx(robot.pose("home"))
    assert load_robot("uzuner").first_pose == pytest.approx(load_robot("uzuner").pose("rest"))


def test_every_safe_count_is_an_angle_inside_the_limits() -> None:
    robot = load_robot("scorbot")
    outputs = robot.output_map
    assert outputs is not None
    ends = np.sort(outputs.zero[:, None] + outputs.per_rad[:, None] * robot.limits, axis=1)
    assert ends == pytest.approx(np.column_stack([outputs.low, outputs.high]))


def test_axes_are_in_counts(tmp_path: Path) -> None:
    robot = load_robot("scorbot")
    assert [axis.entry.axis for axis in robot.board_settings.axes] == [0, 1, 2, 3, 4, 5]
    assert [axis.entry.home_order for axis in robot.board_settings.axes] == [
        6,
        2,
        3,
        4,
        5,
        1,
    ]  # the base goes last
    assert robot.board_settings.differential == (3, 4)
    elbow, gripper = robot.board_settings.axes[2], robot.board_settings.axes[5]
    assert elbow.home_toward == 1
    assert elbow.home_speed == pytest.approx(10 * 113.5555)
    assert elbow.following_error == pytest.approx(5 * 113.5555)
    assert gripper.entry.home_by == "stall"
    turned = loaded(
        tmp_path,
        "axis = 2, counts_per_deg = 113.5555",
        "axis = 2, counts_per_deg = -113.5555",
    )
    assert turned.board_settings.axes[2].home_toward == -1  # the same angle, the other way in counts
    assert turned.output_map.low[2] < turned.output_map.high[2]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kind = "encoder"', 'kind = "firmata"', r"differential|have servo entries"),
        (
            "encoder = { axis = 1, ",
            "servo = { channel = 1, ",
            r"its joints and its gripper have encoder entries, not servo entries",
        ),
        ("axis = 1, counts_per_deg = 113.5555", "axis = 1, counts_per_deg = 0", "counts_per_deg is 0"),
        ("axis = 1,", "axis = 0,", r"two encoders are on the same channel: \[0, 0, 2, 3, 4, 5\]"),
        ("axis = 1,", "axis = 6,", r"joints\[1\]\.encoder\.axis"),
        ("home_deg = -60", "home_deg = -140", "home_deg = -140.0° is outside the limits -130.0° … 35.0°"),
        (
            '"wrist_pitch", "wrist_roll"',
            '"wrist_pitch", "wrist_yaw"',
            "'wrist_yaw' is no joint",
        ),
        ('"wrist_pitch", "wrist_roll"', '"wrist_pitch", "wrist_pitch"', "names one joint twice"),
        ("closed_counts = 50", "closed_counts = 1650", "closed and open are both 1650; they must differ"),
        (
            "axis = 1,",
            "axis = 1, max_drive_percent = 60,",
            r"joints\.shoulder\.encoder\.breakaway_percent = 78 is above max_drive_percent = 60: the motor",
        ),
        (
            "axis = 5,",
            "axis = 5, max_drive_percent = 77.5,",
            r"gripper\.encoder\.breakaway_percent = 78 is above max_drive_percent = 77.5",
        ),
        (
            "axis = 1,",
            "axis = 1, max_drive_percent = 0,",
            r"joints\[1\]\.encoder\.max_drive_percent: must be more than 0 and at most 100",
        ),
        (
            'home_toward = "+"',
            'home_toward = "up"',
            r"joints\[2\]\.encoder\.home_toward: must be one of '\+', '-', not 'up'",
        ),
        (
            'home_by = "stall"',
            'home_by = "touch"',
            r"gripper\.encoder\.home_by: must be one of 'stall', 'switch', not 'touch'",
        ),
        (
            'kind = "encoder"',
            'kind = "arduino"',
            r"board\.kind: must be one of 'encoder', 'firmata', 'maestro', not 'arduino'",
        ),
        ("format = 1", "format = 2", r"key format: must be 1, not 2$"),
    ],
)
def test_what_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(RobotFileError, match=said):
        loaded(tmp_path, old, new)


def test_a_motor_may_be_given_less_than_its_full_drive(tmp_path: Path) -> None:
    robot = loaded(tmp_path, "axis = 1,", "axis = 1, max_drive_percent = 90,")
    drives = [axis.entry.max_drive_percent for axis in robot.board_settings.axes]
    assert drives == [100, 90, 100, 100, 100, 100]


def test_an_encoder_that_one_joint_lacks_is_named(tmp_path: Path) -> None:
    line = next(line for line in SCORBOT.splitlines() if line.startswith("encoder = { axis = 0"))
    with pytest.raises(RobotFileError, match=r"joints\.waist\.encoder is missing; the other joints have one"):
        loaded(tmp_path, line, "")
    line = next(line for line in SCORBOT.splitlines() if line.startswith("encoder = { axis = 5"))
    with pytest.raises(RobotFileError, match=r"gripper\.encoder is missing; the joints have one"):
        loaded(tmp_path, line, "")
