"""Masses of shipped arms against their makers' own: ``python -m benchmarks.gravity so101=FILE ur5=FILE …``.

Each file is the arm's public description (URDF or xacro), and its inertials are the truth. Gravity torques of
500 random poses come out of a plain recursion over the description's tree, and out of the robot file; the
table gives the RMS of the difference in percent of the RMS of the truth, a joint each, and how far the two
disagree about where the axes are. Joints that gravity does not load have a dash. The status is 1 where a
joint is beyond ``_MOST``.

``--bodies`` prints the ``[[bodies]]`` of the robot file instead, as the description has them. Jaws are as
near to closed as the description lets them; the payload does not count.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from armctl import Robot, load_robot
from armctl.arrays import FloatArray
from armctl.kinematics.energy import STANDARD_GRAVITY
from armctl.kinematics.frames import LinkFrames
from armctl.robot.urdf import UrdfSource
from armctl.robot.urdf.reading import parse_xml
from armctl.robot.urdf.xacro import expand, is_xacro

_POSES = 500
_MOST = 0.10
_NONE = 1e-4
"""RMS torque [N·m] of a joint that gravity does not load"""


Line = tuple[FloatArray, FloatArray]
"""of a joint's axis: a point [m], and the direction that angles of the robot file turn about"""
Mass = tuple[int, float, FloatArray]
"""by how many joints it is carried, mass [kg], centre [m]"""


@dataclass(frozen=True, slots=True)
class Description:
    """How joints of a maker's description stand to those of the robot file: ``sense * q + zero``."""

    joints: str
    """from the base to the tool, with spaces between"""
    senses: tuple[int, ...]
    zeros_deg: tuple[float, ...]
    """the first stands for the yaw of the base frame, too, which gravity does not feel"""
    arguments: Mapping[str, str] = field(default_factory=dict[str, str])
    """of its xacro file"""


_SO = "shoulder_pan shoulder_lift elbow_flex wrist_flex wrist_roll"
DESCRIPTIONS = {
    "so100": Description(_SO, (1, 1, 1, 1, -1), (90, 193.132, 180, -32.705, 0)),
    "so101": Description(_SO, (1,) * 5, (0,) * 5),
    "ur5": Description(
        "shoulder_pan_joint shoulder_lift_joint elbow_joint wrist_1_joint wrist_2_joint wrist_3_joint",
        (1,) * 6,
        (180, 0, 0, 0, 0, 0),
        {"ur_type": "ur5", "name": "ur5"},
    ),
    "pincherx100": Description("waist shoulder elbow wrist_angle", (1,) * 4, (0,) * 4),
    "open_manipulator_x": Description("joint1 joint2 joint3 joint4", (1,) * 4, (0,) * 4),
    "parol6": Description("L1 L2 L3 L4 L5 L6", (1, 1, -1, -1, -1, -1), (0, 90, 180, 0, 0, 180)),
    "ar4": Description(
        "joint_1 joint_2 joint_3 joint_4 joint_5 joint_6",
        (-1, 1, 1, 1, 1, 1),
        (-90, 0, 0, 0, 0, 0),
        {"ar_model": "mk3", "include_gripper": "false"},
    ),
    "mico": Description(
        "m1n4s200_joint_1 m1n4s200_joint_2 m1n4s200_joint_3 m1n4s200_joint_4",
        (-1, -1, 1, -1),
        (0, 90, -90, 0),
    ),
    "koch": Description(
        "yaw pitch1 pitch2 pitch3 effector_roll",
        (-1, 1, -1, 1, -1),
        (0, -90.069, 90.035, -0.034, -90),
    ),
    "widowx250s": Description(
        "waist shoulder elbow forearm_roll wrist_angle wrist_rotate", (1,) * 6, (0,) * 6
    ),
}


def _numbers(element: Element | None, key: str, default: tuple[float, float, float]) -> FloatArray:
    text = None if element is None else element.get(key)
    return np.array(default if text is None else [float(word) for word in text.split()], dtype=np.float64)


