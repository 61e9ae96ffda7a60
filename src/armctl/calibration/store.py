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
from armctl.documents import write_atomically
from armctl.errors import CalibrationError

VERSIONS_KEPT = 50
_VERSION = re.compile(r"\d{6,}\.toml")
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]+")
_LONGEST_NAME = 40


@dataclass(frozen=True, slots=True)
class Version:
    """One version of a calibration."""

    number: int
    made: str
    """when it was measured (ISO 8601); empty where the file cannot be read"""
    note: str
    calibration: Calibration | None
    """None: the robot file as it is, or a file that cannot be read"""
    problem: str | None
    """why the file cannot be read"""
    again: int | None
    """the earlier version that this one brought back"""
    path: Path


@dataclass(frozen=True, slots=True)
class Stored:
    """What is in force for one robot on one board."""

    robot: str
    board: str
    calibration: Calibration | None
    problem: str | None


class CalibrationStore:
    """Calibrations by robot and board.

    Every save is a new file with the next number; the one with the highest number is in force. Two programs
    that save at once both leave their version. Going back brings an earlier version in force as a new one.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """Use ``folder``, or the user's own; nothing is made before something is saved."""
        self.folder = platformdirs.user_config_path("armctl") / "calibrations" if folder is None else folder

    def load(self, robot: str, board: str) -> Calibration | None:
        """The calibration in force; None where there is none.

        Raises:
            CalibrationError: its file cannot be read; names the file, and how to go back.
        """
        names = self._names(robot, board)
        if not names:
            return None
        version = self._read(self._place(robot, board) / names[-1], robot, board)
        if version.problem is not None:
            raise CalibrationError(
                f"{version.problem}; mend the file, or go back with "
                f"`armctl calibrate revert {robot} --board {shlex.quote(board)}`"
            )
        return version.calibration

    def save(self, calibration: Calibration) -> Version:
        """Bring a calibration in force; the earlier ones stay.

        Raises:
            CalibrationError: it contradicts itself, or cannot be written.
        """
        return self._save(calibration, None)

    def versions(self, robot: str, board: str) -> tuple[Version, ...]:
        """All versions that are kept, the newest, which is in force, first."""
        place = self._place(robot, board)
        return tuple(self._read(place / name, robot, board) for name in reversed(self._names(robot, board)))

    def revert(self, robot: str, board: str, number: int | None = None) -> Version:
        """Bring an earlier version in force again, as a new one.

        Args:
            robot: name of the robot.
            board: serial number of the board.
            number: of the version; None: the one before the one in force (once more: the one before that).

        Raises:
            CalibrationError: there is no such version, or its file cannot be read.
        """
        versions = self.versions(robot, board)
        if not versions:
            raise CalibrationError(f"{robot} on board {board} was never calibrated: nothing to go back to")
        chosen = _before(versions) if number is None else _numbered(versions, number)
        if chosen.problem is not None:
            raise CalibrationError(f"version {chosen.number} cannot be brought back: {chosen.problem}")
        calibration = chosen.calibration or self._as_in_file(robot, board, "µs", chosen.made)
        return self._save(calibration, chosen.again or chosen.number)

    def forget(self, robot: str, board: str, made: str, unit: str = "µs") -> Version:
        """Let the robot file hold as it is; the calibrations so far stay among the versions.

        Args:
            robot: name of the robot.
            board: serial number of the board.
            made: when (ISO 8601).
            unit: of the board's outputs.
        """
        return self._save(self._as_in_file(robot, board, unit, made), None)

    def boards(self) -> tuple[Stored, ...]:
        """What is in force for each robot and board that was ever calibrated, sorted by both."""
        found: list[Stored] = []
        for place in sorted(self.folder.glob("*/*")) if self.folder.is_dir() else ():
            names = _version_names(place)
            if names:
                version = self._read(place / names[-1], None, None)
                robot, board = self._owner(place, names)
                found.append(Stored(robot, board, version.calibration, version.problem))
        return tuple(sorted(found, key=lambda one: (one.robot, one.board)))

    def _save(self, calibration: Calibration, again: int | None) -> Version:
        place = self._place(calibration.robot, calibration.board)
        try:
            text = encode_calibration(calibration, again)
            place.mkdir(parents=True, exist_ok=True)
            path = _write_next(place, text)
        except OSError as cause:
            raise CalibrationError(f"{place}: the calibration cannot be saved: {cause.strerror}") from cause
        except UnicodeError as cause:
            raise CalibrationError(
                f"the calibration cannot be saved, it holds text that is none: {cause}"
            ) from cause
        version = self._read(path, calibration.robot, calibration.board)
        self._thin_out(place)
        return version

    def _thin_out(self, place: Path) -> None:
        """Delete the oldest versions beyond the number kept, but never a file that cannot be read."""
        for name in _version_names(place)[:-VERSIONS_KEPT]:
            if self._read(place / name, None, None).problem is None:
                (place / name).unlink(missing_ok=True)

    def _names(self, robot: str, board: str) -> list[str]:
        return _version_names(self._place(robot, board))

    def _place(self, robot: str, board: str) -> Path:
        return self.folder / _safe_name(robot) / _safe_name(board)

    def _owner(self, place: Path, names: list[str]) -> tuple[str, str]:
        """Robot and board of a folder, from its newest file that can be read."""
        for name in reversed(names):
            try:
                calibration, _ = read_version(place / name)
            except CalibrationError:  # the caller tells it as the version's problem
                continue
            return calibration.robot, calibration.board
        return place.parent.name, place.name

    def _read(self, path: Path, robot: str | None, board: str | None) -> Version:
        number = _number(path.name)
        try:
            calibration, again = read_version(path)
        except CalibrationError as problem:
            return Version(number, "", "", None, str(problem), None, path)
        version = Version(number, calibration.made, calibration.note, calibration, None, again, path)
        if robot is not None and (calibration.robot, calibration.board) != (robot, board):
            return replace(
                version,
                calibration=None,
                problem=f"{path}: is of {calibration.robot} on board {calibration.board}, "
                f"not of {robot} on board {board}",
            )
        return replace(version, calibration=None) if calibration.empty else version

    @staticmethod
    def _as_in_file(robot: str, board: str, unit: str, made: str) -> Calibration:
        return Calibration(robot, board, unit, {}, None, made, "as in the robot file")


