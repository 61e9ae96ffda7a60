"""Robot files are read strictly: what is wrong is named by file and key."""

from __future__ import annotations

import copy
import math
import re
import tomllib
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from armctl import load_robot
from armctl.documents import Document
from armctl.errors import InputError, RobotFileError
from armctl.robot import robots_folder, says_no_board
from armctl.robot.file import ROBOT_FILES
from armctl.robot.load import robot_of

SHIPPED = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8").partition("[look]")[0]
SCORBOT = (robots_folder() / "scorbot.toml").read_text(encoding="utf-8")
ROOT = Path(__file__).parents[2]
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])")


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def changed(old: str, new: str, text: str = SHIPPED) -> str:
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize("name", [None, 5, b"uzuner"])
def test_what_is_no_name_is_refused(name: object) -> None:
    with pytest.raises(InputError, match=f"a robot is a shipped name or the path .*, not {name!r}"):
        load_robot(name)  # type: ignore[arg-type]


def test_a_copy_of_the_shipped_file_is_the_same_robot(tmp_path: Path) -> None:
    mine, shipped = load_robot(written(tmp_path, SHIPPED)), load_robot("uzuner")
    q = np.radians([10, 20, -30, 10, 5.0])
    assert np.array_equal(mine.forward(q), shipped.forward(q))
    assert mine.joint_names == ("base", "shoulder", "elbow", "wrist_pitch", "wrist_roll")
    assert np.degrees(mine.limits[1]) == pytest.approx([-3.19, 146.831])
    assert np.degrees(mine.pose("home")) == pytest.approx([0, 90, -80, -40, 0])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('name = "uzuner"', 'name = "uzuner"\ncolour = "red"', r"line \d+: unknown key 'colour'; mistyped\?"),
        ("d_mm = 98,", "d_cm = 9.8,", r"key dh\.rows\[0\]: unknown key 'd_cm'"),
        ("d_mm = 98,", "", r"key dh\.rows\[0\]: the key 'd_mm' is missing"),
        ("d_mm = 98,", 'd_mm = "98",', r"key dh\.rows\[0\]\.d_mm: must be a number, not '98'"),
        ("d_mm = 98,", f"d_mm = 1{'0' * 400},", "mine.toml"),
        ("format = 1", "format = 2", r"line 3, key format: must be 1, not 2$"),
        (
            'convention = "modified"',
            'convention = "craig"',
            r"key dh\.convention: must be one of 'modified', 'standard', not 'craig'",
        ),
        ('joint = "elbow" }', 'joint = "knee" }', "must name the same joints once each"),
        ('joint = "elbow" }', 'joint = "shoulder" }', "must name the same joints once each"),
        ('name = "elbow"', 'name = "shoulder"', "two joints have the same name"),
        ('name = "elbow"', 'name = "Elbow!"', r"joints\[2\]\.name"),
        ("[-102.8, 107.26]", "[107.26, -102.8]", r"joints\.base\.limit_deg = \[107\.26, -102\.8\]"),
        (
            "[-102.8, 107.26]",
            "[-102.8, 1e9]",
            r"limit_deg\[1\]: must be -720 … 720, not 1000000000\.0",
        ),
        ("[-102.8, 107.26]", "[-102.8]", r"joints\[0\]\.limit_deg: must have 2 values"),
        ("speed_deg_s = 60", "speed_deg_s = 0", r"joints\[0\]\.speed_deg_s: must be at least 1e-06"),
        ("channel = 1,", "channel = 0,", r"two servos are on the same channel: \[0, 0, 2, 3, 4, 5\]"),
        ("channel = 5,", "channel = 2,", r"two servos are on the same channel"),
        ("channel = 1,", "channel = 1.5,", r"joints\[1\]\.servo\.channel: must be a whole number"),
        ("channel = 1,", "channel = -1,", r"joints\[1\]\.servo\.channel: must be 0 … 63, not -1"),
        ("[749, 2251]", "[800, 2251]", r"shoulder\.servo: the limits -3\.19° … 146\.831° need pulses"),
        ("[749, 2251]", "[2251, 749]", r"joints\.shoulder\.servo"),
        ("[749, 2251]", "[749, 9000]", r"joints\[1\]\.servo\.pulse_us\[1\]"),
        ("us_per_deg = 10", "us_per_deg = 1e-9", r"shoulder\.servo\.us_per_deg is 1e-09: .*; 0\.001 or more"),
        ("open_us = 2000", "open_us = 1000", "closed and open are both 1000; they must differ"),
        ("home = [0, 90, -80, -40, 0]", "", r"poses\.home is missing"),
        ("rest = [0, 110, -80, -70, 0]", "", r"poses\.rest is missing"),
        (
            "home = [0, 90, -80, -40, 0]",
            "home = [0, 90, -80, -40]",
            r"5 angles are needed, there are 4",
        ),
        ("home = [0, 90,", "home = [0, 190,", r"poses\.home: shoulder = 190.*outside"),
        ("mass_kg = 0.25", "mass_kg = -0.25", r"bodies\[0\]\.mass_kg: must be at least 0, not -0\.25"),
        ('joint = "base"\nmass_kg', 'joint = "neck"\nmass_kg', "bodies: there is no joint 'neck'"),
        ("a_mm = 125", "a_mm = nan", r"key dh\.rows\[4\]\.a_mm: nan is no number to use"),
        (
            "servo = { channel = 2, zero_us = 1446.45, us_per_deg = 10, pulse_us = [602, 2398] }\n",
            "",
            r"joints\.elbow\.servo is missing; the other joints have one",
        ),
        (
            "servo = { channel = 2, zero_us = 1446.45, us_per_deg = 10, pulse_us = [602, 2398] }",
            "servo = 2",
            r"key joints\[2\]\.servo: must be a table, not 2",
        ),
        ("[dh]", "[dh", "mine.toml"),
        ('title = "Base"', 'title = "Base"\ntitle = "Base"', "mine.toml"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = written(tmp_path, changed(old, new))
    with pytest.raises(RobotFileError, match=says) as refused:
        load_robot(path)
    assert str(path) in str(refused.value)


def numeric_places() -> list[tuple[int, int]]:
    """Where a number stands in the shipped file as a value; comments and text left out."""
    places: list[tuple[int, int]] = []
    at = 0
    for line in SHIPPED.splitlines(keepends=True):
        code = re.sub(r'"[^"]*"', lambda text: "_" * len(text.group()), line.split("#")[0])
        if "=" in code:
            places += [(at + m.start(), at + m.end()) for m in NUMBER.finditer(code)]
        at += len(line)
    return places


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e300"])
def test_no_number_may_be_anything_but_a_number(tmp_path: Path, value: str) -> None:
    """Every numeric field in turn: TOML knows nan and inf, and comparisons with nan are false."""
    places = numeric_places()
    assert len(places) > 100
    for start, end in places:
        path = written(tmp_path, SHIPPED[:start] + value + SHIPPED[end:])
        with pytest.raises(RobotFileError, match=re.escape(str(path))):
            load_robot(path)


def test_an_arm_without_servos_or_gripper(tmp_path: Path) -> None:
    text = SHIPPED.split("[gripper]")[0] + "[poses]" + SHIPPED.split("[poses]")[1]
    robot = load_robot(written(tmp_path, re.sub(r"^servo = .*$", "", text, flags=re.M)))
    assert robot.output_map is None and robot.gripper is None
    assert robot.simulated_only is not None and "gives no servos" in robot.simulated_only


def test_why_no_board_drives_an_arm_is_said_only_where_none_does(tmp_path: Path) -> None:
    assert load_robot("uzuner").simulated_only is None and not says_no_board("uzuner")
    ur5 = load_robot("ur5")
    assert ur5.simulated_only == ur5.no_board != "" and says_no_board("ur5")
    path = written(tmp_path, changed('title = "Uzuner 5-DOF arm"', 'title = "U"\nno_board = "a reason"'))
    assert says_no_board(str(path))
    with pytest.raises(RobotFileError, match="no_board: the joints have outputs"):
        load_robot(path)


def test_a_file_from_an_editor_that_begins_with_a_mark(tmp_path: Path) -> None:
    path = written(tmp_path, SHIPPED)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load_robot(path).joint_names == load_robot("uzuner").joint_names


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nobody", r"there is no robot 'nobody'; shipped are .*uzuner"),
        ("UR5", r"there is no robot 'UR5'; did you mean 'ur5'\?"),
        ("SO-101", r"there is no robot 'SO-101'; did you mean 'so101'\?"),
        ("Open Manipulator-X", r"there is no robot .*; did you mean 'open_manipulator_x'\?"),
        (5000 * "x", r"there is no robot 'xxxxxxxx.*shipped are"),  # longer than the name of a file may be
        ("arm\0.toml", r"\\x00.*the name of a file holds no NUL"),
        ("arm\0.urdf", r"\\x00.*the name of a file holds no NUL"),
        (Path("none.toml"), "cannot be read: No such file"),
        (Path("arm.yaml"), r"ends in \.toml or \.urdf"),
        (Path("folder.toml"), "folder.toml: cannot be read"),
        (Path("binary.toml"), "binary.toml: "),
        (Path("deep.toml"), "arrays or tables are nested too deep"),
    ],
)
def test_files_that_are_none(tmp_path: Path, name: str | Path, says: str) -> None:
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "deep.toml").write_text(f"a = {5000 * '['}{5000 * ']'}")
    with pytest.raises(RobotFileError, match=says):
        load_robot(tmp_path / name if isinstance(name, Path) else name)


