"""Leading the tool along a line or an arc: q(s) over the way gone, on the branch the arm is on.

A curve that cannot be followed is refused before the arm moves, with the place and the reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts.angles import DEGREE
from armctl.kinematics import Target
from armctl.kinematics.angles import rotation_angle
from armctl.kinematics.target import checked_number
from armctl.lazy_dataclass import dataclass
from armctl.motion.paths.refusals import Attempt, end_refusal, limit_refusal, pitch_refusal, turn_refusal
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolCurve
from armctl.motion.paths.tool_orientation import PitchRows, ToolRotation, led_pitches, pitch_rows
from armctl.motion.paths.tool_walk import SHORTEST, StepBudget, ToolTask, Walk, walk
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

TurnMode = Literal["kept", "interpolated", "free"]
"""what the tool does on its way: as at the start; evenly to the end's; whatever takes the least motion"""
PitchMode = TurnMode
"""the same of its pitch alone"""
TURN_MODES: tuple[TurnMode, ...] = get_args(TurnMode)
_PUSHES = (6.0, 30.0)
"""tried in this order: how strongly a free joint keeps away from the limits [rad/m]"""
_DRIFTS = (0.5, 1.5, 4.0)
"""and then: by how much the free joints are led aside on the whole way, each way [rad]"""
_TRIED_STEPS, _LAST_STEPS = 60, 40
"""for all that is tried with free joints where the least motion does not lead along the whole curve; and for
the one that led farthest, once more for what is said of it"""
_AT_ONCE = 1e-6
_SAME_TURN = 0.01 * DEGREE
"""turns nearer to each other than this count as one where there is no way to turn on [rad]"""


def usual_pitch(robot: Robot) -> PitchMode:
    """What an arm can do along most lines: keep its pitch, or let it come where it has none of its own."""
    solver = robot.inverse_kinematics
    has_pitch = solver.pitch_and_roll(robot.pose("home"))[0] is not None
    return "kept" if has_pitch and len(solver.pitch_joints) != 2 else "free"


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    """How the tool is to turn on the way."""

    whole: bool
    """its whole orientation; else its pitch"""
    mode: TurnMode
    pitch: float | None = None
    """at the end [rad], where it is led there"""
    rotation: FloatArray | None = None
    """(3, 3) ``R_base_tool`` at the end, where it is led there"""

    @property
    def name(self) -> str:
        """What is kept or led, in a word."""
        return "orientation" if self.whole else "pitch"


def follow(
    robot: Robot,
    q_start: ArrayLike,
    curve: ToolCurve,
    pitch: PitchMode | None = None,
    end_pitch: float | None = None,
    orientation: TurnMode | None = None,
    end_rotation: ArrayLike | None = None,
) -> PiecewisePolynomial | None:
    """Lead the tool along a curve that begins where it is with the joints at ``q_start`` (n,) [rad].

    Either ``pitch`` is given, or ``orientation``, which is about the tool's whole rotation; neither: what the
    arm can do is kept, its orientation with six joints or more, else its pitch. The tool keeps within 0.01 mm
    of the curve, and within 1e-6 rad of the pitch or orientation asked for. With a pitch, or with "free", the
    roll joint stays. A free joint moves as little as serves, weighted by the joints' speeds, and is led
    around the limits.

    Returns:
        q(s) [rad] over 0 … ``curve.length`` [m], quintics, smooth to the second derivative; None for a curve
        so short that the arm stays.
    Raises ``InputError``: a value that is not finite, a curve that begins elsewhere, contradictory wishes
    (``end_pitch`` [rad] and ``end_rotation`` (3, 3) go with "interpolated", and only there);
    ``MotionRefusedError``: a start outside the limits; a limit, a singularity or the end of a branch on the
    way, or an orientation that the arm cannot keep there (``ToolPathRefusedError``, which knows the place); a
    pitch that this arm cannot hold; ``UnreachableError``: out of reach (``ToolPathUnreachableError``, which
    knows the place).
    """
    q = robot.chain.checked(q_start)
    robot.check_limits(q)
    turn = _checked_turn(robot, pitch, end_pitch, orientation, end_rotation)
    pose = robot.forward(q)
    away = float(np.linalg.norm(pose[:3, 3] - curve.positions(0.0)))
    if away > NO_WAY_M:
        raise InputError(f"the {curve.kind} begins {1000 * away:.4g} mm from where the tool is")
    if curve.length == 0.0:
        if _turns_by(robot, q, pose, turn) > _SAME_TURN:
            raise InputError(
                f"a {curve.kind} of no length leaves no way to turn the tool on; "
                f"go to a point with that {turn.name}"
            )
        return None
    task, pitch_asked = _task(robot, q, pose, curve, turn)
    walked = _best_walk(robot, task, q)
    path, crossing = walked.path, walked.crossing

    def lead(start: FloatArray, effort: StepBudget) -> PiecewisePolynomial | None:
        task, pitch = _task(robot, start, robot.forward(start), curve, turn)
        return _whole(robot, walk(task, start, only_inside=True, effort=effort), pitch, curve)

    tried = Attempt(robot, curve, q, walked, task.turn, chosen=task.redundant, pitch=pitch_asked, lead=lead)
    if path is not None and crossing is not None:
        # a limit that is left at once, only because a singularity is at hand, is not the reason
        at_once = crossing[0] < _AT_ONCE * curve.length and walked.knots[-1].s < 1e3 * _AT_ONCE * curve.length
        if walked.complete or not at_once:
            raise limit_refusal(tried, path, *crossing)
    if path is None or not walked.complete:
        raise (turn_refusal(tried, task) if task.overdetermined else None) or end_refusal(tried)
    if pitch_asked is not None and (refusal := pitch_refusal(robot, pitch_asked, curve, path)) is not None:
        raise refusal
    return path


