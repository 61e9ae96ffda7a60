"""Leading the tool along a line or an arc: q(s) over the way gone, on the branch the arm is on.

A curve that cannot be followed is refused before the arm moves, with the place and the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError, MotionRefusedError, UnreachableError
from armctl.kinematics.target import checked_number
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolCurve
from armctl.motion.paths.tool_pitch import PitchRows, elevations, led_pitches, pitch_rows
from armctl.motion.paths.tool_walk import TILT, ToolTask, Walk, walk
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

PitchMode = Literal["kept", "interpolated", "free"]
"""tool pitch on the way: as at the start; evenly to that at the end; whatever takes the least motion"""
PITCH_MODES: tuple[PitchMode, ...] = get_args(PitchMode)
_PUSHES = (6.0, 30.0)
"""tried in this order: how strongly a free joint keeps away from the limits [rad/m]"""
_SAMPLES = 65
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


def usual_pitch(robot: Robot) -> PitchMode:
    """What an arm can do along most lines: keep its pitch, or, with two pitch joints, let it come."""
    return "free" if len(robot.inverse_kinematics.pitch_joints) == 2 else "kept"


def follow(
    robot: Robot, q_start: ArrayLike, curve: ToolCurve, pitch: PitchMode, end_pitch: float | None = None
) -> PiecewisePolynomial | None:
    """Lead the tool along a curve that begins where it is with the joints at ``q_start`` (n,) [rad].

    The tool keeps within 0.01 mm of the curve, and a held pitch within 0.01°. The roll joint stays. A free
    joint moves as little as serves, weighted by the joints' speeds, and is led around the limits.

    Returns:
        q(s) [rad] over 0 … ``curve.length`` [m], quintics, smooth to the second derivative; None for a curve
        so short that the arm stays.
    Raises ``InputError``: a value that is not finite, a curve that begins elsewhere, contradictory wishes
    about the pitch (``end_pitch`` [rad] goes with "interpolated", and only there); ``MotionRefusedError``: a
    start outside the limits; a limit, a singularity or the end of a branch on the way
    (``ToolPathRefusedError``, which knows the place); a pitch that this arm cannot hold;
    ``UnreachableError``: out of reach (``ToolPathUnreachableError``, which knows the place).
    """
    q = robot.chain.checked(q_start)
    robot.check_limits(q)
    end_pitch = _checked_end(pitch, end_pitch)
    away = float(np.linalg.norm(robot.forward(q)[:3, 3] - curve.positions(0.0)))
    if away > NO_WAY_M:
        raise InputError(f"the {curve.kind} begins {1000 * away:.4g} mm from where the tool is")
    if curve.length == 0.0:
        tool_pitch, _ = robot.inverse_kinematics.pitch_and_roll(q)
        if end_pitch is not None and abs(end_pitch - (tool_pitch or 0.0)) > TILT:
            raise InputError(
                f"a {curve.kind} of no length leaves no way to turn the tool on; "
                "go to a point with that pitch"
            )
        return None
    task = _task(robot, q, curve, pitch, end_pitch)
    # with too few joints the position decides the pitch, which may be the one that is asked for all the same
    wish, task = task.pitch, task if task.rows <= len(task.moving) else replace(task, pitch=None)
    walked = _best_walk(robot, task, q)
    path, crossing, pitch_held = walked.path, walked.crossing, task.pitch is not None
    if path is not None and crossing is not None:
        # a limit that is left at once, only because a singularity is at hand, is not the reason
        at_once = crossing[0] < _AT_ONCE * curve.length and walked.knots[-1].s < 1e3 * _AT_ONCE * curve.length
        if walked.complete or not at_once:
            raise _limit_refusal(robot, curve, path, *crossing, pitch_held=pitch_held)
    if path is None or not walked.complete:
        raise _end_refusal(robot, curve, walked, pitch_held=pitch_held)
    if wish is not None and not pitch_held:
        _require_pitch(robot, wish, curve, path)
    return path


def _checked_end(pitch: PitchMode, end_pitch: float | None) -> float | None:
    """The pitch at the end [rad], where there is to be one."""
    if pitch not in PITCH_MODES:
        raise InputError(f"tool pitch {pitch!r}: allowed are {', '.join(map(repr, PITCH_MODES))}")
    if end_pitch is None:
        if pitch == "interpolated":
            raise InputError("pitch 'interpolated' needs the pitch at the end")
        return None
    if pitch != "interpolated":
        raise InputError(f"a pitch at the end does not go with pitch {pitch!r}; choose 'interpolated'")
    return checked_number(end_pitch, "the pitch at the end")


def _task(
    robot: Robot, q: FloatArray, curve: ToolCurve, pitch: PitchMode, end_pitch: float | None
) -> ToolTask:
    """The equations of a path, as they are asked for."""
    if pitch != "free" and robot.inverse_kinematics.pitch_and_roll(q)[0] is None:
        raise InputError("this arm's tool does not keep to its vertical plane: it has no pitch; choose free")
    moves = robot.limits[:, 0] < robot.limits[:, 1]
    roll_joint = robot.inverse_kinematics.roll_joint
    if roll_joint is not None:
        moves[roll_joint] = False
    if np.count_nonzero(moves) < 3:
        raise InputError(f"the tool of {robot.name} cannot be led: it has too few joints")
    return ToolTask(
        chain=robot.chain,
        curve=curve,
        moving=np.flatnonzero(moves),
        pitch=None if pitch == "free" else pitch_rows(robot, q, curve.length, end_pitch),
        speeds=robot.speed_limits,
        limits=robot.limits,
    )


def _best_walk(robot: Robot, task: ToolTask, q: FloatArray) -> Walk:
    """The least motion; where that fails and a joint is free, the attempt that leads farthest."""
    attempts: list[tuple[Walk, ToolTask]] = []
    for tried in _tasks(robot, task, q):
        walked = walk(tried, q, only_inside=True)
        if walked.complete and walked.crossing is None:
            return walked
        attempts.append((walked, tried))
    best, tried = max(attempts, key=lambda one: one[0].reach)
    # what a joint would need is known only from the whole curve
    return best if best.crossing is None else walk(tried, q, only_inside=False)


def _tasks(robot: Robot, task: ToolTask, q: FloatArray) -> Iterator[ToolTask]:
    """The task, and what else may be done about it with a free joint."""
    yield task
    if not task.redundant:
        return
    plane = robot.inverse_kinematics.plane
    if plane is not None and task.rows + 1 == len(task.moving) and task.pitch is None:
        for pitch in led_pitches(robot, plane, q, task.curve):
            yield replace(task, pitch=pitch)
    else:
        for strength in _PUSHES:
            yield replace(task, push=strength)


def _require_pitch(robot: Robot, wish: PitchRows, curve: ToolCurve, path: PiecewisePolynomial) -> None:
    """Refuse a path on which the pitch, which the position decides, is not the one asked for."""
    s = np.linspace(0.0, curve.length, _SAMPLES)
    poses = robot.forward(path(s))
    if (wish.tilt(path(s), poses, s) <= TILT).all():
        return
    seen = np.degrees(elevations(robot, poses))
    raise MotionRefusedError(
        f"the position alone decides this arm's tool pitch: along the {curve.kind} it goes through "
        f"{seen.min():.2f}° … {seen.max():.2f}°, so that it can be neither kept nor led; choose free"
    )


def _limit_refusal(
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


def _end_refusal(
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
    if pitch is not None and robot.inverse_kinematics.complete:
        names = sorted(set(map(str, robot.inverse(curve.positions(s), pitch).branch)))
    offer = f" ({' or '.join(names)} can be here)" if names else ""
    return f"start on another branch{offer} or move the {curve.kind}"
