"""A calibration in the making: marks, safe limits, gripper, known points, saving. Shared by all pages."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import msgspec
import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration import (
    LEAST_MARKS,
    LEAST_POINTS,
    Calibration,
    JointCalibration,
    JointFit,
    Mark,
    Touches,
    TouchFit,
    Version,
    changes,
    fit_joint,
    fit_touches,
    iso_time,
    narrowed,
    own_calibration,
    own_map,
    safe_outputs,
    suggestion,
)
from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts import State
from armctl.facts.angles import DEGREE, to_degrees
from armctl.hardware import Source
from armctl.protocol import Snapshot, wall_time
from armctl.robot import OutputMap, Robot
from armctl.ui.console import CalibrationInForce, Console

_LARGEST_ANGLE = 720.0 * DEGREE
_FARTHEST_M = 10.0
_APART = 1.0
"""outputs that differ by less are one place"""
End = Literal["low", "high"]
Jaw = Literal["closed", "open"]
WorkOut = Callable[..., Awaitable[Any]]
"""calls a function with arguments on a thread, as ``asyncio.to_thread`` does"""


@dataclass(frozen=True, slots=True)
class JointWork:
    """Marks and limits of one joint. Outputs are in the board's unit."""

    marks: tuple[Mark, ...] = ()
    low: float | None = None
    """smallest output that is safe; None: not set by hand"""
    high: float | None = None
    by_default: bool = False
    """the safe outputs in force do not hold for it any more"""


