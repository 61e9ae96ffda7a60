"""Bodies of shipped arms against their makers' meshes: ``python -m benchmarks.true_bodies FOLDER [NAME…]``.

The folder holds, side by side, what the makers publish of their arms (``MAKERS`` has the files):
``Simulation`` of TheRobotStudio/SO-ARM100; Universal_Robots_ROS2_Description, as ``ur_description``;
``interbotix_xsarm_descriptions`` of Interbotix/interbotix_ros_manipulators; ``open_manipulator_description``
of ROBOTIS-GIT/open_manipulator; ``kinova_description`` of Kinovarobotics/kinova-ros;
ohlr/braccio_arduino_ros_rviz; ``PAROL6_URDF`` of PCrnjak/PAROL6-Desktop-robot-arm;
``annin_ar4_description`` of ycheng517/ar4_ros_driver; ``koch`` of the package mani_skill.
Nothing of them is kept here.

Their visual meshes are placed in the links of the shipped arms: a maker's joint angle is a zero and a sense
times ours, and the base is turned and shifted so that all axes agree as well as they can. The first table
tells how well. At random poses, and on random motions, with the gripper at random openings, the check of a
motion is held against FCL (python-fcl) on all triangles, and against the floor. Neighbours do not count, nor
do links that cut each other in the home or the rest pose. Of what is called clear *missed* truly touches;
of what is truly clear *refused* is called touching.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, Self

import numpy as np
from benchmarks.self_collisions import Meshes, places_between, random_ends
from scipy.spatial import ConvexHull

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.kinematics.frames import LinkFrames
from armctl.kinematics.samples import joint_samples
from armctl.motion import PointToPoint, preflight
from armctl.motion.clearance import FLOOR_TOLERANCE_M, sources
from armctl.robot import Robot
from armctl.robot.body.meshes import solid_of
from armctl.robot.parts import Look
from armctl.robot.urdf.elements import read_urdf_file
from armctl.robot.urdf.package import UrdfSource
from armctl.robot.urdf.tree import UrdfJoint, UrdfTree

Kind = Literal["self-collision", "floor"]
Pair = tuple[int, int]
KINDS: tuple[Kind, ...] = ("self-collision", "floor")
_LIFTS_M = 1e-4
"""A link whose height changes less is lifted by no joint."""
_OPENINGS = 20
"""of the gripper that are tried"""
_MOST_SHOWN = 5


@dataclass(frozen=True)
class Maker:
    """How a maker's description stands to the shipped arm."""

    file: str
    """in the folder"""
    joints: tuple[str, ...]
    """in the order of ours"""
    senses: tuple[int, ...]
    zeros_deg: tuple[float, ...]
    """the maker's angles where ours are 0"""
    jaws: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """joints of the gripper: closed and open [m or rad]"""
    arguments: Mapping[str, str] = field(default_factory=dict[str, str])
    """of its xacro file"""
    base_mm: float = 0.0
    """how far what stands still is lowered, where the file has it too high for its own parts"""


