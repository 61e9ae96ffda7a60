"""The touches of a robot on a board that led to no correction yet, or to one: kept over a restart.

One file a robot and board, beside the versions of its calibration. It holds outputs, not angles, so that the
touches stay true when the calibration changes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np
import tomli_w
from msgspec import Meta

from armctl.calibration.record import CalibrationStore
from armctl.calibration.sheet import Paper, TouchSheet
from armctl.documents import DocumentKind, not_written, write_atomically
from armctl.errors import CalibrationError
from armctl.lazy_dataclass import dataclass
from armctl.robot import OutputMap, Robot

_TOUCHES = DocumentKind(CalibrationError, most_bytes=256 * 1024, largest=1e9, entries={"touches": "touch"})
_NAME = "touched-points.toml"
MOST_TOUCHES = 100
"""each takes part in every fit"""


@dataclass(frozen=True, slots=True)
class TouchedPoint:
    """The tool stood on a point."""

    outputs: Mapping[int, float]
    """by channel, in the board's unit: they stay true when the calibration changes"""
    point_m: tuple[float, float, float]
    """in the frame of all points [m]"""
    number: int | None = None
    """of the crosshair, from 1; None: a place in the base frame"""
    sense: tuple[float, ...] = ()
    """(n,) in which sense each joint turned last: 1, -1, 0 not known; empty: nobody knows"""
    measured: bool = False
    """``outputs`` are what encoders read; else they are setpoints"""
    sent: Mapping[int, float] | None = None
    """the setpoints beside what encoders read; None: there are none, as where the arm is led by hand"""

    def is_where(self, other: TouchedPoint) -> bool:
        """Whether the other one is of the same point."""
        return (self.number, self.point_m) == (other.number, other.point_m)


@dataclass(frozen=True, slots=True, eq=False)
class KeptTouches:
    """Touches, what they were made on, and what they have led to."""

    touches: tuple[TouchedPoint, ...]
    sheet: TouchSheet | None = None
    """None: the points are places in the base frame"""
    block_m: float = 0.0
    load_kg: float = 0.0
    """what the tool carried meanwhile"""
    skipped: frozenset[int] = frozenset()
    corrected: tuple[float, float] | None = None
    """RMS before and after the correction that they led to [m]; None: none was applied"""
    used: int = 0
    """touches before that; those behind check it"""
    made: str = ""
    """when the last of them was made (ISO 8601)"""
    tool: str = ""
    """name of the tool that touched; empty: the robot file named none"""


_Positive = Annotated[float, Meta(ge=0)]


class _SheetEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    paper: Paper
    points_mm: Annotated[list[tuple[float, float]], Meta(min_length=1, max_length=100)]
    place_mm: tuple[float, float, float]
    height_mm: float = 0.0


class _TouchEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    point_mm: tuple[float, float, float]
    outputs: dict[str, float]
    measured: bool = False
    crosshair: Annotated[int, Meta(ge=1)] | None = None
    sense: list[Annotated[float, Meta(ge=-1, le=1)]] = []
    sent: dict[str, float] | None = None


class _TouchesFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    format: Literal[1]
    robot: str
    board: str
    unit: str
    made: str
    touches: Annotated[list[_TouchEntry], Meta(min_length=1, max_length=MOST_TOUCHES)]
    sheet: _SheetEntry | None = None
    block_mm: Annotated[float, Meta(ge=0, le=500)] = 0.0
    load_kg: Annotated[float, Meta(ge=0, le=100)] = 0.0
    skipped: list[int] = []
    corrected_mm: tuple[_Positive, _Positive] | None = None
    used: Annotated[int, Meta(ge=0)] = 0
    tool: str = ""