class CalibrationWork:
    """What was measured of a robot, on top of the calibration that it runs by."""

    def __init__(self, robot: Robot, in_force: Calibration | None) -> None:
        """Begin without a mark; ``robot`` is as its file describes it."""
        self.robot, self.in_force = robot, in_force
        self.jaws: dict[Jaw, float] = {}
        """outputs of the gripper that were set"""
        self._joints: dict[str, JointWork] = {}
        self.chosen = next((one.name for one in robot.joints if one.lower < one.upper), robot.joint_names[0])
        """name of the joint that is being calibrated"""
        self.version = 0
        """rises with every change, so that a page knows when to draw anew"""

    @property
    def map(self) -> OutputMap:
        """The map of the robot file; refuses a robot without one."""
        return own_map(self.robot)

    def choose(self, joint: str) -> None:
        """Go on with another joint."""
        if joint != self.chosen:
            self.chosen = joint
            self.version += 1

    def joint(self, joint: str) -> JointWork:
        """Marks and limits of a joint."""
        return self._joints.get(joint, JointWork())

    @property
    def unfinished(self) -> tuple[str, ...]:
        """Titles of the joints whose marks are too few to be used."""
        return tuple(
            one.title for one in self.robot.joints if 0 < len(self.joint(one.name).marks) < LEAST_MARKS
        )

    def add_mark(self, joint: str, output: float, angle: float) -> None:
        """Note that the joint stood at ``angle`` [rad] when its output was ``output``."""
        if not math.isfinite(angle) or abs(angle) > _LARGEST_ANGLE:
            raise InputError(
                f"{to_degrees(angle):g}° is outside ±{to_degrees(_LARGEST_ANGLE):g}°; type the "
                "angle that the protractor shows"
            )
        marks, mark = self.joint(joint).marks, Mark(output, angle)
        if mark in marks:
            raise InputError(
                f"mark {marks.index(mark) + 1} says the same already ({output:.1f} {self.map.unit}, "
                f"{to_degrees(angle):g}°); jog the joint to another place"
            )
        self._set(joint, marks=(*marks, mark))

    def delete_mark(self, joint: str, index: int) -> None:
        """Take a mark away, from 0."""
        marks = self.joint(joint).marks
        if not 0 <= index < len(marks):
            raise InputError(f"there is no mark {index + 1} of {joint}; it has {len(marks)}")
        self._set(joint, marks=marks[:index] + marks[index + 1 :])

    def fit(self, joint: str) -> JointFit | None:
        """The line through the marks of a joint; None: there are too few."""
        marks = self.joint(joint).marks
        return None if len(marks) < LEAST_MARKS else fit_joint(marks, self.map.unit)

    def limits(self, joint: str) -> tuple[float, float]:
        """Smallest and largest safe output: as set here by hand, else as in force, or by new marks."""
        work, now = self.joint(joint), self._in_force(joint)
        if work.low is not None and work.high is not None:
            return work.low, work.high
        line, kept = self.fit(joint), None if work.by_default else now
        if line is not None:
            low, high = safe_outputs(self.robot, joint, line, kept)
        elif now is not None and kept is None:
            low, high = safe_outputs(self.robot, joint, now)
        else:
            one = kept or own_calibration(self.robot, joint)
            low, high = one.low, one.high
        return (low if work.low is None else work.low, high if work.high is None else work.high)

    def set_limit(self, joint: str, end: End, output: float) -> None:
        """Say that ``output`` is as far as the joint may ever go."""
        (low, high), unit = self.limits(joint), self.map.unit
        word, other, there = ("lower", "upper", high) if end == "low" else ("upper", "lower", low)
        if output >= high if end == "low" else output <= low:
            raise InputError(
                f"{output:.1f} {unit} cannot be the {word} limit, the {other} one is {there:.1f} {unit}; jog "
                "the joint to the other end"
            )
        self._set(joint, **{end: output})

    def limited(self, joint: str) -> bool:
        """Whether its limits are others than all that the robot file allows."""
        work = self.joint(joint)
        by_hand = work.low is not None or work.high is not None
        return by_hand or (not work.by_default and self._in_force(joint) is not None)

    def limits_by_default(self, joint: str) -> None:
        """Let the joint have all that the robot file allows: whatever was set by hand holds no more."""
        self._set(joint, low=None, high=None, by_default=True)

    def set_jaw(self, jaw: Jaw, output: float) -> None:
        """Say at which output the gripper is closed, or open."""
        other: Jaw = "open" if jaw == "closed" else "closed"
        there = self.jaw(other)
        if abs(there - output) < _APART:
            raise InputError(
                f"the gripper is {other} at {there:.1f} {self.map.unit}; move it before you call it {jaw}"
            )
        self.jaws[jaw] = output
        self.version += 1

    def jaw(self, jaw: Jaw) -> float:
        """Output at which the gripper is closed, or open: as set here, else as in force."""
        now = self.in_force and self.in_force.gripper
        closed, opened = now or (self.map.gripper_closed, self.map.gripper_open)
        return self.jaws.get(jaw, closed if jaw == "closed" else opened)

    @property
    def is_empty(self) -> bool:
        """Whether no mark, limit or jaw was set."""
        return not self.jaws and all(work == JointWork() for work in self._joints.values())

    def clear(self) -> None:
        """Forget every mark, limit and jaw."""
        self._joints, self.jaws = {}, {}
        self.version += 1

    def take_over(self, other: CalibrationWork) -> None:
        """Go on with what was measured before the arm was opened anew."""
        self._joints, self.jaws, self.chosen = dict(other._joints), dict(other.jaws), other.chosen
        self.version += 1

    def measured(self) -> dict[str, JointCalibration]:
        """The calibration of each joint with new marks or limits."""
        found: dict[str, JointCalibration] = {}
        for name in self.robot.joint_names:
            work, line = self.joint(name), self.fit(name)
            if line is None and work != JointWork(work.marks):
                line = self._in_force(name) or own_calibration(self.robot, name)
            if line is not None:
                found[name] = JointCalibration(line.zero, line.per_rad, *self.limits(name))
        return found

    def _in_force(self, joint: str) -> JointCalibration | None:
        return self.in_force and self.in_force.joints.get(joint)

    def _set(self, joint: str, **changes: object) -> None:
        self._joints[joint] = replace(self.joint(joint), **changes)
        self.version += 1


@dataclass(frozen=True, slots=True)
class TouchedPoint:
    """The tool stood on a point."""

    outputs: Mapping[int, float]
    """by channel, in the board's unit: they stay true when the calibration changes"""
    point_m: tuple[float, float, float]
    """in the base frame [m]"""