_SO = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
MAKERS = {
    "ur5": Maker(
        "ur_description/urdf/ur.urdf.xacro",
        (
            "shoulder_pan_joint",
            "shoulder_lift_joint",
            "elbow_joint",
            "wrist_1_joint",
            "wrist_2_joint",
            "wrist_3_joint",
        ),
        (1, 1, 1, 1, 1, 1),
        (0, 0, 0, 0, 0, 0),
        arguments={"ur_type": "ur5", "name": "ur5"},
    ),
    "pincherx100": Maker(
        "interbotix_xsarm_descriptions/urdf/px100.urdf.xacro",
        ("waist", "shoulder", "elbow", "wrist_angle"),
        (1, 1, 1, 1),
        (0, 0, 0, 0),
        {"left_finger": (0.015, 0.037), "right_finger": (-0.015, -0.037)},
    ),
    "open_manipulator_x": Maker(
        "open_manipulator_description/urdf/open_manipulator_x/open_manipulator_x.urdf.xacro",
        ("joint1", "joint2", "joint3", "joint4"),
        (1, 1, 1, 1),
        (0, 0, 0, 0),
        {"gripper_left_joint": (-0.009, 0.02), "gripper_right_joint": (-0.009, 0.02)},
        base_mm=17.0,
    ),
    "parol6": Maker(
        "PAROL6_URDF/PAROL6/urdf/PAROL6.urdf",
        ("L1", "L2", "L3", "L4", "L5", "L6"),
        (1, 1, -1, -1, -1, -1),
        (0, 90, 180, 0, 0, 180),
    ),
    "mico": Maker(
        "kinova_description/urdf/m1n4s200_standalone.xacro",
        ("m1n4s200_joint_1", "m1n4s200_joint_2", "m1n4s200_joint_3", "m1n4s200_joint_4"),
        (-1, -1, 1, -1),
        (0, 90, -90, 0),
        {"m1n4s200_joint_finger_1": (1.36, 0.0), "m1n4s200_joint_finger_2": (1.36, 0.0)},
    ),
    "ar4": Maker(
        "annin_ar4_description/urdf/ar.urdf.xacro",
        ("joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"),
        (-1, 1, 1, 1, 1, 1),
        (0, 0, 0, 0, 0, 0),
        arguments={"ar_model": "mk3", "include_gripper": "false"},
    ),
    "braccio": Maker(
        "braccio_arduino_ros_rviz/urdf/braccio_arm.urdf",
        ("base_joint", "shoulder_joint", "elbow_joint", "wrist_pitch_joint", "wrist_roll_joint"),
        (1, 1, 1, 1, -1),
        (90, 90, 90, 90, 0),
        {"gripper_joint": (1.274, 0.175), "sub_gripper_joint": (1.274, 0.175)},
    ),
    "so100": Maker(
        "Simulation/SO100/so100.urdf",
        _SO,
        (1, 1, 1, 1, -1),
        (0, -166.859, 179.993, -32.702, 0),
        {"gripper": (-0.2, 1.745)},
    ),
    "so101": Maker(
        "Simulation/SO101/so101_new_calib.urdf",
        _SO,
        (1, 1, 1, 1, 1),
        (0, 0, 0, 0, 0),
        {"gripper": (-0.175, 1.745)},
    ),
    "koch": Maker(
        "koch/follower_arm_v1.1.urdf",
        ("joint_1", "joint_2", "joint_3", "joint_4", "joint_5"),
        (1, 1, 1, 1, 1),
        (0, 0, 0, 0, 0),
        {"joint_6": (0, 1.6)},
    ),
    "widowx250s": Maker(
        "interbotix_xsarm_descriptions/urdf/wx250s.urdf.xacro",
        ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate"),
        (1, 1, 1, 1, 1, 1),
        (0, 0, 0, 0, 0, 0),
        {"left_finger": (0.015, 0.037), "right_finger": (-0.015, -0.037)},
    ),
}


