"""From what is asked for to a trajectory that has passed its pre-flight."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError, UnreachableError
from armctl.kinematics import DEFAULT_STEP, Target, checked_criterion
from armctl.kinematics.target import as_numbers
from armctl.motion.blend import Leg, blend
from armctl.motion.paths.tool_path import PitchMode, ToolPath, tool_arc, tool_line
from armctl.motion.paths.tool_refusal import ToolPathRefusedError, ToolPathUnreachableError
from armctl.motion.polynomial import PiecewisePolynomial, spline_through
from armctl.motion.preflight import require_clear
from armctl.motion.profiles import PointToPoint, ProfileName, checked_duration, shortest_words
from armctl.motion.timing import PathTrajectory, timed
from armctl.motion.trajectory import JoinedTrajectory, SlowedTrajectory, Trajectory
from armctl.robot import Robot

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
        checked: run the pre-flight; False: the caller does.

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
    position_only = target.pitch is None and target.roll is None and target.rotation is None
    if checked_criterion(choose) == "least-rotation" and position_only and solver.direct:
        q = robot.least_rotation(target.position)  # the same without listing ten thousand others
        if np.isfinite(q).all():
            return q
    solutions = solver.solve(target, DEFAULT_STEP)
    if not solutions.success:
        raise UnreachableError(solutions.explanation or "there is no solution")
    return solutions.best(choose, start)


# Motions of the tool along a line or an arc, and of the joints smoothly through points.

NOWHERE = 1e-12
"""no joint turns so little on purpose [rad]"""


def plan_line(
    robot: Robot,
    start: ArrayLike,
    position_m: ArrayLike,
    *,
    pitch: PitchMode = "kept",
    end_pitch: float | None = None,
    speed: float | None = None,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """Plan a motion of the tool in a straight line, on the branch the arm is on, and check it.

    Args:
        robot: the arm.
        start: (n,) where it stands [rad].
        position_m: (3,) where the tool shall go, base frame [m].
        pitch: tool pitch on the way: as at the start, evenly to ``end_pitch``, or as it comes.
        end_pitch: tool pitch at the end [rad]; with "interpolated" only.
        speed: largest speed of the tool [m/s]; None: as fast as the joints can.
        duration_s: seconds; None: the shortest.
        profile: how the way is spread over time.
        checked: as in ``plan_joints``.

    Raises:
        InputError: a value that is not finite, or a wrong shape.
        UnreachableError: a place on the way is out of reach; says when, where and why.
        MotionRefusedError: a limit, a singular pose or another branch on the way, said with the time, the
            place and the joint; too short a duration; the floor.
    """
    path = follow_line(robot, as_numbers(start, "joint angles"), position_m, pitch, end_pitch, speed)
    return plan_path(robot, start, path, speed=speed, duration_s=duration_s, profile=profile, checked=checked)


def plan_arc(
    robot: Robot,
    start: ArrayLike,
    via_m: ArrayLike,
    end_m: ArrayLike,
    *,
    pitch: PitchMode = "kept",
    end_pitch: float | None = None,
    speed: float | None = None,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """Plan a motion of the tool along the circle through where it is, ``via_m`` and ``end_m`` (3,) [m].

    The rest as ``plan_line``.
    """
    path = follow_arc(robot, as_numbers(start, "joint angles"), via_m, end_m, pitch, end_pitch, speed)
    return plan_path(robot, start, path, speed=speed, duration_s=duration_s, profile=profile, checked=checked)


def plan_spline(
    robot: Robot,
    points: ArrayLike,
    *,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """Plan a motion of the joints through configurations without a stop, and check it.

    Args:
        robot: the arm.
        points: (k, n) at least one [rad]; the arm stands in the first.
        duration_s: seconds; None: the shortest.
        profile: how the way is spread over time.
        checked: as in ``plan_joints``.

    Raises:
        InputError: a value that is not finite, or a wrong shape.
        MotionRefusedError: outside the joint limits (the curve may swing beyond a point), too short a
            duration, through the floor.
    """
    q = as_numbers(points, "joint angles")
    if q.ndim != 2 or q.shape[1] != robot.n or len(q) == 0:
        raise InputError(f"a spline needs configurations (k, {robot.n}), got the shape {q.shape}")
    still = len(q) == 1 or float(np.abs(q - q[0]).max()) <= NOWHERE
    path = None if still else spline_through(q, 1.0 / robot.speed_limits)
    return plan_path(robot, q[0], path, duration_s=duration_s, profile=profile, checked=checked)


def plan_path(
    robot: Robot,
    start: ArrayLike,
    path: PiecewisePolynomial | None,
    *,
    speed: float | None = None,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """Plan a motion along a path q(s) of the joints, (n,) [rad], and check it.

    Args:
        robot: the arm.
        start: (n,) where the path begins [rad].
        path: from ``follow_line``, ``follow_arc`` or ``spline_through``; None: the arm stays.
        speed: largest ds/dt: of the tool [m/s] where s is its way; None: as fast as the joints can.
        duration_s: seconds; None: the shortest.
        profile: how the way is spread over time.
        checked: as in ``plan_joints``.

    Raises:
        InputError: a speed that is not positive, or a duration that is not a time.
        MotionRefusedError: too short a duration, or what the pre-flight finds.
    """
    if path is None:
        return PointToPoint.lasting(start, start, 0.0 if duration_s is None else duration_s)
    cap = math.inf if speed is None else speed
    trajectory = timed(robot, path, profile=profile, rate_cap=cap, duration_s=duration_s)
    if checked:
        require_clear(robot, trajectory, tool_path=True)
    return trajectory


def follow_line(
    robot: Robot,
    start: FloatArray,
    end_m: ArrayLike,
    pitch: PitchMode,
    end_pitch: float | None,
    speed: float | None = None,
) -> PiecewisePolynomial | None:
    """The joints' path q(s) along a straight line of the tool, s its way [m]; None where it goes nowhere.

    Raises:
        As ``plan_line``, but for the duration and the floor.
    """
    return _followed(robot, speed, lambda: tool_line(robot, start, end_m, pitch, end_pitch))


def follow_arc(
    robot: Robot,
    start: FloatArray,
    via_m: ArrayLike,
    end_m: ArrayLike,
    pitch: PitchMode,
    end_pitch: float | None,
    speed: float | None = None,
) -> PiecewisePolynomial | None:
    """The same along the circle through three points."""
    return _followed(robot, speed, lambda: tool_arc(robot, start, via_m, end_m, pitch, end_pitch))


def _followed(
    robot: Robot, speed: float | None, follow: Callable[[], ToolPath]
) -> PiecewisePolynomial | None:
    try:
        found = follow()
    except (ToolPathRefusedError, ToolPathUnreachableError) as cause:
        seconds = 0.0
        if cause.before is not None:  # when the tool comes there, without slowing down for it
            cap = math.inf if speed is None else speed
            seconds = PathTrajectory.fastest(robot, cause.before, cap, last=math.inf).duration
        raise type(cause)(f"at {seconds:.2f} s, {cause}", cause.place, cause.before) from cause
    return None if found.is_still else found.polynomial


# Motions through a list of points: at rest in each, smoothly through all, or turning off before each.

Passing = Literal["stop", "spline", "blend"]
"""at rest in each point; smoothly through all points; turning off before each point, towards the next"""
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
        checked: as in ``plan_joints``.

    Raises:
        InputError: fewer than two stops.
        MotionRefusedError: outside the limits, through the floor, or too short a duration; says where.
    """
    _require_two(stops)
    no_durations = [None] * (len(stops) - 1)
    if duration_s is None:
        return _joined(robot, stops, profile, no_durations, checked=checked)
    law: Profile = "cubic" if profile == "normal" else profile
    shortest = _joined(robot, stops, law, no_durations, checked=False)
    slower = _slower(duration_s, shortest.duration)
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
    return SlowedTrajectory(shortest, _slower(duration_s, shortest.duration))


def _joined(
    robot: Robot,
    stops: Sequence[FloatArray],
    profile: Profile,
    durations: Sequence[float | None],
    *,
    checked: bool,
) -> JoinedTrajectory:
    parts: list[Trajectory] = []
    for k, ((start, end), duration) in enumerate(zip(pairwise(stops), durations, strict=True), 1):
        try:
            parts.append(plan_joints(robot, start, end, duration, profile, checked=checked))
        except MotionRefusedError as cause:
            raise MotionRefusedError(f"from point {k} to point {k + 1}: {cause}") from cause
    return JoinedTrajectory(parts)


def _require_two(stops: Sequence[FloatArray]) -> None:
    if len(stops) < 2:
        raise InputError("a motion through points needs at least two of them")


def _slower(duration_s: float, shortest_s: float) -> float:
    """How many times as long as the shortest a duration is.

    Raises:
        MotionRefusedError: it is too short.
    """
    if checked_duration(duration_s) < shortest_s * (1 - _ROUNDING):
        raise MotionRefusedError(
            f"the whole motion cannot take {duration_s:g} s; {shortest_words(shortest_s)}"
        )
    return max(duration_s / shortest_s, 1.0) if shortest_s > 0 else 1.0
