"""Planning what the Trajectory tab asks for: drawn as far as it goes, whatever its pre-flight says."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import field, replace
from typing import Literal

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError, ProgramError
from armctl.facts import say
from armctl.facts.targets import AtPoint
from armctl.kinematics import Target
from armctl.lazy_dataclass import dataclass
from armctl.motion import (
    PROFILES,
    Finding,
    Kind,
    PitchMode,
    Profile,
    ProfileName,
    ToolPathRefusedError,
    ToolPathUnreachableError,
    Trajectory,
    TurnMode,
    arc,
    line,
    plan_joints,
    plan_spline,
    preflight,
    solve,
)
from armctl.motion.analysis import MotionAnalysis, analyse
from armctl.motion.choices import solve_points
from armctl.motion.paths.tool_curve import ToolArc, ToolLine
from armctl.motion.plan import Passing, follow_tool, plan_blended, plan_path, plan_through
from armctl.motion.profiles import PointToPoint
from armctl.motion.timing import PathTrajectory
from armctl.motion.trajectory import Peaks, peaks_of
from armctl.program import Program, SavedPrograms
from armctl.program.rehearsal import rehearse
from armctl.robot import CarriedPart, Robot

JOINTS = "Joint motion"
TOOL_LINE = "Tool line"
TOOL_ARC = "Tool arc"
ARC = "Arc (58 points)"
LINE = "Line (29 points)"
PROGRAM = "Program on the desk"
JOINT_BY_JOINT = "Joint by joint (study)"
TOOL_PATHS = (TOOL_LINE, TOOL_ARC)
TEST_PATHS = {ARC: arc, LINE: line}
"""the paper's test paths, by their labels"""
_SAMPLES = 1501
_POINTS = 25
"""of a tool line or arc, in its error report"""
_COARSE_STEP = 0.02
"""[rad] of a swept joint, where it only matters whether there is a solution"""
_FLAT_M2 = 1e-9
_MOST_STEPS, _LONGEST_S = 400, 600.0
"""of a program that is drawn"""
_PASSED: dict[Passing | None, str] = {
    "stop": "The arm stops in each point.",
    "spline": "Passes through every point without a stop.",
    "blend": "Passes near each point without a stop.",
    None: "The tool follows the curve itself.",
}
_SWINGS = (
    "Between the points the spline passes a joint limit: choose by another criterion, or stop at each point."
)
_CUT_SHORT = (
    "Drawn as far as the arm can follow, as fast as its limits allow: profile and duration are ignored."
)
_JOINTS_DO = "A joint motion may reach this end: choose Joint motion, and To: X Y Z."


@dataclass(frozen=True, slots=True, eq=False)
class MotionRequest:
    """The motion that the fields ask for."""

    motion: str
    subject: str
    """what leads from where to where: begins its title"""
    start: FloatArray | Target
    """(n,) where it begins [rad], or where the tool is then"""
    profile: Profile = "cubic"
    duration_s: float | None = None
    choose: str = "least-rotation"
    end: FloatArray | Target | None = None
    """of a joint motion: as ``start``; of a tool line or arc: the tool's last point, and how it is turned"""
    via: FloatArray | None = None
    """(3,) a point of a tool arc [m]"""
    pitch: PitchMode | None = None
    """of the tool along its line or arc"""
    orientation: TurnMode | None = None
    """instead of the pitch"""
    yields: bool = False
    """where pitch or orientation cannot be kept on the whole way, less is asked of it"""
    speed: float | None = None
    """largest speed of the tool along its line or arc [m/s]; None: as fast as the joints can"""
    passing: Passing | None = "stop"
    """how the points of a test path are passed; None: the tool is led along the curve itself"""
    blend_m: float = 0.002
    program: Program | None = None
    library: SavedPrograms | None = None
    """of the programs that it may call"""
    present: FloatArray | None = None
    """(n,) where the arm stands [rad], for the choice of a start by least travel"""
    opening: float | None = None
    """of the gripper when the motion begins, 0..1; None: not known"""
    part: CarriedPart | None = None
    """what it carries then; None: nothing"""

    @property
    def turned(self) -> str:
        """Its title without the profile: what moves, and how the tool is turned on the way."""
        kept = f"pitch {self.pitch}" if self.orientation is None else f"orientation {self.orientation}"
        is_led = self.motion in TOOL_PATHS and not (self.pitch is None and self.orientation is None)
        return f"{self.subject}, {kept}" if is_led else self.subject

    @property
    def title(self) -> str:
        """What people call it."""
        has_profile = self.motion not in TEST_PATHS or self.passing != "blend"
        return f"{self.turned}, {self.profile}" if has_profile else self.turned


