"""How fast each joint moves the tip: joints that turn at one constant speed, alone or all at once.

A joint that turns alone carries the tip along a circle about its axis, so the tip's speed is level: the
joint's speed times the tip's distance from its axis. With all joints turning the distances change, and
with them what each joint contributes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.robot import Robot

Turning = Literal["in turn", "all at once"]
Rule = Callable[[Robot, FloatArray, FloatArray], FloatArray]
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

    @property
    def fastest(self) -> int:
        """Index (among all joints) of the one that moves the tip fastest."""
        return self.moving[int(np.argmax(self.peaks))]


def study_joints(
    robot: Robot, start: ArrayLike, turning: Turning, speed: float, duration_s: float | None = None
) -> JointStudy:
    """Turn every joint from a start pose (n,) [rad] towards its farther limit, at ``speed`` [rad/s].

    In turn: each from the start pose, the others standing still; a joint's curve ends at its limit. All at
    once: a joint that has come to its limit stays there. Without ``duration_s`` [s] the last joint ends the
    study.

    Raises:
        InputError: a value that is not finite or not above zero, or a joint count that is not the arm's.
        MotionRefusedError: the start is outside the joint limits.
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
    turned = np.minimum(speed * time[:, None], np.abs(way))
    angle = start[moving] + np.sign(way) * turned
    velocity = np.sign(way) * speed * (speed * time[:, None] <= np.abs(way) * (1 + 1e-12))
    together = turning == "all at once"
    analytic, measured = (
        _alone(robot, start, moving, angle, velocity, together, rule) for rule in (tip_speed, _by_differences)
    )
    total = None
    misses = [np.abs(analytic - measured).max()]
    if together:
        q, rates = _filled(start, moving, angle), _filled(np.zeros(robot.n), moving, velocity)
        total = tip_speed(robot, q, rates)
        misses.append(np.abs(total - _by_differences(robot, q, rates)).max())
    else:
        over = velocity == 0.0
        angle, analytic = np.where(over, np.nan, angle), np.where(over, np.nan, analytic)
    largest = float(np.nanmax(analytic))
    return JointStudy(
        turning=turning,
        speed=speed,
        moving=tuple(moving.tolist()),
        held=tuple(np.flatnonzero(high <= low).tolist()),
        time=time,
        angle=angle,
        tip_speed=analytic,
        total=total,
        mismatch=float(max(misses)) / largest if largest > 0 else 0.0,
    )


def tip_speed(robot: Robot, q: FloatArray, velocity: FloatArray) -> FloatArray:
    """(k,) speed of the tool point ``|J q̇|`` [m/s] at ``q`` (k, n) [rad] and ``velocity`` (k, n) [rad/s]."""
    return np.linalg.norm(np.einsum("kij,kj->ki", robot.jacobian(q)[:, :3], velocity), axis=1)


def study_csv(robot: Robot, study: JointStudy) -> str:
    """The curves as CSV in s, degrees and mm/s; empty where a joint does not turn any more."""
    names = [robot.joint_names[i] for i in study.moving]
    heads = ["time_s", *(f"{name}_deg" for name in names), *(f"tip_by_{name}_mm_s" for name in names)]
    columns = [study.time[:, None], np.degrees(study.angle), 1000 * study.tip_speed]
    if study.total is not None:
        heads.append("tip_mm_s")
        columns.append(1000 * study.total[:, None])
    rows = np.hstack(columns) + 0.0
    lines = [",".join("" if math.isnan(value) else f"{value:.6f}" for value in row) for row in rows.tolist()]
    return "\n".join([",".join(heads), *lines, ""])


def _alone(
    robot: Robot,
    start: FloatArray,
    moving: NDArray[np.intp],
    angle: FloatArray,
    velocity: FloatArray,
    together: bool,
    rule: Rule,
) -> FloatArray:
    """What each joint alone gives the tip (k, m), from the start pose or on the common way."""
    everywhere = _filled(start, moving, angle)
    speeds: list[FloatArray] = []
    for column, joint in enumerate(moving.tolist()):
        q = everywhere if together else np.tile(start, (len(angle), 1))
        q[:, joint] = angle[:, column]
        rates = np.zeros_like(q)
        rates[:, joint] = velocity[:, column]
        speeds.append(rule(robot, q, rates))
    return np.column_stack(speeds)


def _by_differences(robot: Robot, q: FloatArray, velocity: FloatArray) -> FloatArray:
    """As ``tip_speed``, by central differences of the tip's position along the motion."""
    fastest = np.abs(velocity).max()
    step = _PROBE_RAD / fastest if fastest > 0 else 1.0
    ahead, behind = (robot.forward(q + side * step * velocity)[:, :3, 3] for side in (1, -1))
    return np.linalg.norm(ahead - behind, axis=1) / (2 * step)


def _filled(start: FloatArray, moving: NDArray[np.intp], values: FloatArray) -> FloatArray:
    """``start`` (n,) at every time, with the moving joints' values (k, m) put in: (k, n)."""
    filled = np.tile(start, (len(values), 1))
    filled[:, moving] = values
    return filled


def _require_above_zero(value: float, what: str) -> None:
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{what} must be a finite number above zero, got {value}")