def renamed(calibration: Calibration, board: str) -> Calibration:
    """The same calibration for another board, as when the electronics are changed for a new one."""
    return msgspec.structs.replace(calibration, board=board)


def _before(versions: tuple[Version, ...]) -> Version:
    """The version before the newest one, past what that one brought back."""
    newest = versions[0]
    place = newest.again or newest.number
    for version in versions:
        if version.number < place and version.again is None and version.problem is None:
            return version
    raise CalibrationError(
        f"there is no version before version {place} to go back to; "
        "to go by the robot file, forget the calibration"
    )


def _numbered(versions: tuple[Version, ...], number: int) -> Version:
    for version in versions:
        if version.number == number:
            return version
    known = ", ".join(str(version.number) for version in versions)
    raise CalibrationError(f"there is no version {number}; kept are {known}")


def _version_names(place: Path) -> list[str]:
    """Names of the version files, the oldest first."""
    try:
        names = [name for name in os.listdir(place) if _VERSION.fullmatch(name)]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as cause:
        raise CalibrationError(f"{place}: cannot be read: {cause.strerror}") from cause
    return sorted(names, key=_number)


def _number(name: str) -> int:
    return int(name.partition(".")[0])


def _write_next(place: Path, text: str) -> Path:
    """Write the next version. Programs that save at once take turns by claiming a number each."""
    number = 1 + max((_number(name) for name in _version_names(place)), default=0)
    while True:
        path, claim = place / f"{number:06d}.toml", place / f".{number:06d}.claim"
        number += 1
        try:
            claim.touch(exist_ok=False)
        except FileExistsError:  # somebody is writing it, or died while doing so
            continue
        try:
            if not path.exists():
                write_atomically(path, text.encode())
                return path
        finally:
            claim.unlink(missing_ok=True)


def _safe_name(text: str) -> str:
    """A file name for any text: readable where it can be, its own for each text on every file system."""
    readable = _UNSAFE.sub("_", text)[:_LONGEST_NAME]
    return f"{readable}-{hashlib.sha256(text.encode(errors='surrogatepass')).hexdigest()[:12]}"