def led_at_once(
    robot: Robot, q: FloatArray, curve: ToolCurve, mode: PitchMode, effort: StepBudget
) -> PiecewisePolynomial | None:
    """As ``follow`` with the pitch "kept" or "free", where a short search leads along the whole curve.

    None where it does not: then a longer one may. ``InputError``: the arm has no pitch, or too few joints.
    """
    task, pitch_asked = _task(robot, q, robot.forward(q), curve, _Turn(False, mode))
    walks = _walks(robot, task, q, effort, drifts=())
    paths = (_whole(robot, walked, pitch_asked, curve) for walked, _ in walks)
    return next((path for path in paths if path is not None), None)


def led_within(
    robot: Robot, q: FloatArray, curve: ToolCurve, effort: StepBudget
) -> PiecewisePolynomial | None:
    """As ``follow`` with what the arm usually keeps, as long as an ``effort`` lasts that several share.

    None where it leads to no end inside the limits, or nowhere: why is not asked, which takes longest.
    """
    if curve.length == 0.0 or effort.left <= 0:
        return None
    turn = _checked_turn(robot, None, None, None, None)
    task, pitch_asked = _task(robot, q, robot.forward(q), curve, turn)
    own = StepBudget(min(effort.left, _TRIED_STEPS)) if task.redundant else StepBudget(effort.left, SHORTEST)
    most = own.left
    paths = (_whole(robot, walked, pitch_asked, curve) for walked, _ in _walks(robot, task, q, own))
    path = next((path for path in paths if path is not None), None)
    effort.left -= most - own.left
    return path


def led_far(
    robot: Robot,
    q: FloatArray,
    curve: ToolCurve,
    pitch: PitchMode | None = None,
    orientation: TurnMode | None = None,
) -> tuple[PiecewisePolynomial | None, float]:
    """As ``follow``, as far as that leads inside the limits: q(s) up to there, and how far that is [m].

    It does not say why it ends there, which takes longer than to follow. None where it leads nowhere, or not
    with what is asked of the tool. ``InputError`` as ``follow``.
    """
    if curve.length == 0.0:
        return None, 0.0
    turn = _checked_turn(robot, pitch, None, orientation, None)
    task, pitch_asked = _task(robot, q, robot.forward(q), curve, turn)
    walked = _best_walk(robot, task, q) if task.redundant else walk(task, q, only_inside=True)
    path, reach = walked.path, walked.reach
    if path is None:
        return None, 0.0
    if pitch_asked is not None and pitch_refusal(robot, pitch_asked, curve, path) is not None:
        return None, 0.0
    if walked.complete and walked.crossing is None:
        return path, curve.length
    if reach <= _AT_ONCE * curve.length:
        return None, 0.0
    return path.cut(np.append(path.breaks[path.breaks < reach], reach)), reach


def _whole(
    robot: Robot, walked: Walk, pitch_asked: PitchRows | None, curve: ToolCurve
) -> PiecewisePolynomial | None:
    """The path where it leads along the whole curve inside the limits, with the pitch asked for."""
    if walked.path is None or not walked.complete or walked.crossing is not None:
        return None
    if pitch_asked is not None and pitch_refusal(robot, pitch_asked, curve, walked.path) is not None:
        return None
    return walked.path


def _checked_turn(
    robot: Robot,
    pitch: PitchMode | None,
    end_pitch: float | None,
    orientation: TurnMode | None,
    end_rotation: ArrayLike | None,
) -> _Turn:
    """What is asked for, or what the arm usually keeps."""
    asks_pitch, asks_whole = (
        mode is not None or end is not None for mode, end in ((pitch, end_pitch), (orientation, end_rotation))
    )
    if asks_pitch and asks_whole:
        raise InputError("give either the pitch of the tool on its way, or its orientation, not both")
    if asks_whole or (not asks_pitch and robot.orients_tool):
        mode = _checked_mode("orientation", "rotation", orientation, end_rotation is not None)
        rotation = None if end_rotation is None else Target.of(np.zeros(3), rotation=end_rotation).rotation
        return _Turn(True, mode, rotation=rotation)
    usual = pitch if asks_pitch else usual_pitch(robot)
    mode = _checked_mode("pitch", "pitch", usual, end_pitch is not None)
    end = None if end_pitch is None else checked_number(end_pitch, "the pitch at the end")
    return _Turn(False, mode, pitch=end)


