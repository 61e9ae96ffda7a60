"""Leading the tool along a line or an arc: q(s) over the way gone, on the branch the arm is on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError
from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.kinematics.target import checked_number
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolArc, ToolCurve, ToolLine
from armctl.motion.paths.tool_pitch import (
    SMOOTHINGS,
    PitchGrid,
    PitchRows,
    PlanePitch,
    elevations,
    led_pitch,
    motion_weights,
    pitch_rows,
    plane_senses,
)
from armctl.motion.paths.tool_refusal import Crossing, ends_at_once, first_crossing, refuse_end, refuse_limits
from armctl.motion.paths.tool_walk import TILT, Repulsion, ToolTask, Walk, walk
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

PitchMode = Literal["kept", "interpolated", "free"]
"""tool pitch on the way: as at the start; evenly to that at the end; whatever takes the least motion"""
PITCH_MODES: tuple[PitchMode, ...] = get_args(PitchMode)
_JOINTS_FOR_PITCH = 3
_PUSHES = (6.0, 30.0)
"""tried in this order: how strongly a free joint keeps away from the limits [rad/m]"""
_MARGIN = 0.35
"""how far from a limit that begins [rad], or a quarter of the joint's range"""
_SAMPLES = 65


@dataclass(frozen=True, slots=True, eq=False)
class ToolPath:
    """A path of the tool that has been found to be possible, joint limits included."""

    polynomial: PiecewisePolynomial
    """q(s) [rad] over 0 … ``length`` [m], quintics, smooth to the second derivative; over 0 … 1 if still"""
    curve: ToolCurve
    pitch: PitchMode

    @property
    def q_start(self) -> FloatArray:
        """(n,) [rad]."""
        return self.polynomial(self.polynomial.low)

    @property
    def q_end(self) -> FloatArray:
        """(n,) [rad]."""
        return self.polynomial(self.polynomial.high)

    @property
    def length(self) -> float:
        """The way of the tool [m]."""
        return self.curve.length

    @property
    def is_still(self) -> bool:
        """Whether the way is so short that the arm just stays where it is."""
        return self.curve.length == 0.0


def usual_pitch(robot: Robot) -> PitchMode:
    """What an arm can do with its tool pitch along most lines: keep it, or let it come as it comes.

    With two parallel pitch joints, the place of the tool decides about its pitch.
    """
    joints = robot.inverse_kinematics.pitch_joints
    return "free" if joints and len(joints) < _JOINTS_FOR_PITCH else "kept"


def tool_line(
    robot: Robot,
    q_start: ArrayLike,
    end_m: ArrayLike,
    pitch: PitchMode = "kept",
    end_pitch: float | None = None,
    end_roll: float | None = None,
) -> ToolPath:
    """Lead the tool from where it is in a straight line.

    Args:
        robot: the arm.
        q_start: (n,) where it stands [rad].
        end_m: (3,) where the tool point shall go, base frame [m].
        pitch: what the tool pitch does on the way.
        end_pitch: tool pitch at the end [rad]; with "interpolated", and only there.
        end_roll: angle of the roll joint at the end [rad]; None: it stays.

    Raises:
        InputError: a value that is not finite, or contradictory wishes about the pitch.
        MotionRefusedError: a start outside the limits; a limit, a singularity or the end of a branch on the
            way (``ToolPathRefusedError``, which knows the place); a pitch that this arm cannot hold.
        UnreachableError: out of reach (``ToolPathUnreachableError``, which knows the place).
    """
    start = robot.forward(robot.chain.checked(q_start))[:3, 3]
    return follow(robot, q_start, ToolLine(start, np.asarray(end_m)), pitch, end_pitch, end_roll)


