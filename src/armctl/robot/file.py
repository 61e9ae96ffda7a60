"""Robot files: TOML decoded strictly into frozen structs (an unknown key or a wrong type is refused)."""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal, cast

import msgspec
from msgspec import Meta, inspect

from armctl.errors import RobotFileError

# What is wrong with a file that was decoded strictly: which key, its value and what is allowed.

_NO_CHOICE = re.compile(r"Invalid enum value (?P<value>.*) - at `\$\.(?P<key>.*)`", re.DOTALL)
_INDEX = re.compile(r"\[[^]]*\]")


def decoding_words(error: msgspec.DecodeError, model: type) -> str:
    """The words of ``error``, in which a value that is no choice of its key is answered with the choices.

    Args:
        error: of decoding into ``model``.
        model: the struct of the whole file.
    """
    found = _NO_CHOICE.fullmatch(str(error))
    choices = None if found is None else _choices(inspect.type_info(model), found["key"])
    if found is None or choices is None:
        return str(error)
    return f"{found['key']} = {found['value']}: {must_be(choices)}"


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
SHORTEST_PULSE_US, LONGEST_PULSE_US = 64, 4080
Pulse = Annotated[float, Meta(ge=SHORTEST_PULSE_US, le=LONGEST_PULSE_US)]
Limit = Annotated[float, Meta(ge=-720, le=720)]
Color = Annotated[str, Meta(pattern=r"^#[0-9a-fA-F]{6}$")]
LARGEST = 1e6
"""no number of a robot file, in mm, degrees or µs, is larger than this"""


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What all parts of a robot file share."""


class DHRowEntry(_Strict, frozen=True):
    """One DH row; without ``joint`` it is fixed at ``theta_deg``, with it ``theta_deg`` is the offset."""

    alpha_deg: float
    a_mm: float
    d_mm: float
    theta_deg: float = 0.0
    joint: Name | None = None


class DHEntry(_Strict, frozen=True):
    """The arm's geometry."""

    convention: Literal["standard", "modified"]
    rows: Annotated[tuple[DHRowEntry, ...], Meta(min_length=1)]


class ServoEntry(_Strict, frozen=True):
    """The servo of a joint: pulse = zero_us + us_per_deg · angle; negative ``us_per_deg`` turns it round."""

    channel: Channel
    zero_us: float
    us_per_deg: float
    pulse_us: tuple[Pulse, Pulse]


class AxisEntry(_Strict, frozen=True):
    """A motor with an encoder on an encoder board; the defaults suit the gear motors of a small arm."""

    axis: Annotated[int, Meta(ge=0, le=5)]
    home_order: Annotated[int, Meta(ge=1, le=15)]
    """place in the homing order"""
    home_toward: Literal["+", "-"] = "-"
    """which way the switch is looked for first"""
    home_by: Literal["switch", "stall"] = "switch"
    p_percent: NotNegative = 1.8
    """drive for a position error of one count [% of full drive]"""
    i_percent_s: NotNegative = 3.0
    """[% of full drive for a count and a second]"""
    d_percent: NotNegative = 0.025
    """[% of full drive for a count a second]"""
    breakaway_percent: Annotated[float, Meta(ge=0, le=100)] = 35.0
    """drive below which a motor that stands does not move"""
    max_drive_percent: Annotated[float, Meta(gt=0, le=100)] = 100.0
    """the largest drive that the motor is given; what it can push with"""
    stall_s: Annotated[float, Meta(gt=0, le=5)] = 0.5
    encoder_inverted: bool = False
    motor_inverted: bool = False
    switch_inverted: bool = False
    """the home switch is closed all the time and opens when it is pressed"""


class EncoderEntry(AxisEntry, frozen=True, kw_only=True):
    """The encoder of a joint: counts = counts_per_deg · (angle - home_deg)."""

    counts_per_deg: float
    home_deg: float = 0.0
    """the angle where homing ends: at the edge of the switch"""
    home_speed_deg_s: Positive = 10.0
    following_error_deg: Positive = 5.0
    """this far from its setpoint the motors are switched off"""


class GripperEncoderEntry(AxisEntry, frozen=True, kw_only=True):
    """The gripper's encoder: its position closed and open, counted from where homing ends."""

    closed_counts: float
    open_counts: float
    home_speed_counts_s: Positive = 500.0
    following_error_counts: Positive = 2000.0