def _checked_mode(name: str, end: str, mode: TurnMode | None, has_end: bool) -> TurnMode:
    """``InputError``: no such mode, or an end that does not go with it."""
    mode = "kept" if mode is None else mode
    if not isinstance(mode, str) or mode not in TURN_MODES:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"tool {name} {mode!r}: allowed are {', '.join(map(repr, TURN_MODES))}")
    if has_end and mode != "interpolated":
        raise InputError(f"a {end} at the end does not go with {name} {mode!r}; choose 'interpolated'")
    if not has_end and mode == "interpolated":
        raise InputError(f"{name} 'interpolated' needs the {end} at the end")
    return mode


def _turns_by(robot: Robot, q: FloatArray, pose: FloatArray, turn: _Turn) -> float:
    """How far the tool is from what it is to be at the end [rad]."""
    if turn.rotation is not None:
        return float(rotation_angle(turn.rotation @ pose[:3, :3].T))
    if turn.pitch is not None:
        return abs(turn.pitch - (robot.inverse_kinematics.pitch_and_roll(q)[0] or 0.0))
    return 0.0


def _task(
    robot: Robot, q: FloatArray, pose: FloatArray, curve: ToolCurve, turn: _Turn
) -> tuple[ToolTask, PitchRows | None]:
    """The equations of a path, as they are asked for.

    And the pitch that is asked for besides, where with so few joints the position decides it.
    """
    moves = robot.limits[:, 0] < robot.limits[:, 1]
    if turn.mode == "free":
        rows = None
    elif turn.whole:
        rows = ToolRotation.between(pose[:3, :3], turn.rotation, curve.length)
    elif robot.inverse_kinematics.pitch_and_roll(q)[0] is None:
        raise InputError("this arm's tool does not keep to its vertical plane: it has no pitch; choose free")
    else:
        rows = pitch_rows(robot, q, curve.length, turn.pitch)
    roll_joint = robot.inverse_kinematics.roll_joint
    if roll_joint is not None and not isinstance(rows, ToolRotation):
        moves[roll_joint] = False
    if np.count_nonzero(moves) < 3:
        raise InputError(f"the tool of {robot.name} cannot be led: it has too few joints")
    task = ToolTask(
        chain=robot.chain,
        curve=curve,
        moving=np.flatnonzero(moves),
        turn=rows,
        speeds=robot.speed_limits,
        limits=robot.limits,
    )
    if rows is None or isinstance(rows, ToolRotation) or not task.overdetermined:
        return task, None
    return replace(task, turn=None), rows


def _best_walk(robot: Robot, task: ToolTask, q: FloatArray) -> Walk:
    """The least motion; where that fails and a joint is free, the attempt that leads farthest."""
    attempts: list[tuple[Walk, ToolTask]] = []
    effort = StepBudget(_TRIED_STEPS) if task.redundant else None
    for walked, tried in _walks(robot, task, q, effort):
        if walked.complete and walked.crossing is None:
            return walked
        attempts.append((walked, tried))
    best, tried = max(attempts, key=lambda one: one[0].reach)
    if effort is None and best.crossing is None:
        return best
    # what a joint would need is known only from the whole curve, and where a branch ends from short steps
    last = None if effort is None else StepBudget(_LAST_STEPS, SHORTEST)
    return walk(tried, q, only_inside=best.crossing is None, effort=last, before=best)


def _walks(
    robot: Robot, task: ToolTask, q: FloatArray, effort: StepBudget | None, drifts: Sequence[float] = _DRIFTS
) -> Iterator[tuple[Walk, ToolTask]]:
    """The walk of a task, and of what else may be done about it with a free joint, while an effort lasts."""
    least = walk(task, q, only_inside=True, effort=effort)
    yield least, task
    if effort is None or not task.redundant:
        return
    for tried in _others(robot, task, least, q, effort, drifts):
        if effort.left <= 0:
            return
        yield walk(tried, q, only_inside=True, effort=effort), tried


def _others(
    robot: Robot, task: ToolTask, least: Walk, q: FloatArray, effort: StepBudget, drifts: Sequence[float]
) -> Iterator[ToolTask]:
    """What may be done with a free joint where the walk of the ``least`` motion does not lead on."""
    plane = robot.inverse_kinematics.plane
    if plane is not None and task.rows + 1 == len(task.moving) and task.turn is None:
        for pitch in led_pitches(robot, plane, q, task.curve):
            yield replace(task, turn=pitch)
        return
    if task.nears_limits(least.knots):
        for strength in _PUSHES:
            yield replace(task, push=strength)
    else:  # a push would lead the same way: these steps are counted, not made again
        effort.left -= min(effort.left, len(_PUSHES) * sum(least.tries))
    for turn, free in product(drifts, task.free_rates(q)):
        drift = free * (turn / (task.curve.length * np.abs(free * task.speeds[task.moving]).max()))
        for sense in (1.0, -1.0):
            yield replace(task, push=_PUSHES[0], drift=sense * drift)