@dataclass(frozen=True, slots=True, eq=False)
class PlannedMotion:
    """A motion that can be drawn, sampled, and its pre-flight."""

    robot: Robot
    title: str
    trajectory: Trajectory
    findings: tuple[Finding, ...] = ()
    ideal: ToolLine | ToolArc | None = None
    """the line or arc of the tool; None: nothing is prescribed between its ends"""
    points: FloatArray | None = None
    """(k, 3) points that it goes through [m]; None: none are prescribed"""
    solved: FloatArray | None = None
    """(k, n) joint angles in those points [rad]"""
    program: Program | None = None
    """run this instead of the trajectory: it has waits and gripper steps"""
    steps: tuple[tuple[float, int], ...] = ()
    """of a program: when the motion of which step begins [s]"""
    speed: float | None = None
    """largest speed of the tool that was asked for [m/s]"""
    note: str = ""
    freer: Literal["kept", "free"] | None = None
    """the tool pitch with which the whole line or arc can be followed, where this is only its beginning"""
    motion: MotionAnalysis = field(init=False)
    peaks: Peaks = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "motion", analyse(self.robot, self.trajectory, _SAMPLES))
        object.__setattr__(self, "peaks", peaks_of(self.trajectory))

    @property
    def refusal(self) -> Finding | None:
        """The first error of its pre-flight; None: it may be run."""
        return next((finding for finding in self.findings if finding.severity == "error"), None)

    def step_at(self, time: float) -> int | None:
        """Index of the program step that moves at a time [s]; None: it is no program."""
        at = bisect_right(self.steps, time, key=lambda step: step[0]) - 1
        return self.steps[at][1] if at >= 0 else None


def plan_motion(robot: Robot, asked: MotionRequest) -> PlannedMotion:
    """Plan what is asked for; an ``ArmctlError`` says why nothing of it can be drawn."""
    robot = robot.gripping(asked.opening).carrying(asked.part)
    if isinstance(asked.start, Target):
        start = solve(robot, asked.present, asked.start, asked.choose)
    else:
        start = robot.check_limits(asked.start)
    if asked.motion in TEST_PATHS:
        return _test_path(robot, asked, start)
    if asked.motion == PROGRAM:
        return _program(robot, asked, start)
    if asked.motion in TOOL_PATHS and isinstance(asked.end, Target):
        return _tool_motion(robot, asked, start, asked.end)
    return _joint_motion(robot, asked, start)


def why_not(robot: Robot, points: FloatArray) -> str | None:
    """The first point of a path (k, 3) [m] that is out of reach, and why; None: all can be reached."""
    for number, point in enumerate(points, 1):
        solutions = robot.inverse(point, step=_COARSE_STEP)
        if (why := solutions.why()) is not None:
            return say(AtPoint(number, len(points), why))
    return None


def _joint_motion(robot: Robot, asked: MotionRequest, start: FloatArray) -> PlannedMotion:
    end = start if asked.end is None else asked.end
    if isinstance(end, Target):
        end = solve(robot, start, end, asked.choose)
    trajectory = plan_joints(robot, start, end, asked.duration_s, asked.profile, checked=False)
    note = "" if trajectory.duration > 0 else "It ends where it begins."
    return PlannedMotion(robot, asked.title, trajectory, tuple(preflight(robot, trajectory)), note=note)


