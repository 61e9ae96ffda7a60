"""Planning what the Trajectory screen asks for, off the event loop.

What can be planned is planned and drawn, whatever its pre-flight says; a line or an arc that ends where
the arm can go no farther is drawn as far as that.
"""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError, ProgramError
from armctl.kinematics import Target
from armctl.motion import (
    Finding,
    Kind,
    Profile,
    ProfileName,
    ToolPathRefusedError,
    ToolPathUnreachableError,
    Trajectory,
    plan_arc,
    plan_joints,
    plan_line,
    plan_spline,
    plan_target,
    preflight,
    solve,
)
from armctl.motion.analysis import analyse
from armctl.motion.error_report import IdealPath
from armctl.motion.paths.tool_curve import ToolArc, ToolLine
from armctl.motion.plan import Passing, plan_blended, plan_through, solve_points
from armctl.motion.timing import PathTrajectory
from armctl.motion.trajectory import peaks_of
from armctl.program import GripperStep, Program, ProgramFinding
from armctl.program.rehearsal import Rehearsal, rehearse
from armctl.robot import Robot
from armctl.ui.tabs.trajectory.motions import (
    PROGRAM,
    TEST_PATHS,
    MotionRequest,
    PlannedMotion,
    ShownMotion,
    ToolWish,
)

# One pass of a program as a single motion that can be drawn.

FloatArray = NDArray[np.float64]
_MOST_STEPS = 400
_LONGEST_S = 600.0


def plan_program(robot: Robot, program: Program, start: FloatArray, opening: float | None) -> PlannedMotion:
    """Plan one pass as the arm would run it, as far as it can be drawn.

    Args:
        robot: the arm.
        program: what to draw.
        start: (n,) where the arm stands [rad].
        opening: of the gripper, 0..1; None: not known.

    Raises:
        ProgramError: none of its steps takes time, or the first cannot be planned.
    """
    whole = rehearse(
        robot, program, start, opening, longest_s=_LONGEST_S, most_steps=_MOST_STEPS, as_far=True
    )
    if whole.duration == 0:
        raise ProgramError(f"{program.name}: no step of it moves a joint, so there is nothing to show")
    # a drawing that is cut short may end in motion
    findings: list[Finding | ProgramFinding] = list(preflight(robot, whole.trajectory, at_rest=False))
    if whole.broken is not None:
        findings.insert(0, ProgramFinding(whole.broken.index, str(whole.broken.error)))
    return PlannedMotion(
        f"program {program.name}",
        whole.trajectory,
        tuple(findings),
        program=program,
        steps=tuple((step.begins, step.index) for step in whole.steps),
        note=_note(program, whole),
    )


def _note(program: Program, whole: Rehearsal) -> str:
    if whole.broken is not None:
        return f"Drawn as far as step {whole.broken.index + 1}, which cannot be run."
    if whole.cut:
        return f"The first {len(whole.steps)} steps of a pass; the rest is not drawn."
    untimed = sum(
        isinstance(program.steps[step.index], GripperStep) and step.duration == 0 for step in whole.steps
    )
    note = "One pass, with the durations of its own steps."
    if untimed:
        note += f" The time of {untimed} gripper step{'' if untimed == 1 else 's'} is not counted."
    return note


SAMPLES = 1501
_POINTS = 25
"""of a tool line or arc, in its error report"""
_FLAT_M2 = 1e-9
_PASSED: dict[Passing | None, str] = {
    "stop": "At rest for an instant in each point.",
    "spline": "Through every point without a stop.",
    "blend": "Turns off before each point, so that it passes near it without a stop.",
    None: "The tool is led along the curve itself.",
}
_SWINGS = (
    "Between the points the spline swings beyond a joint limit that the points come close to: "
    "choose by another criterion, or stop at each point."
)
_CUT_SHORT = (
    "Drawn as far as the arm can follow, as fast as its limits allow: profile and duration are left out."
)
_TIME = re.compile(r"^at [\d.]+ s, ")


def plan_shown(robot: Robot, asked: MotionRequest) -> ShownMotion:
    """Plan what is asked for, and sample it.

    Raises:
        ArmctlError: as ``plan_motion``.
    """
    planned = plan_motion(robot, asked)
    motion = analyse(robot, planned.trajectory, SAMPLES)
    return ShownMotion(planned, motion, peaks_of(planned.trajectory))


def plan_motion(robot: Robot, asked: MotionRequest) -> PlannedMotion:
    """Plan what is asked for.

    Raises:
        ArmctlError: there is nothing of it that could be drawn; says why.
    """
    start = _start(robot, asked)
    if asked.motion in TEST_PATHS:
        return _test_path(robot, asked, start, TEST_PATHS[asked.motion]())
    if asked.motion == PROGRAM:
        if asked.program is None or not asked.program.steps:
            raise ProgramError("the program on the desk has no steps; record some in Manual → Serial motion")
        return plan_program(robot, asked.program, start, asked.opening)
    if asked.tool is not None:
        return _tool_motion(robot, asked, start, asked.tool)
    return _joint_motion(robot, asked, start)


def _start(robot: Robot, asked: MotionRequest) -> FloatArray:
    if isinstance(asked.start, Target):
        return solve(robot, asked.present, asked.start, asked.choose)
    return robot.check_limits(asked.start)


