"""The settings of servos that armctl has kept as right, by robot and board; what was changed since.

A file a robot and board, beside the calibrations. It is written where somebody saves or restores the
settings, has armctl write some, or says that they are right; and read whenever the board is connected.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import platformdirs
import tomli_w
from msgspec import Meta

from armctl.documents import DocumentKind, not_written, safe_name, write_atomically
from armctl.errors import InputError
from armctl.facts.servos import ServoChanged
from armctl.hardware.servos import FoundServo, ServoSettings

_RECORDS = DocumentKind(InputError, most_bytes=64 * 1024, largest=1e9)


class KeptSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What stood in the EEPROM of a servo."""

    offset: int
    """homing offset [steps]"""
    lowest: int
    highest: int
    """range [steps]"""
    mode: int

    @classmethod
    def of(cls, settings: ServoSettings) -> KeptSettings:
        """As they are now."""
        return cls(settings.offset, settings.lowest, settings.highest, settings.mode)


class _RecordFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    format: Literal[1]
    robot: Annotated[str, Meta(min_length=1)]
    board: Annotated[str, Meta(min_length=1)]
    servos: dict[str, KeptSettings]
    """by id"""


def changes(servo: int, now: ServoSettings, kept: KeptSettings | None) -> tuple[ServoChanged, ...]:
    """What is not as it was kept; nothing where nothing was."""
    if kept is None:
        return ()
    before, after = msgspec.structs.asdict(kept), msgspec.structs.asdict(KeptSettings.of(now))
    return tuple(
        ServoChanged(servo, name, before[name], after[name]) for name in before if before[name] != after[name]
    )


class ServoRecords:
    """The records of this computer."""

    def __init__(self, folder: Path | None = None) -> None:
        """Use ``folder``, or the user's own; nothing is made before something is kept."""
        self.folder = platformdirs.user_config_path("armctl") / "servos" if folder is None else folder

    def load(self, robot: str, board: str) -> Mapping[int, KeptSettings]:
        """What was kept, by servo; empty: nothing. ``InputError`` names a file that cannot be read."""
        path = self._path(robot, board)
        if not path.exists():
            return {}
        record = _RECORDS.load(path, lambda content: _RECORDS.decode(content, _RecordFile))
        if (record.robot, record.board) != (robot, board):
            raise InputError(f"{path}: is of {record.robot} on board {record.board}; delete it")
        wrong = next((key for key in record.servos if not key.isdecimal()), None)
        if wrong is not None:
            raise InputError(f"{path}: servos.{wrong}: the id of a servo is a number")
        return {int(key): one for key, one in record.servos.items()}

    def keep(self, robot: str, board: str, found: Iterable[FoundServo]) -> Mapping[int, KeptSettings]:
        """These are right as they are now; others stay as they were kept. ``InputError``: not writable."""
        path = self._path(robot, board)
        kept = dict(self.load(robot, board)) | {one.id: KeptSettings.of(one.settings) for one in found}
        record = _RecordFile(1, robot, board, {str(servo): kept[servo] for servo in sorted(kept)})
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, tomli_w.dumps(msgspec.to_builtins(record)).encode())
        except OSError as cause:
            raise InputError(f"the settings are not kept; {not_written(path, cause)}") from cause
        return kept

    def _path(self, robot: str, board: str) -> Path:
        return self.folder / safe_name(robot) / f"{safe_name(board)}.toml"
