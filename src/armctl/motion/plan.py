"""From what is asked for to a trajectory that has passed its pre-flight.

Everywhere: ``start`` (n,) [rad] is where the arm stands; without ``duration_s`` [s] a motion takes the
shortest that the limits allow; ``checked`` runs the pre-flight, without it the caller does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError, UnreachableError
from armctl.facts import Freer
from armctl.kinematics.target import as_numbers, checked_number, require_finite
from armctl.motion.blend import Leg, blend
from armctl.motion.one_sided import ONE_SIDED, OneSided, commanded_end, one_sided_stops
from armctl.motion.paths.refusals import ToolPathRefusedError, ToolPathUnreachableError, beyond_links
from armctl.motion.paths.tool_curve import ToolArc, ToolCurve, ToolLine
from armctl.motion.paths.tool_path import PitchMode, TurnMode, follow, led_at_once, led_within
from armctl.motion.paths.tool_walk import StepBudget
from armctl.motion.polynomial import PiecewisePolynomial, points_apart, spline_through
from armctl.motion.preflight import passes, require_clear, require_robot
from armctl.motion.profiles import PointToPoint, ProfileName, checked_profile, lasting_s
from armctl.motion.timing import PathTrajectory, timed
from armctl.motion.trajectory import JoinedTrajectory, SlowedTrajectory, Trajectory
from armctl.robot import Robot

Profile = ProfileName | OneSided | Literal["normal"]
"""A law for all joints together; a cubic that comes to the end from one side; or "normal": each joint at its
own speed (takes no duration)."""
_FREER_STEPS = 20
"""for each of the questions whether a curve can be followed with less asked of the tool's turn"""
_SLOWEST = 1e-6
"""of the tool, so that it comes to an end [m/s]"""