def _tool_motion(robot: Robot, asked: MotionRequest, start: FloatArray, end: Target) -> PlannedMotion:
    ideal = _curve(robot.forward(start)[:3, 3], asked.via, end.position)
    trajectory, cut = _led(robot, start, asked, end)
    note = ""
    if cut is not None and cut.freer is not None and asked.yields:
        note = yielded(robot, cut)
        asked = replace(asked, pitch=cut.freer, orientation=None)
        trajectory, cut = _led(robot, start, asked, end._replace(pitch=None, rotation=None))
    findings = _judged(robot, trajectory, cut)
    if cut is not None:
        note = _CUT_SHORT
        if cut.freer is None and robot.inverse(end.position, step=_COARSE_STEP).success:
            note += f" {_JOINTS_DO}"
        return PlannedMotion(
            robot, asked.turned, trajectory, findings, ideal, speed=asked.speed, note=note, freer=cut.freer
        )
    points = ideal.positions(np.linspace(0.0, ideal.length, _POINTS)) if ideal.length > 0 else None
    return PlannedMotion(
        robot, asked.title, trajectory, findings, ideal, points, speed=asked.speed, note=note
    )


def yielded(robot: Robot, cut: Cut) -> str:
    """What is told of a line or an arc on which the tool's turn cannot be kept."""
    whole = robot.orients_tool
    given_up = "orientation" if whole else "pitch"
    now = "Only its pitch is kept." if whole and cut.freer == "kept" else "It is free on this way."
    percent = f"{math.floor(100 * cut.fraction)} %"
    return f"The tool {given_up} cannot be kept: the arm would get {percent} of the way. {now}"


