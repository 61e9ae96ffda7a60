"""A robot file in the making: from the link lengths of a usual build, from DH rows, or from another file."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, cast

import tomli_w

from armctl.arrays import FloatArray
from armctl.documents import as_path, not_written, write_atomically
from armctl.errors import InputError, RobotFileError
from armctl.lazy_dataclass import dataclass
from armctl.robot.file import ROBOT_FILES, Table, board_tables, read_robot_file
from armctl.robot.load import robot_of, shipped_robots, user_robots_folder
from armctl.robot.robot import Robot

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_SPEED_DEG_S, _ACCELERATION_DEG_S2 = 60.0, 360.0
_SERVO_US, _SERVO_MIDDLE_US, _SERVO_US_PER_DEG = (500.0, 2500.0), 1500.0, 10.0
_GRIPPER = {"title": "Gripper", "speed_percent_s": 100.0}
_GRIPPER_SERVO = {"closed_us": 1000.0, "open_us": 2000.0}


# Usual builds: lengths in, DH rows out.


@dataclass(frozen=True, slots=True)
class Length:
    """One length that a build asks for."""

    key: str
    title: str
    meaning: str
    usual_mm: float
    least_mm: float = -math.inf


@dataclass(frozen=True, slots=True)
class Build:
    """A usual build. With all joints at 0 the arm lies stretched forward."""

    name: str
    title: str
    lengths: tuple[Length, ...]
    limits_deg: Mapping[str, tuple[float, float]]
    """usual limits of its joints, from the base to the tool"""
    rows: Callable[[Mapping[str, float]], list[Table]]
    """standard DH rows of lengths by key [mm]"""


def _row(a_mm: float, alpha_deg: float, d_mm: float, joint: str | None = None, **more: object) -> Table:
    row: Table = {"a_mm": a_mm, "alpha_deg": alpha_deg, "d_mm": d_mm, **more}
    return row if joint is None else {**row, "joint": joint}


_HEIGHT = Length("height", "Height", "from the floor to the shoulder axis", 80.0)
_AHEAD = Length("ahead", "Shoulder ahead", "from the base axis forward to the shoulder axis", 0.0)
_UPPER = Length("upper", "Upper arm", "from the shoulder axis to the elbow axis", 120.0, 1.0)
_FORE = Length("fore", "Forearm", "from the elbow axis to the wrist axis", 110.0, 1.0)
_HAND = Length("hand", "Hand", "from the wrist axis to the tool point", 90.0, 0.0)
_DROP = Length("drop", "Tool below", "from the wrist axis down to the tool point", 40.0)
_TOOL = Length("tool", "Hand", "from where the wrist axes meet to the tool point", 70.0, 0.0)
_WIDE, _PITCH, _ROLL = (-90.0, 90.0), (-120.0, 120.0), (-180.0, 180.0)


def _base(mm: Mapping[str, float]) -> list[Table]:
    """The first two links of all of them."""
    return [_row(mm["ahead"], 90, mm["height"], "base"), _row(mm["upper"], 0, 0, "shoulder")]


def _pitching(mm: Mapping[str, float]) -> list[Table]:
    tool = _row(0, 90, 0, theta_deg=90)  # the approach axis along the hand
    return [*_base(mm), _row(mm["fore"], 0, 0, "elbow"), _row(mm["hand"], 0, 0, "wrist"), tool]


def _pitching_rolling(mm: Mapping[str, float]) -> list[Table]:
    wrist = _row(0, 90, 0, "wrist", theta_deg=90)
    return [*_base(mm), _row(mm["fore"], 0, 0, "elbow"), wrist, _row(0, 0, mm["hand"], "roll")]


def _two_links(mm: Mapping[str, float]) -> list[Table]:
    return [*_base(mm), _row(mm["fore"], 0, 0, "elbow"), _row(0, 90, 0, theta_deg=90)]


def _rods(mm: Mapping[str, float]) -> list[Table]:
    """All links of a palletiser but what its level hand carries."""
    fore = _row(mm["fore"], 0, 0, "elbow", follows={"shoulder": -1})
    return [*_base(mm), fore, _row(mm["hand"], 90, 0, link="hand", follows={"elbow": -1})]


def _palletiser(mm: Mapping[str, float]) -> list[Table]:
    return [*_rods(mm), _row(0, 0, 0, theta_deg=90), _row(0, 90, 0), _row(0, 0, 0, theta_deg=90)]


def _palletiser_rolling(mm: Mapping[str, float]) -> list[Table]:
    return [*_rods(mm), _row(0, 0, mm["drop"], "roll")]


def _spherical_wrist(mm: Mapping[str, float]) -> list[Table]:
    return [
        *_base(mm),
        _row(mm["offset"], 90, 0, "elbow", theta_deg=90),
        _row(0, -90, mm["fore"], "forearm_roll"),
        _row(0, 90, 0, "wrist"),
        _row(0, 0, mm["tool"], "roll"),
    ]


def _three_parallel(mm: Mapping[str, float]) -> list[Table]:
    return [
        *_base(mm),
        _row(mm["fore"], 0, 0, "elbow"),
        _row(0, 90, mm["aside"], "wrist_1"),
        _row(0, -90, mm["wrist"], "wrist_2"),
        _row(0, 0, mm["tool"], "wrist_3"),
    ]


def _limits(**joints: tuple[float, float]) -> dict[str, tuple[float, float]]:
    return {"base": _WIDE, "shoulder": (0.0, 150.0), **joints}


BUILDS = (
    Build(
        "pitch3-roll",
        "5 joints: base, shoulder, elbow, wrist, roll",
        (_HEIGHT, _AHEAD, _UPPER, _FORE, _HAND),
        _limits(elbow=_PITCH, wrist=_PITCH, roll=_ROLL),
        _pitching_rolling,
    ),
    Build(
        "pitch3",
        "4 joints: base, shoulder, elbow, wrist",
        (_HEIGHT, _AHEAD, _UPPER, _FORE, _HAND),
        _limits(elbow=_PITCH, wrist=_PITCH),
        _pitching,
    ),
    Build(
        "pitch2",
        "3 joints: base, shoulder, elbow",
        (_HEIGHT, _AHEAD, _UPPER, replace(_FORE, meaning="from the elbow axis to the tool point")),
        _limits(elbow=_PITCH),
        _two_links,
    ),
    Build(
        "palletiser",
        "3 joints, rods keep the hand level (MeArm, EEZYbotARM, uArm)",
        (
            _HEIGHT,
            _AHEAD,
            _UPPER,
            _FORE,
            replace(_HAND, meaning="level, from the wrist axis to the tool point"),
        ),
        _limits(shoulder=(20.0, 130.0), elbow=(-80.0, 30.0)),
        _palletiser,
    ),
    Build(
        "palletiser-roll",
        "4 joints, rods keep the hand level, it turns about the vertical",
        (
            _HEIGHT,
            _AHEAD,
            _UPPER,
            _FORE,
            replace(_HAND, meaning="level, from the wrist axis to the axis that turns it"),
            _DROP,
        ),
        _limits(shoulder=(20.0, 130.0), elbow=(-80.0, 30.0), roll=_WIDE),
        _palletiser_rolling,
    ),
    Build(
        "spherical-wrist",
        "6 joints, the last three axes meet (PAROL6, AR4, industrial arms)",
        (
            _HEIGHT,
            _AHEAD,
            _UPPER,
            Length("offset", "Elbow offset", "from the elbow axis up to the forearm's axis", 0.0),
            _FORE,
            _TOOL,
        ),
        _limits(elbow=_PITCH, forearm_roll=_ROLL, wrist=_PITCH, roll=_ROLL),
        _spherical_wrist,
    ),
    Build(
        "three-parallel",
        "6 joints, shoulder, elbow and first wrist axis parallel (UR, myCobot)",
        (
            replace(_HEIGHT, usual_mm=90.0),
            _AHEAD,
            _UPPER,
            _FORE,
            Length("aside", "Wrist aside", "from the arm's plane sideways to the hand", 65.0),
            Length("wrist", "Wrist", "from the first to the third wrist axis", 65.0),
            _TOOL,
        ),
        _limits(elbow=_PITCH, wrist_1=_ROLL, wrist_2=_ROLL, wrist_3=_ROLL),
        _three_parallel,
    ),
)


def build_named(name: str) -> Build:
    """One of ``BUILDS``. Raises ``InputError``."""
    for build in BUILDS:
        if build.name == name:
            return build
    raise InputError(f"there is no build {name!r}; there are {', '.join(one.name for one in BUILDS)}")


# The file.


@dataclass(frozen=True)
class Draft:
    """A robot file as its table; each change gives another draft. Nothing is checked before ``robot``."""

    table: Table

    @classmethod
    def of_build(cls, name: str, title: str, build: Build, lengths_mm: Mapping[str, float]) -> Self:
        """A usual build; a length that is not given has its usual value. Raises ``InputError``."""
        unknown = sorted(set(lengths_mm) - {one.key for one in build.lengths})
        if unknown:
            known = ", ".join(one.key for one in build.lengths)
            raise InputError(f"{build.name} has no length {unknown[0]!r}; it has {known}")
        lengths = {one.key: lengths_mm.get(one.key, one.usual_mm) for one in build.lengths}
        for one in build.lengths:
            if not lengths[one.key] >= one.least_mm:
                said = f"{one.title}: {lengths[one.key]:g} mm is too short"
                raise InputError(f"{said}; {one.least_mm:g} mm or more is allowed ({one.meaning})")
        return cls.of_rows(name, title, "standard", build.rows(lengths), build.limits_deg)

    @classmethod
    def of_rows(
        cls,
        name: str,
        title: str,
        convention: str,
        rows: Sequence[Mapping[str, object]],
        limits_deg: Mapping[str, tuple[float, float]],
    ) -> Self:
        """DH rows as in a robot file; a joint without limits has ±90°."""
        joints = [str(row["joint"]) for row in rows if "joint" in row]
        limits = {joint: limits_deg.get(joint, _WIDE) for joint in joints}
        rest = [_nearest_to_zero(one) for one in limits.values()]
        return cls(
            {
                "format": 1,
                "name": name,
                "title": title,
                "source": "entered by hand",
                "assumed": ["joint speeds and accelerations"],
                "dh": {"convention": convention, "rows": [dict(row) for row in rows]},
                "joints": [
                    {
                        "name": joint,
                        "title": joint.replace("_", " ").capitalize(),
                        "limit_deg": list(limit),
                        "speed_deg_s": _SPEED_DEG_S,
                        "acceleration_deg_s2": _ACCELERATION_DEG_S2,
                    }
                    for joint, limit in limits.items()
                ],
                "poses": {"home": list(rest), "rest": list(rest)},
                "floor": {"z_mm": 0.0},
            }
        )

    @classmethod
    def of_file(cls, path: str | Path) -> Self:
        """What a robot file says, for a copy of it. Raises ``RobotFileError``."""
        source = as_path(path, "a draft begins with the path of a robot file")
        return ROBOT_FILES.load(source, lambda content: cls(dict(read_robot_file(content)[1].record)))

    @property
    def name(self) -> str:
        """The name of the file and of the robot."""
        return str(self.table["name"])

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints as the file lists them."""
        return tuple(str(joint["name"]) for joint in self._joints)

    @property
    def _joints(self) -> list[Table]:
        return cast("list[Table]", self.table["joints"])

    def _joint(self, name: str) -> dict[str, Any]:
        if name not in self.joints:
            raise InputError(f"there is no joint {name!r}; there are {', '.join(self.joints)}")
        return cast("dict[str, Any]", self._joints[self.joints.index(name)])

    def changed(self, **entries: object) -> Self:
        """With other entries at the top of the file; None takes one out."""
        table = {**self.table, **entries}
        return replace(self, table={key: value for key, value in table.items() if value is not None})

    def with_joint(self, name: str, **entries: object) -> Self:
        """With other entries of one joint; None takes one out. Raises ``InputError``: no such joint.

        Named poses that have this joint where nobody put it, as near to 0° as its limits let it, follow them.
        """
        before = self._joint(name)
        joint = {**before, **entries}
        joints = [joint if one["name"] == name else one for one in self._joints]
        for key in [key for key, value in joint.items() if value is None]:
            del joint[key]
        draft = self.changed(joints=joints, **({"no_board": None} if board_tables(joint) else {}))
        was, now = (_nearest_to_zero(one.get("limit_deg")) for one in (before, joint))
        index = self.joints.index(name)
        for pose, q_deg in cast("Mapping[str, Sequence[float]]", self.table.get("poses", {})).items():
            if now not in (None, was) and index < len(q_deg) and q_deg[index] == was:
                draft = draft.with_pose(pose, [*q_deg[:index], now, *q_deg[index + 1 :]])
        return draft

    def with_servo(
        self,
        name: str,
        channel: float,
        zero_us: float | None = None,
        us_per_deg: float | None = None,
        pulse_us: tuple[float, float] = _SERVO_US,
    ) -> Self:
        """With a servo for one joint: output = zero + scale · angle; by default mid-travel is 1500 µs.

        The scale is 10 µs a degree by default, or less, so that the pulses reach from limit to limit.
        Raises ``InputError``: no such joint, or a channel that is no whole number.
        """
        number = _channel(name, channel)
        low, high = self._joint(name)["limit_deg"]
        if us_per_deg is None:
            travel_us = pulse_us[1] - pulse_us[0]
            fitting = math.floor(10 * travel_us / max(high - low, 1.0)) / 10
            us_per_deg = min(_SERVO_US_PER_DEG, fitting)
        if zero_us is None:
            zero_us = _SERVO_MIDDLE_US - us_per_deg * 0.5 * (low + high)
        servo: dict[str, Any] = {
            "channel": number,
            "zero_us": zero_us,
            "us_per_deg": us_per_deg,
            "pulse_us": list(pulse_us),
        }
        before: dict[str, Any] = self._joint(name).get("servo") or {}
        if "also" in before:
            servo["also"] = before["also"]
        return self.with_joint(name, servo=servo)

    def with_channels(self, channels: Mapping[str, int]) -> Self:
        """With each joint's output on another channel. Raises ``InputError``: no such joint, or no output."""
        draft = self
        for name, channel in channels.items():
            tables = board_tables(self._joint(name))
            if not tables:
                raise InputError(f"joint {name!r} has no output yet")
            for key, table in tables.items():
                number = "channel" if "channel" in cast("Table", table) else "axis"
                draft = draft.with_joint(name, **{key: {**cast("Table", table), number: channel}})
        return draft

    def with_gripper(
        self,
        channel: float,
        closed_us: float | None = None,
        open_us: float | None = None,
    ) -> Self:
        """With a gripper on a servo, what is not given as it was, or as is usual.

        Raises ``InputError``: a channel that is no whole number.
        """
        gripper = dict(cast("Table", self.table.get("gripper", _GRIPPER)))
        servo = dict(cast("Table", gripper.get("servo", _GRIPPER_SERVO)))
        servo["channel"] = _channel("the gripper", channel)
        given = {"closed_us": closed_us, "open_us": open_us}
        servo |= {key: pulse for key, pulse in given.items() if pulse is not None}
        return self.changed(gripper={**gripper, "servo": servo})

    def with_guess(self, servo: str | None = None, hand: str | None = None) -> Self:
        """With what its look is guessed from besides lengths: the make of its motors, what holds things."""
        given = {key: value for key, value in (("servo", servo), ("hand", hand)) if value is not None}
        look = dict(cast("Table", self.table.get("look", {})))
        return self.changed(look={**look, **given}) if given else self

    def with_pose(self, name: str, q_deg: Sequence[float] | FloatArray) -> Self:
        """With a named pose [degrees]."""
        poses = dict(cast("Mapping[str, object]", self.table.get("poses", {})))
        return self.changed(poses={**poses, name: [round(float(angle), 4) + 0.0 for angle in q_deg]})

    def text(self) -> str:
        """The file. Raises ``RobotFileError``: an entry that a file cannot hold."""
        try:
            return tomli_w.dumps(cast("dict[str, Any]", self.table))
        except (TypeError, ValueError) as cause:
            raise RobotFileError(f"{self.name}: {cause}") from cause

    def robot(self) -> Robot:
        """The robot, checked as if it had been loaded. Raises ``RobotFileError``, without lines."""
        return robot_of(replace(ROBOT_FILES.parse(self.text()), text=None))

    def save(self, *, replace_old: bool = False) -> Path:
        """Write the file into the user's folder of robots, where ``load_robot`` finds it by its name.

        Raises ``RobotFileError``: it is not sound, the name is taken, or it cannot be written.
        """
        if not _NAME.fullmatch(self.name):
            raise RobotFileError(
                f"the name {self.name!r}: it begins with a small letter; small letters, digits and _ follow"
            )
        if self.name in shipped_robots():
            raise RobotFileError(f"{self.name!r} is a robot of armctl; choose another name")
        self.robot()
        path = user_robots_folder() / f"{self.name}.toml"
        urdf = (path.with_name(f"{self.name}.armctl.toml"), path.with_suffix(""))
        taken = next((one for one in (*(() if replace_old else (path,)), *urdf) if one.exists()), None)
        if taken is not None:
            raise RobotFileError(f"there is a robot {self.name!r} already ({taken}); choose another name")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, self.text().encode(), keep=True)
        except OSError as error:
            raise RobotFileError(not_written(path, error)) from error
        return path


def _channel(whose: str, number: float) -> int:
    if not float(number).is_integer():
        raise InputError(f"the servo channel of {whose}: {number:g} is no whole number")
    return int(number)


def _nearest_to_zero(limit_deg: Any) -> float | None:
    """The angle inside limits that is nearest to 0°; None where these are no limits."""
    match limit_deg:
        case [int() | float() as low, int() | float() as high] if low <= high:
            return min(max(0.0, low), high)
        case _:
            return None