def tool_arc(
    robot: Robot,
    q_start: ArrayLike,
    via_m: ArrayLike,
    end_m: ArrayLike,
    pitch: PitchMode = "kept",
    end_pitch: float | None = None,
    end_roll: float | None = None,
) -> ToolPath:
    """Lead the tool from where it is along the circle through two more points; else as ``tool_line``.

    Args:
        robot: the arm.
        q_start: (n,) where it stands [rad].
        via_m: (3,) a point on the way, base frame [m].
        end_m: (3,) where the tool point shall go, base frame [m].
        pitch: what the tool pitch does on the way.
        end_pitch: tool pitch at the end [rad]; with "interpolated", and only there.
        end_roll: angle of the roll joint at the end [rad]; None: it stays.

    Raises:
        InputError: as ``tool_line``; or points that coincide or stand on one line.
        MotionRefusedError: as ``tool_line``.
        UnreachableError: as ``tool_line``.
    """
    start = robot.forward(robot.chain.checked(q_start))[:3, 3]
    return follow(robot, q_start, ToolArc.through(start, via_m, end_m), pitch, end_pitch, end_roll)


def follow(
    robot: Robot,
    q_start: ArrayLike,
    curve: ToolCurve,
    pitch: PitchMode = "kept",
    end_pitch: float | None = None,
    end_roll: float | None = None,
) -> ToolPath:
    """Lead the tool along a curve that begins where it is; else as ``tool_line``.

    The tool keeps within 0.01 mm of the curve, and a held pitch within 0.01°, between the knots of the
    polynomial too. A free joint moves as little as serves, weighted by the joints' speeds; where that runs
    into a limit it is led around it.

    Raises:
        InputError: as ``tool_line``; or a curve that begins elsewhere.
        MotionRefusedError: as ``tool_line``.
        UnreachableError: as ``tool_line``.
    """
    q = robot.chain.checked(q_start)
    robot.check_limits(q)
    end_pitch = _checked_end(pitch, end_pitch)
    away = float(np.linalg.norm(robot.forward(q)[:3, 3] - curve.positions(0.0)))
    if away > NO_WAY_M:
        raise InputError(f"the {curve.kind} begins {1000 * away:.4g} mm from where the tool is")
    if curve.length == 0.0:
        return _still(robot, q, curve, pitch, end_pitch, end_roll)
    task = _task(robot, q, curve, pitch, end_pitch, end_roll)
    # with too few joints the position decides the pitch, which may be the one that is asked for all the same
    wish, task = task.pitch, task if task.rows <= len(task.moving) else replace(task, pitch=None)
    attempt = _best_attempt(robot, task, q)
    walked, crossing, pitch_held = attempt.walked, attempt.crossing, task.pitch is not None
    path = walked.polynomial
    if path is not None and crossing is not None and not ends_at_once(walked, crossing, curve.length):
        raise refuse_limits(robot, curve, path, crossing, pitch_held=pitch_held)
    if path is None or not walked.complete:
        raise refuse_end(robot, curve, walked, pitch_held=pitch_held)
    if wish is not None and not pitch_held:
        _require_pitch(robot, wish, curve, path)
    return ToolPath(path, curve, pitch)


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    """A walk along the whole curve, and where it leaves the limits."""

    walked: Walk
    crossing: Crossing | None

    @property
    def reach(self) -> float:
        """How far it serves [m]."""
        return self.walked.s if self.crossing is None else self.crossing.s


def _best_attempt(robot: Robot, task: ToolTask, q: FloatArray) -> _Attempt:
    """The least motion; where that fails and a joint is free, the attempt that leads farthest."""
    attempts: list[tuple[_Attempt, ToolTask]] = []
    for tried in _tasks(robot, task, q):
        attempt = _attempt(robot, tried, q, only_inside=True)
        if attempt.walked.complete and attempt.crossing is None:
            return attempt
        attempts.append((attempt, tried))
    best, tried = max(attempts, key=lambda one: one[0].reach)
    # what a joint would need is known only from the whole curve
    return best if best.crossing is None else _attempt(robot, tried, q, only_inside=False)


def _attempt(robot: Robot, task: ToolTask, q: FloatArray, *, only_inside: bool) -> _Attempt:
    bounds = robot.limits + np.array([-LIMIT_TOLERANCE, LIMIT_TOLERANCE])
    walked = walk(task, q, bounds if only_inside else None)
    path = walked.polynomial
    return _Attempt(walked, None if path is None else first_crossing(path, robot.limits))