def _test_path(robot: Robot, asked: MotionRequest, start: FloatArray) -> PlannedMotion:
    points = TEST_PATHS[asked.motion]()
    solved = solve_points(robot, points, asked.choose, start)
    first, middle, last = points[0], points[len(points) // 2], points[-1]
    straight = bool(np.linalg.norm(np.cross(middle - first, last - first)) < _FLAT_M2)
    via = None if straight else middle
    cut: Cut | None = None
    match asked.passing:
        case "stop":
            law = "normal" if asked.profile == "normal" else _path_profile(asked.profile)
            trajectory = plan_through(robot, list(solved), asked.duration_s, law)
        case "spline":
            law = _path_profile(asked.profile)
            trajectory = plan_spline(robot, solved, duration_s=asked.duration_s, profile=law, checked=False)
        case "blend":
            trajectory = plan_blended(robot, list(solved), asked.blend_m, asked.duration_s)
        case None:
            wish = replace(asked, via=via, pitch="free", orientation=None)
            trajectory, cut = _led(robot, solved[0], wish, Target.of(last))
    findings = _judged(robot, trajectory, cut, tool_path=asked.passing is None)
    swings = asked.passing == "spline" and any(finding.kind == "limits" for finding in findings)
    note = f"{_PASSED[asked.passing]} {_SWINGS if swings else 'Run goes to the first point first.'}"
    ideal = _curve(first, via, last)
    return PlannedMotion(robot, asked.title, trajectory, findings, ideal, points, solved, note=note)


def _curve(start: FloatArray, via: FloatArray | None, end: FloatArray) -> ToolLine | ToolArc:
    return ToolLine(start, end) if via is None else ToolArc(start, via, end)


@dataclass(frozen=True, slots=True)
class Cut:
    """Why a line or an arc is followed in part only."""

    finding: Finding
    fraction: float
    """share of the way that is followed, 0 … 1"""
    freer: Literal["kept", "free"] | None
    """the tool pitch with which the whole way can be followed; None: with neither"""


def _led(robot: Robot, start: FloatArray, asked: MotionRequest, end: Target) -> tuple[Trajectory, Cut | None]:
    """The motion of the tool, None; or its beginning, and why it cannot go on."""
    law, speed = _path_profile(asked.profile), asked.speed
    try:
        turn = (asked.pitch, end.pitch, asked.orientation, end.rotation)
        path = follow_tool(robot, start, asked.via, end.position, *turn, speed=speed)
    except (ToolPathRefusedError, ToolPathUnreachableError) as refusal:
        cap = math.inf if speed is None else speed
        if refusal.before is None:
            if refusal.freer is None:
                raise
            trajectory: Trajectory = PointToPoint.lasting(start, start, 0.0)
        else:
            trajectory = PathTrajectory.fastest(robot, refusal.before, cap)
        finding = _ends_here(robot, refusal, trajectory.duration)
        return trajectory, Cut(finding, refusal.place.fraction, refusal.freer)
    duration = asked.duration_s
    return plan_path(robot, start, path, speed=speed, duration_s=duration, profile=law, checked=False), None


def _path_profile(profile: Profile) -> ProfileName:
    for known in PROFILES:
        if profile == known:
            return known
    raise InputError(f"{profile} leads each joint for itself, off the path; choose another profile")


def _ends_here(
    robot: Robot, refusal: ToolPathRefusedError | ToolPathUnreachableError, time: float
) -> Finding:
    """A refusal as a finding at the end of what is drawn, which comes there later than at full speed."""
    place = refusal.place
    part = "tool" if place.joint is None else robot.joints[place.joint].title
    kind: Kind = "singularity" if place.needed is None else "limits"
    if isinstance(refusal, ToolPathUnreachableError):
        kind = "reach"
    return Finding(refusal.on_curve, time, part, kind)


def _judged(
    robot: Robot, trajectory: Trajectory, cut: Cut | None, *, tool_path: bool = True
) -> tuple[Finding, ...]:
    """The pre-flight, after what has cut the motion short; a limit that has done so is named once."""
    found = preflight(robot, trajectory, tool_path=tool_path)
    if cut is None:
        return tuple(found)
    first = cut.finding
    named = ("limits", first.part) if first.kind == "limits" else None
    return first, *(finding for finding in found if (finding.kind, finding.part) != named)


def _program(robot: Robot, asked: MotionRequest, start: FloatArray) -> PlannedMotion:
    program = asked.program
    if program is None or not program.steps:
        raise ProgramError("the program on the desk has no steps; record some in Serial motion")
    program = program if asked.library is None else asked.library.link(program)
    whole = rehearse(
        robot, program, start, asked.opening, longest_s=_LONGEST_S, most_steps=_MOST_STEPS, as_far=True
    )
    if whole.duration == 0:
        raise ProgramError(f"{program.name}: no step of it moves a joint, so there is nothing to show")
    # a drawing that is cut short may end in motion
    findings = list(preflight(robot, whole.trajectory, at_rest=False))
    untimed = sum(step.grips and step.duration == 0 for step in whole.steps)
    if whole.broken is not None and whole.broken.error is not None:
        why = whole.broken.place.within(whole.broken.error.reason)
        findings.insert(0, Finding(why, step=whole.broken.index))
        note = f"Drawn as far as step {whole.broken.index + 1}, which cannot be run."
    elif whole.cut:
        drawn = "step" if len(whole.steps) == 1 else f"{len(whole.steps)} steps"
        note = f"The first {drawn} of a pass; the rest is not drawn."
    else:
        note = "One pass, with the durations of its own steps."
        if untimed:
            note += f" The time of {untimed} gripper step{'' if untimed == 1 else 's'} is not counted."
    steps = tuple((step.begins, step.index) for step in whole.steps)
    title = f"program {program.name}"
    return PlannedMotion(
        robot, title, whole.trajectory, tuple(findings), program=program, steps=steps, note=note
    )