def plan_joints(
    robot: Robot,
    start: ArrayLike,
    end: ArrayLike,
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> Trajectory:
    """Plan a motion to joint angles (n,) [rad] and check it; "normal" with a duration is a cubic.

    From one side ("end-plus", "end-minus") the links come to stand there: what is commanded may be a little
    ahead (``one_sided``).

    Raises ``InputError`` for what is no configuration, ``MotionRefusedError`` for one outside the joint
    limits, too short a duration, or what the pre-flight refuses.
    """
    require_robot(robot)
    end = robot.check_limits(end)
    if profile in ONE_SIDED:
        begin, end = robot.chain.checked(start), commanded_end(robot, end, profile)
        stops = one_sided_stops(robot, begin, end, profile)
        trajectory: Trajectory = plan_through(robot, stops, duration_s)
    elif str(profile) == "normal" and duration_s is None:
        trajectory = PointToPoint.each_for_itself(robot, start, end)
    else:
        law = "cubic" if str(profile) == "normal" else checked_profile(profile)
        trajectory = PointToPoint.plan(robot, start, end, duration_s, law)
    if checked:
        require_clear(robot, trajectory)
    return trajectory


# Motions of the tool along a line or an arc, and of the joints smoothly through points.


def plan_line(
    robot: Robot,
    start: ArrayLike,
    position_m: ArrayLike,
    *,
    pitch: PitchMode | None = None,
    end_pitch: float | None = None,
    orientation: TurnMode | None = None,
    end_rotation: ArrayLike | None = None,
    speed: float | None = None,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """Plan a motion of the tool straight to a position (3,) [m], on the branch the arm is on, and check it.

    ``orientation``: the tool's rotation is kept as at the start, turns evenly to ``end_rotation`` (3, 3)
    ``R_base_tool``, or is free. ``pitch``, instead: the same for its pitch alone, to ``end_pitch`` [rad].
    Without either the arm keeps what it can, the orientation with six joints or more, else the pitch.
    ``speed`` is the largest of the tool [m/s]; None: as fast as the joints can.
    Raises ``InputError``: a value that is not finite, or a wrong shape; ``UnreachableError``: a place on the
    way is out of reach; ``MotionRefusedError``: a limit, a singular pose or another branch on the way, with
    the time, the place and the joint; too short a duration; the floor.
    """
    turn = (pitch, end_pitch, orientation, end_rotation)
    path = follow_tool(robot, start, None, position_m, *turn, speed=speed)
    return plan_path(robot, start, path, speed=speed, duration_s=duration_s, profile=profile, checked=checked)


def plan_arc(
    robot: Robot,
    start: ArrayLike,
    via_m: ArrayLike,
    end_m: ArrayLike,
    *,
    pitch: PitchMode | None = None,
    end_pitch: float | None = None,
    orientation: TurnMode | None = None,
    end_rotation: ArrayLike | None = None,
    speed: float | None = None,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """As ``plan_line``, along the circle through where the tool is, ``via_m`` and ``end_m`` (3,) [m]."""
    turn = (pitch, end_pitch, orientation, end_rotation)
    path = follow_tool(robot, start, via_m, end_m, *turn, speed=speed)
    return plan_path(robot, start, path, speed=speed, duration_s=duration_s, profile=profile, checked=checked)


def plan_spline(
    robot: Robot,
    points: ArrayLike,
    *,
    duration_s: float | None = None,
    profile: ProfileName = "trapezoid",
    checked: bool = True,
) -> Trajectory:
    """Plan a motion through configurations (k, n) [rad] without a stop, from the first on, and check it.

    Points that less than a microsecond of motion separates count as one. Raises as ``plan_joints``; the curve
    may swing beyond a point, and so leave the joint limits.
    """
    q = _checked_stops(robot, points, "a spline")
    apart = points_apart(q, 1.0 / robot.speed_limits)
    if len(apart) < 2:
        return plan_joints(robot, q[0], q[-1], duration_s, profile, checked=checked)
    path = spline_through(apart, 1.0 / robot.speed_limits)
    return plan_path(robot, q[0], path, duration_s=duration_s, profile=profile, checked=checked)


def _checked_stops(robot: Robot, stops: ArrayLike, what: str) -> FloatArray:
    """Configurations (k, n) [rad] to go through, one at least; ``InputError`` for anything else."""
    require_robot(robot)
    q = as_numbers(stops, "joint angles")
    if q.ndim != 2 or q.shape[1] != robot.n or len(q) == 0:
        raise InputError(f"{what} needs configurations (k, {robot.n}), got the shape {q.shape}")
    require_finite(q, "joint angles")
    return q


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
    """Plan a motion along a path q(s) of the joints, (n,) [rad] (None: the arm stays), and check it.

    ``speed``: largest ds/dt, of the tool [m/s] where s is its way; None: as fast as the joints can.
    """
    if path is None:
        return PointToPoint.lasting(start, start, 0.0 if duration_s is None else duration_s)
    trajectory = timed(robot, path, profile=profile, rate_cap=_cap(speed), duration_s=duration_s)
    if checked:
        require_clear(robot, trajectory, tool_path=True)
    return trajectory


def _cap(speed: float | None) -> float:
    if speed is None:
        return math.inf
    checked = checked_number(speed, "the speed of the tool")
    if checked < _SLOWEST:
        raise InputError(f"the tool cannot move at {1000 * checked:.6g} mm/s; {1000 * _SLOWEST:g} at least")
    return checked


def follow_tool(
    robot: Robot,
    start: ArrayLike,
    via_m: ArrayLike | None,
    end_m: ArrayLike,
    pitch: PitchMode | None = None,
    end_pitch: float | None = None,
    orientation: TurnMode | None = None,
    end_rotation: ArrayLike | None = None,
    *,
    speed: float | None = None,
) -> PiecewisePolynomial | None:
    """The joints' path q(s) along a line of the tool, or the arc over ``via_m``; s is its way [m].

    None where it goes nowhere. Raises as ``plan_line``, but for the duration and the floor; a refusal says
    whether the way can be had with less asked of the tool's turn.
    """
    require_robot(robot)
    q = robot.chain.checked(as_numbers(start, "joint angles"))
    tool = robot.forward(q)[:3, 3]
    curve = ToolLine(tool, end_m) if via_m is None else ToolArc(tool, via_m, end_m)
    try:
        return follow(robot, q, curve, pitch, end_pitch, orientation, end_rotation)
    except (ToolPathRefusedError, ToolPathUnreachableError) as cause:
        seconds, cap = 0.0, _cap(speed)
        if cause.before is not None:  # when the tool comes there, without slowing down for it
            seconds = PathTrajectory.fastest(robot, cause.before, cap, last=math.inf).duration
        freer = _freer(robot, q, curve, cap, pitch, orientation)
        told = replace(cause.on_curve, at_s=seconds, freer=freer)
        raise type(cause)(told, cause.place, cause.before) from cause


def straight_way(
    robot: Robot, start: FloatArray, end_m: ArrayLike, effort: StepBudget
) -> PiecewisePolynomial | None:
    """As ``follow_tool`` along a line from ``start`` (n,) [rad]; None: no way inside the limits was found.

    Quicker, where why not is not asked; ``effort``: of all those that are tried for one answer.
    """
    return led_within(robot, start, ToolLine(robot.forward(start)[:3, 3], end_m), effort)


def _freer(
    robot: Robot,
    q: FloatArray,
    curve: ToolCurve,
    cap: float,
    pitch: PitchMode | None,
    orientation: TurnMode | None,
) -> Freer | None:
    """With how much less asked of the tool the curve can be followed all the same; None: it cannot."""
    whole = orientation is not None or (pitch is None and robot.orients_tool)
    if (orientation if whole else pitch) == "free":
        return None
    if beyond_links(robot, curve) is not None:
        return None  # the tool comes to no such place, however it is turned
    ways: list[tuple[Literal["kept", "free"], Freer]] = [
        ("free", "orientation free" if whole else "pitch free")
    ]
    if whole and robot.inverse_kinematics.pitch_and_roll(q)[0] is not None:
        ways.insert(0, ("kept", "pitch kept"))
    for mode, freer in ways:
        try:
            path = led_at_once(robot, q, curve, mode, StepBudget(_FREER_STEPS))
            if path is None:
                continue
            follows = passes(robot, PathTrajectory.fastest(robot, path, cap), tool_path=True)
        except (InputError, MotionRefusedError, UnreachableError):  # InputError: an arm that has no pitch
            continue
        if follows:
            return freer
    return None


# Motions through a list of points: at rest in each, smoothly through all, or turning off before each.

Passing = Literal["stop", "spline", "blend"]
"""at rest in each point; smoothly through all points; turning off before each point, towards the next"""


def plan_through(
    robot: Robot,
    stops: Sequence[FloatArray],
    duration_s: float | None = None,
    profile: ProfileName | Literal["normal"] = "cubic",
) -> JoinedTrajectory:
    """Plan a motion through configurations (n,) [rad], at rest in each; no pre-flight.

    A duration slows all parts alike; where all stops are equal, the arm stands that long. Raises
    ``MotionRefusedError`` where it is too short.
    """
    law = "cubic" if profile == "normal" and duration_s is not None else profile
    points = _checked_stops(robot, stops, "a motion through points")
    if len(points) == 1:
        return JoinedTrajectory([plan_joints(robot, points[0], points[0], duration_s, law, checked=False)])
    parts = [plan_joints(robot, *ends, None, law, checked=False) for ends in pairwise(points)]
    shortest = JoinedTrajectory(parts)
    if duration_s is None:
        return shortest
    lasts = _whole_s(duration_s, shortest.duration, "trapezoid" if law == "normal" else law)
    each = [part.duration for part in parts] if shortest.duration else [1.0] * len(parts)
    factor = lasts / sum(each)
    return JoinedTrajectory(
        [
            plan_joints(robot, part.start, part.end, factor * length, law, checked=False)
            for part, length in zip(parts, each, strict=True)
        ]
    )


def plan_blended(
    robot: Robot, stops: Sequence[FloatArray], radius_m: float, duration_s: float | None = None
) -> Trajectory:
    """Plan a motion that turns off towards the next configuration before it comes to each; no pre-flight.

    ``stops`` (n,) [rad]; the tool may begin to turn off ``radius_m`` [m] before each. Where all stops are
    equal, the arm stands. Raises ``InputError`` for a radius that is not positive, ``MotionRefusedError`` for
    too short a duration.
    """
    radius_m, points = checked_number(radius_m, "a blend radius"), _checked_stops(robot, stops, "a blend")
    if not radius_m > 0:
        raise InputError(
            f"a blend radius must be positive, got {1000 * radius_m:g} mm; or stop at each point"
        )
    legs = [
        Leg(PiecewisePolynomial([0.0, 1.0], np.stack([start, end - start])[None]), radius_m)
        for start, end in pairwise(points)
        if bool((start != end).any())
    ]
    if not legs:
        return PointToPoint.lasting(points[0], points[0], 0.0 if duration_s is None else duration_s)
    legs[-1] = Leg(legs[-1].path)
    shortest = JoinedTrajectory(blend(robot, legs).trajectories)
    if duration_s is None:
        return shortest
    lasts = _whole_s(duration_s, shortest.duration, "trapezoid", exact=False)
    return SlowedTrajectory(shortest, lasts / shortest.duration)


def _whole_s(duration_s: float, shortest: float, profile: ProfileName, *, exact: bool = True) -> float:
    return lasting_s(
        duration_s, shortest, lambda _, told: f"the whole motion cannot take {told}", profile, exact=exact
    )