def _turned(axis: FloatArray, angle: float) -> FloatArray:
    """(4, 4) turn about a unit vector (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return T


def _origin(element: Element) -> FloatArray:
    """(4, 4) of its ``<origin>``: roll, pitch, yaw about the fixed x, y, z [rad], then moved [m]."""
    origin = element.find("origin")
    T = np.eye(4)
    T[:3, 3] = _numbers(origin, "xyz", (0, 0, 0))
    for axis, angle in zip(np.eye(3)[::-1], _numbers(origin, "rpy", (0, 0, 0))[::-1], strict=True):
        T = T @ _turned(axis, float(angle))
    return T


class Tree:
    """A description: links, masses and joints as they are written."""

    def __init__(self, file: Path, description: Description) -> None:
        root = parse_xml(file.read_bytes(), file)
        if is_xacro(root):
            root = expand(root, UrdfSource.at(file), description.arguments).root
        self.names, self.description = description.joints.split(), description
        self._below: dict[str, list[Element]] = {}
        for joint in root.findall("joint[parent]"):
            self._below.setdefault(_link(joint, "parent"), []).append(joint)
        self._masses = {
            link.get("name", ""): (float(mass.get("value", "0")), _origin(inertial)[:3, 3])
            for link in root.findall("link")
            for inertial in link.findall("inertial")
            for mass in inertial.findall("mass")
        }
        children = {_link(joint, "child") for joint in root.findall("joint[parent]")}
        (self._root,) = {link.get("name", "") for link in root.findall("link")} - children

    def placed(self, q: FloatArray) -> tuple[list[Line], list[Mass]]:
        """Axes of the joints, and the masses that move, in the root's frame, at ``q`` (n,) [rad]."""
        d = self.description
        angles = np.array(d.senses) * q + np.radians(d.zeros_deg)
        lines: list[Line] = [(np.zeros(3), np.zeros(3))] * len(self.names)
        masses: list[Mass] = []

        def walk(link: str, T: FloatArray, below: int) -> None:
            if below and link in self._masses:
                mass, centre = self._masses[link]
                masses.append((below, mass, T[:3, :3] @ centre + T[:3, 3]))
            for joint in self._below.get(link, ()):
                here, name, kind = T @ _origin(joint), joint.get("name", ""), joint.get("type")
                axis = _numbers(joint.find("axis"), "xyz", (1, 0, 0))
                if name in self.names:
                    k = self.names.index(name)
                    lines[k] = here[:3, 3], d.senses[k] * here[:3, :3] @ axis
                    walk(_link(joint, "child"), here @ _turned(axis, angles[k]), k + 1)
                    continue
                if kind != "fixed":
                    here = here @ _moved(axis, _nearest_to_zero(joint), kind)
                walk(_link(joint, "child"), here, below)

        walk(self._root, np.eye(4), 0)
        return lines, masses

    def torque(self, q: FloatArray) -> FloatArray:
        """Torque (n,) [N·m] against gravity at ``q`` (n,) [rad] of the robot file."""
        lines, masses = self.placed(q)
        torque = np.zeros(len(lines))
        for k, (point, axis) in enumerate(lines):
            for below, mass, centre in masses:
                if below > k:
                    torque[k] += mass * STANDARD_GRAVITY * np.cross(axis, centre - point)[2]
        return torque


def _link(joint: Element, which: str) -> str:
    found = joint.find(which)
    return "" if found is None else found.get("link", "")


def _nearest_to_zero(joint: Element) -> float:
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return 0.0
    return min(max(0.0, float(limit.get("lower", "0"))), float(limit.get("upper", "0")))


def _moved(axis: FloatArray, by: float, kind: str | None) -> FloatArray:
    if kind != "prismatic":
        return _turned(axis, by)
    T = np.eye(4)
    T[:3, 3] = by * axis
    return T


def _random(robot: Robot, many: int) -> FloatArray:
    return np.random.default_rng(38).uniform(robot.limits[:, 0], robot.limits[:, 1], (many, robot.n))


def _lines_of(robot: Robot, q: FloatArray) -> list[Line]:
    links = LinkFrames.at(robot.chain, q[None])
    return [(links.origin[k][:, 0], links.rotation[k][:, 2, 0]) for k in range(robot.n)]


def _base(robot: Robot, tree: Tree, q: FloatArray) -> FloatArray:
    """(4, 4) of the description's root in the base frame: the first axis upon the first, then the yaw and the
    height that bring the second upon the second."""
    (p1, _), (p2, z2) = _lines_of(robot, q)[:2]
    (o1, _), (o2, a2) = tree.placed(q)[0][:2]
    yaw = np.arctan2(z2[1], z2[0]) - np.arctan2(a2[1], a2[0])
    T = _turned(np.array([0.0, 0.0, 1.0]), float(yaw))
    T[:3, 3] = p1 - T[:3, :3] @ o1
    T[2, 3] = p2[2] - o2[2]
    return T


