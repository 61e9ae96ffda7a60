"""A motion seen over time: joints and tool, position, velocity and acceleration, and the peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.motion.joined import JoinedTrajectory
from armctl.motion.profiles.cubic import CubicTrajectory
from armctl.motion.profiles.trapezoid import TrapezoidTrajectory
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_PROBE_S = 1e-4
_PEAK_SAMPLES = 4001


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
    position: FloatArray
    """(k, 3) of the tool, base frame [m]"""
    tool_velocity: FloatArray
    """(k, 3) [m/s]"""
    tool_acceleration: FloatArray
    """(k, 3) [m/s²]"""


def analyse(robot: Robot, trajectory: Trajectory, samples: int) -> MotionAnalysis:
    """Sample a motion evenly.

    The tool's velocity is ``J q̇``, its acceleration ``J q̈ + J̇ q̇`` with ``J̇`` as the central difference
    of the Jacobian along ``q̇``.

    Args:
        robot: the arm.
        trajectory: the motion.
        samples: how many times, at least 2, both ends included.
    """
    time = np.linspace(0.0, trajectory.duration, samples)
    state = trajectory.sample(time)
    q, v = state.q, state.velocity
    J = robot.jacobian(q)[:, :3]
    J_dot = (robot.jacobian(q + _PROBE_S * v)[:, :3] - robot.jacobian(q - _PROBE_S * v)[:, :3]) / (
        2 * _PROBE_S
    )
    return MotionAnalysis(
        time=time,
        q=q,
        velocity=v,
        acceleration=state.acceleration,
        position=robot.forward(q)[:, :3, 3],
        tool_velocity=np.einsum("kij,kj->ki", J, v),
        tool_acceleration=np.einsum("kij,kj->ki", J, state.acceleration) + np.einsum("kij,kj->ki", J_dot, v),
    )


def peak_rates(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Largest joint speeds (n,) [rad/s] and accelerations (n,) [rad/s²], exact where they can be."""
    if isinstance(trajectory, JoinedTrajectory):
        peaks = [peak_rates(part) for part in trajectory.parts]
        return np.max([speed for speed, _ in peaks], axis=0), np.max([push for _, push in peaks], axis=0)
    if isinstance(trajectory, CubicTrajectory | TrapezoidTrajectory):
        return trajectory.peak_speed, trajectory.peak_acceleration
    state = trajectory.sample(np.linspace(0.0, trajectory.duration, _PEAK_SAMPLES))
    return np.abs(state.velocity).max(axis=0), np.abs(state.acceleration).max(axis=0)


def analysis_csv(robot: Robot, motion: MotionAnalysis) -> str:
    """The samples as CSV in s, degrees and mm; the head names the units."""
    heads = ["time_s"]
    columns = [motion.time[:, None]]
    for values, unit in (
        (motion.q, "deg"),
        (motion.velocity, "deg_s"),
        (motion.acceleration, "deg_s2"),
    ):
        heads += [f"{name}_{unit}" for name in robot.joint_names]
        columns.append(np.degrees(values))
    for values, name in (
        (motion.position, "{}_mm"),
        (motion.tool_velocity, "v{}_mm_s"),
        (motion.tool_acceleration, "a{}_mm_s2"),
    ):
        heads += [name.format(axis) for axis in "xyz"]
        columns.append(1000 * values)
    rows = np.hstack(columns) + 0.0
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows.tolist()]
    return "\n".join([",".join(heads), *lines, ""])
