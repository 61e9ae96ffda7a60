"""Motions through a list of points, at rest in each of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError, MotionRefusedError, UnreachableError
from armctl.kinematics import Target
from armctl.motion.joined import JoinedTrajectory
from armctl.motion.plan import Profile, plan_joints, solve
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9


def solve_points(robot: Robot, points: FloatArray, choose: str, start: FloatArray) -> FloatArray:
    """Solve each point of a path by the same criterion.

    Args:
        robot: the arm.
        points: (k, 3) in the base frame [m].
        choose: criterion for the choice among the solutions.
        start: (n,) where the arm stands before the first point [rad]; each next one starts from the last.

    Returns:
        (k, n) joint angles [rad].

    Raises:
        UnreachableError: a point has no solution; says which and why.
    """
    found: list[FloatArray] = []
    for number, point in enumerate(points, 1):
        try:
            found.append(solve(robot, found[-1] if found else start, Target.of(point), choose))
        except UnreachableError as cause:
            raise UnreachableError(f"point {number} of {len(points)}: {cause}") from cause
    return np.array(found)


def plan_through(
    robot: Robot, stops: Sequence[FloatArray], duration_s: float | None = None, profile: Profile = "planned"
) -> JoinedTrajectory:
    """Plan a motion through configurations, at rest in each.

    Args:
        robot: the arm.
        stops: at least two configurations (n,) [rad].
        duration_s: of the whole motion [s], shared out so that each part is slowed down alike; None: the
            shortest that the limits allow.
        profile: as in ``plan_joints``.

    Raises:
        InputError: fewer than two stops.
        MotionRefusedError: outside the limits, through the floor, or too short a duration; says where.
    """
    if len(stops) < 2:
        raise InputError("a motion through points needs at least two of them")
    if duration_s is None:
        return _joined(robot, stops, profile)
    shortest = _joined(robot, stops, "planned")
    if not duration_s >= shortest.duration * (1 - _ROUNDING):
        raise MotionRefusedError(
            f"the whole motion cannot take {duration_s:.3f} s; "
            f"the shortest possible duration is {shortest.duration:.3f} s"
        )
    slower = duration_s / shortest.duration if shortest.duration > 0 else 1.0
    return _joined(robot, stops, "planned", [slower * part.duration for part in shortest.parts])


def _joined(
    robot: Robot, stops: Sequence[FloatArray], profile: Profile, durations: Sequence[float] | None = None
) -> JoinedTrajectory:
    parts: list[Trajectory] = []
    for k, (start, end) in enumerate(pairwise(stops)):
        try:
            parts.append(plan_joints(robot, start, end, durations[k] if durations else None, profile))
        except MotionRefusedError as cause:
            raise MotionRefusedError(f"from point {k + 1} to point {k + 2}: {cause}") from cause
    return JoinedTrajectory(parts)
