"""Motions over time, limits that are near, the tip joint by joint; and how well points and paths are met."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.lazy_dataclass import dataclass
from armctl.motion.paths.tool_curve import ToolArc, ToolLine
from armctl.motion.paths.tool_orientation import elevations
from armctl.motion.trajectory import Sample, Trajectory
from armctl.robot import Robot

Derivative = Literal["position", "velocity", "acceleration", "jerk"]
_PROBE_S = 1e-4
_JERK_PROBE_S = 1e-3
"""longer, because a second difference loses twice as many digits to rounding"""


@dataclass(frozen=True, slots=True, eq=False)
class MotionAnalysis:
    """A motion sampled at k times."""

    time: FloatArray
    """(k,) [s]"""
    q: FloatArray
    """(k, n) [rad]"""
    velocity: FloatArray
    """(k, n) [rad/s]"""
    acceleration: FloatArray
    """(k, n) [rad/s²]"""
    jerk: FloatArray
    """(k, n) [rad/s³]"""
    position: FloatArray
    """(k, 3) of the tool, base frame [m]"""
    tool_velocity: FloatArray
    """(k, 3) [m/s]"""
    tool_acceleration: FloatArray
    """(k, 3) [m/s²]"""
    tool_jerk: FloatArray
    """(k, 3) [m/s³]"""
    pitch: FloatArray
    """(k,) angle of the tool's approach axis above the horizontal [rad]"""

    @property
    def tool_speed(self) -> FloatArray:
        """(k,) [m/s]."""
        return np.linalg.norm(self.tool_velocity, axis=1)

    def of(self, quantity: Derivative) -> tuple[FloatArray, FloatArray]:
        """One quantity of the joints (k, n) [rad], and of the tool (k, 3) [m], by [s] for the derivatives."""
        return {
            "position": (self.q, self.position),
            "velocity": (self.velocity, self.tool_velocity),
            "acceleration": (self.acceleration, self.tool_acceleration),
            "jerk": (self.jerk, self.tool_jerk),
        }[quantity]


def analyse(robot: Robot, trajectory: Trajectory, samples: int) -> MotionAnalysis:
    """Sample a motion evenly, at least 2 times, both ends included.

    The tool's velocity is ``J q̇``, its acceleration ``J q̈ + J̇ q̇``. Its jerk is the second difference of its
    velocity as if the joints' jerk stayed, so a jump of the joints' acceleration does not show as a spike.
    """
    time = np.linspace(0.0, trajectory.duration, samples)
    state = trajectory.sample(time)
    q, v = state.q, state.velocity
    J, ahead, behind = (robot.jacobian(q + h * v)[:, :3] for h in (0.0, _PROBE_S, -_PROBE_S))
    J_dot = (ahead - behind) / (2 * _PROBE_S)
    before, now, after = (_tool_velocity(robot, state, h) for h in (-_JERK_PROBE_S, 0.0, _JERK_PROBE_S))
    poses = robot.forward(q)
    return MotionAnalysis(
        time=time,
        q=q,
        velocity=v,
        acceleration=state.acceleration,
        jerk=state.jerk,
        position=poses[:, :3, 3],
        tool_velocity=now,
        tool_acceleration=np.einsum("kij,kj->ki", J, state.acceleration) + np.einsum("kij,kj->ki", J_dot, v),
        tool_jerk=(before - 2 * now + after) / _JERK_PROBE_S**2,
        pitch=elevations(robot, poses),
    )


def _tool_velocity(robot: Robot, state: Sample, h: float) -> FloatArray:
    """(k, 3) of the tool [m/s], ``h`` seconds on if the jerk stayed as it is."""
    v, a, j = state.velocity, state.acceleration, state.jerk
    q = state.q + h * (v + h * (a / 2 + h * j / 6))
    return np.einsum("kij,kj->ki", robot.jacobian(q)[:, :3], v + h * (a + h * j / 2))


def analysis_csv(robot: Robot, motion: MotionAnalysis) -> str:
    """The samples as CSV in s, degrees and mm; the head names the units."""
    heads = ["time_s"]
    joints, tool = list[FloatArray](), list[FloatArray]()
    tool_heads: list[str] = []
    units: tuple[tuple[Derivative, str, str], ...] = (
        ("position", "", ""), ("velocity", "v", "_s"), ("acceleration", "a", "_s2"), ("jerk", "j", "_s3"),
    )  # fmt: skip
    for quantity, letter, per in units:
        of_joints, of_tool = motion.of(quantity)
        joints.append(robot.shown(of_joints))
        tool.append(1000 * of_tool)
        heads += [f"{name}_deg{per}" for name in robot.joint_names]
        tool_heads += [f"{letter}{axis}_mm{per}" for axis in "xyz"]
    columns = [motion.time[:, None], *joints, *tool, np.degrees(motion.pitch)[:, None]]
    return _csv([*heads, *tool_heads, "tool_pitch_deg"], columns)


