"""The board's part of a robot file: which board drives the arm, and what it must be told for which angle.

Each board reads its own part, for only it knows its tables (``BoardEntries``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Protocol, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from armctl.documents import Document, Place, must_be
from armctl.errors import RobotFileError
from armctl.robot.file import (
    BoardTables,
    JointEntry,
    RobotFile,
    Strict,
)
from armctl.robot.outputs import DEFAULT_BOARD, FLATTEST_PER_DEG, OutputMap

Entry = TypeVar("Entry", bound=msgspec.Struct)
Channel = Annotated[int, Meta(ge=0, le=63)]
_ROUNDING = 0.125
"""robot files may round the safe range inwards by this [output]"""


@dataclass(frozen=True, slots=True)
class BoardPart:
    """The board's part of a robot file, for its ``BoardEntries`` to read.

    Args:
        path: the robot file.
        kind: of the board.
        tables: as they stand in the file.
        joints: names and limits [degrees], from the base to the tool.
        has_gripper: whether the arm has one.
    """

    path: Path
    kind: str
    tables: BoardTables
    joints: Sequence[tuple[str, tuple[float, float]]]
    has_gripper: bool

    def board(self, model: type[Entry]) -> Entry:
        """``[board]`` without its kind.

        Raises:
            RobotFileError: it is no ``model``; so for the other tables.
        """
        options = {key: value for key, value in self.tables.board.items() if key != "kind"}
        return self._decoded(replace(self.tables.document, record={"board": options}), model, ("board",))

    def outputs(self, key: str, model: type[Entry]) -> list[Entry]:
        """The table ``key`` of each joint; empty where no joint has one.

        Raises:
            RobotFileError: some joints have none, or one has the table of another board.
        """
        everywhere = [*self.tables.joints.values(), self.tables.gripper]
        for other in (name for tables in everywhere for name in tables if name != key):
            raise RobotFileError(
                f"{self.path}: board.kind = {self.kind!r}: its joints and its gripper have {key} entries, "
                f"not {other} entries"
            )
        there = [name for name, _ in self.joints if self.tables.joints[name]]
        missing = [name for name, _ in self.joints if name not in there]
        if there and missing:
            raise RobotFileError(
                f"{self.path}: joints.{missing[0]}.{key} is missing; the other joints have one"
            )
        places: list[Place] = [("joints", self.tables.order.index(name), key) for name in there]
        return [self._decoded(self.tables.document, model, place) for place in places]

    def gripper(self, key: str, model: type[Entry], closed: str, opened: str) -> Entry | None:
        """The table ``key`` of the gripper; None for an arm without a gripper.

        Args:
            key: of the table.
            model: of the table.
            closed: the key in it of the gripper's closed end.
            opened: of its open end.

        Raises:
            RobotFileError: there is a gripper without one, or its two ends are the same.
        """
        if not self.has_gripper:
            return None
        if key not in self.tables.gripper:
            raise RobotFileError(f"{self.path}: gripper.{key} is missing; the joints have one")
        entry = self._decoded(self.tables.document, model, ("gripper", key))
        if getattr(entry, closed) == getattr(entry, opened):
            raise RobotFileError(
                f"{self.path}: gripper.{key}: closed and open are both {getattr(entry, closed):g}; they must "
                "differ, or it cannot move"
            )
        return entry

    def check_channels(self, channels: Sequence[int], gripper: int | None, what: str) -> None:
        """Refuse two ``what`` on one channel."""
        everything = [*channels, *([] if gripper is None else [gripper])]
        if len(set(everything)) != len(everything):
            raise RobotFileError(f"{self.path}: two {what} are on the same channel: {everything}")

    def check_scale(self, per_deg: float, where: str) -> None:
        """Refuse a scale on which a whole turn is about a step of the board, or less."""
        if abs(per_deg) < FLATTEST_PER_DEG:
            raise RobotFileError(
                f"{self.path}: {where} is {per_deg:g}: the joint would not move; {FLATTEST_PER_DEG} or more"
            )

    def _decoded(self, document: Document, model: type[Entry], place: Place) -> Entry:
        try:
            return document.convert(model, place)
        except RobotFileError as cause:
            raise RobotFileError(f"{self.path}: {cause}") from cause


class BoardEntries(Protocol):
    """How a kind of board reads its part of a robot file."""

    def read(self, part: BoardPart) -> tuple[OutputMap | None, object]:
        """The map of the outputs, None where the file has none; and what else the board's driver needs.

        Raises:
            RobotFileError: the file names the place, the value and what is allowed.
        """
        ...


class NoOptions(Strict, frozen=True):
    """``[board]`` of a board that needs to be told nothing."""


@dataclass(frozen=True)
class ServoEntries:
    """Entries of servos, or of any outputs that are proportional to the angle: output = zero + scale · angle.

    In a robot file: ``servo = { channel = 0, zero_us = 1500, us_per_deg = 10, pulse_us = [600, 2400] }`` in
    each joint, and ``servo = { channel = 5, closed_us = 1000, open_us = 2000 }`` in the gripper.

    Args:
        unit: of the outputs.
        key: how the unit is written in the keys.
        range_key: the key of the range of outputs that is safe.
        lowest: no output of this board may be below.
        highest: … or above.
    """

    unit: str = "µs"
    key: str = "us"
    range_key: str = "pulse_us"
    lowest: float = 64.0
    highest: float = 4080.0

    def read(self, part: BoardPart) -> tuple[OutputMap | None, object]:
        """The map of the outputs; None where the file has none."""
        part.board(NoOptions)
        zero, per_deg = f"zero_{self.key}", f"{self.key}_per_deg"
        closed, opened = f"closed_{self.key}", f"open_{self.key}"
        servos = [_fields(one) for one in part.outputs("servo", self._joint)]
        if not servos:
            return None, None
        entry = part.gripper("servo", self._gripper, closed, opened)
        gripper: dict[str, Any] = {} if entry is None else _fields(entry)
        gripper_channel: int | None = gripper.get("channel")
        part.check_channels([servo["channel"] for servo in servos], gripper_channel, "servos")
        for (name, limits), servo in zip(part.joints, servos, strict=True):
            where = f"joints.{name}.servo"
            self._check_range(
                servo[zero], servo[per_deg], servo[self.range_key], limits, f"{part.path}: {where}"
            )
            part.check_scale(servo[per_deg], f"{where}.{per_deg}")
        outputs = OutputMap(
            unit=self.unit,
            channels=tuple(servo["channel"] for servo in servos),
            zero=np.array([servo[zero] for servo in servos]),
            per_rad=np.array([servo[per_deg] for servo in servos]) * (180 / math.pi),
            low=np.array([servo[self.range_key][0] for servo in servos]),
            high=np.array([servo[self.range_key][1] for servo in servos]),
            gripper_channel=gripper_channel,
            gripper_closed=gripper.get(closed, 0.0),
            gripper_open=gripper.get(opened, 0.0),
            lowest=self.lowest,
            highest=self.highest,
            key=self.key,
            range_key=self.range_key,
        )
        return outputs, None

    @cached_property
    def _joint(self) -> type[msgspec.Struct]:
        allowed = Annotated[float, Meta(ge=self.lowest, le=self.highest)]
        return self._struct(
            ("channel", Channel),
            (f"zero_{self.key}", float),
            (f"{self.key}_per_deg", float),
            (self.range_key, tuple[allowed, allowed]),
        )

    @cached_property
    def _gripper(self) -> type[msgspec.Struct]:
        allowed = Annotated[float, Meta(ge=self.lowest, le=self.highest)]
        return self._struct(
            ("channel", Channel), (f"closed_{self.key}", allowed), (f"open_{self.key}", allowed)
        )

    def _struct(self, *fields: tuple[str, object]) -> type[msgspec.Struct]:
        return msgspec.defstruct("ServoEntry", fields, bases=(Strict,), frozen=True)  # pyright: ignore

    def _check_range(
        self,
        zero: float,
        per_deg: float,
        safe: tuple[float, float],
        limits: tuple[float, float],
        where: str,
    ) -> None:
        """Refuse limits [degrees] that the safe range of outputs does not hold."""
        needed = sorted(zero + per_deg * angle for angle in limits)
        if needed[0] < safe[0] - _ROUNDING or needed[1] > safe[1] + _ROUNDING:
            raise RobotFileError(
                f"{where}: the limits {limits[0]}° … {limits[1]}° need pulses of "
                f"{needed[0]:.1f} … {needed[1]:.1f} {self.unit}, {self.range_key} allows "
                f"{safe[0]} … {safe[1]} {self.unit}"
            )


FindEntries = Callable[[str], "BoardEntries | tuple[str, ...]"]
"""finds what reads the entries of a kind of board; where there is no such board, the kinds that there are"""
_find: list[FindEntries] = []


def use_boards(find: FindEntries) -> None:
    """Tell the loader where boards are found: they are known in a layer above this one."""
    _find[:] = [find]


def read_outputs(
    file: RobotFile, tables: BoardTables, entries: Sequence[JointEntry], path: Path
) -> tuple[str, OutputMap | None, object]:
    """The kind of the board, the map of the joints ``entries`` in their order, and what else the board needs.

    Raises:
        RobotFileError: no such board; or its part of the file contradicts itself.
    """
    kind = tables.board.get("kind", None if tables.board else DEFAULT_BOARD)
    if kind is None:
        raise RobotFileError(f"{path}: board: the key 'kind' is missing")
    found = _find[0](kind) if isinstance(kind, str) else _find[0]("")
    if isinstance(found, tuple):
        raise RobotFileError(f"{path}: key board.kind: {must_be(found)}, not {kind!r}")
    joints = [(entry.name, entry.limit_deg) for entry in entries]
    outputs, settings = found.read(BoardPart(path, str(kind), tables, joints, file.gripper is not None))
    return str(kind), outputs, settings


def _fields(entry: msgspec.Struct) -> dict[str, Any]:
    return msgspec.structs.asdict(entry)
