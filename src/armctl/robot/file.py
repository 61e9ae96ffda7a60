"""Robot files: TOML decoded strictly into frozen structs (an unknown key or a wrong type is refused)."""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, cast

import msgspec
from msgspec import Meta, inspect

from armctl.errors import RobotFileError

Table = dict[str, object]

# What is wrong with a file that was decoded strictly: which key, its value and what is allowed.

_NO_CHOICE = re.compile(r"Invalid enum value (?P<value>.*) - at `\$\.(?P<key>.*)`", re.DOTALL)
_INDEX = re.compile(r"\[[^]]*\]")


def decoding_words(error: msgspec.DecodeError, model: type, table: str = "") -> str:
    """The words of ``error``, in which a value that is no choice of its key is answered with the choices.

    Args:
        error: of decoding into ``model``.
        model: the struct of the whole file, or of one table of it.
        table: where that table stands in the file, such as ``joints[0].servo``.
    """
    words = str(error)
    found = _NO_CHOICE.fullmatch(words)
    choices = None if found is None else _choices(inspect.type_info(model), found["key"])
    if found is not None and choices is not None:
        key = f"{table}.{found['key']}" if table else found["key"]
        return f"{key} = {found['value']}: {must_be(choices)}"
    if not table:
        return words
    return words.replace("`$", f"`$.{table}") if "`$" in words else f"{words} - at `$.{table}`"


def must_be(choices: Sequence[object]) -> str:
    """What may stand where only some values may: "must be one of 'a', 'b'"."""
    allowed = ", ".join(repr(choice) for choice in choices)
    return f"must be {'one of ' if len(choices) > 1 else ''}{allowed}"


def _choices(node: inspect.Type, key: str) -> tuple[object, ...] | None:
    """The literals that may stand under ``key`` below ``node``; None where there is more than literals."""
    for name in _INDEX.sub(".[]", key).split("."):
        node = _without_none(node)
        if name == "[]":
            match node:
                case inspect.VarTupleType() | inspect.ListType():
                    node = node.item_type
                case inspect.DictType():
                    node = node.value_type
                case _:
                    return None
        elif isinstance(node, inspect.StructType):
            node = next(field.type for field in node.fields if field.encode_name == name)
        else:
            return None
    node = _without_none(node)
    return tuple(node.values) if isinstance(node, inspect.LiteralType) else None


def _without_none(node: inspect.Type) -> inspect.Type:
    if not isinstance(node, inspect.UnionType):
        return node
    others = [one for one in node.types if not isinstance(one, inspect.NoneType)]
    return others[0] if len(others) == 1 else node


_SMALLEST = 1e-6
"""what must be positive is no smaller than this"""
Positive = Annotated[float, Meta(ge=_SMALLEST)]
NotNegative = Annotated[float, Meta(ge=0)]
Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
PointName = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
Channel = Annotated[int, Meta(ge=0, le=63)]
Limit = Annotated[float, Meta(ge=-720, le=720)]
Color = Annotated[str, Meta(pattern=r"^#[0-9a-fA-F]{6}$")]
LARGEST = 1e6
"""no number of a robot file, in mm, degrees or µs, is larger than this"""


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of a robot file: an unknown key is refused."""


class DHRowEntry(Strict, frozen=True):
    """One DH row; without ``joint`` it is fixed at ``theta_deg``, with it ``theta_deg`` is the offset."""

    alpha_deg: float
    a_mm: float
    d_mm: float
    theta_deg: float = 0.0
    joint: Name | None = None


class DHEntry(Strict, frozen=True):
    """The arm's geometry."""

    convention: Literal["standard", "modified"]
    rows: Annotated[tuple[DHRowEntry, ...], Meta(min_length=1)]


class JointEntry(Strict, frozen=True):
    """One joint."""

    name: Name
    title: str
    limit_deg: tuple[Limit, Limit]
    speed_deg_s: Positive
    acceleration_deg_s2: Positive
    jerk_deg_s3: Positive | None = None
    """None: the acceleration is reached in 50 ms"""
    stall_torque_nm: Positive | None = None


class GripperEntry(Strict, frozen=True):
    """The gripper, as an opening of 0 to 100 %."""

    title: str
    speed_percent_s: Positive
    stall_torque_nm: Positive | None = None


class BodyEntry(Strict, frozen=True):
    """A mass that moves with a joint; ``com_mm`` in the frame of that joint's DH row."""

    joint: Name
    mass_kg: NotNegative
    com_mm: tuple[float, float, float]


class LookEntry(Strict, frozen=True):
    """How the arm is drawn; colours as ``#rrggbb``."""

    links: Annotated[tuple[Color, ...], Meta(min_length=1)]
    """one colour a joint, used over and over where there are more joints"""
    joints: Color = "#3c3c41"
    shape: Literal["round", "square"] = "round"
    """cross-section of the links"""
    width_percent: Annotated[float, Meta(gt=0, le=20)] = 5.2
    """width of the links in percent of the arm's reach"""


class FloorEntry(Strict, frozen=True):
    """The plane that the arm must stay above."""

    z_mm: float = 0.0


