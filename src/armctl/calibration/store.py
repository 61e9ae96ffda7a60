"""The calibrations of this computer: a folder a robot and board, a file a version, none ever rewritten."""

from __future__ import annotations

import hashlib
import os
import re
import shlex
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import platformdirs

from armctl.calibration.record import Calibration, encode_calibration, read_version
from armctl.documents import claim, not_written, write_atomically
from armctl.errors import CalibrationError

VERSIONS_KEPT = 50
_VERSION = re.compile(r"\d{6,}\.toml")
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]+")
_LONGEST_NAME = 40


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
        paths = _version_paths(self._place(robot, board))
        if not paths:
            return None
        version = _read(paths[-1], (robot, board))
        if version.problem is not None:
            raise CalibrationError(
                f"{version.problem}; mend the file, or go back with "
                f"`armctl calibrate revert {robot} --board {shlex.quote(board)}`"
            )
        return version.calibration

    def save(self, calibration: Calibration, again: int | None = None) -> Version:
        """Bring a calibration in force; the earlier ones stay. ``again``: the earlier version that it is."""
        place = self._place(calibration.robot, calibration.board)
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
            if _read(old).problem is None:  # a file that cannot be read is never deleted
                old.unlink(missing_ok=True)
        return _read(path)

    def versions(self, robot: str, board: str) -> tuple[Version, ...]:
        """All versions that are kept, the newest, which is in force, first."""
        paths = _version_paths(self._place(robot, board))
        return tuple(_read(path, (robot, board)) for path in reversed(paths))

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
                newest = _read(paths[-1])
                named = next((one for path in reversed(paths) if not (one := _read(path)).problem), None)
                robot, board = (named.robot, named.board) if named else (place.parent.name, place.name)
                found.append(replace(newest, robot=robot, board=board))
        return tuple(sorted(found, key=lambda one: (one.robot, one.board)))

    def _place(self, robot: str, board: str) -> Path:
        return self.folder / _safe_name(robot) / _safe_name(board)


def renamed(calibration: Calibration, board: str) -> Calibration:
    """The same calibration for another board, as when the electronics are changed for a new one."""
    return msgspec.structs.replace(calibration, board=board)


def _as_in_file(robot: str, board: str, unit: str, made: str) -> Calibration:
    return Calibration(robot, board, unit, {}, None, made, "as in the robot file")


def _read(path: Path, owner: tuple[str, str] | None = None) -> Version:
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


def _safe_name(text: str) -> str:
    """A file name for any text: readable where it can be, its own for each text on every file system."""
    readable = _UNSAFE.sub("_", text)[:_LONGEST_NAME]
    return f"{readable}-{hashlib.sha256(text.encode(errors='surrogatepass')).hexdigest()[:12]}"
