"""All checks of one motion, before the arm makes it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError
from armctl.kinematics.chain import LinkFrames
from armctl.kinematics.target import checked_number
from armctl.kinematics.velocity import NEAR
from armctl.motion.preflight.clearance import Floor, Obstacles, SelfCollision, gap_finding
from armctl.motion.preflight.sampled import Finding, Kind, SampledMotion
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot


def preflight(
    robot: Robot,
    trajectory: Trajectory,
    payload_kg: float | None = None,
    *,
    tool_path: bool = False,
    at_rest: bool = True,
) -> list[Finding]:
    """Check one motion.

    - Joint limits, speed and acceleration by the exact peaks where a trajectory knows them, else by
      samples; rest at both ends.
    - Floor, obstacles and self-collision over the whole motion (``gap_finding``). Where it starts below the
      floor, or touching, it must not get worse.
    - Singularities of the tool point, and gravity torque against stall torque, at the samples.

    Args:
        robot: whose limits, geometry, masses and surroundings.
        trajectory: what is to be run.
        payload_kg: what the tool holds; None: what the robot file says.
        tool_path: whether it leads the tool along a path, which no singularity may cut.
        at_rest: whether it must start and end at rest; the pieces of a blended program need not.

    Returns:
        Errors first, then warnings, each in the order of time; empty if nothing was found.

    Raises:
        InputError: the trajectory has another number of joints, or a value that is not finite.
    """
    motion = SampledMotion.of(robot, trajectory)
    if payload_kg is not None and checked_number(payload_kg, "a payload") < 0.0:
        raise InputError(f"a payload must be at least 0 kg, got {payload_kg}")
    links = LinkFrames.at(robot.chain, motion.q)
    findings = [*_limit_findings(motion)]
    findings += [*_rate_findings(motion, "speed"), *_rate_findings(motion, "acceleration")]
    around = (Obstacles(robot),) if robot.obstacles else ()
    for source in (Floor(robot), *around, SelfCollision(robot)):
        finding = gap_finding(motion, source, source.gaps(links))
        if finding is not None:
            findings.append(finding)
    findings += _singularity_findings(motion, tool_path=tool_path)
    findings += _torque_findings(motion, links, payload_kg)
    if at_rest:
        findings += _rest_findings(motion)
    return sorted(findings, key=lambda finding: (finding.severity != "error", finding.time))


def require_clear(
    robot: Robot,
    trajectory: Trajectory,
    payload_kg: float | None = None,
    *,
    tool_path: bool = False,
    at_rest: bool = True,
) -> None:
    """Refuse a motion that must not be run; takes what ``preflight`` takes.

    Raises:
        InputError: as ``preflight``.
        MotionRefusedError: says the first error in words, and how many more there are.
    """
    findings = preflight(robot, trajectory, payload_kg, tool_path=tool_path, at_rest=at_rest)
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise MotionRefusedError(f"{errors[0]}{more}")


# Joint limits, speeds and accelerations, rest at both ends.

_ANGLE_TOLERANCE = 1e-9
_RATE_TOLERANCE = 1e-6
_REST_SPEED = 1e-6


def _limit_findings(motion: SampledMotion) -> Iterator[Finding]:
    robot, peaks = motion.robot, motion.peaks
    lower, upper = robot.limits.T
    below, above = lower - peaks.low, peaks.high - upper
    for j in np.flatnonzero(np.maximum(below, above) > _ANGLE_TOLERANCE).tolist():
        joint, q = robot.joints[j], motion.q[:, j]
        is_below = below[j] >= above[j]
        at = int(q.argmin() if is_below else q.argmax())
        angle, least, most = np.degrees(
            [peaks.low[j] if is_below else peaks.high[j], joint.lower, joint.upper]
        )
        yield Finding(
            float(motion.time[at]),
            joint.title,
            f"{angle:.2f}° is outside {least:.2f}° … {most:.2f}°",
            "keep away from this limit: another target, another branch or a straighter way",
            "limits",
        )


def _rate_findings(motion: SampledMotion, kind: Kind) -> Iterator[Finding]:
    """Joints whose speed or acceleration is over its limit."""
    robot, peaks = motion.robot, motion.peaks
    if kind == "speed":
        most, limits, rates, unit, power = peaks.speed, robot.speed_limits, motion.velocity, "°/s", 1.0
    else:
        most, limits, rates = peaks.acceleration, robot.acceleration_limits, motion.acceleration
        unit, power = "°/s²", 0.5
    for j in np.flatnonzero(most > limits * (1 + _RATE_TOLERANCE)).tolist():
        value, limit = np.degrees([most[j], limits[j]])
        yield Finding(
            float(motion.time[np.abs(rates[:, j]).argmax()]),
            robot.joints[j].title,
            f"{value:.1f} {unit} is over its limit of {limit:.1f} {unit}",
            f"take {(most[j] / limits[j]) ** power:.2f} times as long",
            kind,
        )


def _rest_findings(motion: SampledMotion) -> Iterator[Finding]:
    for k, where in ((0, "starts"), (-1, "ends")):
        speeds = np.abs(motion.velocity[k])
        j = int(speeds.argmax())
        if speeds[j] > _REST_SPEED:
            yield Finding(
                float(motion.time[k]),
                motion.robot.joints[j].title,
                f"the motion {where} at {np.degrees(speeds[j]):.2f} °/s",
                "let it start and end at rest",
                "rest",
            )


# Does the tool lose a direction? The isotropy is the smallest over the largest singular value of the tool
# point's Jacobian.

_LOST = 0.005
"""isotropy below which a tool path that needs the hardest direction is refused"""
_STRAINED = 0.25 / _LOST
"""Joint travel per tool travel, in units of the best direction's, that shows that a path needs it."""