class CapsuleEntry(Strict, frozen=True):
    """A piece of the arm's body: all within a radius of a segment, in the frame of the joint's DH row."""

    from_mm: tuple[float, float, float]
    to_mm: tuple[float, float, float]
    radius_mm: Positive
    joint: Name | None = None
    """the joint that moves it; None: it stands still with the base, in the base frame"""


class ObstacleEntry(Strict, frozen=True):
    """A box that the arm must stay out of, between two opposite corners in the base frame."""

    title: Annotated[str, Meta(min_length=1)]
    from_mm: tuple[float, float, float]
    to_mm: tuple[float, float, float]


class RobotFile(Strict, frozen=True):
    """One robot file, as written."""

    format: Literal[1]
    name: Name
    title: str
    dh: DHEntry
    joints: Annotated[tuple[JointEntry, ...], Meta(min_length=1)]
    poses: dict[Name, tuple[float, ...]]
    points: dict[PointName, tuple[float, float, float]] = {}
    """named tool points [mm]"""
    source: str = ""
    assumed: tuple[str, ...] = ()
    payload_kg: NotNegative = 0.0
    gripper: GripperEntry | None = None
    bodies: tuple[BodyEntry, ...] = ()
    floor: FloorEntry = FloorEntry()
    capsules: tuple[CapsuleEntry, ...] = ()
    """the arm's body; none: as it is drawn"""
    obstacles: tuple[ObstacleEntry, ...] = ()
    """a table, a wall, a conveyor"""
    look: LookEntry | None = None


@dataclass(frozen=True, slots=True)
class BoardTables:
    """The board's part of a robot file, undecoded: only the board knows its own tables."""

    board: Mapping[str, object]
    """the table ``[board]``"""
    joints: Mapping[str, Mapping[str, object]]
    """by joint, the tables in it: ``servo``, ``encoder``, or what the board calls its own"""
    gripper: Mapping[str, object]
    """the tables in ``[gripper]``"""
    order: tuple[str, ...]
    """names of the joints, as they follow each other in the file"""


def read_robot_file(path: Path) -> tuple[RobotFile, BoardTables]:
    """Decode ``path`` without judging what it says; the board's part is left as it is.

    Raises:
        RobotFileError: unreadable, not TOML, an unknown key, a wrong type or an impossible value;
            the message names the file and the key.
    """
    try:
        text = path.read_bytes()
    except OSError as cause:
        raise RobotFileError(f"{path}: cannot be read: {cause.strerror}") from cause
    try:
        data = msgspec.toml.decode(text.removeprefix(BOM_UTF8))  # some editors begin with it
        board, outputs, gripper = _take_board(data)
        file = msgspec.convert(data, RobotFile)
    except msgspec.DecodeError as cause:
        raise RobotFileError(f"{path}: {decoding_words(cause, RobotFile)}") from cause
    except ValueError as cause:  # not UTF-8
        raise RobotFileError(f"{path}: is not a text file: {cause}") from cause
    except RecursionError as cause:
        raise RobotFileError(f"{path}: arrays or tables are nested too deep") from cause
    except OverflowError as cause:  # a whole number with hundreds of digits
        raise RobotFileError(f"{path}: holds a number that is too large: {cause}") from cause
    order = tuple(joint.name for joint in file.joints)
    tables = BoardTables(board, dict(zip(order, outputs, strict=True)), gripper, order)
    check_numbers(file, "", path)
    return file, tables


def check_numbers(part: msgspec.Struct, table: str, path: Path) -> None:
    """Refuse a number in ``part``, which stands in ``table`` of the file, that nothing in an arm can have.

    Raises:
        RobotFileError: not finite, or beyond ``LARGEST``.
    """
    for key, value in _numbers(msgspec.to_builtins(part), table):
        if not abs(value) <= LARGEST:  # TOML has nan and inf, and every comparison with nan is false
            raise RobotFileError(f"{path}: {key} = {value}: must be a finite number within ±{LARGEST:.0e}")


def _take_board(data: dict[str, object]) -> tuple[Table, list[Table], Table]:
    """Take out of ``data`` what only the board can decode: ``[board]``, and tables in joints and gripper."""
    joints, gripper = data.get("joints"), data.get("gripper")
    entries = cast("list[object]", joints) if isinstance(joints, list) else []
    inside = [_take_tables(entry) for entry in entries]
    board = data.pop("board", {})
    if not isinstance(board, dict):
        raise msgspec.ValidationError(f"Expected `object`, got `{type(board).__name__}` - at `$.board`")
    return cast("Table", board), inside, _take_tables(gripper)


def _take_tables(entry: object) -> Table:
    """No key of a joint or of the gripper but those of the board has a table as its value."""
    if not isinstance(entry, dict):
        return {}
    table = cast("Table", entry)
    return {key: table.pop(key) for key, value in [*table.items()] if isinstance(value, dict)}


def _numbers(node: object, key: str) -> Iterator[tuple[str, float]]:
    """Every number under a node of the decoded file, with the key that leads there."""
    if isinstance(node, dict):
        for name, value in cast("dict[str, object]", node).items():
            yield from _numbers(value, f"{key}.{name}" if key else name)
    elif isinstance(node, list | tuple):
        for i, value in enumerate(cast("list[object]", node)):
            yield from _numbers(value, f"{key}[{i}]")
    elif isinstance(node, float):
        yield key, node
