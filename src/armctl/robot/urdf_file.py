"""URDF files: the XML read strictly into links and joints. What armctl has no use for is passed over."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from armctl.errors import RobotFileError
from armctl.robot.urdf_rounding import Rounding, exact_axis, exact_rotation

FloatArray = NDArray[np.float64]
JointKind = Literal["revolute", "continuous", "fixed", "prismatic", "planar", "floating"]
KINDS: tuple[JointKind, ...] = get_args(JointKind)
LARGEST = 1e6
"""no number of a URDF file, in metres, radians, kg or N·m, is larger than this"""


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


class _NoDoctype(ElementTree.TreeBuilder):
    """Refuses a document type: URDF has none, and its entities can grow without bound or name other files."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise RobotFileError(f"holds a document type ({name!r}); a URDF file has none, take it out")


def read_urdf_file(path: Path) -> UrdfFile:
    """Decode ``path`` into links and joints without judging how they hang together.

    Raises:
        RobotFileError: unreadable, not XML, no ``<robot>``, an element or attribute that is missing, doubled
            or no finite number; the message names the file and the element.
    """
    try:
        data = path.read_bytes()
    except OSError as cause:
        raise RobotFileError(f"{path}: cannot be read: {cause.strerror}") from cause
    try:
        root = ElementTree.fromstring(data, ElementTree.XMLParser(target=_NoDoctype()))
    except (ElementTree.ParseError, ValueError, LookupError) as cause:  # LookupError: an unknown encoding
        raise RobotFileError(f"{path}: is not XML: {cause}") from cause
    except RobotFileError as refusal:
        raise RobotFileError(f"{path}: {refusal}") from refusal
    return _Reader(path).robot(root)


class _Reader:
    """Turns elements into records; knows the file for its messages."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def robot(self, root: ElementTree.Element) -> UrdfFile:
        if root.tag != "robot":
            raise RobotFileError(f"{self._path}: the root element is <{root.tag}>, a URDF file has <robot>")
        for element in root.iter():
            if "xacro" in element.tag:
                raise RobotFileError(
                    f"{self._path}: holds macros ({element.tag.rpartition('}')[2]}); expand them first: "
                    "xacro arm.urdf.xacro > arm.urdf"
                )
        links = [self._link(element) for element in root.findall("link")]
        joints = [self._joint(element) for element in root.findall("joint")]
        self._no_doubles("link", [link.name for link in links])
        self._no_doubles("joint", [joint.name for joint in joints])
        return UrdfFile(self._path, root.get("name", ""), {link.name: link for link in links}, tuple(joints))

    def _no_doubles(self, tag: str, names: list[str]) -> None:
        for name in names:
            if names.count(name) > 1:
                raise RobotFileError(f'{self._path}: <{tag} name="{name}">: there are two of that name')

    def _link(self, element: ElementTree.Element) -> UrdfLink:
        name = self._attribute(element, "name", f"{self._path}: <link>")
        where = f'{self._path}: <link name="{name}">'
        inertial = element.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None:
            return UrdfLink(name, 0.0, np.zeros(3))
        kilograms = self._numbers(mass, "value", 1, f"{where}: <mass>")[0]
        if kilograms < 0:
            raise RobotFileError(f"{where}: <mass value={kilograms}>: a mass is not negative")
        return UrdfLink(name, kilograms, self._origin(inertial, f"{where}: <inertial>")[0][:3, 3])

    def _joint(self, element: ElementTree.Element) -> UrdfJoint:
        name = self._attribute(element, "name", f"{self._path}: <joint>")
        where = f'{self._path}: <joint name="{name}">'
        kind = self._attribute(element, "type", where)
        known: list[JointKind] = [k for k in KINDS if k == kind]
        if not known:
            raise RobotFileError(f'{where}: type="{kind}": allowed are {", ".join(KINDS)}')
        mimic = element.find("mimic")
        origin, turned = self._origin(element, where)
        axis, leaned = self._axis(element, where)
        return UrdfJoint(
            name=name,
            kind=known[0],
            parent=self._end(element, "parent", where),
            child=self._end(element, "child", where),
            origin=origin,
            axis=axis,
            limit=self._limit(element, where),
            mimics=None if mimic is None else self._attribute(mimic, "joint", f"{where}: <mimic>"),
            rounding=turned + leaned,
        )

    def _end(self, element: ElementTree.Element, tag: str, where: str) -> str:
        end = element.find(tag)
        if end is None:
            raise RobotFileError(f"{where}: <{tag}> is missing")
        return self._attribute(end, "link", f"{where}: <{tag}>")

    def _attribute(self, element: ElementTree.Element, key: str, where: str) -> str:
        value = element.get(key, "").strip()
        if not value:
            raise RobotFileError(f"{where}: the attribute {key!r} is missing or empty")
        return value

    def _numbers(
        self, element: ElementTree.Element, key: str, count: int, where: str, default: float | None = None
    ) -> list[float]:
        """``count`` finite numbers of an attribute."""
        text = element.get(key)
        if text is None and default is not None:
            return [default] * count
        text = self._attribute(element, key, where)
        try:
            values = [] if "_" in text else [float(part) for part in text.split()]  # Python reads 1_5 as 15
        except ValueError:
            values = []
        if len(values) != count or not all(abs(value) <= LARGEST for value in values):
            needed = "a finite number" if count == 1 else f"{count} finite numbers"
            raise RobotFileError(f'{where}: {key}="{text}": must be {needed} within ±{LARGEST:.0e}')
        return values

    def _origin(self, element: ElementTree.Element, where: str) -> tuple[FloatArray, Rounding]:
        T, rounding = np.eye(4), Rounding()
        origin = element.find("origin")
        if origin is not None:
            self._numbers(origin, "rpy", 3, f"{where}: <origin>", 0.0)
            T[:3, :3], rounding = exact_rotation(origin.get("rpy", "0 0 0").split())
            T[:3, 3] = self._numbers(origin, "xyz", 3, f"{where}: <origin>", 0.0)
        return T, rounding

    def _axis(self, element: ElementTree.Element, where: str) -> tuple[FloatArray, Rounding]:
        axis = element.find("axis")
        if axis is None:
            return np.array([1.0, 0.0, 0.0]), Rounding()  # the format's default
        vector = self._numbers(axis, "xyz", 3, f"{where}: <axis>")
        length = math.hypot(*vector)
        if length < 1e-6 and element.get("type") not in ("fixed", "floating"):
            raise RobotFileError(
                f'{where}: <axis xyz="{axis.get("xyz")}">: has no direction; a unit vector is needed'
            )
        if length < 1e-6:
            return np.array(vector), Rounding()
        return exact_axis(np.array(vector) / length)

    def _limit(self, element: ElementTree.Element, where: str) -> UrdfLimit | None:
        limit = element.find("limit")
        if limit is None:
            return None
        keys = ("lower", "upper", "velocity", "effort")
        lower, upper, velocity, effort = (
            self._numbers(limit, key, 1, f"{where}: <limit>", 0.0)[0] for key in keys
        )
        if velocity < 0 or effort < 0:
            raise RobotFileError(f"{where}: <limit>: velocity and effort are not negative")
        return UrdfLimit(lower, upper, velocity, effort)