def _singularity_findings(motion: SampledMotion, *, tool_path: bool) -> Iterator[Finding]:
    """At most one finding.

    A joint motion passes any singularity; a warning tells where it ends at one (below ``NEAR``), since lines
    and jogs of the tool cannot well begin there. A path of the tool is checked all the way. There it is
    an error where the direction that is lost is the one that the path takes: then the joints turn many
    times as far as the tool's way asks for elsewhere.
    """
    robot = motion.robot
    q, time = (motion.q, motion.time) if tool_path else (motion.q[-1:], motion.time[-1:])
    jacobians = robot.jacobian(q) if tool_path else robot.jacobian(q[-1])[None]
    isotropy, largest = isotropy_of(robot, jacobians)
    if isotropy.min() >= NEAR or robot.always_singular:
        return
    at, is_lost = int(isotropy.argmin()), False
    lost = np.flatnonzero(isotropy[1:] < _LOST) + 1
    if len(lost):
        tool = robot.forward(q)[:, :3, 3]
        way = np.linalg.norm(tool[lost] - tool[lost - 1], axis=1)
        turn = np.linalg.norm(q[lost] - q[lost - 1], axis=1)
        lost = lost[turn * largest[lost] > _STRAINED * way]
    if len(lost):
        at, is_lost = int(lost[isotropy[lost].argmin()]), True
    percent = 100 * float(isotropy[at])
    yield Finding(
        float(time[at]),
        "the tool",
        f"{'at' if percent < 0.1 else 'near'} a singularity: in one direction it moves only "
        f"{percent:.1f} % as freely as in the best",
        "lead the path past there, or go joint by joint"
        if is_lost
        else "begin no lines and no jogs of the tool there: they would be slow, or refused",
        "singularity",
        "error" if is_lost else "warning",
    )


def isotropy_of(robot: Robot, jacobians: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of Jacobians (m, 6, n): the isotropy, and the largest singular value [m/rad], (m,) each."""
    J = jacobians[:, :3, robot.limits[:, 0] < robot.limits[:, 1]]
    singular = np.sqrt(np.maximum(np.linalg.eigvalsh(J @ J.swapaxes(1, 2)), 0.0))
    return singular[:, 0] / np.maximum(singular[:, 2], 1e-150), singular[:, 2]


# Can the joints hold the arm and what it carries?

_WARM = 0.5
"""Above this share of its stall torque a motor is told of: held for long, it gets hot."""
_TORQUE_TOLERANCE = 1e-3


def _torque_findings(motion: SampledMotion, links: LinkFrames, payload_kg: float | None) -> Iterator[Finding]:
    """Static gravity torque of each joint against its stall torque.

    More than the stall torque is an error, unless the motion starts there and it gets no worse.
    """
    robot = motion.robot
    if not robot.gravity.bodies or not any(joint.stall_torque for joint in robot.joints):
        return
    gravity = robot.gravity if payload_kg is None else replace(robot.gravity, payload_kg=payload_kg)
    for joint, torque in zip(robot.joints, np.abs(gravity.torque_of(links)), strict=True):
        stall = joint.stall_torque
        if not stall:
            continue
        at = int(torque.argmax())
        share = float(torque[at]) / stall
        if share <= _WARM:
            continue
        over = share > max(float(torque[0]) / stall, 1.0) * (1 + _TORQUE_TOLERANCE)
        yield Finding(
            float(motion.time[at]),
            joint.title,
            f"gravity asks for {torque[at]:.2f} N·m, "
            f"{100 * share:.0f} % of its stall torque of {stall:.2f} N·m",
            "keep the load nearer to the joint, or take a lighter one"
            if over
            else "do not stay there for long: the motor gets hot",
            "torque",
            "error" if over else "warning",
        )


def not_checked(robot: Robot) -> tuple[str, ...]:
    """What the pre-flight cannot judge, because the robot file gives no figures for it."""
    if not robot.gravity.bodies:
        return (f"gravity torque: the file of {robot.name} gives no masses",)
    unknown = [joint.title for joint in robot.joints if joint.stall_torque is None]
    if not unknown:
        return ()
    which = "any joint" if len(unknown) == robot.n else ", ".join(unknown)
    return (f"gravity torque: the file of {robot.name} gives no stall torque of {which}",)
