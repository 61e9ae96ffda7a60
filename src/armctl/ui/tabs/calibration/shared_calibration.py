"""A calibration in the making: marks, safe limits, gripper, known points, saving. Shared by all pages."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Literal, Self

import msgspec
import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration import (
    LEAST_MARKS,
    LEAST_POINTS,
    Calibration,
    CheckPose,
    JointCalibration,
    JointFit,
    Mark,
    TouchedPoint,
    TouchesFile,
    TouchFit,
    Version,
    check_pose,
    corrected,
    fit_joint,
    iso_time,
    narrowed,
    own_calibration,
    own_map,
    safe_outputs,
)
from armctl.errors import InputError, StateError
from armctl.facts import State, say
from armctl.facts.angles import DEGREE, to_degrees
from armctl.hardware import Source
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Snapshot, wall_time
from armctl.robot import OutputMap, Robot
from armctl.ui.console import CalibrationInForce, Console, pose_unknown
from armctl.ui.tabs.calibration.touched_points import TouchedPoints, read_outputs

_LARGEST_ANGLE = 720.0 * DEGREE
_APART = 1.0
"""outputs that differ by less are one place"""
End = Literal["low", "high"]
Jaw = Literal["closed", "open"]


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
        return None if len(marks) < LEAST_MARKS else fit_joint(marks, self.map.unit, self.map.turn)

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


class SharedCalibration:
    """In force, measured since, and saved. Used on the web server's event loop only."""

    def __init__(self, in_force: CalibrationInForce, now: Callable[[], float] = wall_time) -> None:
        """Begin without a mark; ``now`` gives seconds since the epoch."""
        self._kept, self._now = in_force, now
        self.board, self.in_force = in_force.board, in_force.calibration
        self.work = CalibrationWork(in_force.file_robot, self.in_force)
        file_robot, kept = in_force.file_robot, None
        if self.board is not None and file_robot.output_map is not None:
            kept = TouchesFile(in_force.store, file_robot, self.board)
        self.points = TouchedPoints(
            in_force.robot,
            self.in_force.joints if self.in_force else (),
            file_robot=file_robot,
            file=kept,
            stamp=lambda: iso_time(self._now()),
        )

    @cached_property
    def check_pose(self) -> CheckPose:
        """Where one looks at the arm once it is calibrated; looking for it may take half a second."""
        return check_pose(self._kept.robot)

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

    def correction(self) -> tuple[TouchFit, Calibration]:
        """What the touched points say, and the calibration with it; ``ArmctlError``: it is not better."""
        fit = self.points.result
        if not isinstance(fit, TouchFit):
            raise StateError(
                fit or f"there is no correction yet: {LEAST_POINTS} points tell one, 10 a better one"
            )
        if fit.verdict is not None:
            raise StateError(say(fit.verdict))
        board, work = self._require_board(), self.work
        now = self.in_force or Calibration(work.robot.name, board, work.map.unit, {})
        note = f"touched points: {1000 * fit.before.rms:.1f} → {1000 * fit.after.rms:.1f} mm"
        drawn = msgspec.structs.replace(corrected(fit, now), made=iso_time(self._now()), note=note)
        narrowed(work.robot, drawn)
        return fit, drawn

    async def correct(self) -> Version:
        """Save what the touched points say as a new version; the arm goes by it once it is opened anew."""
        (fit, drawn), used = self.correction(), len(self.points.touches)
        saved = await asyncio.to_thread(self._save, drawn)
        self.points.applied(fit, used)
        await self.points.keep()
        return saved

    def with_load(self, load_kg: float) -> Calibration:
        """The calibration in force for an arm that carries this at the tool point [kg].

        ``StateError``: nothing of it depends on a load, or it is this one. ``CalibrationError``: a joint
        would sag by more than is corrected.
        """
        self._require_board()
        now = self.in_force
        if now is None or not now.deflection:
            raise StateError(
                "no joint is known to give way, so a load changes nothing; 'Known points' measures that"
            )
        if load_kg == now.load_kg:
            raise StateError(f"a load of {load_kg:g} kg is in force already")
        note = f"a load of {load_kg:g} kg"
        drawn = msgspec.structs.replace(now, load_kg=load_kg, made=iso_time(self._now()), note=note)
        narrowed(self.work.robot, drawn)
        return drawn

    async def set_load(self, load_kg: float) -> Version:
        """Save that the arm carries this [kg]; it goes by it once it is opened anew."""
        return await asyncio.to_thread(self._save, self.with_load(load_kg))

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
        raise pose_unknown(snapshot)
    return own_map(robot).outputs(np.where(unknown, snapshot.q_command, snapshot.q))


def standing_outputs(robot: Robot, snapshot: Snapshot) -> dict[int, float]:
    """``present_outputs`` of an arm that stands still: a mark is taken there."""
    if snapshot.state in (State.MOVING, State.PAUSED):
        raise StateError("the arm is in the middle of a motion; wait until it stands, then press again")
    return present_outputs(robot, snapshot)


def standing_touch(
    robot: Robot, snapshot: Snapshot, point_m: FloatArray, number: int | None, sense: tuple[float, ...]
) -> TouchedPoint:
    """Where the tool touches a point (3,) [m]; the rest as in ``TouchedPoint``."""
    outputs, sent = standing_outputs(robot, snapshot), None
    measured = snapshot.source is Source.MEASURED and not np.isnan(snapshot.q).any()
    if measured:
        drives = snapshot.state is State.HOLDING and not snapshot.limp  # a hand carries what is limp
        sent = own_map(robot).outputs(snapshot.q_command) if drives else None
        outputs = read_outputs(robot, snapshot.q)
    x, y, z = point_m.tolist()
    return TouchedPoint(outputs, (x, y, z), number, sense, measured, sent)


def standing_gripper(robot: Robot, snapshot: Snapshot) -> float:
    """Output of the gripper."""
    if snapshot.gripper is None:
        raise StateError("the gripper has not been told to move yet; press 'Move gripper' first")
    (output,) = own_map(robot).gripper_output(snapshot.gripper).values()
    return output
