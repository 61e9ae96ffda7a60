"""What is said of a line or an arc that the tool cannot follow: the place, the reason, what to do instead."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, MotionRefusedError, UnreachableError
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolCurve
from armctl.motion.paths.tool_pitch import PitchRows, elevations
from armctl.motion.paths.tool_walk import TILT, Walk
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

_SAMPLES = 65
_BEYOND = 1e-4
"""how far past the end of a branch it is asked whether anything reaches there (share of the curve)"""


@dataclass(frozen=True, slots=True, eq=False)
class PathPlace:
    """Where on a curve it is, and what is wrong there."""

    s: float
    """way gone [m]"""
    fraction: float
    """share of the whole way, 0 … 1"""
    point: FloatArray
    """(3,) tool point, base frame [m]"""
    joint: int | None = None
    """index of the joint that cannot do what it would have to"""
    needed: float | None = None
    """the angle that it would need beyond its limits, the farthest on the curve [rad]"""


class _PlacedError(ArmctlError):
    def __init__(self, message: str, place: PathPlace, before: PiecewisePolynomial | None) -> None:
        super().__init__(message)
        self.place = place
        self.before = before
        """q(s) as far as the place; None where it cannot be left"""


class ToolPathRefusedError(_PlacedError, MotionRefusedError):
    """A joint limit, the end of a branch or a singularity on the way."""


class ToolPathUnreachableError(_PlacedError, UnreachableError):
    """A stretch of the curve that the arm does not reach at all."""


def pitch_refusal(
    robot: Robot, wish: PitchRows, curve: ToolCurve, path: PiecewisePolynomial
) -> MotionRefusedError | None:
    """For a path on which the pitch, which the position decides, is not the one asked for."""
    s = np.linspace(0.0, curve.length, _SAMPLES)
    poses = robot.forward(path(s))
    if (wish.tilt(path(s), poses, s) <= TILT).all():
        return None
    seen = np.degrees(elevations(robot, poses))
    return MotionRefusedError(
        f"the position alone decides this arm's tool pitch: along the {curve.kind} it goes through "
        f"{seen.min():.2f}° … {seen.max():.2f}°, so that it can be neither kept nor led; choose free"
    )


def limit_refusal(
    robot: Robot, curve: ToolCurve, path: PiecewisePolynomial, s: float, k: int, *, pitch_held: bool
) -> ToolPathRefusedError:
    """Joint ``k`` leaves its limits at ``s`` [m]: says by how much on the rest of the curve."""
    lower, upper = robot.limits[k]
    rest = path.cut(np.append(s, path.breaks[path.breaks > s])) if s < path.high else path
    low, high = (float(end[k]) for end in rest.extremes())
    needed = low if lower - low > high - upper else high
    pitch, beyond = None, min(curve.length, s + 10 * _BEYOND * curve.length)
    if pitch_held:
        pitch = float(elevations(robot, robot.forward(path(beyond))[None])[0])
    place = PathPlace(s, s / curve.length, curve.positions(s), k, needed)
    message = (
        f"{_where(curve, place)}: {robot.joints[k].title} would need {math.degrees(needed):.2f}°, its limits "
        f"are {math.degrees(lower):.2f}° … {math.degrees(upper):.2f}°; "
        f"{_other_ways(robot, curve, beyond, pitch)}"
    )
    return ToolPathRefusedError(message, place, _before(path, s))


def end_refusal(
    robot: Robot, curve: ToolCurve, walked: Walk, *, pitch_held: bool
) -> ToolPathRefusedError | ToolPathUnreachableError:
    """The branch ends: out of reach, or no smooth motion leads on."""
    if not walked.knots:
        place = PathPlace(0.0, 0.0, curve.positions(0.0))
        return ToolPathRefusedError(
            f"{_where(curve, place)}: the arm stands in a singularity and cannot begin this {curve.kind}; "
            "bend the arm first (Main → Home, or turn a joint)",
            place,
            None,
        )
    last = walked.knots[-1]
    s, before = last.s, _before(walked.path, last.s)
    place = PathPlace(s, s / curve.length, curve.positions(s))
    pitch = float(elevations(robot, robot.forward(last.q)[None])[0]) if pitch_held else None
    why = _out_of_reach(robot, curve, s, pitch)
    if why is not None:
        return ToolPathUnreachableError(f"{_where(curve, place)}: {why}", place, before)
    k = int((np.abs(last.slope) / robot.speed_limits).argmax())
    beyond = min(curve.length, s + _BEYOND * curve.length)
    return ToolPathRefusedError(
        f"{_where(curve, place)}: {robot.joints[k].title} would have to turn without bound "
        f"({math.degrees(abs(last.slope[k])) / 1000:.3g}° a mm and more): a singularity, where this branch "
        f"ends; {_other_ways(robot, curve, beyond, pitch)}",
        replace(place, joint=k),
        before,
    )


def _out_of_reach(robot: Robot, curve: ToolCurve, s: float, pitch: float | None) -> str | None:
    """Why no branch reaches the curve just beyond ``s`` [m], limits not looked at; None: one does."""
    left = curve.length - s
    searched = robot.inverse_kinematics.searches_parts  # by many starts: too slow to ask often

    def missing(share: float) -> str | None:
        point = curve.positions(s + share * left)
        solutions = robot.inverse(point, pitch)
        reached = solutions.success or (not searched and robot.branches(point, pitch))
        return None if reached else solutions.explanation

    nearest = min(1.0, _BEYOND * curve.length / left) if left > 0.0 else 0.0
    why, share = missing(nearest), nearest
    if why is None:
        return None
    farther, clearer = 1.0, None
    while clearer is None and farther > nearest and not searched:  # clearer than just beyond
        clearer = missing(farther)
        if clearer is not None:
            why, share = clearer, farther
        farther *= 0.5
    left_for = "the arm's reach" if pitch is None else "what the arm reaches with that pitch"
    return f"here it leaves {left_for}; at {100.0 * (s + share * left) / curve.length:.0f} %, {why}"


def _where(curve: ToolCurve, place: PathPlace) -> str:
    x, y, z = (1000.0 * place.point).tolist()
    return f"{100.0 * place.fraction:.0f} % of the {curve.kind} (x {x:.1f}, y {y:.1f}, z {z:.1f} mm)"


def _before(path: PiecewisePolynomial | None, s: float) -> PiecewisePolynomial | None:
    """A path as far as ``s`` [m]; None where that is no way at all."""
    if path is None or s < NO_WAY_M:
        return None
    return path.cut(np.append(path.breaks[path.breaks < s], s))


def _other_ways(robot: Robot, curve: ToolCurve, s: float, pitch: float | None) -> str:
    """What to do instead, with the branches that reach ``s`` [m] at a held pitch inside the limits."""
    names: list[str] = []
    if pitch is not None and not robot.inverse_kinematics.searches_parts:
        names = sorted(set(map(str, robot.inverse(curve.positions(s), pitch).branch)))
    offer = f" ({' or '.join(names)} can be here)" if names else ""
    return f"start on another branch{offer} or move the {curve.kind}"