class TouchesFile:
    """Where the touches of a robot on a board are kept."""

    def __init__(self, store: CalibrationStore, robot: Robot, board: str) -> None:
        """Nothing is made before something is kept. ``robot``: whose output map the touches were made by."""
        self._robot, self._board = robot, board
        self.path = store.folder_of(robot.name, board) / _NAME

    def load(self) -> KeptTouches | None:
        """What is kept; None: nothing. ``CalibrationError`` names the file, and what is wrong in it."""
        if not self.path.exists():
            return None
        return _TOUCHES.load(self.path, self._decode)

    def save(self, kept: KeptTouches) -> None:
        """Keep touches in place of those before; without a touch there is no file. May block."""
        try:
            if not kept.touches:
                self.path.unlink(missing_ok=True)
                return
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self.path, tomli_w.dumps(self._record(kept)).encode())
        except OSError as cause:
            why = not_written(self.path, cause)
            raise CalibrationError(f"the touched points would not survive a restart; {why}") from cause

    def _record(self, kept: KeptTouches) -> dict[str, object]:
        sheet = kept.sheet
        file = _TouchesFile(
            format=1,
            robot=self._robot.name,
            board=self._board,
            unit=self._robot.outputs.unit,
            made=kept.made,
            touches=[
                _TouchEntry(
                    _in_mm(one.point_m),
                    _by_text(one.outputs),
                    one.measured,
                    one.number,
                    list(one.sense),
                    None if one.sent is None else _by_text(one.sent),
                )
                for one in kept.touches
            ],
            sheet=sheet
            and _SheetEntry(
                sheet.paper,
                [(1000 * x, 1000 * y) for x, y, _ in sheet.points_m.tolist()],
                _in_mm(sheet.place_m.tolist()),
                1000 * sheet.height_m,
            ),
            block_mm=1000 * kept.block_m,
            load_kg=kept.load_kg,
            skipped=sorted(kept.skipped),
            corrected_mm=kept.corrected and (1000 * kept.corrected[0], 1000 * kept.corrected[1]),
            used=kept.used,
            tool=kept.tool,
        )
        return msgspec.to_builtins(file)

    def _decode(self, content: bytes) -> KeptTouches:
        file = _TOUCHES.decode(content, _TouchesFile)
        outputs = self._robot.outputs
        if (file.robot, file.board, file.unit) != (self._robot.name, self._board, outputs.unit):
            raise CalibrationError(
                f"is of {file.robot} on board {file.board} in {file.unit}, not of {self._robot.name} on "
                f"board {self._board} in {outputs.unit}; delete it"
            )
        if file.used > len(file.touches):
            raise CalibrationError(f"used = {file.used}, and it has {len(file.touches)} touches")
        sheet = None
        if file.sheet is not None:
            points = np.array([(x, y, 0.0) for x, y in file.sheet.points_mm]) / 1000
            place = np.array(file.sheet.place_mm) / 1000
            height = file.sheet.height_mm / 1000
            sheet = TouchSheet(self._robot.title, file.sheet.paper, points, place, height)
        touches = [self._touch(i, one, sheet) for i, one in enumerate(file.touches, 1)]
        corrected = file.corrected_mm and (file.corrected_mm[0] / 1000, file.corrected_mm[1] / 1000)
        return KeptTouches(
            tuple(touches), sheet, file.block_mm / 1000, file.load_kg, frozenset(file.skipped), corrected,
            file.used, file.made, file.tool,
        )  # fmt: skip

    def _touch(self, number: int, one: _TouchEntry, sheet: TouchSheet | None) -> TouchedPoint:
        where, outputs = f"touch {number}", self._robot.outputs
        if len(one.sense) not in (0, self._robot.n):
            raise CalibrationError(f"{where}: sense has {len(one.sense)} numbers, {self._robot.n} joints do")
        count = 0 if sheet is None else len(sheet.points_m)
        if (one.crosshair is None) is not (sheet is None) or (one.crosshair or 0) > count:
            raise CalibrationError(
                f"{where}: crosshair = {one.crosshair or 'none'}; its sheet has {count}; delete the file"
            )
        x, y, z = (value / 1000 for value in one.point_mm)
        sent = None if one.sent is None else _by_channel(f"{where}, sent", one.sent, outputs)
        return TouchedPoint(
            _by_channel(f"{where}, outputs", one.outputs, outputs),
            (x, y, z),
            one.crosshair,
            tuple(one.sense),
            one.measured,
            sent,
        )


def _in_mm(point_m: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (1000 * float(value) for value in point_m)
    return x, y, z


def _by_text(outputs: Mapping[int, float]) -> dict[str, float]:
    return {str(channel): float(value) for channel, value in outputs.items()}


def _by_channel(where: str, given: Mapping[str, float], outputs: OutputMap) -> dict[int, float]:
    """Outputs of all joints; refuses those of other channels than the robot's."""
    if sorted(given) != sorted(map(str, outputs.channels)):
        raise CalibrationError(
            f"{where}: of the channels {', '.join(given)}; the joints of this robot have "
            f"{', '.join(map(str, outputs.channels))}: another robot file was in force; delete the file"
        )
    if not all(map(math.isfinite, given.values())):
        raise CalibrationError(f"{where}: not a finite number")
    return {int(channel): value for channel, value in given.items()}