def test_a_joint_may_be_held_where_it_is(tmp_path: Path) -> None:
    held = changed("limit_deg = [-47.64, 47.32]", "limit_deg = [0, 0]")
    robot = load_robot(written(tmp_path, held))
    assert robot.limits[4].tolist() == [0.0, 0.0]
    assert robot.inverse([0.2, 0.0, 0.1]).best()[4] == 0.0


def test_named_points_and_the_look_are_read(tmp_path: Path) -> None:
    more = (
        '[points]\nP0 = [200, 0, 100]\n\n[look]\nlinks = ["#ff8000"]\nshape = "square"\nwidth_percent = 8\n'
    )
    robot = load_robot(written(tmp_path, SHIPPED + more))
    assert robot.point("P0").tolist() == pytest.approx([0.2, 0.0, 0.1])
    assert robot.look.links == ((255, 128, 0),)
    assert (robot.look.shape, robot.look.width) == ("square", pytest.approx(0.08))
    with pytest.raises(InputError, match="uzuner has no point 'P9'; it has P0"):
        robot.point("P9")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ('[look]\nlinks = ["red"]', r"look\.links\[0\]"),
        ("[look]\nlinks = []", r"look\.links: must have at least 1 value"),
        (
            '[look]\nlinks = ["#ff8000"]\nwidth_percent = 0',
            "width_percent: must be more than 0 and at most",
        ),
        ("[points]\nP0 = [1, 2]", r"line \d+, key points\.P0: must have 3 values"),
        ('[points]\n"P 0" = [0, 0, 0]', r"points"),
    ],
)
def test_a_wrong_point_or_look_is_named(tmp_path: Path, more: str, says: str) -> None:
    with pytest.raises(RobotFileError, match=says):
        load_robot(written(tmp_path, f"{SHIPPED}\n{more}\n"))


