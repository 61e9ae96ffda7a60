"""A motion seen over time: joints and tool, position, velocity, acceleration and jerk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from armctl.arrays import FloatArray
from armctl.motion.paths.tool_pitch import elevations
from armctl.motion.trajectory import Sample, Trajectory
from armctl.robot import Robot

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


def analyse(robot: Robot, trajectory: Trajectory, samples: int) -> MotionAnalysis:
    """Sample a motion evenly, at least 2 times, both ends included.

    The tool's velocity is ``J q̇``, its acceleration ``J q̈ + J̇ q̇`` with ``J̇`` as the central difference
    of the Jacobian along ``q̇``. Its jerk is the second central difference of its velocity along the
    polynomial that the joints follow at that instant, so that a jump of the joints' acceleration between
    two samples does not show as a spike.
    """
    time = np.linspace(0.0, trajectory.duration, samples)
    state = trajectory.sample(time)
    q, v = state.q, state.velocity
    J = robot.jacobian(q)[:, :3]
    J_dot = (robot.jacobian(q + _PROBE_S * v)[:, :3] - robot.jacobian(q - _PROBE_S * v)[:, :3]) / (
        2 * _PROBE_S
    )
    poses = robot.forward(q)
    return MotionAnalysis(
        time=time,
        q=q,
        velocity=v,
        acceleration=state.acceleration,
        jerk=state.jerk,
        position=poses[:, :3, 3],
        tool_velocity=np.einsum("kij,kj->ki", J, v),
        tool_acceleration=np.einsum("kij,kj->ki", J, state.acceleration) + np.einsum("kij,kj->ki", J_dot, v),
        tool_jerk=_tool_jerk(robot, state),
        pitch=elevations(robot, poses),
    )


def analysis_csv(robot: Robot, motion: MotionAnalysis) -> str:
    """The samples as CSV in s, degrees and mm; the head names the units."""
    heads = ["time_s"]
    columns = [motion.time[:, None]]
    for values, unit in (
        (motion.q, "deg"),
        (motion.velocity, "deg_s"),
        (motion.acceleration, "deg_s2"),
        (motion.jerk, "deg_s3"),
    ):
        heads += [f"{name}_{unit}" for name in robot.joint_names]
        columns.append(np.degrees(values))
    for values, name in (
        (motion.position, "{}_mm"),
        (motion.tool_velocity, "v{}_mm_s"),
        (motion.tool_acceleration, "a{}_mm_s2"),
        (motion.tool_jerk, "j{}_mm_s3"),
    ):
        heads += [name.format(axis) for axis in "xyz"]
        columns.append(1000 * values)
    heads.append("tool_pitch_deg")
    columns.append(np.degrees(motion.pitch)[:, None])
    rows = np.hstack(columns) + 0.0
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows.tolist()]
    return "\n".join([",".join(heads), *lines, ""])


def _tool_jerk(robot: Robot, state: Sample) -> FloatArray:
    """(k, 3) [m/s³]."""
    before, now, after = (_tool_velocity(robot, state, h) for h in (-_JERK_PROBE_S, 0.0, _JERK_PROBE_S))
    return (before - 2 * now + after) / _JERK_PROBE_S**2


def _tool_velocity(robot: Robot, state: Sample, h: float) -> FloatArray:
    """(k, 3) of the tool [m/s], ``h`` seconds on if the jerk stayed as it is."""
    v, a, j = state.velocity, state.acceleration, state.jerk
    q = state.q + h * (v + h * (a / 2 + h * j / 6))
    return np.einsum("kij,kj->ki", robot.jacobian(q)[:, :3], v + h * (a + h * j / 2))


# Which limits a motion comes near to: those that are worth drawing beside it.

Derivative = Literal["position", "velocity", "acceleration", "jerk"]
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
    if quantity == "position":
        return _near_ends(robot, motion.q, every=every)
    values, most = {
        "velocity": (motion.velocity, robot.speed_limits),
        "acceleration": (motion.acceleration, robot.acceleration_limits),
        "jerk": (motion.jerk, robot.jerk_limits),
    }[quantity]
    found: list[Limit] = []
    for joint, limit in enumerate(most.tolist()):
        for sign in (1, -1):
            if every or float((sign * values[:, joint]).max()) >= _NEAR * limit:
                found.append(Limit(sign * float(np.degrees(limit)), joint, is_upper=sign > 0))
    return found


def _near_ends(robot: Robot, q: FloatArray, *, every: bool) -> list[Limit]:
    found: list[Limit] = []
    for joint, (low, high) in enumerate(robot.limits.tolist()):
        room = _POSITION_ROOM * (high - low)
        if every or float(q[:, joint].min()) <= low + room:
            found.append(Limit(float(np.degrees(low)), joint, is_upper=False))
        if every or float(q[:, joint].max()) >= high - room:
            found.append(Limit(float(np.degrees(high)), joint, is_upper=True))
    return found
