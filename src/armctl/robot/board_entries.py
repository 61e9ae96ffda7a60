"""The board's part of a robot file: which board drives the arm, and what it is sent for which angle.

Each board reads its own part, for only it knows its tables (``BoardEntries``). Refusals do not name the file;
``load_robot`` does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any, Protocol, TypeVar, cast

import msgspec
import numpy as np
from msgspec import Meta

from armctl.decoding import Place, did_you_mean, must_be
from armctl.documents import Document
from armctl.errors import ArmctlError, Errors, RefusedBeforeError
from armctl.facts.quantities import NAMES
from armctl.lazy_dataclass import dataclass
from armctl.robot.file import Channel, GripperEntry, Strict, Table, board_tables
from armctl.robot.outputs import DEFAULT_BOARD, FLATTEST_PER_DEG, Mirror, OutputMap
from armctl.robot.signals import InputKind, OutputKind, Signals

Entry = TypeVar("Entry", bound=msgspec.Struct)
_ROUNDING = 0.125
"""robot files may round the safe range inwards by this [output]"""


class BoardEntries(Protocol):
    """How a kind of board reads its part of a robot file."""

    def read(self, part: BoardPart) -> tuple[OutputMap | None, object]:
        """The map of the outputs, None where the file has none; and what else the board's driver needs."""
        ...


def _no_boards(kind: str) -> BoardEntries | tuple[str, ...]:
    return ()


find_entries: Callable[[str], BoardEntries | tuple[str, ...]] = _no_boards
"""What reads the entries of a kind of board; where there is no such board, the kinds that there are.

Boards are known in a layer above this one: ``armctl/__init__.py`` sets it.
"""


_MEASURED = (*(name.partition("_")[0] for name in NAMES), "counter")
"""what programs watch of joints or count, so no name of an input"""
SignalKinds = tuple[Sequence[InputKind], Sequence[OutputKind]]


def _no_signals(kind: str) -> SignalKinds:
    return (), ()


find_signal_kinds: Callable[[str], SignalKinds] = _no_signals
"""The kinds of inputs and of outputs that a kind of board has beside those of joints; set likewise."""


