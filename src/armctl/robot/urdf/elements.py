"""The elements of a URDF file, read strictly where the arm's geometry is concerned.

Rounded right angles are taken as exact (``tree``). Refusals do not name the file; ``load_urdf`` does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar, cast
from xml.etree import ElementTree

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.robot.parts import Color, Shape
from armctl.robot.urdf.package import UrdfSource
from armctl.robot.urdf.reading import URDF_FILES, parse_xml
from armctl.robot.urdf.tree import Rounding, UrdfJoint, UrdfLink, UrdfTree, exact_axis, exact_rotation
from armctl.robot.urdf.xacro import Expanded, expand, is_xacro

T = TypeVar("T")
KINDS = ("revolute", "continuous", "fixed", "prismatic", "planar", "floating")
LARGEST = 1e6
"""no number of a URDF file, in metres, radians, kg or N·m, is larger than this"""
_MOST_NAMED = 6
"""macros, or files that call them, in one refusal"""
_FASTEST = 20 * math.pi
"""a velocity beyond ten turns a second stands for no limit, too [rad/s]"""


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