def _csv(heads: Sequence[str], columns: Sequence[FloatArray]) -> str:
    """Columns (k, …) side by side; NaN stays empty."""
    rows = np.hstack(columns) + 0.0
    lines = [",".join("" if math.isnan(value) else f"{value:.6f}" for value in row) for row in rows.tolist()]
    return "\n".join([",".join(heads), *lines, ""])


# Which limits a motion comes near to: those that are worth drawing beside it.

_NEAR = 0.7
"""a limit is drawn where the motion comes to this share of it"""
_POSITION_ROOM = 0.2
"""a joint limit is drawn where the motion comes this near, as a share of the joint's range"""


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """A limit that a motion comes near to."""

    value: float
    """[°], with [s] for its derivatives"""
    joint: int
    is_upper: bool
    """not to be passed upwards, or not downwards"""


def near_limits(
    robot: Robot, motion: MotionAnalysis, quantity: Derivative, *, every: bool = False
) -> list[Limit]:
    """The joint limits that a motion comes near to (or, with ``every``, all), in degrees and seconds."""
    values, _ = motion.of(quantity)
    if quantity == "position":
        low, high = robot.limits.T
        room = _POSITION_ROOM * (high - low)
    else:
        high = {
            "velocity": robot.speed_limits,
            "acceleration": robot.acceleration_limits,
            "jerk": robot.jerk_limits,
        }[quantity]
        low, room = -high, (1 - _NEAR) * high
    sides = (
        (False, low, values.min(axis=0) <= low + room),
        (True, high, values.max(axis=0) >= high - room),
    )
    return [
        Limit(float(np.degrees(limits[joint])), joint, is_upper)
        for joint in range(robot.n)
        for is_upper, limits, near in sides
        if every or near[joint]
    ]


# How fast each joint moves the tip: joints that turn at one constant speed, alone or all at once.

Turning = Literal["in turn", "all at once"]
_SAMPLES = 601
_PROBE_RAD = 1e-4
"""how far the fastest joint turns to either side of a central difference"""


@dataclass(frozen=True, slots=True, eq=False)
class JointStudy:
    """The tip's speed at k times for each of the m joints that can move."""

    turning: Turning
    speed: float
    """of every joint that turns [rad/s]"""
    moving: tuple[int, ...]
    """(m,) indices of those joints"""
    held: tuple[int, ...]
    """indices of the joints whose limits hold them still"""
    time: FloatArray
    """(k,) [s]"""
    angle: FloatArray
    """(k, m) of the joint that turns [rad]; in turn: NaN once it has come to its limit"""
    tip_speed: FloatArray
    """(k, m) |J_i| q̇_i: by that joint alone [m/s]; NaN as ``angle``"""
    total: FloatArray | None
    """(k,) |J q̇| [m/s]; None where the joints turn one after the other"""
    mismatch: float
    """largest difference between these speeds and central differences of the forward kinematics, over the
    largest of the speeds"""

    @property
    def peaks(self) -> FloatArray:
        """(m,) greatest tip speed by each joint [m/s]."""
        return np.nanmax(self.tip_speed, axis=0)