class TrueArm:
    """A maker's meshes in the links of the shipped arm."""

    def __init__(self, folder: Path, robot: Robot) -> None:
        self.robot, self.maker = robot, MAKERS[robot.name]
        self._source = UrdfSource.at(folder / self.maker.file)
        self._tree: UrdfTree = read_urdf_file(self._source, self.maker.arguments)
        self._joints = tuple(self._tree.below(self._tree.root))
        self._corners = {name: self._read(name) for name in self._tree.links}
        limits = robot.limits
        children = {joint.name: joint.child for joint in self._joints}
        self._turned = [children[name] for name in self.maker.joints]
        self._poses = np.random.default_rng(0).uniform(limits[:, 0], limits[:, 1], (20, robot.n))
        self._T_base = self._fitted_base()

    def _read(self, link: str) -> FloatArray:
        """Triangles (t, 3, 3) [m] of what is drawn of a link of the file, in its frame."""
        found = [np.empty((0, 3, 3))]
        for shape in self._tree.links[link].visual:
            file = self._source.find(shape.file) if shape.kind == "mesh" else None
            if file is not None:
                solid = solid_of(replace(shape, file=str(file)))
                found.append(solid.vertices[solid.faces])
            elif shape.kind == "mesh":
                raise FileNotFoundError(f"{self.maker.file}: {shape.file}")
        return np.concatenate(found)

    def _placed(self, q: FloatArray, opening: float) -> dict[str, FloatArray]:
        """Poses (4, 4) of all links of the file, in its root, at our ``q`` (n,) [rad]."""
        maker = self.maker
        theirs = np.radians(maker.zeros_deg) + q * maker.senses
        angles: dict[str, float] = dict(zip(maker.joints, theirs.tolist(), strict=True))
        angles |= {name: low + opening * (high - low) for name, (low, high) in maker.jaws.items()}
        placed = {self._tree.root: np.eye(4)}
        for joint in self._joints:
            placed[joint.child] = placed[joint.parent] @ joint.origin @ _moved(joint, angles.get(joint.name))
        return placed

    def _axes(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points and directions (n, 3) of the joints' axes in the file's root."""
        placed = self._placed(q, 0.0)
        joints = {joint.name: joint for joint in self._joints}
        found = [joints[name] for name in self.maker.joints]
        points = np.array([placed[joint.child][:3, 3] for joint in found])
        return points, np.array(
            [
                sense * placed[joint.child][:3, :3] @ joint.axis
                for sense, joint in zip(self.maker.senses, found, strict=True)
            ]
        )

    def _pairs_of_axes(self) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
        """Points and directions of our axes and of theirs, (n, 3) each, at some poses."""
        for q in self._poses:
            links = LinkFrames.at(self.robot.chain, q[None])
            ours = [links.pose(j) for j in range(self.robot.n)]
            points = np.array([origin[:, 0] for _, origin in ours])
            yield points, np.array([R[:, 2, 0] for R, _ in ours]), *self._axes(q)

    def _fitted_base(self) -> FloatArray:
        """Their root (4, 4) in our base frame: axes have the same directions, and lie in the same lines."""
        ours, directions, theirs, others = (
            np.concatenate(one) for one in zip(*self._pairs_of_axes(), strict=True)
        )
        U, _, Vt = np.linalg.svd(directions.T @ others)
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
        lacks = (across @ (ours - theirs @ R.T)[:, :, None]).reshape(-1)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, np.linalg.lstsq(across.reshape(-1, 3), lacks, rcond=None)[0]
        return T

    def beside(self) -> tuple[FloatArray, FloatArray]:
        """How far each axis lies beside ours [mm], and leans [degrees], at most: (n,) each."""
        R, t = self._T_base[:3, :3], self._T_base[:3, 3]
        away, leans = list[FloatArray](), list[FloatArray]()
        for ours, directions, theirs, others in self._pairs_of_axes():
            away.append(np.linalg.norm(np.cross(theirs @ R.T + t - ours, directions), axis=1))
            leans.append(np.linalg.norm(np.cross(others @ R.T, directions), axis=1))
        return 1000 * np.max(away, axis=0), np.degrees(np.arcsin(np.minimum(np.max(leans, axis=0), 1.0)))

    @cached_property
    def carriers(self) -> dict[str, int]:
        """Which of our links carries each link of the file; -1: the base."""
        order, found = list(self.maker.joints), {self._tree.root: -1}
        for joint in self._joints:
            found[joint.child] = order.index(joint.name) if joint.name in order else found[joint.parent]
        return found

    def in_links(self, opening: float) -> dict[str, FloatArray]:
        """Poses (4, 4) of the file's links in ours, with the gripper open so far, 0 to 1.

        What an axis turns is shifted aside with it, so that it turns about ours.
        """
        home = self.robot.pose("home")
        links, placed = LinkFrames.at(self.robot.chain, home[None]), self._placed(home, opening)
        found = dict[str, FloatArray]()
        for name, link in self.carriers.items():
            R, origin = links.pose(link)
            back = np.eye(4)
            back[:3, :3], back[:3, 3] = R[:, :, 0].T, -R[:, :, 0].T @ origin[:, 0]
            T = back @ self._T_base
            if link < 0:
                T[2, 3] -= self.maker.base_mm / 1000
            else:
                T[:2, 3] -= (T @ placed[self._turned[link]])[:2, 3]
            found[name] = T @ placed[name]
        return found

    @property
    def base_height(self) -> float:
        """Of the lowest point of what no joint lifts, base frame [m]: some files hang the base on a joint."""
        placed = self.triangles(0.0, only={-1, 0})
        links = LinkFrames.at(self.robot.chain, self.robot.pose("home")[None])
        return min(float(links.place(link, one.reshape(-1, 3))[2].min()) for link, one in placed.items())

    @cached_property
    def hands(self) -> set[int]:
        """Our links that carry jaws."""
        return {self.carriers[joint.child] for joint in self._joints if joint.name in self.maker.jaws}

    def triangles(self, opening: float, only: Container[int] | None = None) -> dict[int, FloatArray]:
        """Of each of our links, or some, all triangles (t, 3, 3) [m], in its frame."""
        found = dict[int, list[FloatArray]]()
        for name, T in self.in_links(opening).items():
            link, corners = self.carriers[name], self._corners[name]
            if len(corners) and (only is None or link in only):
                found.setdefault(link, []).append(corners @ T[:3, :3].T + T[:3, 3])
        return {link: np.concatenate(one) for link, one in found.items()}


def _moved(joint: UrdfJoint, angle: float | None) -> FloatArray:
    """(4, 4) what a joint of a file does to its child."""
    T = np.eye(4)
    if angle is None:
        return T
    if joint.kind == "prismatic":
        T[:3, 3] = angle * joint.axis
        return T
    x, y, z = joint.axis.tolist()
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    T[:3, :3] += math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
    return T


class Truth:
    """What an arm truly touches, with its gripper at one opening: pairs of links, the floor is -1."""

    def __init__(self, robot: Robot, triangles: Mapping[int, FloatArray]) -> None:
        self.robot, self.meshes = robot, Meshes(robot, triangles)
        self._probes = LinkFrames.at(robot.chain, joint_samples(robot.limits, 24))
        self.lifted = dict(self._lifts(triangles))
        """corners (k, 3) [m] of the hulls of links that joints lift"""

    def _lifts(self, triangles: Mapping[int, FloatArray]) -> Iterator[tuple[int, FloatArray]]:
        for link, one in triangles.items():
            points = one.reshape(-1, 3)
            corners = points[ConvexHull(points).vertices]
            if link >= 0 and np.ptp(self._probes.place(link, corners)[2].min(axis=0)) > _LIFTS_M:
                yield link, corners

    def changed(self, triangles: Mapping[int, FloatArray]) -> Self:
        """The same with other triangles of some links."""
        other = copy(self)
        other.meshes = self.meshes.changed(triangles)
        other.lifted = self.lifted | dict(self._lifts(triangles))
        return other

    def touched(self, q: FloatArray) -> dict[Kind, set[Pair]]:
        """At any of ``q`` (m, n) [rad]."""
        links = LinkFrames.at(self.robot.chain, q)
        return {
            "self-collision": self.meshes.cut(q),
            "floor": {
                (-1, link)
                for link, corners in self.lifted.items()
                if links.place(link, corners)[2].min() < self.robot.floor_z - FLOOR_TOLERANCE_M
            },
        }


def verdict(robot: Robot, q: FloatArray, opening: float) -> list[dict[Kind, str]]:
    """The parts that armctl says touch, of each kind, at each of ``q`` (m, n) [rad]; empty: none."""
    robot = robot.gripping(opening)
    links, model, found = robot.body_frames(q), robot.collision, [dict[Kind, str]() for _ in q]
    for source in sources(robot):
        if source.kind == "obstacle":
            continue
        gaps = source.gaps(links)
        lacks = gaps - source.closed[:, None] + FLOOR_TOLERANCE_M < 0.0
        for k, one in enumerate(found):
            part = int(np.where(lacks[:, k], gaps[:, k], np.inf).argmin()) if lacks[:, k].any() else -1
            other = "" if source.kind == "floor" else f", {model.capsules[model.pairs[part][0]].part}"
            one[source.kind] = "" if part < 0 else source.parts[part] + other
    return found


def refused(robot: Robot, a: FloatArray, b: FloatArray, opening: float) -> dict[Kind, str]:
    """As ``verdict``, of a motion of the joints."""
    findings = preflight(robot.gripping(opening), PointToPoint.plan(robot, a, b))
    said = {one.kind: re.sub(r"[\d.]+ mm ", "", f"{one.part}: {one.what}") for one in findings}
    return {kind: said.get(kind, "") for kind in KINDS}


class Count:
    """Of one kind of trial."""

    def __init__(self) -> None:
        self._outcomes = {kind: Counter[tuple[bool, bool]]() for kind in KINDS}
        self.missed, self.false = Counter[str](), Counter[str]()

    def add(self, truly: Mapping[Kind, set[Pair]], said: Mapping[Kind, str]) -> None:
        """One trial: what truly touches, and what is said."""
        for kind in KINDS:
            self._outcomes[kind][bool(truly[kind]), bool(said[kind])] += 1
            if truly[kind] and not said[kind]:
                self.missed.update(f"{kind}: {pair}" for pair in truly[kind])
            elif said[kind] and not truly[kind]:
                self.false[f"{kind}: {said[kind]}"] += 1

    def row(self) -> str:
        """Of each kind: true hits, how many were called clear, of what share that is, and what is refused."""
        cells: list[str] = []
        for kind in KINDS:
            outcomes = self._outcomes[kind]
            hits, missed, false = outcomes[True, True], outcomes[True, False], outcomes[False, True]
            clear = outcomes[False, False]
            cells += [
                f"{hits + missed} | {missed} ({100 * missed / max(missed + clear, 1):.2f} %)",
                f"{false} ({100 * false / max(false + clear, 1):.1f} %)",
            ]
        return " | ".join(cells)


def tried(true: TrueArm, robot: Robot, poses: int, motions: int, seed: int) -> tuple[Count, Count]:
    """Random poses, and random motions that begin where nothing touches."""
    rng, found = np.random.default_rng(seed), (Count(), Count())
    low, high = robot.limits[:, 0], robot.limits[:, 1]
    openings = rng.uniform(size=_OPENINGS).round(2).tolist() if true.maker.jaws else [0.0]
    closed = Truth(robot, true.triangles(0.0))
    for opening in openings:
        truth = closed.changed(true.triangles(opening, only=true.hands))
        q = rng.uniform(low, high, (poses // len(openings), robot.n))
        for one, said in zip(q, verdict(robot, q, opening), strict=True):
            found[0].add(truth.touched(one[None]), said)
        left = motions // len(openings)
        while left:
            a, b = random_ends(robot, rng)
            if not any(truth.touched(a[None]).values()):
                found[1].add(truth.touched(places_between(a, b)), refused(robot, a, b, opening))
                left -= 1
    return found


def told(true: TrueArm, *, transforms: bool) -> Iterator[str]:
    """How the axes agree, how the base stands, and where the maker's links are in ours."""
    away, leans = true.beside()
    lowest = 1000 * (true.base_height - true.robot.floor_z)
    beside = ", ".join(f"{one:.2f}" for one in away)
    yield f"| {true.robot.name} | {beside} | {leans.max():.2f} | {lowest:.1f} |"
    for name, T in true.in_links(0.0).items() if transforms else ():
        turn = np.degrees(rpy(T[:3, :3]))
        yield (
            f"  {name} in link {true.carriers[name]}: {(1000 * T[:3, 3]).round(2).tolist()} mm, "
            f"roll, pitch, yaw {turn.round(2).tolist()}°"
        )


def rpy(R: FloatArray) -> FloatArray:
    """Roll, pitch and yaw (3,) [rad] of a rotation, as URDF files have them."""
    pitch = math.atan2(-R[2, 0], math.hypot(R[2, 1], R[2, 2]))
    return np.array([math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])])


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.true_bodies", description=__doc__)
    parser.add_argument("folder", type=Path, help="with the makers' descriptions")
    parser.add_argument("names", nargs="*", default=list(MAKERS), help="arms; left out: all")
    parser.add_argument("--poses", type=int, default=2000)
    parser.add_argument("--motions", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--guessed", action="store_true", help="with looks that are guessed")
    parser.add_argument("--transforms", action="store_true", help="where the makers' links are in ours")
    options = parser.parse_args()
    arms = [TrueArm(options.folder, load_robot(name)) for name in options.names]
    print("| arm | axes beside ours, mm | lean, ° | base above the floor, mm |\n|---|---|--:|--:|")
    for true in arms:
        print("\n".join(told(true, transforms=options.transforms)))
    kinds = " | ".join(f"{kind}: true hits | missed | refused" for kind in KINDS)
    print(f"\n| arm | | {kinds} |\n|---|---|{'--:|' * 6}")
    for true in arms:
        robot = replace(true.robot, look=Look()) if options.guessed else true.robot
        for what, count in zip(
            ("poses", "motions"),
            tried(true, robot, options.poses, options.motions, options.seed),
            strict=True,
        ):
            print(f"| {robot.name} | {what} | {count.row()} |")
            for title, names in (("missed", count.missed), ("refused", count.false)):
                for name, times in names.most_common(_MOST_SHOWN):
                    print(f"    {title} {times} × {name}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