def _beside(robot: Robot, tree: Tree, q: FloatArray, base: FloatArray) -> list[FloatArray]:
    """What the links of the description must be shifted by, for each axis to lie in that of the robot file
    (n × (3,)) [m]: each as the link before it, and from there at right angles to its axis."""
    found, shift = list[FloatArray](), np.zeros(3)
    for (p, z), (o, axis) in zip(_lines_of(robot, q), tree.placed(q)[0], strict=True):
        if np.dot(base[:3, :3] @ axis, z) < np.cos(np.radians(0.1)):
            raise SystemExit(f"{robot.name}: axis {len(found) + 1} points elsewhere than in the description")
        away = p - base[:3, :3] @ o - base[:3, 3] - shift
        shift = shift + away - np.dot(away, z) * z
        found.append(shift)
    return found


def bodies(robot: Robot, tree: Tree) -> Iterator[tuple[str, float, FloatArray]]:
    """Joint, mass [kg] and centre [m] in the frame of its DH row, of all that moves with it.

    Where an axis of the description lies beside the robot file's, masses keep their place beside the axis.
    """
    places = [robot.chain.places[row + 1].T_link_frame for row in robot.chain.joint_rows]
    sums = np.zeros((robot.n, 4))
    poses = _random(robot, 50)
    for q in poses:
        base, links = _base(robot, tree, q), LinkFrames.at(robot.chain, q[None])
        beside = _beside(robot, tree, q, base)
        for below, mass, centre in tree.placed(q)[1]:
            k = below - 1
            at = base[:3, :3] @ centre + base[:3, 3] + beside[k] - links.origin[k][:, 0]
            inside = links.rotation[k][:, :, 0].T @ at  # of the link, of which the row's frame is a part
            T = places[k]
            sums[k] += mass, *(mass * T[:3, :3].T @ (inside - T[:3, 3]))
    for name, (mass, *moments) in zip(robot.joint_names, (sums / len(poses)).tolist(), strict=True):
        yield name, float(mass), np.array(moments) / mass


def checked(robot: Robot, tree: Tree) -> tuple[FloatArray, FloatArray, float]:
    """RMS torque (n,) [N·m] of the description, of the difference, and how far axes are apart at most [m]."""
    gravity = replace(robot.gravity, payload_kg=0.0)
    poses = _random(robot, _POSES)
    truth = np.array([tree.torque(q) for q in poses])
    wrong = gravity.torque(poses) - truth
    apart = max(
        float(np.linalg.norm(one))
        for q in poses[:50]
        for one in _beside(robot, tree, q, _base(robot, tree, q))
    )
    return np.sqrt((truth**2).mean(axis=0)), np.sqrt((wrong**2).mean(axis=0)), apart


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("arms", nargs="+", metavar="ARM=FILE", help=f"of {', '.join(DESCRIPTIONS)}")
    parser.add_argument("--bodies", action="store_true", help="print the entries of the robot file")
    asked = parser.parse_args()
    far = False
    for one in asked.arms:
        name, _, file = one.partition("=")
        if name not in DESCRIPTIONS or not Path(file).is_file():
            parser.error(f"{one!r}: must be one of {', '.join(DESCRIPTIONS)}, then = and its file")
        robot, tree = load_robot(name), Tree(Path(file), DESCRIPTIONS[name])
        if asked.bodies:
            print(f"# {name}")
            for joint, mass, (x, y, z) in bodies(robot, tree):
                at = ", ".join(f"{round(1000 * value, 2) + 0:g}" for value in (x, y, z))
                print(f'[[bodies]]\njoint = "{joint}"\nmass_kg = {mass:.4g}\ncom_mm = [{at}]\n')
            continue
        truth, wrong, apart = checked(robot, tree)
        loaded = truth > _NONE
        share = [f"{100 * w / t:.2g}" if on else "–" for t, w, on in zip(truth, wrong, loaded, strict=True)]
        far |= bool((wrong > _MOST * truth)[loaded].any())
        loads = " ".join(f"{one:.2g}" if on else "–" for one, on in zip(truth, loaded, strict=True))
        print(f"| {name} | {1000 * apart:.1f} mm | {loads} N·m | {' '.join(share)} % |")
    return int(far)


if __name__ == "__main__":
    sys.exit(main())