def study_joints(
    robot: Robot, start: ArrayLike, turning: Turning, speed: float, duration_s: float | None = None
) -> JointStudy:
    """Turn every joint from a start pose (n,) [rad] towards its farther limit, at ``speed`` [rad/s].

    In turn, the others stand still, and a joint's curve ends at its limit; all at once, it stays there.
    Without ``duration_s`` [s] the last joint ends the study.
    Raises ``InputError``: a value that is not finite or not above zero, or a joint count that is not the
    arm's; ``MotionRefusedError``: the start is outside the joint limits.
    """
    start = robot.check_limits(start)
    _require_above_zero(speed, "the joint speed")
    low, high = robot.limits[:, 0], robot.limits[:, 1]
    moving = np.flatnonzero(high > low)
    way: FloatArray = np.where(high - start >= start - low, high - start, low - start)[moving]
    if duration_s is None:
        duration_s = float(np.abs(way).max()) / speed
    _require_above_zero(duration_s, "the duration")
    time = np.linspace(0.0, duration_s, _SAMPLES)
    angle = start[moving] + np.sign(way) * np.minimum(speed * time[:, None], np.abs(way))
    velocity = np.sign(way) * speed * (speed * time[:, None] <= np.abs(way) * (1 + 1e-12))
    everywhere, rates = _filled(start, moving, angle), _filled(np.zeros(robot.n), moving, velocity)
    together = turning == "all at once"
    runs: list[tuple[FloatArray, FloatArray]] = [
        (everywhere if together else np.where(only, everywhere, start), np.where(only, rates, 0.0))
        for only in np.eye(robot.n, dtype=np.bool_)[moving]
    ]
    if together:
        runs.append((everywhere, rates))
    speeds, misses = zip(*(_tip_speed(robot, *run) for run in runs), strict=True)
    tip_speed, total = np.column_stack(speeds[: len(moving)]), speeds[-1] if together else None
    if not together:
        over = velocity == 0.0
        angle[over] = tip_speed[over] = np.nan
    largest = float(np.nanmax(tip_speed))
    return JointStudy(
        turning=turning,
        speed=speed,
        moving=tuple(moving.tolist()),
        held=tuple(np.flatnonzero(high <= low).tolist()),
        time=time,
        angle=angle,
        tip_speed=tip_speed,
        total=total,
        mismatch=max(misses) / largest if largest > 0 else 0.0,
    )


def study_csv(robot: Robot, study: JointStudy) -> str:
    """The curves as CSV in s, degrees and mm/s; empty where a joint does not turn any more."""
    names = [robot.joint_names[i] for i in study.moving]
    heads = ["time_s", *(f"{name}_deg" for name in names), *(f"tip_by_{name}_mm_s" for name in names)]
    columns = [study.time[:, None], np.degrees(study.angle), 1000 * study.tip_speed]
    if study.total is not None:
        heads.append("tip_mm_s")
        columns.append(1000 * study.total[:, None])
    return _csv(heads, columns)


def _tip_speed(robot: Robot, q: FloatArray, velocity: FloatArray) -> tuple[FloatArray, float]:
    """(k,) speed of the tool point ``|J q̇|`` [m/s], and how far off central differences are."""
    speeds = np.linalg.norm(np.einsum("kij,kj->ki", robot.jacobian(q)[:, :3], velocity), axis=1)
    fastest = np.abs(velocity).max()
    step = _PROBE_RAD / fastest if fastest > 0 else 1.0
    ahead, behind = (robot.forward(q + side * step * velocity)[:, :3, 3] for side in (1, -1))
    measured = np.linalg.norm(ahead - behind, axis=1) / (2 * step)
    return speeds, float(np.abs(speeds - measured).max())


def _filled(start: FloatArray, moving: NDArray[np.intp], values: FloatArray) -> FloatArray:
    """``start`` (n,) at every time, with the moving joints' values (k, m) put in: (k, n)."""
    filled = np.tile(start, (len(values), 1))
    filled[:, moving] = values
    return filled


def _require_above_zero(value: float, what: str) -> None:
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{what} must be a finite number above zero, got {value}")


# How well a list of points was met: the paper's error analysis of its two test trajectories.


@dataclass(frozen=True, slots=True, eq=False)
class ErrorReport:
    """Points that were asked for, and where the tool came."""

    desired: FloatArray
    """(k, 3) [m]"""
    reached: FloatArray
    """(k, 3) [m]"""

    @property
    def error(self) -> FloatArray:
        """(k, 3) reached less desired [m]."""
        return self.reached - self.desired

    @property
    def mse(self) -> FloatArray:
        """(3,) mean squared error of each coordinate [m²]."""
        return (self.error**2).mean(axis=0)

    @property
    def rmse(self) -> FloatArray:
        """(3,) root mean squared error of each coordinate [m]."""
        return np.sqrt(self.mse)

    @property
    def largest(self) -> FloatArray:
        """(3,) largest error of each coordinate, without sign [m]."""
        return np.abs(self.error).max(axis=0)

    @property
    def distance(self) -> FloatArray:
        """(k,) distance between what was asked for and what was reached [m]."""
        return np.linalg.norm(self.error, axis=1)


def as_printed(q: FloatArray) -> FloatArray:
    """Joint angles (..., n) [rad] rounded as the paper's tables print them: to 0.001°."""
    return np.radians(np.degrees(q).round(3))


