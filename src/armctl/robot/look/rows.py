"""The rows of a look, as a robot file writes them.

Each is one solid, in mm and degrees, placed from the point of its joint along the axes of the base frame, as
the arm stands in the look's ``pose_deg``: what one reads off a side view.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Annotated, Literal, cast

import msgspec
from msgspec import Meta

from armctl.robot.look.stock import MakeName, Material, Paint

SOLIDS = "look.solids, row"
"""how messages call one of them; its number from 1 follows"""
Length = Annotated[float, Meta(gt=0, le=10_000)]
"""[mm]"""
Offset = Annotated[float, Meta(ge=-10_000, le=10_000)]
"""[mm]"""
Angle = Annotated[float, Meta(ge=-720, le=720)]
"""[°]"""
Point = tuple[Offset, Offset, Offset]
Axis = Literal["x", "y", "z"]
Direction = Literal["x", "y", "z", "+x", "+y", "+z", "-x", "-y", "-z"] | Point
Widths = float | tuple[float, float]
"""the same at both ends, or at the one and the other; ``Drawing.wrong`` looks whether they are positive, as
msgspec (0.22) does not hold a bound of a number that may be a tuple, too"""
LinkName = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
PartName = Annotated[str, Meta(min_length=1, max_length=60)]


class Row(
    msgspec.Struct,
    frozen=True,
    forbid_unknown_fields=True,
    kw_only=True,
    tag_field="solid",
):
    """What all solids have in common."""

    joint: LinkName | None = None
    """the joint (or named link) that moves it; left out: it stands still with the base"""
    turns_with: LinkName | None = None
    """a crank: it hangs on the point of ``joint``, but turns with this link"""
    name: PartName | None = None
    """what a user calls it ("the left jaw"); left out: named by its joint and kind"""
    mirror: Axis | None = None
    """a second one on the other side of the joint's point, across this axis; its jaw moves the other way"""
    open_mm: Point | None = None
    """a jaw: so far it slides while the gripper opens. It is drawn closed"""
    open_deg: Angle = 0.0
    """a jaw: so far it turns about ``axis`` through ``hinge_mm`` while the gripper opens"""
    axis: Direction = "z"
    hinge_mm: Point = (0.0, 0.0, 0.0)
    material: Material | None = None
    """what it is made of, for its mass; left out: as the look says"""
    body: bool = True
    """false: it is drawn, but not kept apart from anything"""


class Painted(Row, frozen=True, kw_only=True):
    """A row that says its colour."""

    color: Paint


class Box(Painted, frozen=True, kw_only=True, tag="box"):
    """A block with bevelled edges."""

    size_mm: tuple[Length, Length, Length]
    at_mm: Point = (0.0, 0.0, 0.0)
    """its middle"""
    turn_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """about x, then y, then z of the base"""
    edge_mm: Annotated[float, Meta(ge=0, le=10_000)] | None = None
    """of the bevel; left out: a fifth of its half thickness, at most 1.5"""


class Spanned(Painted, frozen=True, kw_only=True):
    """A solid from one point to another."""

    from_mm: Point | None = None
    """left out, without ``from``: the joint's point"""
    to_mm: Point | None = None
    from_: LinkName | None = msgspec.field(default=None, name="from")
    """a joint's point, or ``tool``, instead of mm"""
    to: LinkName | None = None
    width_mm: Widths


class Tube(Spanned, frozen=True, kw_only=True, tag="tube"):
    """A rod, a cone or a drum."""

    ends: Literal["flat", "round"] = "flat"
    """round: it is longer by half its width at each end"""


class Bar(Spanned, frozen=True, kw_only=True, tag="bar"):
    """A flat bar with round ends about both points: a link, a lever, a finger."""

    thick_mm: Length
    face: Direction = "y"
    """across its flat side"""


class Plate(Painted, frozen=True, kw_only=True, tag="plate"):
    """An outline cut from a plate."""

    outline_mm: Annotated[tuple[tuple[Offset, Offset], ...], Meta(min_length=3, max_length=200)]
    """face x: y and z of its corners; face y (a side view): x and z; face z: x and y"""
    thick_mm: Length
    at_mm: Point = (0.0, 0.0, 0.0)
    """the origin of the outline, in the middle of the plate"""
    face: Axis = "y"


class Bracket(Spanned, frozen=True, kw_only=True, tag="bracket"):
    """A bent U: two cheeks from an axis, and a back across their ends."""

    # width_mm: over both cheeks
    deep_mm: Length
    """of the cheeks, across"""
    thick_mm: Length
    face: Direction = "y"
    """along the axis"""


class Rod(Spanned, frozen=True, kw_only=True, tag="rod"):
    """A rod between pins of two links, round or (with ``thick_mm``) flat."""

    to_joint: LinkName
    """the link of its other pin: ``to_mm`` is from the point of that joint"""
    to_mm: Point = (0.0, 0.0, 0.0)
    thick_mm: Length | None = None


class Motor(Row, frozen=True, kw_only=True, tag="motor"):
    """A servo or a stepper."""

    make: MakeName
    shaft: Direction
    """the way the shaft points"""
    case: Direction
    """from the shaft along the case"""
    at_mm: Point = (0.0, 0.0, 0.0)
    """on the shaft, where the horn ends"""
    color: Paint | None = None
    """of the case, instead of its usual one"""


AnyRow = Box | Tube | Bar | Plate | Bracket | Rod | Motor


def written(rows: Iterable[AnyRow]) -> str:
    """Rows as a robot file has them, one a line."""
    return "solids = [\n" + "".join(f"    {{ {', '.join(_entries(row))} }},\n" for row in rows) + "]\n"


def _entries(row: AnyRow) -> Iterator[str]:
    """The joint, the kind of solid, and what else is not as it is when it is left out."""
    if row.joint is not None:
        yield f"joint = {_value(row.joint)}"
    yield f"solid = {_value(row.__struct_config__.tag)}"
    for field in msgspec.structs.fields(row):
        value = getattr(row, field.name)
        if field.name != "joint" and value != field.default:
            yield f"{field.encode_name} = {_value(value)}"


def _value(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case float() | int():
            return f"{value:.9g}"
        case tuple():
            return f"[{', '.join(map(_value, cast('tuple[object, ...]', value)))}]"
        case _:
            return json.dumps(value, ensure_ascii=False)


def called(index: int, row: AnyRow) -> str:
    """How messages name a row of a robot file."""
    return f"{SOLIDS} {index + 1} ({row.__struct_config__.tag})"
