"""What a calibration says, of one robot on one board; and where the versions of it are kept."""

from __future__ import annotations

import math
import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import platformdirs
import tomli_w
from msgspec import Meta

from armctl.documents import Document, DocumentKind, claim, not_written, safe_name, write_atomically
from armctl.errors import CalibrationError
from armctl.lazy_dataclass import dataclass
from armctl.robot import FLATTEST_PER_DEG

_CALIBRATIONS = DocumentKind(CalibrationError, most_bytes=256 * 1024, largest=1e9)


class JointCalibration(msgspec.Struct, frozen=True):
    """output = zero + per_rad · angle, and the outputs that are safe; in the board's unit."""

    zero: float
    """output at 0 rad"""
    per_rad: float
    """signed"""
    low: float
    """smallest output that is safe"""
    high: float
    """largest one"""

    def angles(self) -> tuple[float, float]:
        """The angles at the safe outputs, the smaller one first [rad]."""
        first, last = sorted(((self.low - self.zero) / self.per_rad, (self.high - self.zero) / self.per_rad))
        return first, last


class JointDeflection(msgspec.Struct, frozen=True):
    """How a joint gives way; see ``armctl.robot.Deflection``."""

    compliance: float = 0.0
    """between what is read and the link [rad/(N·m)]"""
    drive: float = 0.0
    """between the setpoint and what is read [rad/(N·m)]"""
    play: float = 0.0
    """from one side to the other [rad]"""


class LengthChange(msgspec.Struct, frozen=True):
    """A length of a DH row that is not as in the robot file."""

    row: int
    """from 0"""
    key: Literal["a", "d"]
    off_m: float
    """how much longer it is [m]"""


class Calibration(msgspec.Struct, frozen=True):
    """What was measured of one robot on one board. What it does not name is as in the robot file."""

    robot: str
    """name of the robot"""
    board: str
    """serial number of the board, or "simulated" """
    unit: str
    joints: Mapping[str, JointCalibration]
    """by name"""
    gripper: tuple[float, float] | None = None
    """outputs at which it is closed and open"""
    made: str = ""
    """when it was measured (ISO 8601)"""
    note: str = ""
    deflection: Mapping[str, JointDeflection] = {}
    """by name, of the joints that give way"""
    load_kg: float = 0.0
    """held at the tool point: with it joints give way"""
    lengths: tuple[LengthChange, ...] = ()

    @property
    def empty(self) -> bool:
        """It changes nothing: the robot file holds as it is."""
        return not (self.joints or self.deflection or self.lengths) and self.gripper is None


def iso_time(stamp: float) -> str:
    """Local day and time to the second, with its offset, of seconds since the epoch (ISO 8601)."""
    return datetime.fromtimestamp(stamp).astimezone().isoformat(timespec="seconds")


# A calibration as TOML, decoded strictly: an unknown key or a wrong type is refused.

_PER_RAD = 180 / math.pi


class _JointEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    zero: float
    per_deg: float
    low: float
    high: float


class _GripperEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    closed: float
    open: float


class _DeflectionEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    # what is too soft depends on the weight: it is the sag that is bounded, where the robot is known
    compliance_deg_per_nm: Annotated[float, Meta(ge=0)] = 0.0
    drive_deg_per_nm: Annotated[float, Meta(ge=0)] = 0.0
    play_deg: Annotated[float, Meta(ge=0, le=10)] = 0.0


class _LengthEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    row: Annotated[int, Meta(ge=1)]
    key: Literal["a", "d"]
    longer_mm: Annotated[float, Meta(ge=-100, le=100)]


class _CalibrationFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    format: Literal[1]
    robot: Annotated[str, Meta(min_length=1)]
    board: Annotated[str, Meta(min_length=1)]
    unit: str
    made: str
    note: str = ""
    again: Annotated[int, Meta(ge=1)] | None = None
    """the earlier version that this one brought back"""
    gripper: _GripperEntry | None = None
    joints: dict[str, _JointEntry] = {}
    load_kg: Annotated[float, Meta(ge=0, le=100)] | None = None
    deflection: dict[str, _DeflectionEntry] | None = None
    lengths: list[_LengthEntry] | None = None

    def require_sense(self) -> None:
        """Refuse numbers that contradict each other."""
        for name, joint in self.joints.items():
            if abs(joint.per_deg) < FLATTEST_PER_DEG:
                raise CalibrationError(
                    f"joints.{name}.per_deg = {joint.per_deg:g}: the joint would not move; "
                    f"{FLATTEST_PER_DEG} {self.unit} a degree or more"
                )
            if joint.low >= joint.high:
                raise CalibrationError(
                    f"joints.{name}: low = {joint.low:g} and high = {joint.high:g} {self.unit}: the smallest "
                    "safe output comes first"
                )
        if self.gripper and self.gripper.closed == self.gripper.open:
            raise CalibrationError(f"gripper: closed and open are both {self.gripper.open:g} {self.unit}")