def closest_on_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """(k, 3) where a path (m, 3), straight between its points, is closest to each of ``points`` [m]."""
    if len(path) == 0:
        raise InputError("a path without points comes close to nothing")
    if len(path) == 1:
        return np.repeat(path, len(points), axis=0)
    starts, ways = path[:-1], np.diff(path, axis=0)
    squares = (ways**2).sum(axis=1)
    along = np.einsum("kmi,mi->km", points[:, None] - starts, ways)
    share = np.clip(np.divide(along, squares, out=np.zeros_like(along), where=squares > 0), 0.0, 1.0)
    candidates = starts + share[..., None] * ways
    nearest = np.linalg.norm(candidates - points[:, None], axis=2).argmin(axis=1)
    return candidates[np.arange(len(points)), nearest]


def report_csv(theoretical: ErrorReport, applied: ErrorReport | None) -> str:
    """Every point of a report as CSV, in mm; the applied columns only where the path was run."""
    heads = ["point", *(f"desired_{axis}_mm" for axis in "xyz")]
    columns = [theoretical.desired]
    for name, report in (("theoretical", theoretical), ("applied", applied)):
        if report is not None:
            heads += [f"{name}_{axis}_mm" for axis in "xyz"]
            columns.append(report.reached)
    rows = 1000 * np.hstack(columns) + 0.0
    lines = [",".join([f"{k}", *(f"{value:.6f}" for value in row)]) for k, row in enumerate(rows.tolist(), 1)]
    return "\n".join([",".join(heads), *lines, ""])


# How far the tool strays from a line or an arc, between points as well.

TICK_S = 0.02
"""a tick of the default rate [s]"""
_MOST_TICKS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class PathError:
    """Distances from the ideal path."""

    time: FloatArray
    """(k,) [s]; numbers of readings where their times are not known"""
    distance: FloatArray
    """(k,) [m]"""

    @property
    def largest(self) -> float:
        """The largest distance [m]."""
        return float(self.distance.max())

    @property
    def when(self) -> float:
        """When it is largest [s]."""
        return float(self.time[int(self.distance.argmax())])

    @property
    def rms(self) -> float:
        """Root mean square of the distances [m]."""
        return math.sqrt(float((self.distance**2).mean()))


def path_error(robot: Robot, trajectory: Trajectory, ideal: ToolLine | ToolArc) -> PathError:
    """The planned tool path against the ideal one, at every tick (100,000 at most) and at the end."""
    ticks = min(math.ceil(trajectory.duration / TICK_S - 1e-9), _MOST_TICKS)
    time = np.minimum(
        np.arange(ticks + 1) * max(TICK_S, trajectory.duration / _MOST_TICKS), trajectory.duration
    )
    points = robot.forward(trajectory.sample(time).q)[:, :3, 3]
    return PathError(time, distances(ideal, points))


def distances(ideal: ToolLine | ToolArc, points: FloatArray) -> FloatArray:
    """How far points (k, 3) [m] lie from a line or an arc, ends included: (k,) [m]."""
    away = points - ideal.start
    if isinstance(ideal, ToolLine):
        s = np.clip(away @ ideal.direction, 0.0, ideal.length)
    else:
        x, y = ideal.radius - away @ ideal.inward, away @ ideal.along
        turned = np.arctan2(y, x) % (2 * np.pi)
        # beyond the end of the arc, the end that is the nearer one on the circle
        beyond = np.where(turned - ideal.sweep < 2 * np.pi - turned, ideal.sweep, 0.0)
        s = ideal.radius * np.where(turned <= ideal.sweep, turned, beyond)
    return np.linalg.norm(points - ideal.positions(s), axis=-1)


# The two test paths of the uzuner paper.

_PEN_PLANE_M = 0.085


def arc() -> FloatArray:
    """The arc: (58, 3) points [m] of radius 200 mm about the base axis, -87° ... 87°, 85 mm high."""
    angle = np.radians(np.linspace(-87.0, 87.0, 58))
    return np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.full(58, _PEN_PLANE_M)])


def line() -> FloatArray:
    """The line: (29, 3) points [m] at x = 220 mm, y = -196 ... 196 mm by 14 mm, 85 mm high."""
    y = np.arange(-196.0, 197.0, 14.0) / 1000
    return np.column_stack([np.full(29, 0.22), y, np.full(29, _PEN_PLANE_M)])
