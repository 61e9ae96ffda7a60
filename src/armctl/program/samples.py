"""Sample programs for any arm: they are fitted to its reach, and checked before they are offered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations, islice

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, ProgramError
from armctl.program.check import check_program
from armctl.program.program import Program
from armctl.program.steps import CommentStep, GripperStep, LineStep, MoveStep, PointStep, Step, WaitStep
from armctl.robot import Robot

_SIZES_MM = (80.0, 60.0, 40.0, 25.0, 15.0)
"""of a square, and of a way down; the first that passes the check is taken"""
_AROUND = (0.5, 0.35, 0.2, 0.0)
"""between the home pose (0) and the rest pose (1): where the middle of a sample lies"""
_TURN_RAD = 0.3
_MOST_WAYS = 20
"""of so many poses: each is checked, and an arm may have many poses"""


def sample_program(name: str, robot: Robot) -> Program:
    """The sample for this arm, a key of ``SAMPLES``; a ProgramError where none passes the check."""
    for steps in SAMPLES[name](robot):
        program = Program(robot=robot.name, name=name, steps=tuple(steps))
        try:
            findings = check_program(program, robot, start=robot.pose("home"))
        except ArmctlError:
            continue
        if not any(finding.severity == "error" for finding in findings):
            return program
    raise ProgramError(f"{name}: no size of it fits {robot.title}; record a program of your own")


def _poses(robot: Robot) -> Iterator[list[Step]]:
    """Home, as many of the other named poses as can be reached one after the other, and home again."""
    others = [name for name in robot.poses if name != "home"]
    for count in range(len(others), 0, -1):
        for names in islice(combinations(others, count), _MOST_WAYS):
            yield [_move(robot.pose(name), note=name) for name in ("home", *names, "home")]
    home, turned = robot.pose("home"), robot.pose("home")
    low, high = robot.limits[0]
    turned[0] += _TURN_RAD if high - home[0] > home[0] - low else -_TURN_RAD
    yield [_move(home), _move(turned, note=robot.joints[0].title), _move(home)]


def _square(robot: Robot) -> Iterator[list[Step]]:
    """An upright square, the tool led along its sides."""
    for start, middle in _middles(robot):
        across = np.array([-middle[1], middle[0], 0.0])
        length = float(np.linalg.norm(across))
        across = across / length if length > 1.0 else np.array([0.0, 1.0, 0.0])
        up = np.array([0.0, 0.0, 1.0])
        for size in _SIZES_MM:
            sides = (across, across + up, up, 0 * up)
            corners = [middle + size * side for side in sides]
            yield [_move(start, note="the first corner"), *(_line(corner) for corner in corners)]


def _pick_and_place(robot: Robot) -> Iterator[list[Step]]:
    """Pick at one point, place at another, and come back."""
    for start, middle in _middles(robot):
        for size in _SIZES_MM:
            down = np.array([0.0, 0.0, size])
            there = np.array([-size * middle[1], size * middle[0], 0.0]) / max(np.hypot(*middle[:2]), 1.0)
            pick, place = middle - there, middle + there
            yield [
                _move(start),
                *_grip(robot, 80.0),
                *(_point(pick, note="above the part"), _point(pick - down)),
                *_grip(robot, 20.0),
                *(_point(pick), _point(place, note="above its place"), _point(place - down)),
                *_grip(robot, 80.0),
                _point(place),
                _move(start),
            ]


SAMPLES: dict[str, Callable[[Robot], Iterator[list[Step]]]] = {
    "sample - named poses": _poses,
    "sample - square": _square,
    "sample - pick and place": _pick_and_place,
}


def _middles(robot: Robot) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Configurations (n,) [rad] between home and rest, with their tool points (3,) [mm]."""
    home, rest = robot.pose("home"), robot.pose("rest")
    for share in _AROUND:
        q = home + share * (rest - home)
        yield q, 1000 * robot.forward(q)[:3, 3]


def _move(q: FloatArray, note: str = "") -> MoveStep:
    return MoveStep(joints_deg=tuple(np.round(np.degrees(q), 9).tolist()), note=note)


def _line(point: FloatArray) -> LineStep:
    x, y, z = np.round(point, 1).tolist()
    return LineStep(x_mm=x, y_mm=y, z_mm=z, pitch="free")


def _point(point: FloatArray, note: str = "") -> PointStep:
    x, y, z = np.round(point, 1).tolist()
    return PointStep(x_mm=x, y_mm=y, z_mm=z, choose="least-travel", note=note)


def _grip(robot: Robot, percent: float) -> list[Step]:
    if robot.gripper is None:
        return [CommentStep(note=f"gripper to {percent:g} %, if it had one")]
    return [GripperStep(open_percent=percent), WaitStep(seconds=0.3)]