def checked_record(calibration: Calibration, again: int | None = None) -> dict[str, object]:
    """The tables of a calibration's file; refuses numbers that make no sense by themselves."""
    file = _CalibrationFile(
        format=1,
        robot=calibration.robot,
        board=calibration.board,
        unit=calibration.unit,
        made=calibration.made,
        note=calibration.note,
        again=again,
        gripper=calibration.gripper and _GripperEntry(*map(float, calibration.gripper)),
        joints={
            name: _JointEntry(float(one.zero), float(one.per_rad) / _PER_RAD, float(one.low), float(one.high))
            for name, one in calibration.joints.items()
        },
        load_kg=float(calibration.load_kg) or None,
        deflection={
            name: _DeflectionEntry(*(float(way) * _PER_RAD for way in (one.compliance, one.drive, one.play)))
            for name, one in calibration.deflection.items()
        }
        or None,
        lengths=[_LengthEntry(one.row + 1, one.key, 1000 * float(one.off_m)) for one in calibration.lengths]
        or None,
    )
    record = {key: value for key, value in msgspec.to_builtins(file).items() if value is not None}
    Document(_CALIBRATIONS, record).convert(_CalibrationFile)
    file.require_sense()
    return record


def encode_calibration(calibration: Calibration, again: int | None = None) -> str:
    """The text of a calibration's file; ``again``: the version of the store that it brings back."""
    return tomli_w.dumps(checked_record(calibration, again))


def decode_calibration(text: str | bytes) -> Calibration:
    """A calibration from the text of its file; a refusal names the key."""
    return _decode_version(text)[0]


def _decode_version(text: str | bytes) -> tuple[Calibration, int | None]:
    file = _CALIBRATIONS.decode(text, _CalibrationFile)
    file.require_sense()
    calibration = Calibration(
        robot=file.robot,
        board=file.board,
        unit=file.unit,
        joints={
            name: JointCalibration(entry.zero, entry.per_deg * _PER_RAD, entry.low, entry.high)
            for name, entry in file.joints.items()
        },
        gripper=file.gripper and (file.gripper.closed, file.gripper.open),
        made=file.made,
        note=file.note,
        deflection={
            name: JointDeflection(
                one.compliance_deg_per_nm / _PER_RAD, one.drive_deg_per_nm / _PER_RAD, one.play_deg / _PER_RAD
            )
            for name, one in (file.deflection or {}).items()
        },
        load_kg=file.load_kg or 0.0,
        lengths=tuple(LengthChange(one.row - 1, one.key, one.longer_mm / 1000) for one in file.lengths or ()),
    )
    return calibration, file.again


def read_calibration(path: Path) -> Calibration:
    """A calibration from a file; a refusal names the file, and as ``decode_calibration``."""
    return read_version(path)[0]


def read_version(path: Path) -> tuple[Calibration, int | None]:
    """As ``read_calibration``, with the version that it brought back, if it did."""
    return _CALIBRATIONS.load(path, _decode_version)


# The calibrations of this computer: a folder a robot and board, a file a version, none ever rewritten.

VERSIONS_KEPT = 50
_VERSION = re.compile(r"\d{6,}\.toml")


@dataclass(frozen=True, slots=True)
class Version:
    """One version of a calibration. Texts are empty where the file cannot be read."""

    number: int
    robot: str
    board: str
    made: str
    """when it was measured (ISO 8601)"""
    note: str
    calibration: Calibration | None
    """None: the robot file as it is, or a file that cannot be read"""
    problem: str | None
    """why the file cannot be read"""
    again: int | None
    """the earlier version that this one brought back"""
    path: Path


