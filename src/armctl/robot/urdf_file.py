"""URDF files: the XML read strictly into links and joints. What armctl has no use for is passed over.

Exporters write a quarter turn as 1.5708 and a zero as -9.4e-08. Read to the letter, axes that are parallel in
the machine are not in the file, and no closed form fits the arm. So rounded right angles are taken as exact,
and each joint tells how far that is from what is written.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Literal, get_args
from xml.etree import ElementTree

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import rotation_from_rpy
from armctl.kinematics.chain import frame_along

JointKind = Literal["revolute", "continuous", "fixed", "prismatic", "planar", "floating"]
KINDS: tuple[JointKind, ...] = get_args(JointKind)
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


@dataclass(frozen=True, slots=True)
class UrdfLimit:
    """The ``<limit>`` of a joint; what is not written is 0, as the format has it."""

    lower: float
    upper: float
    velocity: float
    effort: float


@dataclass(frozen=True)
class UrdfJoint:
    """One joint, in metres and radians."""

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: FloatArray
    """(4, 4) ``T_parent_joint``"""
    axis: FloatArray
    """(3,) unit vector in the joint's frame"""
    limit: UrdfLimit | None
    mimics: str | None
    """the joint that this one follows"""
    rounding: Rounding
    """how origin and axis differ from what is written"""
    held_at: float | None = None
    """the one angle [rad] of a turning joint that was taken as fixed; ``origin`` has it in"""


@dataclass(frozen=True, slots=True)
class UrdfLink:
    """One link with its mass, 0 where none is written."""

    name: str
    mass_kg: float
    com: FloatArray
    """(3,) centre of mass in the link's frame [m]"""


@dataclass(frozen=True, slots=True)
class UrdfFile:
    """One URDF file, as written."""

    path: Path
    name: str
    links: dict[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]


def read_urdf_file(path: Path) -> UrdfFile:
    """Decode ``path`` into links and joints without judging how they hang together.

    Raises:
        RobotFileError: unreadable, not XML, no ``<robot>``, an element or attribute that is missing, doubled
            or no finite number; the message names the file and the element.
    """
    try:
        root = ElementTree.fromstring(path.read_bytes(), ElementTree.XMLParser(target=_NoDoctype()))
    except OSError as cause:
        raise RobotFileError(f"{path}: cannot be read: {cause.strerror}") from cause
    except (ElementTree.ParseError, ValueError, LookupError) as cause:  # LookupError: an unknown encoding
        raise RobotFileError(f"{path}: is not XML: {cause}") from cause
    except RobotFileError as refusal:
        raise RobotFileError(f"{path}: {refusal}") from refusal
    if root.tag != "robot":
        raise RobotFileError(f"{path}: the root element is <{root.tag}>, a URDF file has <robot>")
    for element in root.iter():
        if "xacro" in element.tag:
            raise RobotFileError(
                f"{path}: holds macros ({element.tag.rpartition('}')[2]}); expand them first: "
                "xacro arm.urdf.xacro > arm.urdf"
            )
    links = [_link(element, f"{path}: <link>") for element in root.findall("link")]
    joints = [_joint(element, f"{path}: <joint>") for element in root.findall("joint")]
    for tag, names in (("link", [link.name for link in links]), ("joint", [joint.name for joint in joints])):
        for name in names:
            if names.count(name) > 1:
                raise RobotFileError(f'{path}: <{tag} name="{name}">: there are two of that name')
    return UrdfFile(path, root.get("name", ""), {link.name: link for link in links}, tuple(joints))


def limits_of(joint: UrdfJoint, path: Path) -> tuple[float, float]:
    """Lower and upper limit [rad] of a turning joint; ±180° of a continuous one.

    Raises:
        RobotFileError: a revolute joint without limits, or with some that cannot be meant.
    """
    if joint.kind == "continuous":
        return -math.pi, math.pi
    where, limit = f'{path}: <joint name="{joint.name}">', joint.limit
    if limit is None:
        raise RobotFileError(f"{where}: <limit> is missing; a revolute joint needs lower and upper")
    lower, upper = limit.lower, limit.upper
    where = f"{where}: <limit lower={lower} upper={upper}>"
    if not -WIDEST <= lower <= upper <= WIDEST:
        degrees = " (they look like degrees)" if max(abs(lower), abs(upper)) > WIDEST else ""
        raise RobotFileError(
            f"{where}: the lower limit comes first, both in radians within ±{WIDEST:.2f}{degrees}"
        )
    if lower == upper == 0.0:  # exporters write that where nobody has filled the limits in
        raise RobotFileError(
            f"{where}: both are 0, which is also what is read where they are not written; write the angles "
            'that the joint may take, or make it type="fixed" if it does not turn'
        )
    return lower, upper