@dataclass(frozen=True, slots=True)
class BoardPart:
    """The board's part of a robot file, for its ``BoardEntries`` to read."""

    kind: str
    """of the board"""
    document: Document
    """all of the file"""
    joints: Sequence[tuple[str, tuple[float, float]]]
    """names and limits [degrees], from the base to the tool"""
    has_gripper: bool

    def board(self, model: type[Entry]) -> Entry:
        """``[board]`` without its kind; ``RobotFileError`` where it is no ``model``."""
        options = dict(self.document.record.get("board", {}))
        options.pop("kind", None)
        return replace(self.document, record={"board": options}).convert(model, ("board",))

    def outputs(self, key: str, model: type[Entry]) -> list[Entry]:
        """The table ``key`` of each joint; empty where no joint has one, refused where only some have it."""
        errors = Errors()
        places = [self._place(name) for name, _ in self.joints]
        tables = [{} if place is None else board_tables(self._at(place)) for place in places]
        for where, own in [*zip(places, tables, strict=True), (("gripper",), self._gripper)]:
            for other in own.keys() - {key}:
                with errors:
                    raise self.document.error(
                        f"board.kind = {self.kind!r}: its joints and its gripper have {key} entries, "
                        f"not {other} entries",
                        (*(where or ()), other),
                    )
        missing = [
            name
            for (name, _), place in zip(self.joints, places, strict=True)
            if place is None or key not in self._at(place)
        ]
        errors.raise_all()
        if len(missing) == len(self.joints):
            return []
        entries: list[Entry] = []
        for (name, _), place in zip(self.joints, places, strict=True):
            with errors:
                if name in missing:
                    raise self.error(f"joints.{name}.{key}", " is missing; the other joints have one")
                entries.append(self.document.convert(model, (*(place or ()), key)))
        errors.raise_all()
        return entries

    def gripper(self, key: str, model: type[Entry], closed: str, opened: str) -> Entry | None:
        """The table ``key`` of the gripper; None for an arm without a gripper.

        Refuses a gripper without one, and two ends (the keys ``closed`` and ``opened``) that are the same.
        """
        if not self.has_gripper:
            return None
        where = f"gripper.{key}"
        if key not in self.document.record["gripper"]:
            raise self.error(where, " is missing; the joints have one")
        entry = self.document.convert(model, ("gripper", key))
        if getattr(entry, closed) == getattr(entry, opened):
            both = f"closed and open are both {getattr(entry, closed):g}"
            raise self.error(where, f": {both}; they must differ, or it cannot move")
        return entry

    def check_channels(
        self, channels: Sequence[int], gripper: int | None, what: str, mirrors: Sequence[Mirror] = ()
    ) -> None:
        """Refuse two ``what`` on one channel."""
        places = [f"joints.{name}" for name, _ in self.joints[: len(channels)]]
        places += [f"joints.{self.joints[one.joint][0]}" for one in mirrors]
        everything = [*channels, *(one.channel for one in mirrors), *([] if gripper is None else [gripper])]
        for i, (channel, where) in enumerate(zip(everything, [*places, "gripper"], strict=False)):
            if channel in everything[:i]:
                raise self.error(where, f": two {what} are on the same channel: {everything}")

    def check_scale(self, per_deg: float, where: str) -> None:
        """Refuse a scale on which a whole turn is about a step of the board, or less."""
        if abs(per_deg) < FLATTEST_PER_DEG:
            what = f" is {per_deg:g}: the joint would not move; {FLATTEST_PER_DEG} or more"
            raise self.error(where, what)

    def error(self, where: str, what: str) -> ArmctlError:
        """The refusal of what stands at ``where``, e.g. ``joints.elbow.servo``; it names the line."""
        first, *rest = where.split(".")
        place: Place = (first, *rest)
        if first == "joints" and rest:
            place = (*(self._place(rest[0]) or (first,)), *rest[1:])
        return self.document.error(f"{where}{what}", place)

    @property
    def _gripper(self) -> Table:
        return board_tables(self.document.record.get("gripper"))

    def _place(self, joint: str) -> Place | None:
        """Of a joint's table; None: a side file need not name every joint."""
        entries = cast("Sequence[object]", self.document.record.get("joints", ()))
        for i, entry in enumerate(entries):
            if isinstance(entry, dict) and cast("Table", entry).get("name") == joint:
                return "joints", i
        return None

    def _at(self, place: Place) -> Table:
        return self.document.record["joints"][place[1]]


class NoOptions(Strict, frozen=True):
    """``[board]`` of a board without options."""


