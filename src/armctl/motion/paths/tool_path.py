"""Leading the tool along a line or an arc: q(s) over the way gone, on the branch the arm is on.

A curve that cannot be followed is refused before the arm moves, with the place and the reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics.target import checked_number
from armctl.motion.paths.refusals import Attempt, end_refusal, limit_refusal, pitch_refusal
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolCurve
from armctl.motion.paths.tool_pitch import led_pitches, pitch_rows
from armctl.motion.paths.tool_walk import TILT, ToolTask, Walk, walk
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

PitchMode = Literal["kept", "interpolated", "free"]
"""tool pitch on the way: as at the start; evenly to that at the end; whatever takes the least motion"""
PITCH_MODES: tuple[PitchMode, ...] = get_args(PitchMode)
_PUSHES = (6.0, 30.0)
"""tried in this order: how strongly a free joint keeps away from the limits [rad/m]"""
_AT_ONCE = 1e-6


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

    def lead(start: FloatArray) -> PiecewisePolynomial | None:
        other = _best_walk(robot, _task(robot, start, curve, pitch, end_pitch), start)
        return other.path if other.complete and other.crossing is None else None

    held = "pitch" if pitch_held else "nothing"
    tried = Attempt(robot, curve, q, walked, held, chosen=task.redundant, lead=lead)
    if path is not None and crossing is not None:
        # a limit that is left at once, only because a singularity is at hand, is not the reason
        at_once = crossing[0] < _AT_ONCE * curve.length and walked.knots[-1].s < 1e3 * _AT_ONCE * curve.length
        if walked.complete or not at_once:
            raise limit_refusal(tried, path, *crossing)
    if path is None or not walked.complete:
        raise end_refusal(tried)
    if wish is not None and not pitch_held:
        refusal = pitch_refusal(robot, wish, curve, path)
        if refusal is not None:
            raise refusal
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