class TouchedPoints:
    """The touches so far. Used on the web server's event loop only."""

    def __init__(self, robot: Robot, calibrated: Collection[str] = ()) -> None:
        """``robot``: as the arm runs; ``calibrated``: the joints that the calibration in force covers."""
        self._robot, self._calibrated = robot, calibrated
        self.touches: tuple[TouchedPoint, ...] = ()
        """in the order in which they were made"""
        self.result: TouchFit | str | None = None
        """the tool error, or why there is none, in words; None: too few points, or not known yet"""
        self.version = 0
        """rises with every change, so that a page knows when to draw anew"""

    @property
    def distances_m(self) -> FloatArray:
        """(k,) from each point to where the arm believes the tool to be [m]."""
        if not self.touches:
            return np.zeros(0)
        points = np.array([touch.point_m for touch in self.touches])
        return np.linalg.norm(points - self._robot.forward(self._angles())[:, :3, 3], axis=1)

    def add(self, outputs: Mapping[int, float], point_m: FloatArray) -> None:
        """Note that the tool touches a point (3,) [m]."""
        if not (np.isfinite(point_m).all() and np.linalg.norm(point_m) < _FARTHEST_M):
            raise InputError(f"a point is less than {_FARTHEST_M:.0f} m from the base; give X, Y, Z in mm")
        x, y, z = point_m.tolist()
        self._set((*self.touches, TouchedPoint(dict(outputs), (x, y, z))))

    def delete(self, index: int) -> None:
        """Take a touch away, from 0."""
        if not 0 <= index < len(self.touches):
            raise InputError(f"there is no point {index + 1}; there are {len(self.touches)}")
        self._set(self.touches[:index] + self.touches[index + 1 :])

    def take_over(self, other: TouchedPoints) -> None:
        """Go on with the touches of another one."""
        self._set(other.touches)

    def go_back(self, touches: tuple[TouchedPoint, ...], now: tuple[TouchedPoint, ...]) -> bool:
        """Have ``touches`` again in place of ``now``; not where somebody has changed them since."""
        if self.touches is not now:
            return False
        self._set(touches)
        return True

    @property
    def suggestion(self) -> str:
        """What to write where by the result; empty where there is none."""
        result = self.result
        return suggestion(changes(result, self._calibrated)) if isinstance(result, TouchFit) else ""

    async def compute(self, work_out: WorkOut = asyncio.to_thread) -> None:
        """Compute the tool error off the event loop, unless it is known or there are too few points.

        ``work_out`` does so. What it raises but an ``ArmctlError`` leaves the touches without a result.
        """
        touches = self.touches
        if len(touches) < LEAST_POINTS or self.result is not None:
            return
        q, points = self._angles(), np.array([touch.point_m for touch in touches])
        try:
            given = Touches.checked(self._robot, q, points)
            result: TouchFit | str = await work_out(fit_touches, self._robot, given)
        except ArmctlError as error:
            result = str(error)
        if self.touches is touches:  # else they have changed meanwhile, and are computed anew
            self._set(touches, result)

    def _set(self, touches: tuple[TouchedPoint, ...], result: TouchFit | str | None = None) -> None:
        self.touches, self.result = touches, result
        self.version += 1

    def _angles(self) -> FloatArray:
        """(k, n) [rad]."""
        outputs = own_map(self._robot)
        return np.array([outputs.angles(touch.outputs) for touch in self.touches])


