"""Targets half a degree off what an arm of five joints can do: who still answers them.

Counted as answered by a peer: any configuration among those that it returns, joint limits aside, that
comes within 0.01 mm of the position and 0.6° of the orientation. For armctl the orientation must be the
nearest there is, so within 0.5°, and inside the limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from benchmarks.measure import Effort
from benchmarks.peers.eaik import Eaik
from benchmarks.peers.ik_geo import IkGeo
from benchmarks.peers.ikpy import Ikpy
from benchmarks.peers.roboticstoolbox import RoboticsToolbox
from benchmarks.planar_arm import ABAAS, SCORBOT, FloatArray, PlanarArm
from benchmarks.row import Goal, NotMeasuredError, Row

from armctl import Robot, load_robot

_OFF = math.radians(0.5)
_POSITION = 1e-5
_PEER = math.radians(0.6)
_OURS = _OFF + 1e-6
_PEERS = ((Eaik, 1000), (IkGeo, 1000), (RoboticsToolbox, 1000), (Ikpy, 200))
"""and how many targets of each arm they get in a full run: the numeric ones are slow where they fail"""

Answers = Callable[[FloatArray], FloatArray]


def rows(effort: Effort) -> Iterator[Row]:
    arms = [(load_robot("abaas"), ABAAS), (load_robot("scorbot"), SCORBOT)]
    targets = [(robot, _targets(robot, arm, effort.count(1000, least=20))) for robot, arm in arms]
    ours = float(np.mean([_share(robot, _inverse(robot), poses, _OURS) for robot, poses in targets]))
    for make, full in _PEERS:
        work, name, count = (
            "abaas + scorbot, targets 0.5° off the arm's own",
            make.name,
            effort.count(full, least=10),
        )
        goal = Goal("share", 1.0)
        try:
            shares = [_share(robot, make(robot).answers, poses[:count], _PEER) for robot, poses in targets]
        except NotMeasuredError as missing:
            yield Row(work, name, goal=goal, missing=str(missing))
        else:
            yield Row(work, f"{name}: {100 * float(np.mean(shares)):.1f} % answered", ratio=ours, goal=goal)


def _targets(robot: Robot, arm: PlanarArm, count: int) -> FloatArray:
    """(count, 4, 4) poses that the arm takes, turned out of its vertical plane by half a degree."""
    q = arm.random(np.random.default_rng(2016), count)
    poses = robot.forward(q)
    normal = np.stack([np.sin(q[:, 0]), -np.cos(q[:, 0]), np.zeros(count)], axis=1)
    in_plane = np.cross(normal, poses[:, :3, 2])  # across the tool, in the plane: leans the tool out of it
    off = np.array([_turned(axis, T[:3, :3]) for axis, T in zip(in_plane, poses, strict=True)])
    poses[:, :3, :3] = off
    return poses


def _turned(axis: FloatArray, rotation: FloatArray) -> FloatArray:
    """Rodrigues' formula for half a degree about a unit axis of the base frame."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (np.eye(3) + math.sin(_OFF) * K + (1.0 - math.cos(_OFF)) * K @ K) @ rotation


def _inverse(robot: Robot) -> Answers:
    return lambda pose: robot.inverse(pose[:3, 3], rotation=pose[:3, :3]).q


def _share(robot: Robot, answers: Answers, poses: FloatArray, within: float) -> float:
    return float(np.mean([_is_answered(robot, answers(pose), pose, within) for pose in poses]))


def _is_answered(robot: Robot, q: FloatArray, pose: FloatArray, within: float) -> bool:
    if not q.size:
        return False
    T = robot.forward(q)
    away = np.linalg.norm(T[:, :3, 3] - pose[:3, 3], axis=1)
    chord = np.linalg.norm(T[:, :3, :3] - pose[:3, :3], axis=(1, 2)) / math.sqrt(
        8.0
    )  # sine of half the angle
    turned = 2.0 * np.arcsin(np.minimum(chord, 1.0))
    return bool(((away < _POSITION) & (turned <= within)).any())
