"""All checks over whole motions, before the arm moves."""

from __future__ import annotations

from collections.abc import Sequence

from armctl.errors import InputError, MotionRefusedError
from armctl.kinematics.link_frames import LinkFrames
from armctl.motion.preflight.batch import Batch, Finding
from armctl.motion.preflight.clearance import Floor, KeepOut, Obstacles, SelfCollision
from armctl.motion.preflight.rates import limit_findings, rate_findings, rest_findings
from armctl.motion.preflight.singularity import Singularity
from armctl.motion.preflight.torque import Torque
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
    """Check one motion; see ``preflight_batch``.

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
    return preflight_batch(robot, [trajectory], payload_kg, tool_paths=[tool_path], at_rest=at_rest)[0]


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


def preflight_batch(
    robot: Robot,
    trajectories: Sequence[Trajectory],
    payload_kg: float | None = None,
    *,
    tool_paths: Sequence[bool] | None = None,
    at_rest: bool = True,
) -> list[list[Finding]]:
    """Check many motions in one pass over all their samples.

    - Joint limits, speed and acceleration by the exact peaks where a trajectory knows them
      (``KnowsPeaks``), else by samples; rest at both ends.
    - Floor, obstacles and self-collision over the whole of each motion (``KeepOut``). Where a motion
      starts below the floor, or touching, it must not get worse.
    - Singularities of the tool point, and gravity torque against stall torque, at the samples.

    Args:
        robot: whose limits, geometry, masses and surroundings.
        trajectories: what is to be run; each counts for itself.
        payload_kg: what the tool holds; None: what the robot file says.
        tool_paths: for each, whether it leads the tool along a path; None: none does.
        at_rest: whether they must start and end at rest.

    Returns:
        For each motion what ``preflight`` returns.

    Raises:
        InputError: as ``preflight``, or another number of ``tool_paths``.
    """
    paths = [False] * len(trajectories) if tool_paths is None else list(tool_paths)
    if len(paths) != len(trajectories):
        raise InputError(f"{len(trajectories)} trajectories need as many tool_paths, got {len(paths)}")
    found: list[list[Finding]] = [[] for _ in trajectories]
    if not trajectories:
        return found
    batch = Batch.of(robot, trajectories)
    at_start = LinkFrames.at(robot.chain, batch.starts)
    checks = [
        *(KeepOut(batch, gaps(robot), at_start) for gaps in (Floor, Obstacles, SelfCollision)),
        Singularity(batch, paths),
        Torque(batch, at_start, payload_kg),
    ]
    for chunk in batch.chunks():
        links = LinkFrames.at(robot.chain, chunk.q)
        for check in checks:
            check.look(chunk, links)
    sources = [limit_findings(batch), rate_findings(batch), *(check.findings() for check in checks)]
    if at_rest:
        sources.append(rest_findings(batch))
    for source in sources:
        for motion, finding in source:
            found[motion].append(finding)
    for findings in found:
        findings.sort(key=lambda finding: (finding.severity != "error", finding.time))
    return found