def fixed_where_held(joint: UrdfJoint, path: Path) -> UrdfJoint:
    """The joint itself, or a fixed one at the one angle that its limits leave it.

    Raises:
        RobotFileError: as ``limits_of``.
    """
    if joint.kind == "fixed":
        return joint
    lower, upper = limits_of(joint, path)
    if lower < upper:
        return joint
    turn, rounding = exact_rotation(["0", "0", repr(lower)])
    along, held = frame_along(joint.axis), np.eye(4)
    held[:3, :3] = along[:3, :3] @ turn @ along[:3, :3].T
    return replace(
        joint, kind="fixed", origin=joint.origin @ held, rounding=joint.rounding + rounding, held_at=lower
    )


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


def exact_rotation(texts: list[str]) -> tuple[FloatArray, Rounding]:
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


class _NoDoctype(ElementTree.TreeBuilder):
    """Refuses a document type: URDF has none, and its entities can grow without bound or name other files."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise RobotFileError(f"holds a document type ({name!r}); a URDF file has none, take it out")


def _link(element: ElementTree.Element, where: str) -> UrdfLink:
    name = _attribute(element, "name", where)
    where = f'{where[:-1]} name="{name}">'
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return UrdfLink(name, 0.0, np.zeros(3))
    (kilograms,) = _numbers(mass, "value", 1, f"{where}: <mass>")
    if kilograms < 0:
        raise RobotFileError(f"{where}: <mass value={kilograms}>: a mass is not negative")
    return UrdfLink(name, kilograms, _origin(inertial, f"{where}: <inertial>")[0][:3, 3])


def _joint(element: ElementTree.Element, where: str) -> UrdfJoint:
    name = _attribute(element, "name", where)
    where = f'{where[:-1]} name="{name}">'
    written = _attribute(element, "type", where)
    kinds: list[JointKind] = [kind for kind in KINDS if kind == written]
    if not kinds:
        raise RobotFileError(f'{where}: type="{written}": allowed are {", ".join(KINDS)}')
    mimic = element.find("mimic")
    origin, turned = _origin(element, where)
    axis, leaned = _axis(element, where)
    return UrdfJoint(
        name=name,
        kind=kinds[0],
        parent=_end(element, "parent", where),
        child=_end(element, "child", where),
        origin=origin,
        axis=axis,
        limit=_limit(element, where),
        mimics=None if mimic is None else _attribute(mimic, "joint", f"{where}: <mimic>"),
        rounding=turned + leaned,
    )


def _end(element: ElementTree.Element, tag: str, where: str) -> str:
    end = element.find(tag)
    if end is None:
        raise RobotFileError(f"{where}: <{tag}> is missing")
    return _attribute(end, "link", f"{where}: <{tag}>")


def _origin(element: ElementTree.Element, where: str) -> tuple[FloatArray, Rounding]:
    T, rounding = np.eye(4), Rounding()
    origin = element.find("origin")
    if origin is not None:
        _numbers(origin, "rpy", 3, f"{where}: <origin>", 0.0)
        T[:3, :3], rounding = exact_rotation(origin.get("rpy", "0 0 0").split())
        T[:3, 3] = _numbers(origin, "xyz", 3, f"{where}: <origin>", 0.0)
    return T, rounding


def _axis(element: ElementTree.Element, where: str) -> tuple[FloatArray, Rounding]:
    axis = element.find("axis")
    if axis is None:
        return np.array([1.0, 0.0, 0.0]), Rounding()  # the format's default
    vector = np.array(_numbers(axis, "xyz", 3, f"{where}: <axis>"))
    length = math.hypot(*vector)
    if length >= 1e-6:
        return exact_axis(vector / length)
    if element.get("type") in ("fixed", "floating"):
        return vector, Rounding()
    raise RobotFileError(
        f'{where}: <axis xyz="{axis.get("xyz")}">: has no direction; a unit vector is needed'
    )


def _limit(element: ElementTree.Element, where: str) -> UrdfLimit | None:
    limit = element.find("limit")
    if limit is None:
        return None
    keys = ("lower", "upper", "velocity", "effort")
    values = UrdfLimit(*(_numbers(limit, key, 1, f"{where}: <limit>", 0.0)[0] for key in keys))
    if values.velocity < 0 or values.effort < 0:
        raise RobotFileError(f"{where}: <limit>: velocity and effort are not negative")
    return values


def _attribute(element: ElementTree.Element, key: str, where: str) -> str:
    value = element.get(key, "").strip()
    if not value:
        raise RobotFileError(f"{where}: the attribute {key!r} is missing or empty")
    return value


def _numbers(
    element: ElementTree.Element, key: str, count: int, where: str, default: float | None = None
) -> list[float]:
    """``count`` finite numbers of an attribute."""
    if default is not None and element.get(key) is None:
        return [default] * count
    text = _attribute(element, key, where)
    try:
        values = [] if "_" in text else [float(part) for part in text.split()]  # Python reads 1_5 as 15
    except ValueError:
        values = []
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        needed = "a finite number" if count == 1 else f"{count} finite numbers"
        raise RobotFileError(f'{where}: {key}="{text}": must be {needed} within ±{LARGEST:.0e}')
    return values
