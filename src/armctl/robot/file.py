"""Robot files: TOML decoded strictly into frozen structs (an unknown key or a wrong type is refused)."""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import replace
from typing import Annotated, Literal, Protocol, TypeVar, cast

import msgspec
import numpy as np
from msgspec import Meta

from armctl.decoding import REFUSED, known
from armctl.documents import Document, DocumentKind
from armctl.errors import Errors, RobotFileError
from armctl.kinematics import Criterion
from armctl.robot.look.rows import SOLIDS, AnyRow, MakeName, Material
from armctl.robot.parts import MOST_JOINTS, Gripper, Hand, Look, Obstacle, spoken
from armctl.robot.parts import Color as Rgb
from armctl.robot.signals import MOST_SIGNALS, Input, InputKind, Output, OutputKind, Signals, Then
from armctl.robot.tool_entries import MOST_TOOLS, RobotToolEntry

T = TypeVar("T")

Table = dict[str, object]
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
ROBOT_FILES = DocumentKind(
    RobotFileError, most_bytes=256 * 1024, largest=LARGEST, entries={"look.solids": SOLIDS}
)


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of a robot file: an unknown key is refused."""


class DHRowEntry(Strict, frozen=True):
    """One DH row; without ``joint`` it is fixed at ``theta_deg``, with it ``theta_deg`` is the offset.

    Rods of a parallel linkage: a row that ``follows`` joints turns by its factor times the angle of each,
    besides its own joint. Without a joint of its own it needs a name, ``link``. The joint limits alone may
    let two links fold onto each other: ``between_deg`` limits the sum that the link turns by.
    """

    alpha_deg: float
    """turn about x"""
    a_mm: float
    """length along x"""
    d_mm: float
    """offset along z"""
    theta_deg: float = 0.0
    """turn about z; of a joint, at its zero"""
    joint: Name | None = None
    """the joint that turns this row"""
    follows: dict[Name, Annotated[float, Meta(ge=-10, le=10)]] = {}
    """joint and factor, for rods of a parallel linkage"""
    between_deg: tuple[Limit, Limit] | None = None
    """of a row that follows: limits of the angle between its link and the one ahead, 0 as the row has it"""
    link: Name | None = None
    """name of a row that follows joints and has none of its own"""

    @property
    def turning(self) -> Name | None:
        """What its link is called; None: the row is fixed."""
        return self.joint or self.link


class DHEntry(Strict, frozen=True):
    """The arm's geometry."""

    convention: Literal["standard", "modified"]
    """standard: z turns first; modified (Craig): x turns first"""
    rows: Annotated[tuple[DHRowEntry, ...], Meta(min_length=1, max_length=4 * MOST_JOINTS)]
    """from the base to the tool"""


class JointEntry(Strict, frozen=True):
    """One joint."""

    name: Name
    """as in the rows, and in columns of CSV files"""
    title: str
    """as it is shown"""
    limit_deg: tuple[Limit, Limit]
    """lowest and highest angle; the same twice holds the joint there"""
    speed_deg_s: Positive
    """largest speed"""
    acceleration_deg_s2: Positive
    """largest acceleration"""
    jerk_deg_s3: Positive | None = None
    """left out: the acceleration is reached in 50 ms"""
    stall_torque_nm: Positive | None = None
    """of the servo; for the criterion least-torque"""


class GripperEntry(Strict, frozen=True):
    """The gripper, as an opening of 0 to 100 %."""

    title: str
    """as it is shown"""
    speed_percent_s: Positive
    """largest speed; 100 opens it in a second"""
    stall_torque_nm: Positive | None = None
    output: Name | None = None
    """the output that closes it, of a vacuum or magnet gripper: on is closed; instead of a servo"""
    part_input: Name | None = None
    """the input that is on while it holds a part"""

    def gripper(self) -> Gripper:
        """What it says."""
        return Gripper(self.title, self.speed_percent_s / 100, self.output or "", self.part_input or "")


class InputEntry(Strict, frozen=True):
    """A pin of the board that is read: a button, a sensor."""

    name: Name
    """in programs and commands"""
    channel: Channel
    """the Maestro's channel, the Arduino's pin"""
    kind: InputKind = "digital"
    """pull-up: digital, and the board pulls it high; analog: a share of the board's supply"""
    title: str = ""
    """as it is shown; left out: its name"""
    active_low: bool = False
    """it is on where its pin is low, as a button to ground is"""
    debounce_ms: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """a change counts once it has lasted so long"""

    def input(self) -> Input:
        """What it says."""
        title, debounce_s = self.title or spoken(self.name), self.debounce_ms / 1000
        return Input(self.name, title, self.channel, self.kind, self.active_low, debounce_s)