def places_in(value: object, place: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place, *(one for key, part in inner for one in places_in(part, (*place, key)))]


@pytest.mark.parametrize("name", ["uzuner", "scorbot", "eezybotarm_mk2"])
def test_whatever_is_wrong_is_told_in_words(name: str) -> None:
    """Values of another kind in up to five places; a check that meets one of them must not fail."""
    shipped = tomllib.loads((ROOT / "robots" / f"{name}.toml").read_text(encoding="utf-8"))
    shipped["capsules"] = [{"from_mm": [0, 0, 0], "to_mm": [0, 0, 9], "radius_mm": 5}]
    shipped["obstacles"] = [{"title": "wall", "from_mm": [900, 0, 0], "to_mm": [950, 10, 10]}]
    places, random = places_in(shipped)[1:], Random(1)
    told = 0
    for _ in range(60):
        record = copy.deepcopy(shipped)
        for _ in range(random.randint(1, 5)):
            *above, last = random.choice(places)
            inside: Any = record
            with suppress(KeyError, IndexError, TypeError):  # what was there is replaced already
                for key in above:
                    inside = inside[key]
                inside[last] = random.choice([3, "x", [], {}, True, math.nan, -1e9, [1, "a"], {"a": 1}])
        try:
            robot_of(Document(ROBOT_FILES, record))
        except RobotFileError as refused:
            told += len(refused.each) or 1
    assert told > 60


