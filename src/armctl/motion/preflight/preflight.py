"""Checks over a whole trajectory, before the arm moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError, MotionRefusedError
from armctl.motion.joined import JoinedTrajectory
from armctl.motion.preflight.floor import Floor
from armctl.motion.profiles.cubic import CubicTrajectory
from armctl.motion.profiles.trapezoid import TrapezoidTrajectory
from armctl.motion.trajectory import Sample, Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]

FLOOR_TOLERANCE_M = 5e-4
"""How far a part may dip below the floor: less than a servo arm can tell."""
_LIMIT_TOLERANCE = 1e-9
_RELATIVE_TOLERANCE = 1e-6
_REST_SPEED = 1e-6
_FINEST_S = 1e-3
_SAMPLES = (33, 4001)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with a trajectory."""

    time: float
    """when it is worst [s]"""
    part: str
    """the joint, or the part of the arm"""
    what: str
    """what is wrong, with numbers"""
    mend: str
    """what to do about it"""

    def __str__(self) -> str:
        return f"{self.part}: {self.what} at {self.time:.2f} s; {self.mend}"


def preflight(robot: Robot, trajectory: Trajectory) -> list[Finding]:
    """Check joint limits, speed, acceleration, rest at both ends and the floor over the whole motion.

    Cubic and trapezoidal motions are checked by their exact peaks (joints run monotonously from end to
    end); others are sampled at a millisecond, or 4,000 times if they are longer. Every corner of the
    arm is held above the floor along the samples; where the arm starts below it, it must not sink further.

    Args:
        robot: whose limits, geometry and floor.
        trajectory: what is to be run.

    Returns:
        What was found: limits first, then speed, acceleration, rest, floor; empty if it may be run.

    Raises:
        InputError: the trajectory has another number of joints, or a value that is not finite.
    """
    duration = trajectory.duration
    if trajectory.start.shape != (robot.n,) or trajectory.end.shape != (robot.n,):
        raise InputError(f"{robot.name} has {robot.n} joints, the trajectory has {len(trajectory.start)}")
    if not (math.isfinite(duration) and duration >= 0):
        raise InputError(f"a trajectory cannot take {duration} s")
    times = np.linspace(0.0, duration, _count(duration))
    sample = trajectory.sample(times)
    for what, values in (
        ("angle", sample.q),
        ("speed", sample.velocity),
        ("acceleration", sample.acceleration),
    ):
        if values.shape != (len(times), robot.n) or not np.isfinite(values).all():
            raise InputError(f"the trajectory gives a joint {what} that is not a finite number")
    findings = _limits(robot, times, sample)
    if not _known(trajectory):
        findings += _rates(robot, times, sample) + _rest(robot, times, sample)
    else:
        findings += _exact_rates(robot, trajectory, 0.0)
    return findings + _floor(robot, times, sample)


def require_clear(robot: Robot, trajectory: Trajectory) -> None:
    """Refuse a trajectory that must not be run.

    Raises:
        InputError: as ``preflight``.
        MotionRefusedError: says the first finding in words, and how many more there are.
    """
    findings = preflight(robot, trajectory)
    if findings:
        more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
        raise MotionRefusedError(f"{findings[0]}{more}")


def _count(duration: float) -> int:
    low, high = _SAMPLES
    return min(max(math.ceil(duration / _FINEST_S) + 1, low), high)


def _known(trajectory: Trajectory) -> bool:
    """Whether the peaks are known in closed form."""
    if isinstance(trajectory, JoinedTrajectory):
        return all(_known(part) for part in trajectory.parts)
    return isinstance(trajectory, CubicTrajectory | TrapezoidTrajectory)