class OutputEntry(Strict, frozen=True):
    """A pin of the board that is switched: a lamp, a valve, a pump."""

    name: Name
    """in programs and commands"""
    channel: Channel
    """the Maestro's channel, the Arduino's pin"""
    kind: OutputKind = "digital"
    title: str = ""
    """as it is shown; left out: its name"""
    active_low: bool = False
    """it is on where its pin is low"""
    at_stop: Then = "keep"
    """at STOP"""
    at_release: Then = "keep"
    """at Release"""
    at_fault: Then = "keep"
    """where a fault begins, if the board can still be reached"""
    at_end: Then = "keep"
    """where a program ends by itself, finished or not"""

    def output(self) -> Output:
        """What it says."""
        then = (self.at_stop, self.at_release, self.at_fault, self.at_end)
        title = self.title or spoken(self.name)
        return Output(self.name, title, self.channel, self.kind, self.active_low, *then)


class _WithSignals(Protocol):
    @property
    def inputs(self) -> tuple[InputEntry, ...]: ...
    @property
    def outputs(self) -> tuple[OutputEntry, ...]: ...


def signals_of(file: _WithSignals) -> Signals:
    """The inputs and outputs of a file; those that were refused are left out."""
    inputs = tuple(one.input() for one in known(file.inputs) if one is not REFUSED)
    return Signals(inputs, tuple(one.output() for one in known(file.outputs) if one is not REFUSED))


class BodyEntry(Strict, frozen=True):
    """A mass that moves with a joint (or a named link); ``com_mm`` in the frame of that DH row."""

    joint: Name
    """the joint (or named link) that moves it"""
    mass_kg: NotNegative
    com_mm: tuple[float, float, float]
    """centre of mass, in the frame of that DH row"""


class LookEntry(Strict, frozen=True):
    """How the arm is drawn, and what is kept apart: its ``solids``.

    Without these they are guessed from its lengths; what else is here says how wide and in which colours
    (``#rrggbb``, of which the nearest of the palette is taken).
    """

    solids: Annotated[tuple[AnyRow, ...], Meta(max_length=400)] = ()
    """boxes, tubes, bars, plates, brackets, rods and motors, from the base to the tool"""
    pose_deg: tuple[Limit, ...] = ()
    """how the arm stands where the solids describe it; left out: all joints at 0"""
    source: str = ""
    """where the sizes of the solids come from"""
    links: Annotated[tuple[Color, ...], Meta(min_length=1)] = tuple(
        f"#{r:02x}{g:02x}{b:02x}" for r, g, b in Look().links
    )
    """one colour a joint, used over and over where there are more joints"""
    joints: Color = "#3c3c41"
    shape: Literal["round", "square"] = "round"
    """cross-section of the links"""
    width_percent: Annotated[float, Meta(gt=0, le=20)] = 5.2
    """width of the links in percent of the arm's reach"""
    material: Material = "printed"
    """of solids that say none: what they weigh follows from it where the file gives no ``bodies``"""
    servo: MakeName | None = None
    """make of its servos: a guess draws them, and is as wide as they are"""
    hand: Hand | None = None
    """what a guess draws at the tool point; left out: jaws where there is a gripper, else a tip"""

    def look(self) -> Look:
        """What it says."""
        pose = tuple(map(math.radians, self.pose_deg))
        return Look(
            links=tuple(map(_rgb, self.links)),
            joints=_rgb(self.joints),
            shape=self.shape,
            width=self.width_percent / 100,
            rows=self.solids,
            pose=pose,
            source=self.source,
            material=self.material,
            servo=self.servo,
            hand=self.hand,
        )


def _rgb(text: str) -> Rgb:
    red, green, blue = bytes.fromhex(text.removeprefix("#"))
    return red, green, blue


class FloorEntry(Strict, frozen=True):
    """The plane that the arm must stay above."""

    z_mm: float = 0.0
    """height in the base frame"""


class CapsuleEntry(Strict, frozen=True):
    """A piece of the arm's body: all within a radius of a segment, in the frame of the joint's DH row."""

    from_mm: tuple[float, float, float]
    """one end of the segment"""
    to_mm: tuple[float, float, float]
    """the other end"""
    radius_mm: Positive
    joint: Name | None = None
    """the joint (or named link) that moves it; left out: it stands still with the base, in the base frame"""