# Encoder boards.


def scorbot(tmp_path: Path, old: str, new: str) -> Any:
    return load_robot(written(tmp_path, changed(old, new, SCORBOT)))


def test_counts_there_and_back() -> None:
    robot = load_robot("scorbot")
    outputs = robot.output_map
    assert outputs is not None and outputs.unit == "counts"
    q = np.radians([10, -50, 85, -90, 30])
    counts = outputs.outputs(q)
    assert counts[0] == pytest.approx(1418.888)
    assert counts[1] == pytest.approx(113.5555 * 10)
    assert counts[3] == pytest.approx(-279.0)
    assert outputs.angles(counts) == pytest.approx(q)
    ends = np.sort(outputs.zero[:, None] + outputs.per_rad[:, None] * robot.limits, axis=1)
    assert ends == pytest.approx(np.column_stack([outputs.low, outputs.high]))  # every safe count is an angle


def test_homing_ends_in_the_first_pose() -> None:
    robot = load_robot("scorbot")
    assert robot.first_pose == pytest.approx(robot.pose("home"))
    assert load_robot("uzuner").first_pose == pytest.approx(load_robot("uzuner").pose("rest"))


def test_axes_are_in_counts(tmp_path: Path) -> None:
    settings = load_robot("scorbot").board_settings
    assert [axis.entry.axis for axis in settings.axes] == [0, 1, 2, 3, 4, 5]
    assert [axis.entry.home_order for axis in settings.axes] == [6, 2, 3, 4, 5, 1]  # the base goes last
    assert settings.differential == (3, 4)
    elbow, gripper = settings.axes[2], settings.axes[5]
    assert elbow.home_toward == 1
    assert elbow.home_speed == pytest.approx(10 * 113.5555)
    assert elbow.following_error == pytest.approx(5 * 113.5555)
    assert gripper.entry.home_by == "stall"
    turned = scorbot(tmp_path, "axis = 2, counts_per_deg = 113.5555", "axis = 2, counts_per_deg = -113.5555")
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
        ('"wrist_pitch", "wrist_roll"', '"wrist_pitch", "wrist_yaw"', "'wrist_yaw' is no joint"),
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
            'home_toward = "+"',
            'home_toward = "up"',
            r"home_toward: must be one of '\+', '-', not 'up'",
        ),
        (
            'kind = "encoder"',
            'kind = "arduino"',
            "must be one of .*'encoder', .*'maestro'.*, not 'arduino'",
        ),
    ],
)
def test_what_is_wrong_with_an_encoder_is_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(RobotFileError, match=said):
        scorbot(tmp_path, old, new)


def test_a_motor_may_be_given_less_than_its_full_drive(tmp_path: Path) -> None:
    robot = scorbot(tmp_path, "axis = 1,", "axis = 1, max_drive_percent = 90,")
    drives = [axis.entry.max_drive_percent for axis in robot.board_settings.axes]
    assert drives == [100, 90, 100, 100, 100, 100]


@pytest.mark.parametrize(("axis", "joint"), [(0, r"joints\.waist"), (5, "gripper")])
def test_an_encoder_that_is_missing_is_named(tmp_path: Path, axis: int, joint: str) -> None:
    line = next(line for line in SCORBOT.splitlines() if line.startswith(f"encoder = {{ axis = {axis}"))
    with pytest.raises(RobotFileError, match=rf"{joint}\.encoder is missing; the (other )?joints have one"):
        scorbot(tmp_path, line, "")
