"""URDF files: the XML read strictly into a tree of links and joints. What armctl has no use for is skipped.

Exporters write a quarter turn as 1.5708 and a zero as -9.4e-08. Read to the letter, axes that are parallel in
the machine are not in the file, and no closed form fits the arm. So rounded right angles are taken as exact,
and each joint tells how far that is from what is written. Refusals do not name the file; ``load_urdf`` does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np

from armctl.arrays import FloatArray
from armctl.documents import DocumentKind
from armctl.errors import RobotFileError
from armctl.kinematics import rotation_from_rpy
from armctl.kinematics.chain import frame_along

T = TypeVar("T")
URDF_FILES = DocumentKind(RobotFileError, most_bytes=4 * 1024 * 1024)
_PART_BYTES = 64 * 1024
"""handed to the XML parser at once, which lets no other thread run meanwhile"""
KINDS = ("revolute", "continuous", "fixed", "prismatic", "planar", "floating")
LARGEST = 1e6
"""no number of a URDF file, in metres, radians, kg or N·m, is larger than this"""
WIDEST = 4 * math.pi
"""no limit of a joint is farther from zero [rad]"""
_QUARTER = math.pi / 2
_NOISE = 1e-6
"""angles [rad] and components of unit vectors below this are a rounded zero"""
_FEWEST_DECIMALS = 4
"""that a rounded quarter turn has: 1.57 may be meant"""
_MOST_QUARTERS = 4


@dataclass(frozen=True, slots=True)
class Rounding:
    """What was taken as exact, and how far that is from what is written."""

    quarters: tuple[str, ...] = ()
    """rounded quarter turns as written, signs left out"""
    zeros: int = 0
    """numbers that are a rounded zero"""
    shift: float = 0.0
    """how far a point one metre off is moved by it, at most [m]"""

    def __add__(self, other: Rounding) -> Rounding:
        return Rounding(self.quarters + other.quarters, self.zeros + other.zeros, self.shift + other.shift)


@dataclass(frozen=True)
class UrdfJoint:
    """One joint, in metres and radians."""

    name: str
    kind: str
    """one of ``KINDS``"""
    parent: str
    child: str
    origin: FloatArray
    """(4, 4) ``T_parent_joint``"""
    axis: FloatArray
    """(3,) unit vector in the joint's frame"""
    limits: tuple[float, float] | None
    """lower and upper; 0 where one is not written"""
    speed: float
    """0 where none is written, as ``effort``"""
    effort: float
    mimics: str | None
    """the joint that this one follows"""
    rounding: Rounding
    """how origin and axis differ from what is written"""
    held_at: float | None = None
    """the one angle [rad] of a turning joint that was taken as fixed; ``origin`` has it in"""

    def settled(self) -> UrdfJoint:
        """The joint with the limits that it has in an arm, or fixed at the one angle that they leave it."""
        if self.kind == "fixed":
            return self
        if self.kind == "continuous":
            return replace(self, limits=(-math.pi, math.pi))
        where = f'<joint name="{self.name}">'
        if self.limits is None:
            raise RobotFileError(f"{where}: <limit> is missing; a revolute joint needs lower and upper")
        lower, upper = self.limits
        where = f"{where}: <limit lower={lower} upper={upper}>"
        if not -WIDEST <= lower <= upper <= WIDEST:
            degrees = " (they look like degrees)" if max(abs(lower), abs(upper)) > WIDEST else ""
            raise RobotFileError(
                f"{where}: the lower limit comes first, both in radians within ±{WIDEST:.2f}{degrees}"
            )
        if lower == upper == 0.0:  # exporters write that where the limits were never filled in
            raise RobotFileError(
                f"{where}: both are 0, which is also what is read where they are not written; write the "
                'angles that the joint may take, or make it type="fixed" if it does not turn'
            )
        if lower < upper:
            return self
        turn, rounding = exact_rotation(["0", "0", repr(lower)])
        along, held = frame_along(self.axis), np.eye(4)
        held[:3, :3] = along[:3, :3] @ turn @ along[:3, :3].T
        rounding = self.rounding + rounding
        return replace(self, kind="fixed", origin=self.origin @ held, rounding=rounding, held_at=lower)


@dataclass(frozen=True, slots=True)
class UrdfLink:
    """The mass of a link, 0 where none is written."""

    mass_kg: float
    com: FloatArray
    """(3,) centre of mass in the link's frame [m]"""