class BoardEntry(_Strict, frozen=True):
    """The board that drives the arm."""

    kind: Literal["maestro", "firmata", "encoder"]
    differential: tuple[Name, Name] | None = None
    """two joints that two motors drive together (encoder board): the sum, and the difference"""


class JointEntry(_Strict, frozen=True):
    """One joint."""

    name: Name
    title: str
    limit_deg: tuple[Limit, Limit]
    speed_deg_s: Positive
    acceleration_deg_s2: Positive
    jerk_deg_s3: Positive | None = None
    """None: the acceleration is reached in 50 ms"""
    stall_torque_nm: Positive | None = None
    servo: ServoEntry | None = None
    """on a Maestro or a Firmata board"""
    encoder: EncoderEntry | None = None
    """on an encoder board"""


class GripperServoEntry(_Strict, frozen=True):
    """The gripper's servo: closed and open pulse."""

    channel: Channel
    closed_us: Pulse
    open_us: Pulse


class GripperEntry(_Strict, frozen=True):
    """The gripper, as an opening of 0 to 100 %."""

    title: str
    speed_percent_s: Positive
    servo: GripperServoEntry | None = None
    encoder: GripperEncoderEntry | None = None
    stall_torque_nm: Positive | None = None


class BodyEntry(_Strict, frozen=True):
    """A mass that moves with a joint; ``com_mm`` in the frame of that joint's DH row."""

    joint: Name
    mass_kg: NotNegative
    com_mm: tuple[float, float, float]


class LookEntry(_Strict, frozen=True):
    """How the arm is drawn; colours as ``#rrggbb``."""

    links: Annotated[tuple[Color, ...], Meta(min_length=1)]
    """one colour a joint, used over and over where there are more joints"""
    joints: Color = "#3c3c41"
    shape: Literal["round", "square"] = "round"
    """cross-section of the links"""
    width_percent: Annotated[float, Meta(gt=0, le=20)] = 5.2
    """width of the links in percent of the arm's reach"""


class FloorEntry(_Strict, frozen=True):
    """The plane that the arm must stay above."""

    z_mm: float = 0.0


class CapsuleEntry(_Strict, frozen=True):
    """A piece of the arm's body: all within a radius of a segment, in the frame of the joint's DH row."""

    from_mm: tuple[float, float, float]
    to_mm: tuple[float, float, float]
    radius_mm: Positive
    joint: Name | None = None
    """the joint that moves it; None: it stands still with the base, in the base frame"""


class ObstacleEntry(_Strict, frozen=True):
    """A box that the arm must stay out of, between two opposite corners in the base frame."""

    title: Annotated[str, Meta(min_length=1)]
    from_mm: tuple[float, float, float]
    to_mm: tuple[float, float, float]


class RobotFile(_Strict, frozen=True):
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
    board: BoardEntry = BoardEntry("maestro")
    gripper: GripperEntry | None = None
    bodies: tuple[BodyEntry, ...] = ()
    floor: FloorEntry = FloorEntry()
    capsules: tuple[CapsuleEntry, ...] = ()
    """the arm's body; none: as it is drawn"""
    obstacles: tuple[ObstacleEntry, ...] = ()
    """a table, a wall, a conveyor"""
    look: LookEntry | None = None


def read_robot_file(path: Path) -> RobotFile:
    """Decode ``path`` without judging what it says.

    Raises:
        RobotFileError: unreadable, not TOML, an unknown key, a wrong type or an impossible value;
            the message names the file and the key.
    """
    try:
        text = path.read_bytes()
    except OSError as cause:
        raise RobotFileError(f"{path}: cannot be read: {cause.strerror}") from cause
    try:
        file = msgspec.toml.decode(text.removeprefix(BOM_UTF8), type=RobotFile)  # some editors begin with it
    except msgspec.DecodeError as cause:
        raise RobotFileError(f"{path}: {decoding_words(cause, RobotFile)}") from cause
    except ValueError as cause:  # not UTF-8
        raise RobotFileError(f"{path}: is not a text file: {cause}") from cause
    except RecursionError as cause:
        raise RobotFileError(f"{path}: arrays or tables are nested too deep") from cause
    except OverflowError as cause:  # a whole number with hundreds of digits
        raise RobotFileError(f"{path}: holds a number that is too large: {cause}") from cause
    for key, value in _numbers(msgspec.to_builtins(file), ""):
        if not abs(value) <= LARGEST:  # TOML has nan and inf, and every comparison with nan is false
            raise RobotFileError(f"{path}: {key} = {value}: must be a finite number within ±{LARGEST:.0e}")
    return file


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
