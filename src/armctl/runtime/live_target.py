"""Following a target that is dragged: the joints move toward a goal that is solved for again and again."""

from __future__ import annotations

import math
from concurrent.futures import Future

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, MotionRefusedError
from armctl.facts import say
from armctl.facts.angles import DEGREE
from armctl.facts.targets import Instead
from armctl.kinematics import Solutions, Target
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Command, FollowTarget, StreamJoints
from armctl.robot import Robot
from armctl.runtime.activity import Setpoint
from armctl.runtime.joint_servo import KeepClear, Led, Step
from armctl.runtime.planner import Submit, result_of

_STEP = 0.05 * DEGREE
"""of a joint that is free [rad]"""
_SAME_POSTURE = 20.0 * DEGREE
"""A change of branch with less travel than this passes through the pose where the branches meet [rad]."""
_TURNED = 1e-6
"""Orientations that differ by less are the same [rad]."""
_DETOUR_M, _DETOUR_SHARE = 0.02, 0.1
"""How much farther from the target the tool may come on its way there, and as a share of its distance."""
_ROUND_M, _ROUND_SHARE = 0.03, 1.4
"""How long the way of the tool may be: a turn of the base by 150 degrees is 1.36 times its chord."""
_LOOKS = 24
_SHORT_M = 1e-3


@dataclass(frozen=True, slots=True)
class LiveGoal:
    """What came of one target."""

    q: FloatArray | None
    """(n,) where to go [rad]; None: stay with the goal before"""
    note: str | None = None
    """what is not as it was asked for"""


class Follower(Led):
    """Joints that move toward the newest target; one at a time is solved for, on another thread."""

    label = "live target"
    led_by = (FollowTarget,)

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float, submit: Submit) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override, ``submit`` runs ``live_goal`` elsewhere."""
        super().__init__(robot, clear, q, speed)
        self._submit = submit
        self._pitch = robot.inverse_kinematics.pitch_and_roll(q)[0]
        self._rotation = robot.forward(q)[:3, :3] if robot.orients_tool else None
        self._target: Target | None = None
        self._stale = False
        """the target is newer than what is being solved"""
        self._solving: Future[LiveGoal] | None = None
        self._goal: FloatArray | None = None
        self._note: str | None = None

    @property
    def q(self) -> FloatArray:
        """(n,) where the joints are [rad]."""
        return self._servo.q.copy()

    def lead(self, command: Command, expires: float) -> None:
        """Follow the target of a command until ``expires`` [s]; none: slow down."""
        if isinstance(command, FollowTarget):
            if command.target is None:
                self.stop()
            else:
                self.aim(command.target, expires)

    def aim(self, target: Target, expires: float) -> None:
        """Follow ``target`` until the clock says ``expires``."""
        self._lead_on(expires)
        if self._target is None or not _same(target, self._target):
            self._target = target
            self._stale = True

    def stop(self) -> None:
        """Slow down as hard as the limits allow; the same target asked for again is a new one."""
        self._goal = self._target = None
        self._stale = False
        if self._solving is not None:  # its answer is to a target that was left
            self._solving.cancel()
            self._solving = None
        super().stop()

    def _step(self, expired: bool, dt: float) -> tuple[Step | None, str | None]:
        self._take_goal(expired)
        notice = None if self._note is None else f"live target: {self._note}"
        if expired or self._goal is None:
            return None, notice
        return self._servo.toward(self._goal, self._speed, dt), notice

    def _take_goal(self, expired: bool) -> None:
        """Take what has been solved, and have the newest target solved if that has not begun."""
        if self._solving is None and self._stale and self._target is not None and not expired:
            self._stale = False
            here = self._servo.q.copy()
            kept = self._pitch, self._rotation
            try:
                self._solving = self._submit(live_goal, self._robot, self._clear, here, self._target, *kept)
            except ArmctlError as error:
                self._note, self._stale = str(error), True
        if self._solving is None or not self._solving.done():
            return
        solving, self._solving = self._solving, None
        if expired:
            self._stale = True  # if the target is asked for again, it is solved for from there
            return
        try:
            found = result_of(solving)
        except ArmctlError as error:
            self._note = str(error)
            return
        self._note = found.note
        if found.q is not None:
            self._goal = found.q


class Streamer(Led):
    """Joints that move toward the newest setpoint of a stream, behind it by their braking way."""

    label = "setpoint stream"
    led_by = (StreamJoints,)

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        super().__init__(robot, clear, q, speed)
        self._goal = q
        self._last = False

    def lead(self, command: Command, expires: float) -> None:
        """Go toward a setpoint until ``expires`` [s]; the last one: all the way, then be done."""
        if isinstance(command, StreamJoints):
            self._goal, self._last = command.q, command.last
            self._lead_on(math.inf if command.last else expires)

    def stop(self) -> None:
        """Slow down as hard as the limits allow."""
        self._last = False
        super().stop()

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on; the last setpoint is reached, or what is in the way of it ends the stream."""
        setpoint = super().advance(now, dt)
        if self._last and setpoint is None:
            self._done = True
            if not np.array_equal(self._servo.q, self._goal):
                self.error = MotionRefusedError(self.notice or f"{self.label}: the arm cannot go on")
        return setpoint

    def _step(self, expired: bool, dt: float) -> tuple[Step | None, str | None]:
        return (None if expired else self._servo.toward(self._goal, self._speed, dt)), None


def _same(one: Target, other: Target) -> bool:
    if one.rotation is None or other.rotation is None:
        turned = one.rotation is other.rotation
    else:
        turned = np.array_equal(one.rotation, other.rotation)
    return turned and (one.point, one.pitch, one.roll) == (other.point, other.pitch, other.roll)