class UrdfTree:
    """The links of a file, hung up by its root; refuses what is no tree."""

    def __init__(self, path: Path, name: str, links: dict[str, UrdfLink], joints: Sequence[UrdfJoint]):
        self.path, self.name, self.links = path, name, links
        self._children: dict[str, list[UrdfJoint]] = {link: [] for link in links}
        self._into: dict[str, UrdfJoint] = {}
        if not links:
            raise RobotFileError("there is no <link>")
        for joint in joints:
            self._hang(joint)
        roots = [link for link in links if link not in self._into]
        if not roots:
            raise RobotFileError("the joints form a loop; a robot has one root link")
        if len(roots) > 1:
            raise RobotFileError(
                f"there are several root links ({', '.join(roots)}); join them by a fixed joint"
            )
        self.root = roots[0]
        lost = set(links) - {self.root, *(joint.child for joint in self.below(self.root))}
        if lost:
            raise RobotFileError(f"the joints form a loop: {', '.join(sorted(lost))}")

    def _hang(self, joint: UrdfJoint) -> None:
        where = f'<joint name="{joint.name}">'
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in self.links:
                raise RobotFileError(f'{where}: <{tag} link="{link}">: there is no such link')
        if joint.child in self._into:
            other = self._into[joint.child].name
            raise RobotFileError(f'{where}: the link "{joint.child}" already hangs on the joint "{other}"')
        self._into[joint.child] = joint
        self._children[joint.parent].append(joint)

    def children(self, link: str) -> list[UrdfJoint]:
        """The joints that a link carries."""
        return self._children[link]

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """Every joint further from the root than a link, parents first."""
        waiting = list(self._children[link])
        while waiting:
            joint = waiting.pop(0)
            yield joint
            waiting += self._children[joint.child]

    def way(self, tool: str) -> list[UrdfJoint]:
        """The joints from the root link to a link, fixed ones too; refuses one that slides or follows."""
        way: list[UrdfJoint] = []
        link = tool
        while link != self.root:
            way.insert(0, self._into[link])
            link = way[0].parent
        for k, joint in enumerate(way):
            where = f'<joint name="{joint.name}">'
            if joint.kind not in ("revolute", "continuous", "fixed"):
                ahead = any(one.kind != "fixed" for one in way[:k])
                way_out = (
                    f"an arm that ends ahead of it is named as {self.path.name}#{joint.parent}"
                    if ahead
                    else "no joint turns ahead of it; if the arm is to be used with it at rest, "
                    'make it type="fixed"'
                )
                raise RobotFileError(
                    f'{where}: type="{joint.kind}": the chain of an arm holds revolute, continuous and fixed '
                    f"joints; {way_out}"
                )
            if joint.mimics is not None and joint.kind != "fixed":
                raise RobotFileError(
                    f'{where}: follows the joint "{joint.mimics}"; every joint of an arm is free'
                )
        return [joint.settled() for joint in way]


def read_urdf_file(path: Path) -> UrdfTree:
    """Read ``path`` into links and joints; a refusal names the element."""
    content, parser = URDF_FILES.read(path), ElementTree.XMLParser(target=_NoDoctype())
    try:
        for begin in range(0, len(content), _PART_BYTES):
            parser.feed(content[begin : begin + _PART_BYTES])
        root = parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as cause:  # LookupError: an unknown encoding
        raise RobotFileError(f"is not XML: {cause}") from cause
    if root.tag != "robot":
        raise RobotFileError(f"the root element is <{root.tag}>, a URDF file has <robot>")
    macro = next((element.tag for element in root.iter() if "xacro" in element.tag), None)
    if macro is not None:
        macro = macro.rpartition("}")[2]
        raise RobotFileError(f"holds macros ({macro}); expand them first: xacro arm.urdf.xacro > arm.urdf")
    links, joints = _by_name(root, "link", _link), _by_name(root, "joint", _joint)
    return UrdfTree(path, root.get("name", ""), links, list(joints.values()))


