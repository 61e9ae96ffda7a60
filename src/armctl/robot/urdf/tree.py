"""URDF files: the XML read into a tree of links and joints, strictly where the arm's geometry is concerned.

Rounded right angles are taken as exact (``rounding``). Refusals do not name the file; ``load_urdf`` does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast
from xml.etree import ElementTree

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics.chain import frame_along
from armctl.robot.parts import Color, Shape
from armctl.robot.urdf.package import UrdfSource
from armctl.robot.urdf.reading import URDF_FILES, parse_xml
from armctl.robot.urdf.rounding import Rounding, exact_axis, exact_rotation, without_noise
from armctl.robot.urdf.xacro import Expanded, expand, is_xacro
from armctl.robot.urdf.xacro_properties import Argument

T = TypeVar("T")
KINDS = ("revolute", "continuous", "fixed", "prismatic", "planar", "floating")
LARGEST = 1e6
"""no number of a URDF file, in metres, radians, kg or N·m, is larger than this"""
WIDEST = 4 * math.pi
"""a limit farther from zero is none [rad]"""
_ROUNDED = 0.05
"""by which whole turns are rounded [rad]"""
_DEGREES = 720.0
"""a limit between ``WIDEST`` and this is likely one in degrees, unless it is of whole half turns"""
_MOST_NAMED = 6
"""macros, or files that call them, in one refusal"""
_FASTEST = 20 * math.pi
"""a velocity beyond ten turns a second stands for no limit, too [rad/s]"""


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
    multiplier: float
    """how far it turns by a turn of that joint"""
    offset: float
    """its angle where that joint is at zero"""
    rounding: Rounding
    """how origin and axis differ from what is written"""
    held: str | None = None
    """where a joint that moves was taken as fixed, and why, to be shown; ``origin`` has it in"""
    limits_told: str | None = None
    """how its limits differ from what is written, or from what is usual, to be shown"""

    def without_noise(self) -> UrdfJoint:
        """The joint with right angles where the file's are nearly right."""
        origin, axis, rounding = without_noise(self.name, self.origin, self.axis)
        return replace(self, origin=origin, axis=axis, rounding=self.rounding + rounding)

    def settled(self) -> UrdfJoint:
        """The joint with the limits that it has in an arm, or fixed at the one angle that they leave it."""
        if self.kind == "fixed" or self.mimics is not None:  # what it follows has limits
            return self
        turn = (-math.pi, math.pi)
        if self.kind == "continuous":
            lower, upper = self.limits or turn
            if not -WIDEST <= lower < upper <= WIDEST or upper - lower > 2 * math.pi - _ROUNDED:
                return replace(self, limits=turn)
            told = f"{self.name}, a continuous joint, keeps to the limits that its file gives"
            return replace(self, limits_told=f"{told}, {_degrees(lower)} … {_degrees(upper)}")
        where = f'<joint name="{self.name}">'
        if self.limits is None:
            raise RobotFileError(f"{where}: <limit> is missing; a revolute joint needs lower and upper")
        lower, upper = (math.copysign(WIDEST, one) if _is_widest(one) else one for one in self.limits)
        where = f"{where}: <limit lower={lower} upper={upper}>"
        if _is_in_degrees(lower) or _is_in_degrees(upper):
            raise RobotFileError(
                f"{where}: both are in radians; these look like degrees. More than two turns are "
                'type="continuous"'
            )
        if lower > upper:
            raise RobotFileError(f"{where}: the lower limit comes first")
        if lower < -WIDEST or upper > WIDEST:
            told = f"{self.name}, with limits of {lower:g} … {upper:g} rad in the file"
            if lower < -WIDEST and upper > WIDEST:
                told += ", is taken as continuous"
                return replace(self, kind="continuous", limits=turn, limits_told=told)
            kept = (
                (lower, lower + turn[1] - turn[0]) if upper > WIDEST else (upper + turn[0] - turn[1], upper)
            )
            told += f", keeps to one turn, {_degrees(kept[0])} … {_degrees(kept[1])}"
            return replace(self, limits=kept, limits_told=told).settled()
        if lower == upper == 0.0:  # exporters write that where the limits were never filled in
            raise RobotFileError(
                f"{where}: both are 0, which is also what is read where they are not written; write the "
                'angles that the joint may take, or make it type="fixed" if it does not turn'
            )
        if lower < upper:
            return replace(self, limits=(lower, upper))
        held = f"{self.name} at {math.degrees(lower):.1f}°, as both limits are the same"
        return replace(self.turned(lower), kind="fixed", held=held)

    def turned(self, angle: float) -> UrdfJoint:
        """The joint with its zero where it stands at an angle [rad]."""
        turn, rounding = exact_rotation(["0", "0", repr(angle)])
        along, place = frame_along(self.axis), np.eye(4)
        place[:3, :3] = along[:3, :3] @ turn @ along[:3, :3].T
        return replace(self, origin=self.origin @ place, rounding=self.rounding + rounding)

    def at_rest(self) -> UrdfJoint:
        """A joint below the arm that slides or floats (a rail, a lift, a mobile base), fixed near zero."""
        place, along = np.eye(4), 0.0
        if self.kind == "prismatic" and self.limits is not None:
            along = min(max(0.0, self.limits[0]), self.limits[1])
            place[:3, 3] = along * self.axis
        held = f"{self.name} at {1000 * along:.4g} mm, which moves the base and is no joint of the arm"
        return replace(self, kind="fixed", origin=self.origin @ place, held=held)