def live_goal(
    robot: Robot,
    clear: KeepClear,
    q: FloatArray,
    target: Target,
    pitch: float | None,
    rotation: FloatArray | None = None,
) -> LiveGoal:
    """The configuration to go to for ``target``: the nearest one, on the branch on which the arm is.

    The joints go straight there, so the way is looked at, too: a way that swings the tool round, away from
    the target before it comes nearer, is not taken; one that leads into the floor, an obstacle or the arm
    itself ends before it. ``q`` (n,) [rad] is where the arm is. A target that gives neither pitch nor roll is
    followed in the orientation ``rotation`` (3, 3) if the arm can (None: any). A roll that the target does
    not give stays as it is; where it gives no pitch, ``pitch`` [rad] is kept if the arm can (None: any).
    """
    oriented = target.rotation is None and target.pitch is None and target.roll is None
    found = _in_orientation(robot, q, target, rotation) if oriented and rotation is not None else None
    lost = oriented and rotation is not None and found is None
    if found is None:
        found = _solutions(robot, q, target, pitch)
    if not found.success:
        goal = _toward_nearest(robot, q, found, pitch)
    else:
        nearest, branch = _nearest(robot, q, found)
        if branch is not None:
            return LiveGoal(
                None, f"it can be reached only with {branch}; the arm keeps its posture and waits"
            )
        note = "the tool cannot keep its orientation there" if lost else None
        goal = _swing_checked(robot, q, nearest, found.target.position, note)
    if goal.q is None:
        return goal
    way = clear.line(q, goal.q)
    blocked = clear.blocked(way)
    return goal if blocked is None else LiveGoal(way[blocked[0] - 1], blocked[1])


def _toward_nearest(robot: Robot, q: FloatArray, found: Solutions, pitch: float | None) -> LiveGoal:
    """To the reachable point nearest to the target, or just short of it: at its edge the arm is singular."""
    goal, point, target = found.nearest_q, found.nearest_m, found.target
    if goal is None or point is None:
        return LiveGoal(None, _instead(found, Instead("wait")))
    back = robot.forward(q)[:3, 3] - point
    back *= min(_SHORT_M / max(float(np.linalg.norm(back)), _SHORT_M), 1.0)
    short = _solutions(robot, q, Target.of(point + back, target.pitch, target.roll, target.rotation), pitch)
    if short.success:
        goal, branch = _nearest(robot, q, short)
        if branch is not None:
            return LiveGoal(None, _instead(found, Instead("wait", branch)))
    return _swing_checked(robot, q, goal, point, _instead(found, Instead("go near")))


def _instead(found: Solutions, instead: Instead) -> str | None:
    return None if (why := found.why(instead)) is None else say(why)


def _in_orientation(robot: Robot, q: FloatArray, target: Target, rotation: FloatArray) -> Solutions | None:
    """With the tool turned so; None where the arm cannot."""
    found = robot.inverse(target.position, rotation=rotation, step=_STEP, start=q)
    return found if found.success and found.residual_rad.min() < _TURNED else None


def _solutions(robot: Robot, q: FloatArray, target: Target, pitch: float | None) -> Solutions:
    """With the present pitch and roll where nothing else is asked for; else with any."""
    roll = target.roll
    if roll is None and target.rotation is None:
        roll = robot.inverse_kinematics.pitch_and_roll(q)[1]
    if target.pitch is None and target.rotation is None and pitch is not None:
        kept = robot.inverse(target.position, pitch, roll, step=_STEP, start=q)
        if kept.success:
            return kept
    return robot.inverse(target.position, target.pitch, roll, target.rotation, _STEP, q)


def _nearest(robot: Robot, q: FloatArray, found: Solutions) -> tuple[FloatArray, str | None]:
    """The solution of least travel on the arm's branch, and None; else that of another branch, named."""
    travel = found.energies("least-travel", q)
    order = int(np.argmin(travel))
    if len(found.branch_names) > 1:
        pose, (pitch, roll) = robot.forward(q), robot.inverse_kinematics.pitch_and_roll(q)
        whole = Target.of(pose[:3, 3], rotation=pose[:3, :3])
        target = Target.of(pose[:3, 3], pitch, roll) if found.target.rotation is None else whole
        here = robot.inverse_kinematics.solve(target, _STEP, q)
        if here.success:
            mine = found.branch == here.branch_of(q)
            if mine.any():
                order = int(np.argmin(np.where(mine, travel, np.inf)))
            elif np.abs(found.q[order] - q).max() > _SAME_POSTURE:
                return found.q[order], str(found.branch[order])
    return found.q[order].copy(), None


def _swing_checked(
    robot: Robot, q: FloatArray, goal: FloatArray, point: FloatArray, note: str | None
) -> LiveGoal:
    """``goal``, unless the tool goes a long way round to it, or first away from ``point`` (3,) [m]."""
    way = robot.forward(q + np.linspace(0.0, 1.0, _LOOKS)[:, None] * (goal - q))[:, :3, 3]
    distance = np.linalg.norm(way - point, axis=1)
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    straight = float(np.linalg.norm(way[-1] - way[0]))
    away = float(distance.max() - distance[0])
    if away > _DETOUR_M + _DETOUR_SHARE * float(distance[0]) or length > _ROUND_M + _ROUND_SHARE * straight:
        return LiveGoal(
            None,
            f"on the way there the tool would swing {1000 * length:.0f} mm, for a distance of "
            f"{1000 * straight:.0f} mm; the arm waits: drag the target around, or go there with Inverse",
        )
    return LiveGoal(goal, note)