def _limits(robot: Robot, times: FloatArray, sample: Sample) -> list[Finding]:
    low, high = robot.limits[:, 0], robot.limits[:, 1]
    excess = np.maximum(low - sample.q, sample.q - high)
    findings: list[Finding] = []
    for j in np.flatnonzero(excess.max(axis=0) > _LIMIT_TOLERANCE):
        k = int(excess[:, j].argmax())
        joint = robot.joints[j]
        value, lower, upper = np.degrees([sample.q[k, j], joint.lower, joint.upper])
        findings.append(
            Finding(
                float(times[k]),
                joint.title,
                f"{value:.2f}° is outside {lower:.2f}° … {upper:.2f}°",
                "choose another target or another branch",
            )
        )
    return findings


def _rates(robot: Robot, times: FloatArray, sample: Sample) -> list[Finding]:
    # The steps between samples are looked at too: a trajectory may not be what it says of itself.
    steps = np.diff(times)[:, None]
    moved = np.zeros_like(sample.q)
    if times[-1] > 0:
        moved[1:] = np.abs(np.diff(sample.q, axis=0)) / steps
    speed = np.maximum(np.abs(sample.velocity), moved)
    return _too_much(robot, times, speed, np.abs(sample.acceleration))


def _too_much(robot: Robot, times: FloatArray, speed: FloatArray, acceleration: FloatArray) -> list[Finding]:
    findings: list[Finding] = []
    for values, limits, unit, power in (
        (speed, robot.speed_limits, "°/s", 1.0),
        (acceleration, robot.acceleration_limits, "°/s²", 0.5),
    ):
        for j in np.flatnonzero(values.max(axis=0) > limits * (1 + _RELATIVE_TOLERANCE)):
            k = int(values[:, j].argmax())
            slower = float(values[k, j] / limits[j]) ** power
            value, limit = np.degrees(values[k, j]), np.degrees(limits[j])
            findings.append(
                Finding(
                    float(times[k]),
                    robot.joints[j].title,
                    f"{value:.1f} {unit} is over its limit of {limit:.1f} {unit}",
                    f"take {slower:.2f} times as long",
                )
            )
    return findings


def _exact_rates(robot: Robot, trajectory: Trajectory, begins: float) -> list[Finding]:
    if isinstance(trajectory, JoinedTrajectory):
        findings: list[Finding] = []
        for part, at in zip(trajectory.parts, trajectory.starts_at.tolist(), strict=True):
            findings += _exact_rates(robot, part, begins + at)
        return findings
    if isinstance(trajectory, CubicTrajectory | TrapezoidTrajectory):
        # a speed is largest at the middle; an acceleration at the start
        return _too_much(
            robot,
            np.array([begins + trajectory.duration / 2]),
            trajectory.peak_speed[None],
            np.zeros((1, robot.n)),
        ) + _too_much(robot, np.array([begins]), np.zeros((1, robot.n)), trajectory.peak_acceleration[None])
    return []


def _rest(robot: Robot, times: FloatArray, sample: Sample) -> list[Finding]:
    findings: list[Finding] = []
    for k, where in ((0, "starts"), (-1, "ends")):
        speed = np.abs(sample.velocity[k])
        j = int(speed.argmax())
        if speed[j] > _REST_SPEED:
            findings.append(
                Finding(
                    float(times[k]),
                    robot.joints[j].title,
                    f"the motion {where} at {np.degrees(speed[j]):.2f} °/s",
                    "let it start and end at rest",
                )
            )
    return findings


def _floor(robot: Robot, times: FloatArray, sample: Sample) -> list[Finding]:
    floor = Floor(robot)
    clearance = floor.clearance(sample.q)
    if clearance.shape[-1] == 0:
        return []
    allowed = np.minimum(clearance[0], 0.0) - FLOOR_TOLERANCE_M
    lacking = allowed - clearance
    k, i = np.unravel_index(int(lacking.argmax()), lacking.shape)
    if lacking[k, i] <= 0:
        return []
    depth = -1000 * float(clearance[k, i])
    return [
        Finding(
            float(times[k]),
            floor.parts[i],
            f"{depth:.1f} mm below the floor",
            f"raise the target, or go round by a point that is {depth:.0f} mm higher",
        )
    ]
