"""Where the joints shall go for a target that is being dragged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import Solutions, Target
from armctl.robot import Robot
from armctl.runtime.keep_clear import KeepClear

FloatArray = NDArray[np.float64]
_STEP = float(np.radians(0.05))
"""of a joint that is free [rad]"""
_SAME_POSTURE = float(np.radians(20.0))
"""A change of branch with less travel than this passes through the pose where the branches meet [rad]."""
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


def live_goal(robot: Robot, clear: KeepClear, q: FloatArray, target: Target, pitch: float | None) -> LiveGoal:
    """The configuration to go to for ``target``: the nearest one, on the branch on which the arm is.

    The joints go straight there, so the way is looked at, too: a way that swings the tool round, away from
    the target before it comes nearer, is none to be taken while somebody drags; one that leads into the
    floor, an obstacle or the arm itself ends before it.

    Args:
        robot: the arm.
        clear: what it must stay out of.
        q: (n,) where the arm is [rad].
        target: where the tool shall be; a roll that it does not give stays as it is.
        pitch: the tool pitch to keep where the target gives none and the arm can [rad]; None: any.
    """
    goal, note = _wanted(robot, q, target, pitch)
    if goal is None:
        return LiveGoal(None, note)
    way = clear.line(q, goal)
    found = clear.blocked(way)
    if found is not None:
        row, why = found
        return LiveGoal(way[row - 1], why)
    return LiveGoal(goal, note)


def _wanted(
    robot: Robot, q: FloatArray, target: Target, pitch: float | None
) -> tuple[FloatArray | None, str | None]:
    """The nearest configuration on the arm's branch, or a reason why not."""
    found = _solutions(robot, q, target, pitch)
    if not found.success:
        return _toward_nearest(robot, q, found, pitch)
    goal, branch = _nearest(robot, q, found)
    if branch is not None:
        return None, f"it can be reached only with {branch}; the arm keeps its posture and waits"
    return _swing_checked(robot, q, goal, target.position, None)


def _toward_nearest(
    robot: Robot, q: FloatArray, found: Solutions, pitch: float | None
) -> tuple[FloatArray | None, str | None]:
    """To the reachable point that comes nearest to a target without a solution.

    Or just short of it: at the edge of its reach the arm is singular, and its branches meet.
    """
    if found.nearest_q is None or found.nearest_m is None:
        return None, f"{found.reason}; the arm waits"
    note = f"{found.reason}; following the nearest point"
    point, target = found.nearest_m, found.target
    back = robot.forward(q)[:3, 3] - point
    back *= min(_SHORT_M / max(float(np.linalg.norm(back)), _SHORT_M), 1.0)
    short = _solutions(robot, q, Target.of(point + back, target.pitch, target.roll, target.rotation), pitch)
    if short.success:
        goal, branch = _nearest(robot, q, short)
        if branch is not None:
            return (
                None,
                f"{found.reason}; the nearest point needs {branch}: the arm keeps its posture and waits",
            )
        return _swing_checked(robot, q, goal, point, note)
    return _swing_checked(robot, q, found.nearest_q, point, note)


def _solutions(robot: Robot, q: FloatArray, target: Target, pitch: float | None) -> Solutions:
    """With the present pitch and roll where nothing else is asked for; else with any."""
    roll = target.roll
    if roll is None and target.rotation is None:
        roll = robot.inverse_kinematics.pitch_and_roll(q)[1]
    if target.pitch is None and target.rotation is None and pitch is not None:
        kept = robot.inverse(target.position, pitch, roll, step=_STEP)
        if kept.success:
            return kept
    return robot.inverse(target.position, target.pitch, roll, target.rotation, step=_STEP)


def _nearest(robot: Robot, q: FloatArray, found: Solutions) -> tuple[FloatArray, str | None]:
    """The solution of least travel on the arm's branch, and None; else that of another branch, named."""
    travel = found.energies("least-travel", q)
    order = int(np.argmin(travel))
    if len(found.branch_names) > 1:
        pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
        here = robot.inverse(robot.forward(q)[:3, 3], pitch, roll, step=_STEP)
        if here.success:
            mine = found.branch == here.branch_of(q)
            if mine.any():
                order = int(np.argmin(np.where(mine, travel, np.inf)))
            elif np.abs(found.q[order] - q).max() > _SAME_POSTURE:
                return found.q[order], str(found.branch[order])
    return found.q[order].copy(), None


def _swing_checked(
    robot: Robot, q: FloatArray, goal: FloatArray, point: FloatArray, note: str | None
) -> tuple[FloatArray | None, str | None]:
    """``goal``, unless the tool goes a long way round to it, or first away from ``point`` (3,) [m]."""
    way = robot.forward(q + np.linspace(0.0, 1.0, _LOOKS)[:, None] * (goal - q))[:, :3, 3]
    distance = np.linalg.norm(way - point, axis=1)
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    straight = float(np.linalg.norm(way[-1] - way[0]))
    away = float(distance.max() - distance[0])
    if away > _DETOUR_M + _DETOUR_SHARE * float(distance[0]) or length > _ROUND_M + _ROUND_SHARE * straight:
        return None, (
            f"the way there would swing the tool round, {1000 * length:.0f} mm for {1000 * straight:.0f} mm; "
            "the arm waits: lead the target round, or go there with Inverse"
        )
    return goal, note
