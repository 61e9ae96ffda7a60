"""From what is asked for to a trajectory that has passed its pre-flight."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError, MotionRefusedError, UnreachableError
from armctl.kinematics import DEFAULT_STEP, Target, YawPitchRollSolver, checked_criterion
from armctl.motion.blend import Leg, blend
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.preflight import preflight, require_clear
from armctl.motion.profiles import PointToPoint, ProfileName, checked_duration, shortest_words
from armctl.motion.trajectory import JoinedTrajectory, SlowedTrajectory, Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
Profile = ProfileName | Literal["normal"]
"""A law for all joints together; or "normal": each joint at its own speed (takes no duration)."""


def plan_joints(
    robot: Robot,
    start: ArrayLike,
    end: ArrayLike,
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> Trajectory:
    """Plan a motion to joint angles and check it.

    Args:
        robot: the arm.
        start: (n,) where it stands [rad].
        end: (n,) where to go [rad].
        duration_s: seconds; None: the shortest that the limits allow.
        profile: a law, or "normal", which goes at each joint's own speed; with a duration that is a cubic.
        checked: run the pre-flight; False only for who runs it over many motions at once.

    Raises:
        InputError: a value that is not finite, or a wrong shape.
        MotionRefusedError: outside the joint limits, too short a duration, or through the floor.
    """
    end = robot.check_limits(end)
    trajectory: Trajectory
    if profile == "normal" and duration_s is None:
        trajectory = PointToPoint.each_for_itself(robot, start, end)
    else:
        law = "cubic" if profile == "normal" else profile
        trajectory = PointToPoint.plan(robot, start, end, duration_s, law)
    if checked:
        require_clear(robot, trajectory)
    return trajectory


def plan_target(
    robot: Robot,
    start: ArrayLike,
    target: Target,
    choose: str = "least-rotation",
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> Trajectory:
    """Plan a motion of the tool to a target by inverse kinematics and check it.

    Args:
        robot: the arm.
        start: (n,) where it stands [rad].
        target: where the tool shall go.
        choose: criterion for the choice among the solutions.
        duration_s: seconds; None: the shortest that the limits allow.
        profile: as in ``plan_joints``.
        checked: as in ``plan_joints``.

    Raises:
        InputError: no such criterion.
        UnreachableError: no solution; says why, and which point is the nearest.
        MotionRefusedError: as in ``plan_joints``.
    """
    end = solve(robot, start, target, choose)
    return plan_joints(robot, start, end, duration_s, profile, checked=checked)


def solve(robot: Robot, start: ArrayLike | None, target: Target, choose: str) -> FloatArray:
    """The configuration (n,) [rad] that the criterion chooses for a target.

    Raises:
        InputError: no such criterion.
        UnreachableError: no solution; says why, and which point is the nearest.
    """
    solver = robot.inverse_kinematics
    anyhow = target.pitch is None and target.roll is None and target.rotation is None
    if checked_criterion(choose) == "least-rotation" and anyhow and isinstance(solver, YawPitchRollSolver):
        q = robot.least_rotation(target.position)  # the same without listing ten thousand others
        if np.isfinite(q).all():
            return q
    solutions = solver.solve(target, DEFAULT_STEP)
    if not solutions.success:
        raise UnreachableError(solutions.explanation or "there is no solution")
    return solutions.best(choose, start)


# Motions through a list of points: at rest in each, smoothly through all, or turning off before each.

Passing = Literal["stop", "spline", "blend"]
"""at rest in each point; smoothly through all points; turning off before each point, towards the next"""
PASSINGS: tuple[Passing, ...] = get_args(Passing)
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
    robot: Robot,
    stops: Sequence[FloatArray],
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> JoinedTrajectory:
    """Plan a motion through configurations, at rest in each.

    Args:
        robot: the arm.
        stops: at least two configurations (n,) [rad].
        duration_s: of the whole motion [s], shared out so that each part is slowed down alike; None: the
            shortest that the limits allow.
        profile: as in ``plan_joints``.
        checked: run the pre-flight; False only for who runs it over the whole.

    Raises:
        InputError: fewer than two stops.
        MotionRefusedError: outside the limits, through the floor, or too short a duration; says where.
    """
    _require_two(stops)
    if duration_s is None:
        return _joined(robot, stops, profile, checked=checked)
    law: Profile = "cubic" if profile == "normal" else profile
    shortest = _joined(robot, stops, law, checked=checked)
    _require_time(duration_s, shortest.duration)
    slower = duration_s / shortest.duration if shortest.duration > 0 else 1.0
    durations = [slower * part.duration for part in shortest.parts]
    return _joined(robot, stops, law, durations, checked=checked)


def plan_blended(
    robot: Robot, stops: Sequence[FloatArray], radius_m: float, duration_s: float | None = None
) -> Trajectory:
    """Plan a motion that turns off towards the next configuration before it comes to each; no pre-flight.

    Args:
        robot: the arm.
        stops: at least two configurations (n,) [rad].
        radius_m: how far from each the tool may begin to turn off [m].
        duration_s: [s]; None: the shortest that the limits allow.

    Raises:
        InputError: fewer than two stops, or a radius that is not positive.
        MotionRefusedError: outside the joint limits, or too short a duration.
    """
    _require_two(stops)
    if not radius_m > 0:
        raise InputError(
            f"a blend radius must be positive, got {1000 * radius_m:g} mm; or stop at each point"
        )
    inside = [robot.check_limits(stop) for stop in stops]
    legs = [
        Leg(PiecewisePolynomial([0.0, 1.0], np.stack([start, end - start])[None]), radius_m)
        for start, end in pairwise(inside)
        if bool((start != end).any())
    ]
    if not legs:
        raise InputError("the points of a blended motion are all the same")
    legs[-1] = Leg(legs[-1].path)
    shortest = JoinedTrajectory(blend(robot, legs).trajectories)
    if duration_s is None:
        return shortest
    _require_time(duration_s, shortest.duration)
    return SlowedTrajectory(shortest, max(duration_s / shortest.duration, 1.0))


def _joined(
    robot: Robot,
    stops: Sequence[FloatArray],
    profile: Profile,
    durations: Sequence[float] | None = None,
    *,
    checked: bool,
) -> JoinedTrajectory:
    parts: list[Trajectory] = []
    for k, (start, end) in enumerate(pairwise(stops)):
        duration = durations[k] if durations else None
        try:
            parts.append(plan_joints(robot, start, end, duration, profile, checked=False))
        except MotionRefusedError as cause:
            raise MotionRefusedError(f"from point {k + 1} to point {k + 2}: {cause}") from cause
    if checked:
        for k, part in enumerate(parts):
            errors = [finding for finding in preflight(robot, part) if finding.severity == "error"]
            if errors:
                raise MotionRefusedError(f"from point {k + 1} to point {k + 2}: {errors[0]}")
    return JoinedTrajectory(parts)


def _require_two(stops: Sequence[FloatArray]) -> None:
    if len(stops) < 2:
        raise InputError("a motion through points needs at least two of them")


def _require_time(duration_s: float, shortest_s: float) -> None:
    if checked_duration(duration_s) < shortest_s * (1 - _ROUNDING):
        raise MotionRefusedError(
            f"the whole motion cannot take {duration_s:g} s; {shortest_words(shortest_s)}"
        )