def is_free(joint: UrdfJoint) -> bool:
    """True where a joint turns, and follows no other."""
    return joint.kind in ("revolute", "continuous") and joint.mimics is None


@dataclass(frozen=True, slots=True)
class UrdfLink:
    """The mass of a link, 0 where none is written, and its shapes."""

    mass_kg: float
    com: FloatArray
    """(3,) centre of mass in the link's frame [m]"""
    visual: tuple[Shape, ...] = ()
    """with their poses in the frame of the file's link, and the names of meshes as written"""
    collision: tuple[Shape, ...] = ()
    problems: tuple[str, ...] = ()
    """why shapes of it were passed over"""

    @property
    def is_solid(self) -> bool:
        """False for a bare frame."""
        return bool(self.visual or self.collision or self.mass_kg)


class UrdfTree:
    """The links of a file, hung up by its root; refuses what is no tree."""

    def __init__(
        self,
        path: Path,
        name: str,
        links: dict[str, UrdfLink],
        joints: Sequence[UrdfJoint],
        arguments: tuple[Argument, ...] = (),
        left_out: tuple[str, ...] = (),
    ):
        self.path, self.name, self.links = path, name, links
        self.arguments, self.left_out = arguments, left_out
        self._children: dict[str, list[UrdfJoint]] = {link: [] for link in links}
        self._into: dict[str, UrdfJoint] = {}
        self._poses: dict[str, FloatArray] = {}
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
        self._poses[self.root] = np.eye(4)
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

    def into(self, link: str) -> UrdfJoint | None:
        """The joint that carries a link; None for the root."""
        return self._into.get(link)

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """Every joint further from the root than a link, parents first."""
        waiting = list(self._children[link])
        for joint in waiting:
            yield joint
            waiting += self._children[joint.child]

    def body(self, link: str) -> list[str]:
        """A link, and those that hang on it by fixed joints, the nearest first."""
        body = [link]
        for one in body:
            body += [joint.child for joint in self._children[one] if joint.kind == "fixed"]
        return body

    def carriers(self) -> dict[str, str]:
        """Of each link, the first one of the ``body`` that it is part of."""
        carriers = {self.root: self.root}
        for joint in self.below(self.root):
            carriers[joint.child] = carriers[joint.parent] if joint.kind == "fixed" else joint.child
        return carriers

    def exits(self, link: str) -> list[UrdfJoint]:
        """The joints that a link and its ``body`` carry and that move."""
        return [one for part in self.body(link) for one in self._children[part] if one.kind != "fixed"]

    def pose(self, link: str) -> FloatArray:
        """(4, 4) of a link in the root frame, all joints at zero."""
        route: list[UrdfJoint] = []
        while link not in self._poses:
            route.append(self._into[link])
            link = route[-1].parent
        for joint in reversed(route):
            self._poses[joint.child] = self._poses[joint.parent] @ joint.origin
        return self._poses[route[0].child if route else link]

    def route(self, link: str) -> list[UrdfJoint]:
        """The joints from the root link to a link, fixed ones too, as they are written."""
        route: list[UrdfJoint] = []
        while link != self.root:
            route.append(self._into[link])
            link = route[-1].parent
        return route[::-1]