def _joint_motion(robot: Robot, asked: MotionRequest, start: FloatArray) -> PlannedMotion:
    duration, profile = asked.duration_s, asked.profile
    if asked.end is None:
        raise InputError("a joint motion needs an end")
    if isinstance(asked.end, Target):
        trajectory = plan_target(robot, start, asked.end, asked.choose, duration, profile, checked=False)
    else:
        trajectory = plan_joints(robot, start, asked.end, duration, profile, checked=False)
    note = "" if trajectory.duration > 0 else "It ends where it begins."
    return PlannedMotion(asked.title, trajectory, tuple(preflight(robot, trajectory)), note=note)


def _tool_motion(robot: Robot, asked: MotionRequest, start: FloatArray, wish: ToolWish) -> PlannedMotion:
    tip = robot.forward(start)[:3, 3]
    ideal = ToolLine(tip, wish.end) if wish.via is None else ToolArc.through(tip, wish.via, wish.end)
    trajectory, refused = _led(robot, start, wish, _law(asked.profile), asked.duration_s)
    findings = (*refused, *_besides(refused, preflight(robot, trajectory, tool_path=True)))
    return PlannedMotion(
        asked.title.removesuffix(f", {asked.profile}") if refused else asked.title,
        trajectory,
        findings,
        ideal,
        points=None
        if refused or ideal.length == 0
        else ideal.positions(np.linspace(0.0, ideal.length, _POINTS)),
        speed=wish.speed,
        note=_CUT_SHORT if refused else "",
    )


def _besides(refused: tuple[Finding, ...], found: list[Finding]) -> list[Finding]:
    """What the pre-flight found, but for the limit at which the motion was refused: that is told already."""
    ends = {finding.part for finding in refused if finding.kind == "limits"}
    return [finding for finding in found if not (finding.kind == "limits" and finding.part in ends)]


def _led(
    robot: Robot, start: FloatArray, wish: ToolWish, profile: ProfileName, duration_s: float | None
) -> tuple[Trajectory, tuple[Finding, ...]]:
    """The motion of the tool; or its beginning, and why it cannot go on."""
    try:
        if wish.via is None:
            return plan_line(
                robot, start, wish.end, pitch=wish.pitch, end_pitch=wish.end_pitch, speed=wish.speed,
                duration_s=duration_s, profile=profile, checked=False,
            ), ()  # fmt: skip
        return plan_arc(
            robot, start, wish.via, wish.end, pitch=wish.pitch, end_pitch=wish.end_pitch, speed=wish.speed,
            duration_s=duration_s, profile=profile, checked=False,
        ), ()  # fmt: skip
    except (ToolPathRefusedError, ToolPathUnreachableError) as refusal:
        if refusal.before is None:
            raise
        cap = math.inf if wish.speed is None else wish.speed
        trajectory = PathTrajectory.fastest(robot, refusal.before, cap)
        return trajectory, (_ends_here(robot, refusal, trajectory.duration),)


def _ends_here(
    robot: Robot, refusal: ToolPathRefusedError | ToolPathUnreachableError, time: float
) -> Finding:
    """A refusal as a finding at the end of what is drawn, which comes there later than at full speed."""
    place, (what, _, mend) = refusal.place, _TIME.sub("", str(refusal)).rpartition("; ")
    part = "tool" if place.joint is None else robot.joints[place.joint].title
    kind: Kind = "singularity"
    if isinstance(refusal, ToolPathUnreachableError):
        kind = "reach"
    elif place.needed is not None:
        kind = "limits"
    return Finding(time, part, what or mend, mend if what else "", kind)


def _test_path(robot: Robot, asked: MotionRequest, start: FloatArray, points: FloatArray) -> PlannedMotion:
    solved = solve_points(robot, points, asked.choose, start)
    ideal = _test_curve(points)
    trajectory, refused = _through(robot, asked, solved, points)
    findings = (*refused, *preflight(robot, trajectory, tool_path=asked.points.passing is None))
    note = f"{_PASSED[asked.points.passing]} Run goes to the first point first."
    if asked.points.passing == "spline" and any(finding.kind == "limits" for finding in findings):
        note = f"{_PASSED['spline']} {_SWINGS}"
    return PlannedMotion(asked.title, trajectory, findings, ideal, points, solved, note=note)


def _through(
    robot: Robot, asked: MotionRequest, solved: FloatArray, points: FloatArray
) -> tuple[Trajectory, tuple[Finding, ...]]:
    wish, duration = asked.points, asked.duration_s
    match wish.passing:
        case "stop":
            return plan_through(robot, list(solved), duration, asked.profile, checked=False), ()
        case "spline":
            law = _law(asked.profile)
            return plan_spline(robot, solved, duration_s=duration, profile=law, checked=False), ()
        case "blend":
            return plan_blended(robot, list(solved), wish.blend_m, duration), ()
        case None:
            middle = None if isinstance(_test_curve(points), ToolLine) else points[len(points) // 2]
            led = ToolWish(points[-1], middle, "free")
            return _led(robot, solved[0], led, _law(asked.profile), duration)


def _test_curve(points: FloatArray) -> IdealPath:
    """The line, or the arc, that a test path's points lie on."""
    first, middle, last = points[0], points[len(points) // 2], points[-1]
    straight = np.linalg.norm(np.cross(middle - first, last - first)) < _FLAT_M2
    return ToolLine(first, last) if straight else ToolArc.through(first, middle, last)


def _law(profile: Profile) -> ProfileName:
    """A profile that can be spread over a path.

    Raises:
        InputError: "normal", which leads each joint for itself.
    """
    if profile == "normal":
        raise InputError("normal leads each joint for itself, off the path; choose another profile")
    return profile