@dataclass(frozen=True)
class ServoEntries:
    """Entries of servos, or of any outputs that are proportional to the angle: output = zero + scale · angle.

    In a robot file: ``servo = { channel = 0, zero_us = 1500, us_per_deg = 10, pulse_us = [600, 2400] }`` in
    each joint, and ``servo = { channel = 5, closed_us = 1000, open_us = 2000 }`` in the gripper. A joint that
    two servos turn has the second one in its servo's table: ``also = [{ channel = 6, zero_us = 1500, … }]``.
    """

    unit: str = "µs"
    """of the outputs"""
    key: str = "us"
    """how the unit is written in the keys"""
    range_key: str = "pulse_us"
    """the key of the range of outputs that is safe"""
    lowest: float = 64.0
    """no output of this board may be below"""
    highest: float = 4080.0
    """… or above"""
    turn: float | None = None
    """as in ``OutputMap``"""

    def read(self, part: BoardPart) -> tuple[OutputMap | None, object]:
        """The map of the outputs; None where the file has none."""
        closed, opened = f"closed_{self.key}", f"open_{self.key}"
        joint, gripper = self.models
        errors, servos = Errors(), list[dict[str, Any]]()
        found: msgspec.Struct | None = None
        with errors:
            part.board(NoOptions)
        with errors:
            servos = [msgspec.to_builtins(one) for one in part.outputs("servo", joint)]
            for (name, limits), servo in zip(part.joints, servos, strict=bool(servos)):
                for one, where in _with_places(servo, f"joints.{name}.servo"):
                    with errors:
                        self._check_range(part, one, limits, where)
                    with errors:
                        part.check_scale(one[self._per_deg], f"{where}.{self._per_deg}")
        with errors:
            if servos or "servo" in board_tables(part.document.record.get("gripper")):
                found = part.gripper("servo", gripper, closed, opened)
        hand: dict[str, Any] = {} if found is None else msgspec.structs.asdict(found)
        channels, mirrors = tuple(servo["channel"] for servo in servos), self._mirrors(servos)
        with errors:
            part.check_channels(channels, hand.get("channel"), "servos", mirrors)
        errors.raise_all()
        if not servos:
            return None, None
        safe = [self._safe(servo) for servo in servos]
        outputs = OutputMap(
            unit=self.unit,
            channels=channels,
            zero=np.array([servo[self._zero] for servo in servos]),
            per_rad=np.array([servo[self._per_deg] for servo in servos]) * (180 / math.pi),
            low=np.array([low for low, _ in safe]),
            high=np.array([high for _, high in safe]),
            gripper_channel=hand.get("channel"),
            gripper_closed=hand.get(closed, 0.0),
            gripper_open=hand.get(opened, 0.0),
            lowest=self.lowest,
            highest=self.highest,
            turn=self.turn,
            key=self.key,
            range_key=self.range_key,
            mirrors=mirrors,
        )
        return outputs, None

    @property
    def _zero(self) -> str:
        return f"zero_{self.key}"

    @property
    def _per_deg(self) -> str:
        return f"{self.key}_per_deg"

    def _mirrors(self, servos: Sequence[dict[str, Any]]) -> tuple[Mirror, ...]:
        """The further servos of all joints."""
        return tuple(
            self._mirror(i, servo, other) for i, servo in enumerate(servos) for other in servo["also"]
        )

    def _mirror(self, joint: int, servo: dict[str, Any], other: dict[str, Any]) -> Mirror:
        ratio = other[self._per_deg] / servo[self._per_deg] if servo[self._per_deg] else 1.0  # refused then
        return Mirror(joint, other["channel"], other[self._zero] - ratio * servo[self._zero], ratio)

    def _safe(self, servo: dict[str, Any]) -> tuple[float, float]:
        """The outputs that are safe for a servo and, as it takes them along, for those beside it."""
        low, high = servo[self.range_key]
        for other in servo["also"]:
            mirror = self._mirror(0, servo, other)
            ends = sorted((end - mirror.zero) / mirror.ratio for end in other[self.range_key])
            low, high = max(low, ends[0]), min(high, ends[1])
        return low, high

    @cached_property
    def models(self) -> tuple[type[msgspec.Struct], type[msgspec.Struct]]:
        """Of a joint's table and of the gripper's."""
        return self._models((), ())

    def _models(
        self, of_joint: Sequence[tuple[str, Any, Any]], of_gripper: Sequence[tuple[str, Any, Any]]
    ) -> tuple[type[msgspec.Struct], type[msgspec.Struct]]:
        """The same, with further keys: name, type and default."""
        allowed = Annotated[float, Meta(ge=self.lowest, le=self.highest)]
        joint = {
            f"zero_{self.key}": float,
            f"{self.key}_per_deg": float,
            self.range_key: tuple[allowed, allowed],
        }
        gripper = {f"closed_{self.key}": allowed, f"open_{self.key}": allowed}

        def model(fields: dict[str, Any], *more: tuple[str, Any, Any]) -> type[msgspec.Struct]:
            every = [("channel", Channel), *fields.items(), *more]
            return msgspec.defstruct("ServoEntry", every, bases=(Strict,), frozen=True)

        several = tuple[model(joint, *of_joint), ...]
        return model(joint, *of_joint, ("also", several, ())), model(gripper, *of_gripper)

    def _check_range(
        self, part: BoardPart, servo: dict[str, Any], limits: tuple[float, float], where: str
    ) -> None:
        """Refuse limits [degrees] that the safe range of outputs does not hold."""
        zero, per_deg = servo[self._zero], servo[self._per_deg]
        least, most = sorted(zero + per_deg * angle for angle in limits)
        low, high = servo[self.range_key]
        if least < low - _ROUNDING or most > high + _ROUNDING:
            raise part.error(
                where,
                f": the limits {limits[0]}° … {limits[1]}° need pulses of {least:.1f} … {most:.1f} "
                f"{self.unit}, {self.range_key} allows {low} … {high} {self.unit}",
            )