def read_urdf_file(source: UrdfSource, arguments: Mapping[str, str] | None = None) -> UrdfTree:
    """Read a file into links and joints, xacro expanded; a refusal names the element.

    ``arguments``: values of what ``<xacro:arg>`` declares, by name.
    """
    root = parse_xml(URDF_FILES.read(source.file), source.file)
    if other := _other_format(root):
        raise RobotFileError(
            f"is {other}; armctl reads URDF: open the .urdf or .urdf.xacro file of the arm, which most "
            "projects have, too"
        )
    if root.tag != "robot":
        raise RobotFileError(f"the root element is <{root.tag}>, a URDF file has <robot>")
    expanded: Expanded | None = None
    if is_xacro(root):
        expanded = expand(root, source, arguments or {})
        root = expanded.root
        if root.find("link") is None and expanded.macros:
            raise _only_macros(source, expanded)
    elif arguments:
        raise RobotFileError(f"it is no xacro file and has no argument {next(iter(arguments))!r}")
    colors = {
        material.get("name", ""): color
        for material in root.findall("material")
        if (color := _color(material, {})) is not None
    }
    links = _by_name(root, "link", lambda element, _: _link(element, colors))
    joints = _by_name(root, "joint", _joint)
    given = ((), ()) if expanded is None else (expanded.arguments, expanded.left_out)
    return UrdfTree(source.file, root.get("name", ""), links, list(joints.values()), *given)


_FORMATS = {
    "sdf": "an SDF file of Gazebo",
    "gazebo": "an SDF file of Gazebo",
    "mujoco": "an MJCF file of MuJoCo",
    "mujocoinclude": "an MJCF file of MuJoCo",
    "launch": "a launch file of ROS",
    "package": "the package.xml of a ROS package",
    "COLLADA": "a Collada mesh (DAE)",
    "html": "a web page (download the file itself, on GitHub by Raw)",
}
"""root elements of files that are taken for an arm's"""
_OF_SRDF = ("group", "group_state", "disable_collisions", "virtual_joint", "end_effector")


def _other_format(root: ElementTree.Element) -> str:
    """What a file is that is no URDF; empty where that is not known."""
    if root.tag == "robot":
        is_srdf = root.find("link") is None and any(root.find(tag) is not None for tag in _OF_SRDF)
        return "an SRDF file of MoveIt, which has groups and poses and no geometry" if is_srdf else ""
    return _FORMATS.get(root.tag, "")


def _only_macros(source: UrdfSource, expanded: Expanded) -> RobotFileError:
    """The refusal of a file that defines macros and calls none; names the files that call them."""
    names = [name for name, _ in expanded.macros]
    what = f"only defines the macro{'s' * (len(names) > 1)} {', '.join(names[:_MOST_NAMED])}"
    if callers := source.callers(names):
        return RobotFileError(f"{what}; open the file that calls it: {', '.join(callers[:_MOST_NAMED])}")
    call = expanded.macros[-1][1]
    return RobotFileError(
        f"{what}; open the file that calls it, or write one: <robot "
        f'xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="{source.file.name}"/>'
        f"{call}</robot>"
    )


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


def _link(element: ElementTree.Element, colors: Mapping[str, Color]) -> UrdfLink:
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    kilograms, com = 0.0, np.zeros(3)
    if inertial is not None and mass is not None:
        (kilograms,) = _numbers(mass, "value", 1)
        if kilograms < 0:
            raise RobotFileError(f"<mass value={kilograms}>: a mass is not negative")
        with _inside(inertial):
            com = _origin(inertial)[0][:3, 3]
    shapes: dict[str, list[Shape]] = {"visual": [], "collision": []}
    problems: list[str] = []
    for tag, found in shapes.items():
        for one in element.findall(tag):
            try:
                found.append(_shape(one, colors))
            except RobotFileError as problem:  # the arm moves without it, too
                problems.append(f"<{tag}>: {problem}")
    return UrdfLink(kilograms, com, tuple(shapes["visual"]), tuple(shapes["collision"]), tuple(problems))


def _shape(element: ElementTree.Element, colors: Mapping[str, Color]) -> Shape:
    geometry = element.find("geometry")
    solid = None if geometry is None else next(iter(geometry), None)
    if solid is None:
        raise RobotFileError("<geometry> is missing or empty")
    origin, material = _origin(element)[0], element.find("material")
    color = None if material is None else _color(material, colors)
    file, kind = "", solid.tag
    match solid.tag:
        case "box":
            size = _numbers(solid, "size", 3)
        case "cylinder" | "capsule":
            kind, size = "cylinder", [*_numbers(solid, "radius", 1), *_numbers(solid, "length", 1)]
            if solid.tag == "capsule":
                size[1] += 2 * size[0]
        case "sphere":
            size = _numbers(solid, "radius", 1)
        case "mesh":
            file, size = _attribute(solid, "filename"), _scale(solid)
        case other:
            raise RobotFileError(f"<{other}>: allowed are box, cylinder, sphere and mesh")
    if kind != "mesh" and min(size) <= 0:
        raise RobotFileError(f"<{solid.tag}>: its sizes must be above 0")
    return Shape(cast("Any", kind), tuple(size), origin, file, color)


