"""The rows of a look, as a robot file writes them.

Each is one solid, in mm and degrees, placed from the point of its joint along the axes of the base frame, as
the arm stands in the look's ``pose_deg``: what one reads off a side view.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Annotated, Literal, cast, get_args

import msgspec
from msgspec import Meta

from armctl.lazy_dataclass import dataclass

# What rows of a look name: colours, and motors that one can buy.

Theme = Literal["light", "dark"]
Paint = Literal[
    "black",
    "graphite",
    "grey",
    "silver",
    "white",
    "cream",
    "yellow",
    "orange",
    "red",
    "green",
    "blue",
    "sky",
    "brass",
    "wood",
]
PAINTS: tuple[Paint, ...] = get_args(Paint)

_ON_LIGHT_AND_DARK: dict[Paint, tuple[str, str]] = {
    "black": ("33383e", "4d545c"),
    "graphite": ("4f565e", "6f7780"),
    "grey": ("868e96", "98a1aa"),
    "silver": ("b9c0c7", "c6ccd2"),
    "white": ("e6e9ec", "e6e9ec"),
    "cream": ("e9dcc3", "dccfb4"),
    "yellow": ("f5c518", "f0c020"),
    "orange": ("e8641b", "ea6f2a"),
    "red": ("d02f2f", "d94545"),
    "green": ("2f9e44", "3fae55"),
    "blue": ("1c7ed6", "3a8fe0"),
    "sky": ("8fc1ea", "8ab8de"),
    "brass": ("b8902f", "c29a3a"),
    "wood": ("c79a63", "bd915c"),
}


def paint(name: Paint, theme: Theme = "light") -> tuple[int, int, int]:
    """Red, green and blue (0..255): black is lifted on a dark ground, white lowered on a light one."""
    red, green, blue = bytes.fromhex(_ON_LIGHT_AND_DARK[name][theme == "dark"])
    return red, green, blue


@dataclass(frozen=True, slots=True)
class Make:
    """A servo or stepper motor, in the frame of its shaft [mm].

    Its case lies below the horn, along ``case`` from the shaft.
    """

    title: str
    """what a user calls it"""
    case: tuple[float, float, float]
    """along, across, and up to where the shaft leaves it"""
    shaft: float
    """from the near end of the case"""
    horn: tuple[float, float]
    """width and height"""
    color: Paint
    horn_color: Paint
    mass_kg: float
    """with its horn"""
    ears: tuple[float, float, float] | None = None
    """over all, thickness, height above the bottom of the case"""
    idler: bool = False
    """a second horn at the other side"""


# Masses: data sheets of MG90S, MG996R, HS-805BB, STS3215, XL430-W250, AX-12A, 17HS4401 and 23HS22.
MakeName = Literal["micro", "standard", "giant", "sts3215", "dynamixel", "ax12", "nema17", "nema23"]
MAKES: dict[MakeName, Make] = {
    "micro": Make("9 g servo", (22.8, 12.2, 22.5), 6, (11.5, 6), "blue", "white", 0.0134, (32.3, 2.5, 17)),
    "standard": Make("standard servo", (40.5, 20, 38), 10, (21, 5), "black", "white", 0.055, (54.5, 2.6, 28)),
    "giant": Make("giant servo", (66, 30, 58), 17.5, (30, 7), "black", "white", 0.152, (83, 4, 42)),
    "sts3215": Make("STS3215", (45.2, 24.7, 33.4), 10.2, (20, 3.1), "black", "silver", 0.055, idler=True),
    "dynamixel": Make(
        "Dynamixel X", (46.5, 28.5, 34), 11.25, (19, 3), "graphite", "black", 0.057, idler=True
    ),
    "ax12": Make("AX-12", (50, 32, 38), 11.5, (22, 3), "black", "white", 0.0546, idler=True),
    "nema17": Make("NEMA 17", (42.3, 42.3, 40), 21.15, (22, 2), "black", "silver", 0.28),
    "nema23": Make("NEMA 23", (56.4, 56.4, 56), 28.2, (38, 2), "black", "silver", 0.7),
}

Material = Literal["printed", "acrylic", "wood", "aluminium", "casting"]
DENSITIES: dict[Material, float] = {
    "printed": 0.38,
    "acrylic": 1.19,
    "wood": 0.6,
    "aluminium": 2.7,
    "casting": 1.3,
}
"""[kg/dm³] of what a solid looks like from outside: printed parts are walls round a few struts, castings of
industrial arms hold their motors and gears. Both were found from published masses of seven arms."""


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
    tools: tuple[LinkName, ...] | None = None
    """names of the tools with which it is there, as jaws that are taken off; left out: with every one"""


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