def _with_places(servo: dict[str, Any], where: str) -> Iterator[tuple[dict[str, Any], str]]:
    """A servo and those beside it, with their places in the file."""
    yield servo, where
    for k, other in enumerate(servo["also"]):
        yield other, f"{where}.also[{k}]"


def read_outputs(
    document: Document,
    joints: Sequence[tuple[str, tuple[float, float]]],
    gripper: GripperEntry | None,
    signals: Signals,
) -> tuple[str, OutputMap | None, object]:
    """The kind of the board, the map of the joints in their order, and what else the board needs.

    An arm whose file gives no outputs has the default board, whichever it names.
    Refuses ``signals`` that the board has not, or that are in the way of a joint.
    """
    board = document.record.get("board", {})
    if not isinstance(board, dict):
        raise RefusedBeforeError
    kind = cast("dict[str, Any]", board).get("kind", None if board else DEFAULT_BOARD)
    if kind is None:
        raise document.error("board: the key 'kind' is missing", ("board",))
    found = find_entries(kind if isinstance(kind, str) else "")
    if isinstance(found, tuple):
        what = f"key board.kind: {must_be(found)}, not {kind!r}{did_you_mean(kind, found)}"
        raise document.error(what, ("board", "kind"))
    moved = gripper is not None and gripper.output is None
    outputs, settings = found.read(BoardPart(kind, document, joints, moved))
    _check_signals(document, kind, outputs, gripper, signals)
    if outputs is None:  # no board but a simulated one may drive the arm: the plain one
        return DEFAULT_BOARD, None, None
    return kind, outputs, settings


def _check_signals(
    document: Document, kind: str, outputs: OutputMap | None, gripper: GripperEntry | None, signals: Signals
) -> None:
    """Refuse inputs and outputs that clash with each other or with a joint, or that the board has not."""
    errors, names = Errors(), set[str]()
    taken = {} if outputs is None else {one: "a joint" for one in outputs.channels}
    for one in () if outputs is None else outputs.mirrors:
        taken[one.channel] = "a joint"
    if outputs is not None and outputs.gripper_channel is not None:
        taken[outputs.gripper_channel] = "the gripper"
    read, switched = find_signal_kinds(kind)
    tables = (("inputs", signals.inputs, read), ("outputs", signals.outputs, switched))
    for table, every, offered in tables:
        for i, one in enumerate(every):
            with errors:
                what = ""
                if outputs is None:
                    what = (
                        ": only an arm whose joints have outputs on a board can have it; give each joint one"
                    )
                elif not offered:
                    what = f": a board of the kind {kind} has no {table} beside those of the joints"
                elif one.kind not in offered:
                    what = f".kind: on a board of the kind {kind} it {must_be(offered)}, not {one.kind!r}"
                elif one.channel in taken:
                    what = (
                        f".channel = {one.channel}: {taken[one.channel]} has it already; choose another one"
                    )
                elif one.name in _MEASURED:
                    what = f": programs use the name {one.name} for something else; choose another one"
                elif one.name in names:
                    what = ": two inputs or outputs have this name; each needs its own"
                if what:
                    raise document.error(f"{table}.{one.name}{what}", (table, i))
            taken.setdefault(one.channel, f"{table}.{one.name}")
            names.add(one.name)
    for key, name, known in (
        ("output", None if gripper is None else gripper.output, signals.outputs),
        ("part_input", None if gripper is None else gripper.part_input, signals.inputs),
    ):
        with errors:
            if name is not None and name not in (every := [one.name for one in known]):
                what = f"gripper.{key}: {must_be(every) if every else 'the file has none'}, not {name!r}"
                raise document.error(what, ("gripper", key))
    with errors:
        own = board_tables(document.record.get("gripper"))
        if gripper is not None and gripper.output is not None and own:
            what = f"gripper: it has an output and a {next(iter(own))}; remove one of them"
            raise document.error(what, ("gripper", "output"))
    errors.raise_all()