class SharedCalibration:
    """In force, measured since, and saved. Used on the web server's event loop only."""

    def __init__(self, in_force: CalibrationInForce, now: Callable[[], float] = wall_time) -> None:
        """Begin without a mark; ``now`` gives seconds since the epoch."""
        self._kept, self._now = in_force, now
        self.board, self.in_force = in_force.board, in_force.calibration
        self.work = CalibrationWork(in_force.file_robot, self.in_force)
        self.points = TouchedPoints(in_force.robot, self.in_force.joints if self.in_force else ())

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Go on with what was measured before the same arm was opened anew."""
        made = cls(console.calibration)
        if before is not None:
            made.adopt(before)
        return made

    def adopt(self, other: SharedCalibration) -> None:
        """Go on with what was measured before, if that is of the same arm on the same board."""
        key = (self.work.robot.name, self.board)
        if self.board is not None and key == (other.work.robot.name, other.board):
            self.work.take_over(other.work)
            self.points.take_over(other.points)

    def draft(self, note: str = "") -> Calibration:
        """The calibration in force with what was measured in its place."""
        board, work, before = self._require_board(), self.work, self.in_force
        joints = {**(before.joints if before else {}), **work.measured()}
        gripper = (work.jaw("closed"), work.jaw("open")) if work.jaws else before and before.gripper
        if not joints and gripper is None:
            hint = f" ({', '.join(work.unfinished)}: too few marks)" if work.unfinished else ""
            raise StateError(
                f"there is nothing to save yet{hint}: a joint needs three marks, or a safe limit set by hand"
            )
        if before is not None and (joints, gripper) == (before.joints, before.gripper):
            raise StateError("everything is saved: nothing differs from the calibration in force")
        made = iso_time(self._now())
        drawn = before or Calibration(work.robot.name, board, work.map.unit, {})
        drawn = msgspec.structs.replace(drawn, joints=joints, gripper=gripper, made=made, note=note)
        narrowed(work.robot, drawn)
        return drawn

    async def save(self, note: str) -> Version:
        """Save the draft; the arm goes by it once it is opened anew."""
        return await asyncio.to_thread(self._save, self.draft(note))

    def _save(self, drawn: Calibration) -> Version:
        if self._kept.is_overtaken():
            raise StateError(
                f"another calibration of this arm on board {self.board} was saved since it was opened; press "
                "Disconnect and Connect on the tab Main to go by it (the marks stay), then save"
            )
        return self._kept.store.save(drawn)

    def versions(self) -> tuple[Version, ...]:
        """What was saved of this arm on this board, the newest first."""
        return () if self.board is None else self._kept.store.versions(self.work.robot.name, self.board)

    def require_revertable(self, number: int | None) -> str:
        """The board; ``StateError`` where this version cannot come in force again."""
        board = self._require_board()
        if number is None and self.in_force is None:
            raise StateError("the robot file is in force already: nothing to go back from")
        return board

    async def revert(self, number: int | None) -> Version:
        """Bring an earlier version in force again; None: the robot file as it is."""
        board, robot, store = self.require_revertable(number), self.work.robot, self._kept.store
        if number is None:
            made = iso_time(self._now())
            return await asyncio.to_thread(store.forget, robot.name, board, made, self.work.map.unit)
        for version in self.versions():
            if version.number == number and version.calibration is not None:
                narrowed(robot, version.calibration)  # else the arm could not be opened any more
        return await asyncio.to_thread(store.revert, robot.name, board, number)

    def _require_board(self) -> str:
        if self.board is None:
            what = "no board was found for this arm yet, so there is none to keep a calibration for"
            raise StateError(f"{what}; connect it first")
        return self.board


# Where the arm stands: a mark or a touch is taken there.


def present_outputs(robot: Robot, snapshot: Snapshot) -> dict[int, float]:
    """Output of every joint by channel, in the board's unit: as the board reports it, else as last told."""
    unknown = np.isnan(snapshot.q)
    if unknown.any() and snapshot.limp:
        raise StateError(f"nobody knows where {', '.join(snapshot.limp)} stands; enable the arm first")
    if unknown.any() and not snapshot.commanded:
        if snapshot.source is Source.MEASURED:
            raise StateError("the board does not know where every joint stands; home the arm first")
        raise StateError(
            f"the arm is {snapshot.state.value}, so nobody knows where it stands; connect and enable it first"
        )
    return own_map(robot).outputs(np.where(unknown, snapshot.q_command, snapshot.q))


def standing_outputs(robot: Robot, snapshot: Snapshot) -> dict[int, float]:
    """``present_outputs`` of an arm that stands still: a mark is taken there."""
    if snapshot.state in (State.MOVING, State.PAUSED):
        raise StateError("the arm is in the middle of a motion; wait until it stands, then press again")
    return present_outputs(robot, snapshot)


def standing_gripper(robot: Robot, snapshot: Snapshot) -> float:
    """Output of the gripper."""
    if snapshot.gripper is None:
        raise StateError("the gripper has not been told to move yet; press 'Move gripper' first")
    (output,) = own_map(robot).gripper_output(snapshot.gripper).values()
    return output