class _NoDoctype(ElementTree.TreeBuilder):
    """Refuses a document type: URDF has none, and its entities can grow without bound or name other files."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise RobotFileError(f"holds a document type ({name!r}); a URDF file has none, take it out")


def _by_name(
    root: ElementTree.Element, tag: str, read: Callable[[ElementTree.Element, str], T]
) -> dict[str, T]:
    found: dict[str, T] = {}
    for element in root.findall(tag):
        with _inside(element):
            name = _attribute(element, "name")
            if name in found:
                raise RobotFileError("there are two of that name")
            found[name] = read(element, name)
    return found


@contextmanager
def _inside(element: ElementTree.Element) -> Generator[None]:
    """Name the element in what is refused inside."""
    name = element.get("name", "").strip()
    try:
        yield
    except RobotFileError as refusal:
        tag = f'<{element.tag} name="{name}">' if name else f"<{element.tag}>"
        raise RobotFileError(f"{tag}: {refusal}") from refusal


def _link(element: ElementTree.Element, name: str) -> UrdfLink:
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return UrdfLink(0.0, np.zeros(3))
    (kilograms,) = _numbers(mass, "value", 1)
    if kilograms < 0:
        raise RobotFileError(f"<mass value={kilograms}>: a mass is not negative")
    with _inside(inertial):
        return UrdfLink(kilograms, _origin(inertial)[0][:3, 3])


def _joint(element: ElementTree.Element, name: str) -> UrdfJoint:
    kind = _attribute(element, "type")
    if kind not in KINDS:
        raise RobotFileError(f'type="{kind}": allowed are {", ".join(KINDS)}')
    origin, turned = _origin(element)
    axis, leaned = _axis(element)
    limit, lower, upper, speed, effort = element.find("limit"), 0.0, 0.0, 0.0, 0.0
    if limit is not None:
        keys = ("lower", "upper", "velocity", "effort")
        lower, upper, speed, effort = (_numbers(limit, key, 1, 0.0)[0] for key in keys)
    if speed < 0 or effort < 0:
        raise RobotFileError("<limit>: velocity and effort are not negative")
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_attribute_of(element, "parent", "link"),
        child=_attribute_of(element, "child", "link"),
        origin=origin,
        axis=axis,
        limits=None if limit is None else (lower, upper),
        speed=speed,
        effort=effort,
        mimics=None if element.find("mimic") is None else _attribute_of(element, "mimic", "joint"),
        rounding=turned + leaned,
    )


def _origin(element: ElementTree.Element) -> tuple[FloatArray, Rounding]:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4), Rounding()
    T = np.eye(4)
    _numbers(origin, "rpy", 3, 0.0)
    T[:3, :3], rounding = exact_rotation(origin.get("rpy", "0 0 0").split())
    T[:3, 3] = _numbers(origin, "xyz", 3, 0.0)
    return T, rounding


def _axis(element: ElementTree.Element) -> tuple[FloatArray, Rounding]:
    axis = element.find("axis")
    if axis is None:
        return np.array([1.0, 0.0, 0.0]), Rounding()  # the format's default
    vector = np.array(_numbers(axis, "xyz", 3))
    length = math.hypot(*vector)
    if length >= 1e-6:
        return exact_axis(vector / length)
    if element.get("type") in ("fixed", "floating"):
        return vector, Rounding()
    raise RobotFileError(f'<axis xyz="{axis.get("xyz")}">: has no direction; a unit vector is needed')


def _attribute(element: ElementTree.Element, key: str) -> str:
    value = element.get(key, "").strip()
    if not value:
        raise RobotFileError(f"the attribute {key!r} is missing or empty")
    return value


def _attribute_of(element: ElementTree.Element, tag: str, key: str) -> str:
    found = element.find(tag)
    if found is None:
        raise RobotFileError(f"<{tag}> is missing")
    with _inside(found):
        return _attribute(found, key)


def _numbers(element: ElementTree.Element, key: str, count: int, default: float | None = None) -> list[float]:
    """``count`` finite numbers of an attribute."""
    if default is not None and element.get(key) is None:
        return [default] * count
    with _inside(element):
        text = _attribute(element, key)
        try:
            values = [] if "_" in text else [float(part) for part in text.split()]  # Python reads 1_5 as 15
        except ValueError:
            values = []
        if len(values) != count or not all(abs(value) <= LARGEST for value in values):
            needed = "a finite number" if count == 1 else f"{count} finite numbers"
            raise RobotFileError(f'{key}="{text}": must be {needed} within ±{LARGEST:.0e}')
    return values


# Right angles that were rounded.


def exact_angle(text: str) -> float:
    """An angle as written [rad], or the whole number of quarter turns that it is when rounded or cut off.

    That needs four decimals, or to be within 1e-6 of it. Twice 1.57079 is 3.14158: a multiple may be off
    by so many units of the last decimal.
    """
    value = float(text)
    quarters = round(value / _QUARTER)
    exponent = Decimal(text).as_tuple().exponent
    allowed = _NOISE
    if isinstance(exponent, int) and exponent <= -_FEWEST_DECIMALS and abs(quarters) <= _MOST_QUARTERS:
        allowed = max(_NOISE, abs(quarters) * 10.0**exponent)
    return quarters * _QUARTER if abs(value - quarters * _QUARTER) < allowed else value


def exact_rotation(texts: Sequence[str]) -> tuple[FloatArray, Rounding]:
    """A rotation (3, 3) from roll, pitch and yaw as written [rad]."""
    written, exact = [float(text) for text in texts], [exact_angle(text) for text in texts]
    rotation = rotation_from_rpy(*exact)
    changed = [k for k in range(3) if written[k] != exact[k]]
    if not changed:
        return rotation, Rounding()
    chord = float(np.linalg.norm(rotation - rotation_from_rpy(*written))) / math.sqrt(2)
    quarters = tuple(texts[k].lstrip("+-") for k in changed if exact[k] != 0.0)
    return rotation, Rounding(quarters, len(changed) - len(quarters), chord)


def exact_axis(axis: FloatArray) -> tuple[FloatArray, Rounding]:
    """A unit vector (3,), without components that are a rounded zero."""
    noise = (axis != 0.0) & (np.abs(axis) < _NOISE)
    if not noise.any():
        return axis, Rounding()
    exact = np.where(noise, 0.0, axis)
    exact /= np.linalg.norm(exact)
    # turning about the other axis: the way there, the turn, the way back
    return exact, Rounding((), int(noise.sum()), 2 * float(np.linalg.norm(exact - axis)))