class ObstacleEntry(Strict, frozen=True):
    """A box that the arm must stay out of, between two opposite corners in the base frame."""

    title: Annotated[str, Meta(min_length=1)]
    """as refusals name it"""
    from_mm: tuple[float, float, float]
    """one corner"""
    to_mm: tuple[float, float, float]
    """the opposite corner"""

    def obstacle(self) -> Obstacle:
        """What it says; refuses a box without a volume."""
        for axis, low, high in zip("xyz", self.from_mm, self.to_mm, strict=True):
            if low == high:
                raise RobotFileError(
                    f"obstacles: {self.title}: from_mm and to_mm have the same {axis}; "
                    "they must be opposite corners of a box"
                )
        corners = np.array([self.from_mm, self.to_mm]) / 1000
        return Obstacle(self.title, corners.min(axis=0), corners.max(axis=0))


class RobotFile(Strict, frozen=True):
    """One robot file, as written."""

    format: Literal[1]
    """of the file"""
    name: Name
    """what programs and commands call the arm"""
    title: str
    """as it is shown"""
    dh: DHEntry
    """the geometry"""
    joints: Annotated[tuple[JointEntry, ...], Meta(min_length=1, max_length=MOST_JOINTS)]
    """from the base to the tool"""
    poses: dict[Name, tuple[float, ...]]
    """joint angles [°]; home and rest are needed"""
    points: dict[PointName, tuple[float, float, float]] = {}
    """named tool points [mm]"""
    source: str = ""
    """where the dimensions come from"""
    assumed: tuple[str, ...] = ()
    """what the source does not give"""
    no_board: str = ""
    """of an arm without outputs: in few words, why no board drives it"""
    payload_kg: NotNegative = 0.0
    """mass at the tool, for torques"""
    criterion: Criterion = "least-travel"
    """by which the page chooses among solutions at first: that of the paper the arm is from"""
    gripper: GripperEntry | None = None
    inputs: Annotated[tuple[InputEntry, ...], Meta(max_length=MOST_SIGNALS)] = ()
    """pins of the board that are read"""
    outputs: Annotated[tuple[OutputEntry, ...], Meta(max_length=MOST_SIGNALS)] = ()
    """pins of the board that are switched, beside the joints"""
    tools: Annotated[tuple[RobotToolEntry, ...], Meta(max_length=MOST_TOOLS)] = ()
    """what can be put on at the flange; the first one is on where nobody says another"""
    bodies: tuple[BodyEntry, ...] = ()
    """masses, for torques"""
    floor: FloorEntry = FloorEntry()
    capsules: Annotated[tuple[CapsuleEntry, ...], Meta(max_length=4 * MOST_JOINTS)] = ()
    """the arm's body; left out: as it is drawn"""
    obstacles: Annotated[tuple[ObstacleEntry, ...], Meta(max_length=4 * MOST_JOINTS)] = ()
    """a table, a wall, a conveyor"""
    look: LookEntry | None = None


def read_robot_file(content: bytes) -> tuple[RobotFile, Document]:
    """Decode a file without judging what it says; the board's part stays in the document."""
    document, errors = ROBOT_FILES.parse(content), Errors()
    file = without_board(document, RobotFile, errors)
    errors.raise_all()
    return file, document


def without_board(document: Document, model: type[T], errors: Errors) -> T:
    """The document as a struct, without the tables that only the board reads; as ``Document.decoded``."""
    record: Table = dict(document.record)
    board, joints = record.pop("board", {}), record.get("joints")
    if not isinstance(board, dict):
        errors.found.append(document.refusal(f"must be a table, not {board!r}", ("board",)))
    entries = cast("list[object]", joints) if isinstance(joints, list) else []
    # what is a table in one joint belongs to the board in all of them, also where it is mistyped
    keys = {key for entry in (*entries, record.get("gripper")) for key in board_tables(entry)}
    if entries:
        record["joints"] = [_without(keys, entry) for entry in entries]
    if "gripper" in record:
        record["gripper"] = _without(keys, record["gripper"])
    return replace(document, record=record).decoded(model, errors)


_OWN_KEYS = frozenset(JointEntry.__struct_fields__) | frozenset(GripperEntry.__struct_fields__)


def board_tables(entry: object) -> Table:
    """The board's tables in a joint or in the gripper: no other key there has a table as its value."""
    table = cast("Table", entry) if isinstance(entry, dict) else {}
    return {key: value for key, value in table.items() if isinstance(value, dict) and key not in _OWN_KEYS}


def _without(keys: Container[str], entry: object) -> object:
    if not isinstance(entry, dict):
        return entry
    return {key: value for key, value in cast("Table", entry).items() if key not in keys}