class CalibrationStore:
    """Calibrations by robot and board.

    Every save is a new file with the next number; the one with the highest number is in force. Two programs
    that save at once both leave their version. Going back brings an earlier version in force as a new one.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """Use ``folder``, or the user's own; nothing is made before something is saved."""
        self.folder = platformdirs.user_config_path("armctl") / "calibrations" if folder is None else folder

    def load(self, robot: str, board: str) -> Calibration | None:
        """The calibration in force, or None; a refusal names its file, and how to go back."""
        paths = _version_paths(self.folder_of(robot, board))
        if not paths:
            return None
        version = _kept_version(paths[-1], (robot, board))
        if version.problem is not None:
            raise CalibrationError(
                f"{version.problem}; mend the file, or go back with "
                f"`armctl calibrate revert {robot} --board {shlex.quote(board)}`"
            )
        return version.calibration

    def save(self, calibration: Calibration, again: int | None = None) -> Version:
        """Bring a calibration in force; the earlier ones stay. ``again``: the earlier version that it is."""
        place = self.folder_of(calibration.robot, calibration.board)
        try:
            text = encode_calibration(calibration, again)
            place.mkdir(parents=True, exist_ok=True)
            path = _write_next(place, text.encode())
        except OSError as cause:
            raise CalibrationError(f"the calibration is not saved; {not_written(place, cause)}") from cause
        except UnicodeError as cause:
            raise CalibrationError(
                f"the calibration cannot be saved, it holds text that is none: {cause}"
            ) from cause
        for old in _version_paths(place)[:-VERSIONS_KEPT]:
            if _kept_version(old).problem is None:  # a file that cannot be read is never deleted
                old.unlink(missing_ok=True)
        return _kept_version(path)

    def versions(self, robot: str, board: str) -> tuple[Version, ...]:
        """All versions that are kept, the newest, which is in force, first."""
        paths = _version_paths(self.folder_of(robot, board))
        return tuple(_kept_version(path, (robot, board)) for path in reversed(paths))

    def revert(self, robot: str, board: str, number: int | None = None) -> Version:
        """Bring an earlier version in force again, as a new one.

        ``number`` None: the one before the one in force (once more: the one before that).
        """
        versions = self.versions(robot, board)
        if not versions:
            raise CalibrationError(f"{robot} on board {board} was never calibrated: nothing to go back to")
        if number is None:
            # before what the newest one brought back, if it did
            number = versions[0].again or versions[0].number
            fitting = [one for one in versions if one.number < number and not (one.again or one.problem)]
            missing = (
                f"before version {number} to go back to; to go by the robot file, forget the calibration"
            )
        else:
            fitting = [one for one in versions if one.number == number]
            missing = f"{number}; kept are {', '.join(str(one.number) for one in versions)}"
        if not fitting:
            raise CalibrationError(f"there is no version {missing}")
        chosen = fitting[0]
        if chosen.problem is not None:
            raise CalibrationError(f"version {chosen.number} cannot be brought back: {chosen.problem}")
        calibration = chosen.calibration or _as_in_file(robot, board, "µs", chosen.made)
        return self.save(calibration, chosen.again or chosen.number)

    def forget(self, robot: str, board: str, made: str, unit: str = "µs") -> Version:
        """Go by the robot file from ``made`` (ISO 8601) on; the versions so far stay."""
        return self.save(_as_in_file(robot, board, unit, made))

    def boards(self) -> tuple[Version, ...]:
        """The version in force for each robot and board that was ever calibrated, sorted by both."""
        found: list[Version] = []
        for place in sorted(self.folder.glob("*/*")):
            paths = _version_paths(place)
            if paths:
                newest = _kept_version(paths[-1])
                named = next(
                    (one for path in reversed(paths) if not (one := _kept_version(path)).problem), None
                )
                robot, board = (named.robot, named.board) if named else (place.parent.name, place.name)
                found.append(replace(newest, robot=robot, board=board))
        return tuple(sorted(found, key=lambda one: (one.robot, one.board)))

    def folder_of(self, robot: str, board: str) -> Path:
        """Where what was measured of a robot on a board is kept; it may not be there yet."""
        return self.folder / safe_name(robot) / safe_name(board)


def renamed(calibration: Calibration, board: str) -> Calibration:
    """The same calibration for another board, as when the electronics are changed for a new one."""
    return msgspec.structs.replace(calibration, board=board)


def _as_in_file(robot: str, board: str, unit: str, made: str) -> Calibration:
    return Calibration(robot, board, unit, {}, None, made, "as in the robot file")


def _kept_version(path: Path, owner: tuple[str, str] | None = None) -> Version:
    """A version from its file; ``owner``: the robot and the board that it must be of."""
    number = _number(path)
    try:
        calibration, again = read_version(path)
    except CalibrationError as problem:
        return Version(number, "", "", "", "", None, str(problem), None, path)
    robot, board = calibration.robot, calibration.board
    problem = None
    if owner is not None and owner != (robot, board):
        problem = f"{path}: is of {robot} on board {board}, not of {owner[0]} on board {owner[1]}"
    kept = None if problem or calibration.empty else calibration
    return Version(number, robot, board, calibration.made, calibration.note, kept, problem, again, path)


def _version_paths(place: Path) -> list[Path]:
    """The files of the versions, the oldest first."""
    try:
        names = [name for name in os.listdir(place) if _VERSION.fullmatch(name)]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as cause:
        raise CalibrationError(f"{place}: cannot be read: {cause.strerror}") from cause
    return sorted((place / name for name in names), key=_number)


def _number(path: Path) -> int:
    return int(path.stem)


def _write_next(place: Path, content: bytes) -> Path:
    """Write the next version. Programs that save at once take turns by claiming a number each."""
    number = 1 + max(map(_number, _version_paths(place)), default=0)
    while True:
        path, claimed = place / f"{number:06d}.toml", place / f".{number:06d}.claim"
        number += 1
        if not claim(claimed):  # another program is writing it, or died while doing so
            continue
        try:
            if not path.exists():
                write_atomically(path, content)
                return path
        finally:
            claimed.unlink(missing_ok=True)