def _tasks(robot: Robot, task: ToolTask, q: FloatArray) -> Iterator[ToolTask]:
    """The task, and what else may be done about it with a free joint."""
    yield task
    if not task.redundant:
        return
    geometry = robot.inverse_kinematics.plane
    if geometry is not None and task.rows + 1 == len(task.moving) and task.pitch is None:
        grid = PitchGrid.of(geometry, robot.limits, q, task.curve)
        way = grid.way(motion_weights(robot.speed_limits))
        senses = plane_senses(geometry, robot.n)
        for smoothing in SMOOTHINGS:
            curve = led_pitch(grid, way, float(senses @ q), smoothing)
            yield replace(task, pitch=PlanePitch(senses, curve, is_wish=False))
        return
    for strength in _PUSHES:
        yield replace(task, repulsion=replace(task.repulsion, strength=strength))


def _task(
    robot: Robot,
    q: FloatArray,
    curve: ToolCurve,
    pitch: PitchMode,
    end_pitch: float | None,
    end_roll: float | None,
) -> ToolTask:
    """The equations of a path, as they are asked for."""
    roll_joint = robot.inverse_kinematics.roll_joint
    tool_pitch, _ = robot.inverse_kinematics.pitch_and_roll(q)
    if pitch != "free" and tool_pitch is None:
        raise InputError("this arm's tool does not keep to its vertical plane: it has no pitch; choose free")
    low, high = robot.limits.T
    led = low >= high
    rate = np.zeros(robot.n)
    if roll_joint is not None:
        led[roll_joint] = True
        if end_roll is not None:
            end = checked_number(end_roll, "the roll at the end")
            rate[roll_joint] = (end - q[roll_joint]) / curve.length
    elif end_roll is not None:
        raise InputError("this arm has no joint that rolls the tool: leave out the roll at the end")
    if robot.n - np.count_nonzero(led) < 3:
        raise InputError(f"the tool of {robot.name} cannot be led: it has too few joints")
    margin = np.maximum(np.minimum(_MARGIN, 0.25 * (high - low)), 1e-6)
    return ToolTask(
        chain=robot.chain,
        curve=curve,
        moving=np.flatnonzero(~led),
        led_start=np.where(led, q, 0.0),
        led_rate=rate,
        pitch=None if pitch == "free" else pitch_rows(robot, q, curve.length, end_pitch),
        speeds=robot.speed_limits,
        repulsion=Repulsion(robot.limits, margin, 0.0),
    )


def _checked_end(pitch: PitchMode, end_pitch: float | None) -> float | None:
    """The pitch at the end, where there is to be one."""
    if pitch not in PITCH_MODES:
        raise InputError(f"tool pitch {pitch!r}: allowed are {', '.join(map(repr, PITCH_MODES))}")
    if pitch != "interpolated":
        if end_pitch is not None:
            raise InputError(f"a pitch at the end does not go with pitch {pitch!r}; choose 'interpolated'")
        return None
    if end_pitch is None:
        raise InputError("pitch 'interpolated' needs the pitch at the end")
    return checked_number(end_pitch, "the pitch at the end")


def _still(
    robot: Robot,
    q: FloatArray,
    curve: ToolCurve,
    pitch: PitchMode,
    end_pitch: float | None,
    end_roll: float | None,
) -> ToolPath:
    """The path of a curve without length, which gives no way to turn the tool on."""
    tool_pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
    turns = end_pitch is not None and abs(end_pitch - (tool_pitch or 0.0)) > TILT
    turns |= end_roll is not None and abs(end_roll - (roll or 0.0)) > TILT
    if turns:
        raise InputError(
            f"a {curve.kind} of no length leaves no way to turn the tool on; go to a point with that pitch"
        )
    return ToolPath(PiecewisePolynomial([0.0, 1.0], q[None, None]), curve, pitch)


def _require_pitch(robot: Robot, wish: PitchRows, curve: ToolCurve, path: PiecewisePolynomial) -> None:
    """Refuses a path on which the pitch, which the position decides, is not the one asked for."""
    s = np.linspace(0.0, curve.length, _SAMPLES)
    poses = robot.forward(path(s))
    if (wish.tilt(path(s), poses, s) <= TILT).all():
        return
    seen = np.degrees(elevations(robot, poses))
    raise MotionRefusedError(
        f"the position alone decides this arm's tool pitch: along the {curve.kind} it goes through "
        f"{seen.min():.2f}° … {seen.max():.2f}°, so that it can be neither kept nor led; choose free"
    )