def _scale(element: ElementTree.Element) -> list[float]:
    single = len(element.get("scale", "1 1 1").split()) == 1
    scale = _numbers(element, "scale", 1) * 3 if single else _numbers(element, "scale", 3, 1.0)
    if 0.0 in scale:
        raise RobotFileError(f'<mesh scale="{element.get("scale")}">: no factor may be 0')
    return scale


def _color(material: ElementTree.Element, colors: Mapping[str, Color]) -> Color | None:
    """Of a material, else of the one of its name; None where it has none that can be read."""
    color = material.find("color")
    try:
        rgba = [] if color is None else [float(part) for part in color.get("rgba", "").split()]
    except ValueError:
        rgba = []
    if len(rgba) < 3 or not all(math.isfinite(part) for part in rgba):
        return colors.get(material.get("name", ""))
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in rgba[:3])
    return red, green, blue


def _joint(element: ElementTree.Element, name: str) -> UrdfJoint:
    kind = _attribute(element, "type")
    if kind not in KINDS:
        raise RobotFileError(f'type="{kind}": allowed are {", ".join(KINDS)}')
    origin, turned = _origin(element)
    axis, leaned = _axis(element)
    limit, lower, upper, speed, effort = element.find("limit"), 0.0, 0.0, 0.0, 0.0
    mimic = element.find("mimic")
    if limit is not None:
        lower, upper = _limit(limit, "lower", kind), _limit(limit, "upper", kind)
        speed, effort = _rating(limit, "velocity", _FASTEST), _rating(limit, "effort", LARGEST)
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
        mimics=None if mimic is None else _attribute_of(element, "mimic", "joint"),
        multiplier=1.0 if mimic is None else _numbers(mimic, "multiplier", 1, 1.0)[0],
        offset=0.0 if mimic is None else _numbers(mimic, "offset", 1, 0.0)[0],
        rounding=turned + leaned,
    )


def _limit(limit: ElementTree.Element, key: str, kind: str) -> float:
    """0 where it is not written; what is no number, or more than any, is infinite: there is none."""
    none = -math.inf if key == "lower" else math.inf
    try:
        value = _number(limit, key, 0.0)
    except RobotFileError:
        if kind != "continuous":  # which needs none
            raise
        return none
    if math.isnan(value):
        return none
    return value if abs(value) <= LARGEST else math.copysign(math.inf, value)


def _is_widest(limit: float) -> bool:
    return abs(abs(limit) - WIDEST) < _ROUNDED


def _is_in_degrees(limit: float) -> bool:
    half_turns = abs(limit) / math.pi
    whole = abs(half_turns - round(half_turns)) * math.pi < _ROUNDED if math.isfinite(half_turns) else True
    return WIDEST < abs(limit) <= _DEGREES and (limit.is_integer() or not whole)


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"


def _rating(limit: ElementTree.Element, key: str, most: float) -> float:
    """0 where none is written, or what stands for none: nothing, below 0, or more than any joint has."""
    value = _number(limit, key, 0.0) if limit.get(key, "").strip() else 0.0
    return value if 0 <= value <= most else 0.0


def _number(element: ElementTree.Element, key: str, default: float) -> float:
    """One number of an attribute, also one that is not finite."""
    if element.get(key) is None:
        return default
    with _inside(element):
        text = _attribute(element, key)
        try:
            return float(text.replace("_", "x"))  # Python reads 1_5 as 15
        except ValueError:
            raise RobotFileError(f'{key}="{text}": must be a number') from None


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
    """``count`` numbers of an attribute, within ±``LARGEST``."""
    if default is not None and element.get(key) is None:
        return [default] * count
    with _inside(element):
        text = _attribute(element, key)
        try:
            values = [] if "_" in text else [float(part) for part in text.split()]  # Python reads 1_5 as 15
        except ValueError:
            values = []
        if len(values) != count or not all(abs(value) <= LARGEST for value in values):
            needed = "a number" if count == 1 else f"{count} numbers"
            raise RobotFileError(f'{key}="{text}": must be {needed} within ±{LARGEST:.0e}')
    return values
