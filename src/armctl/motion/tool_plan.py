"""Motions of the tool in a straight line or along an arc, and of the joints smoothly through points."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError
from armctl.kinematics.target import as_numbers
from armctl.motion.paths import (
    PitchMode,
    ToolPath,
    ToolPathRefusedError,
    ToolPathUnreachableError,
    tool_arc,
    tool_line,
)
from armctl.motion.polynomial import PiecewisePolynomial, spline_through
from armctl.motion.preflight import require_clear
from armctl.motion.profiles import PointToPoint, ProfileName
from armctl.motion.timing import PathTrajectory, timed
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
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
        checked: run the pre-flight; False only for who runs it over many motions at once.

    Raises:
        InputError: a value that is not finite, or a wrong shape.
        UnreachableError: a place on the way is out of reach; says when, where and why.
        MotionRefusedError: a limit, a singular pose or another branch on the way, said with the time, the
            place and the joint; too short a duration; the floor.
    """
    path = follow_line(robot, as_numbers(start, "joint angles"), position_m, pitch, end_pitch, speed)
    return _timed(robot, start, path, speed, duration_s, profile, checked=checked)


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
    return _timed(robot, start, path, speed, duration_s, profile, checked=checked)


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
        checked: run the pre-flight; False only for who runs it over many motions at once.

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
    return _timed(robot, q[0], path, None, duration_s, profile, checked=checked)


def plan_path(
    robot: Robot,
    path: PiecewisePolynomial,
    *,
    speed: float | None = None,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """Plan a motion along a path q(s) of the joints, (n,) [rad], and check it.

    Args:
        robot: the arm.
        path: from ``follow_line``, ``follow_arc`` or ``spline_through``.
        speed: largest ds/dt: of the tool [m/s] where s is its way; None: as fast as the joints can.
        duration_s: seconds; None: the shortest.
        profile: how the way is spread over time.
        checked: run the pre-flight; False only for who runs it over many motions at once.

    Raises:
        InputError: a speed that is not positive, or a duration that is not a time.
        MotionRefusedError: too short a duration, or what the pre-flight finds.
    """
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
    """The same along the circle through three points.

    Raises:
        As ``plan_arc``, but for the duration and the floor.
    """
    return _followed(robot, speed, lambda: tool_arc(robot, start, via_m, end_m, pitch, end_pitch))


def _followed(
    robot: Robot, speed: float | None, follow: Callable[[], ToolPath]
) -> PiecewisePolynomial | None:
    try:
        found = follow()
    except (ToolPathRefusedError, ToolPathUnreachableError) as cause:
        seconds = _time_to(robot, cause.before, speed)
        raise type(cause)(f"at {seconds:.2f} s, {cause}", cause.place, cause.before) from cause
    return None if found.is_still else found.polynomial


def _time_to(robot: Robot, before: PiecewisePolynomial | None, speed: float | None) -> float:
    """When the tool would come to where a path ends, without slowing down for it [s]."""
    if before is None:
        return 0.0
    cap = math.inf if speed is None else speed
    return PathTrajectory.fastest(robot, before, cap, last=math.inf).duration


def _timed(
    robot: Robot,
    start: ArrayLike,
    path: PiecewisePolynomial | None,
    speed: float | None,
    duration_s: float | None,
    profile: ProfileName,
    *,
    checked: bool,
) -> Trajectory:
    if path is None:
        return PointToPoint.lasting(start, start, 0.0 if duration_s is None else duration_s)
    return plan_path(robot, path, speed=speed, duration_s=duration_s, profile=profile, checked=checked)
