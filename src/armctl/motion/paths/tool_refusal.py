"""Why the tool cannot be led along a curve, and where: found before the arm moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import MotionRefusedError, UnreachableError
from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolCurve
from armctl.motion.paths.tool_pitch import elevations
from armctl.motion.paths.tool_walk import Walk
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

_BEYOND = 1e-4
"""how far past the end of a branch it is asked whether anything reaches there (share of the curve)"""

_AT_ONCE = 1e-6


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


class ToolPathRefusedError(MotionRefusedError):
    """A joint limit, the end of a branch or a singularity on the way."""

    def __init__(self, message: str, place: PathPlace, before: PiecewisePolynomial | None) -> None:
        super().__init__(message)
        self.place = place
        self.before = before
        """q(s) as far as the place; None where it cannot be left"""


class ToolPathUnreachableError(UnreachableError):
    """A stretch of the curve that the arm does not reach at all."""

    def __init__(self, message: str, place: PathPlace, before: PiecewisePolynomial | None) -> None:
        super().__init__(message)
        self.place = place
        self.before = before
        """q(s) as far as the place; None where it cannot be left"""


@dataclass(frozen=True, slots=True)
class Crossing:
    """Where a joint leaves its limits."""

    s: float
    """[m]"""
    joint: int


def first_crossing(path: PiecewisePolynomial, limits: FloatArray) -> Crossing | None:
    """The first place at which a joint leaves its limits (n, 2) [rad], exact; None: it never does."""
    bounds = limits + np.array([-LIMIT_TOLERANCE, LIMIT_TOLERANCE])
    least, most = path.bounds_by_piece()
    if (least >= bounds[:, 0]).all() and (most <= bounds[:, 1]).all():  # most paths: no exact extremes needed
        return None
    low, high = path.extremes_by_piece()
    outside = (low < bounds[:, 0]) | (high > bounds[:, 1])
    if not outside.any():
        return None
    piece = int(outside.any(axis=1).argmax())
    begin, width = float(path.breaks[piece]), float(path.breaks[piece + 1] - path.breaks[piece])
    unit = path.coefficients[piece]
    unit = unit * width ** np.arange(len(unit), dtype=np.float64)[:, None]
    found: list[Crossing] = []
    for joint in map(int, np.flatnonzero(outside[piece])):
        passed = (low[piece, joint] < bounds[joint, 0], high[piece, joint] > bounds[joint, 1])
        for bound, is_passed in zip(bounds[joint].tolist(), passed, strict=True):
            if is_passed:
                at_begin = not bounds[joint, 0] <= unit[0, joint] <= bounds[joint, 1]
                root = 0.0 if at_begin else _first_root(unit[:, joint], bound)
                found.append(Crossing(begin + width * root, joint))
    return min(found, key=lambda crossing: crossing.s)


def ends_at_once(walked: Walk, crossing: Crossing, length: float) -> bool:
    """Whether a limit is left only because a singularity is at hand: both at the very start."""
    return not walked.complete and crossing.s < _AT_ONCE * length and walked.s < 1e3 * _AT_ONCE * length


def refuse_limits(
    robot: Robot, curve: ToolCurve, path: PiecewisePolynomial, crossing: Crossing, *, pitch_held: bool
) -> ToolPathRefusedError:
    """What is said where a joint leaves its limits."""
    k, s = crossing.joint, crossing.s
    lower, upper = robot.limits[k]
    rest = path.cut(np.append(s, path.breaks[path.breaks > s])) if s < path.high else path
    low, high = (float(end[k]) for end in rest.extremes())
    needed = low if lower - low > high - upper else high
    place = _place(curve, s, k, needed)
    pitch, beyond = None, min(curve.length, s + 10 * _BEYOND * curve.length)
    if pitch_held:
        pitch = float(elevations(robot, robot.forward(path(beyond))[None])[0])
    ways = _other_ways(robot, curve.positions(beyond), pitch)
    message = (
        f"{_where(curve, place)}: {robot.joints[k].title} would need {math.degrees(needed):.2f}°, its limits "
        f"are {math.degrees(lower):.2f}° … {math.degrees(upper):.2f}°; {ways} or move the {curve.kind}"
    )
    return ToolPathRefusedError(message, place, _before(path, s))


def refuse_end(
    robot: Robot, curve: ToolCurve, walked: Walk, *, pitch_held: bool
) -> ToolPathRefusedError | ToolPathUnreachableError:
    """What is said where the branch ends: out of reach, or no smooth motion leads on."""
    if not walked.knots:
        place = _place(curve, 0.0)
        return ToolPathRefusedError(
            f"{_where(curve, place)}: the arm stands in a singularity and cannot begin this {curve.kind}; "
            "bend the arm first (Main → Home, or turn a joint)",
            place,
            None,
        )
    path, last = walked.polynomial, walked.knots[-1]
    pitch = float(elevations(robot, robot.forward(last.q)[None])[0]) if pitch_held else None
    why = _out_of_reach(robot, curve, last.s, pitch)
    if why is not None:
        place = _place(curve, last.s)
        return ToolPathUnreachableError(f"{_where(curve, place)}: {why}", place, _before(path, last.s))
    k = int((np.abs(last.slope) / robot.speed_limits).argmax())
    place = _place(curve, last.s, k)
    beyond = min(curve.length, last.s + _BEYOND * curve.length)
    ways = _other_ways(robot, curve.positions(beyond), pitch)
    return ToolPathRefusedError(
        f"{_where(curve, place)}: {robot.joints[k].title} would have to turn without bound "
        f"({math.degrees(abs(last.slope[k])) / 1000:.3g}° a mm and more): a singularity, where this branch "
        f"ends; {ways} or move the {curve.kind}",
        place,
        _before(path, last.s),
    )


def _out_of_reach(robot: Robot, curve: ToolCurve, s: float, pitch: float | None) -> str | None:
    """Why no branch reaches the curve just beyond ``s`` [m], limits not looked at; None: one does."""
    left = curve.length - s
    searched = not robot.inverse_kinematics.complete  # by many starts: too slow to ask often

    def missing(share: float) -> str | None:
        point = curve.positions(s + share * left)
        solutions = robot.inverse(point, pitch)
        reached = solutions.success or (not searched and robot.branches(point, pitch))
        return None if reached else solutions.explanation

    nearest = min(1.0, _BEYOND * curve.length / left) if left > 0.0 else 0.0
    why, share = missing(nearest), nearest
    if why is None:
        return None
    farther = 1.0
    while farther > nearest and not searched:  # clearer than just beyond, where all is a trifle too far
        clearer = missing(farther)
        if clearer is not None:
            why, share = clearer, farther
            break
        farther *= 0.5
    left_for = "the arm's reach" if pitch is None else "what the arm reaches with that pitch"
    return f"here it leaves {left_for}; at {100.0 * (s + share * left) / curve.length:.0f} %, {why}"


def _place(curve: ToolCurve, s: float, joint: int | None = None, needed: float | None = None) -> PathPlace:
    return PathPlace(s, s / curve.length, curve.positions(s), joint, needed)


def _where(curve: ToolCurve, place: PathPlace) -> str:
    x, y, z = (1000.0 * place.point).tolist()
    return f"{100.0 * place.fraction:.0f} % of the {curve.kind} (x {x:.1f}, y {y:.1f}, z {z:.1f} mm)"


def _before(path: PiecewisePolynomial | None, s: float) -> PiecewisePolynomial | None:
    """A path as far as ``s`` [m]; None where that is no way at all."""
    if path is None or s < NO_WAY_M:
        return None
    return path.cut(np.append(path.breaks[path.breaks < s], s))


def _other_ways(robot: Robot, point: FloatArray, pitch: float | None) -> str:
    """What to do instead, with the branches that reach a point at a held pitch inside the limits."""
    advice = "start on another branch"
    if pitch is None or not robot.inverse_kinematics.complete:
        return advice
    names = sorted(set(map(str, robot.inverse(point, pitch).branch)))
    return f"{advice} ({' or '.join(names)} can be here)" if names else advice


def _first_root(c: FloatArray, bound: float) -> float:
    """Where a polynomial over 0 … 1 (lowest power first) first reaches a bound that it passes."""
    shifted = c.copy()
    shifted[0] -= bound
    largest = np.abs(shifted).max()
    roots = np.roots(shifted[::-1] / largest)
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > -1e-9) & (roots.real < 1 + 1e-9)]
    return float(np.clip(inside, 0.0, 1.0).min(initial=1.0))
