"""What is wrong with a program, told before it is run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import ArmctlError, ProgramError
from armctl.motion.plan import solve
from armctl.motion.preflight import Finding, Kind, Severity, preflight
from armctl.motion.profiles import PROFILES
from armctl.motion.trajectory import Trajectory
from armctl.program.files.document import out_of_range
from armctl.program.program import (
    ArcStep,
    Blocks,
    EndStep,
    GripperStep,
    LineStep,
    MotionStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    Step,
    block_findings,
)
from armctl.program.step_plan import plan_step, step_target
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ProgramFinding:
    """One thing that is wrong with a program."""

    step: int | None
    """index of the step; None: the program as a whole"""
    what: str
    """what is wrong, with numbers"""
    time: float | None = None
    """when it is worst, from the start of the step's motion [s]; None: not a matter of time"""
    part: str = ""
    """the joint, or the part of the arm"""
    mend: str = ""
    """what to do about it; empty where ``what`` says it"""
    kind: Kind = "program"
    """which check found it"""
    severity: Severity = "error"

    @classmethod
    def of(cls, step: int, finding: Finding) -> ProgramFinding:
        """What the pre-flight found in the motion of a step."""
        return cls(
            step, finding.what, finding.time, finding.part, finding.mend, finding.kind, finding.severity
        )

    def __str__(self) -> str:
        text = self.what if self.time is None else f"at {self.time:.2f} s, {self.what}"
        if self.part:
            text = f"{self.part}: {text}"
        if self.mend:
            text += f"; {self.mend}"
        return text if self.step is None else f"step {self.step + 1}: {text}"


def check_program(
    program: Program,
    robot: Robot,
    *,
    motions: bool = True,
    start: ArrayLike | None = None,
    payload_kg: float | None = None,
) -> list[ProgramFinding]:
    """Check a program against an arm.

    Args:
        program: the program.
        robot: the arm that shall run it.
        motions: also plan every motion whose start is known and check all of them (slower). A blended step
            is checked as if it stopped. That misses no error: its corner is checked when it is run, and
            one that is refused there (through the floor, say) becomes a stop. Nor are warnings told that
            only a corner would give. Of a repeat block two passes are checked: from the third on they are
            like the second.
        start: (n,) where the first motion starts [rad]; None: not known, and so the first motion is not
            checked, only its end.
        payload_kg: what the tool holds; None: what the robot file says.

    Returns:
        What was found, in the order of the steps; it may be run if there are no errors among it.

    Raises:
        InputError: a start or a payload that nobody can work with.
    """
    findings: list[ProgramFinding] = []
    if program.robot != robot.name:
        findings.append(
            ProgramFinding(None, f"it is for the robot {program.robot!r}, this one is {robot.name!r}")
        )
    if not program.steps:
        findings.append(ProgramFinding(None, "it has no steps"))
    wrong_values = list(_value_findings(program, robot))
    broken = block_findings(program)
    wrong_values += [ProgramFinding(index, what) for index, what in broken]
    if motions and not broken:
        begin = None if start is None else robot.chain.checked(start)
        wrong = {finding.step for finding in wrong_values}
        walk = _Walk(program, robot, frozenset(step for step in wrong if step is not None))
        walk.run(begin)
        wrong_values += walk.findings(payload_kg)
    return findings + sorted(wrong_values, key=lambda finding: -1 if finding.step is None else finding.step)


def _value_findings(program: Program, robot: Robot) -> Iterator[ProgramFinding]:
    for index, step in enumerate(program.steps):
        try:
            _check_values(step, robot)
        except ArmctlError as cause:
            yield ProgramFinding(index, str(cause))


def _check_values(step: Step, robot: Robot) -> None:
    # A file's numbers were checked when it was decoded; a program made in Python is checked here only.
    if (what := out_of_range(step)) is not None:
        raise ProgramError(what)
    match step:
        case MoveStep():
            _check_profile(step)
            robot.check_limits(np.radians(step.joints_deg))
        case PointStep():
            _check_profile(step)
            step_target(step)
        case LineStep():
            _check_numbers("the end of the line", step.x_mm, step.y_mm, step.z_mm)
            _check_pitch(step)
        case ArcStep():
            _check_numbers("the point on the arc", step.via_x_mm, step.via_y_mm, step.via_z_mm)
            _check_numbers("the end of the arc", step.x_mm, step.y_mm, step.z_mm)
            _check_pitch(step)
        case GripperStep() if robot.gripper is None:
            raise ProgramError(f"{robot.name} has no gripper; delete the step")
        case _:
            pass


def _check_profile(step: MoveStep | PointStep) -> None:
    if step.profile not in PROFILES:
        raise ProgramError(f"there is no profile {step.profile!r}; choose among {', '.join(PROFILES)}")


def _check_numbers(what: str, *values_mm: float) -> None:
    if not np.isfinite(values_mm).all():
        raise ProgramError(f"{what} must be finite numbers, got {values_mm}")


def _check_pitch(step: LineStep | ArcStep) -> None:
    if (step.pitch_deg is not None) != (step.pitch == "interpolated"):
        raise ProgramError(
            f'pitch = "{step.pitch}" and pitch_deg = {step.pitch_deg} do not go together: "interpolated" '
            "needs the pitch at the end, the others take none"
        )


@dataclass(frozen=True, slots=True)
class _Pass:
    """A pass of a repeat block that is being walked through."""

    begin: int
    """index of the ``repeat``"""
    entered: FloatArray | None
    """(n,) where the block was entered [rad]"""
    first: bool


@dataclass
class _Walk:
    """Plans the motions of a program from step to step, two passes of each block.

    What a step or a block does depends only on where it is entered. So what was walked from the same place
    before is not walked again: blocks in blocks cost no more than their steps.
    """

    program: Program
    robot: Robot
    skipped: frozenset[int]
    """steps that are wrong in themselves"""
    _steps: list[int] = field(default_factory=list[int])
    _trajectories: list[Trajectory] = field(default_factory=list[Trajectory])
    _refused: list[ProgramFinding] = field(default_factory=list[ProgramFinding])
    _known: dict[tuple[int, bytes], FloatArray | None] = field(
        default_factory=dict[tuple[int, bytes], FloatArray | None]
    )
    """where a step or a block ends that was entered somewhere"""

    def run(self, start: FloatArray | None) -> None:
        """Walk through the program from ``start`` (n,) [rad]; None: not known."""
        steps, blocks = self.program.steps, Blocks.of(self.program)
        q, index, passes = start, 0, list[_Pass]()
        second = False  # inside a second pass; the blocks in it are walked through once
        while index < len(steps):
            step = steps[index]
            if isinstance(step, MotionStep):
                q = self._after(index, step, q)
            elif isinstance(step, RepeatStep):
                end = blocks.partner(index)
                if end is not None and (index, _key(q)) in self._known:
                    q, index = self._known[index, _key(q)], end
                else:
                    passes.append(_Pass(index, q, first=True))
            elif isinstance(step, EndStep):
                done = passes.pop()
                repeat = steps[done.begin]
                again = done.first and isinstance(repeat, RepeatStep) and repeat.times > 1
                if again and not second and _key(q) != _key(done.entered):
                    passes.append(_Pass(done.begin, done.entered, first=False))
                    index, second = done.begin, True
                else:
                    second = second and done.first
                    self._known[done.begin, _key(done.entered)] = q
            index += 1

    def findings(self, payload_kg: float | None) -> Iterator[ProgramFinding]:
        """What was found: motions that cannot be planned, and those that the pre-flight has a word on."""
        yield from self._refused
        steps = self.program.steps
        paths = [isinstance(steps[index], LineStep | ArcStep) for index in self._steps]
        told: set[tuple[int, str, str]] = set()
        for index, trajectory, path in zip(self._steps, self._trajectories, paths, strict=True):
            for finding in preflight(self.robot, trajectory, payload_kg, tool_path=path):
                if (index, finding.kind, finding.part) not in told:  # the same of a block's second pass
                    told.add((index, finding.kind, finding.part))
                    yield ProgramFinding.of(index, finding)

    def _after(self, index: int, step: MotionStep, q: FloatArray | None) -> FloatArray | None:
        """Where a moving step ends that starts at ``q``; None where that is not known."""
        if index in self.skipped:
            return None
        key = (index, _key(q))
        if key not in self._known:
            try:
                self._known[key] = self._planned(index, step, q)
            except ArmctlError as cause:
                self._known[key] = None
                refusal = ProgramFinding(index, str(cause))
                if refusal not in self._refused:
                    self._refused.append(refusal)
        return self._known[key]

    def _planned(self, index: int, step: MotionStep, q: FloatArray | None) -> FloatArray | None:
        if q is not None:
            trajectory = plan_step(self.robot, q, step, checked=False)
            self._steps.append(index)
            self._trajectories.append(trajectory)
            return trajectory.end
        if isinstance(step, MoveStep):
            return self.robot.check_limits(np.radians(step.joints_deg))
        if isinstance(step, PointStep):
            known = (
                step.choose != "least-travel"
            )  # that depends on the start: reachable is all there is to say
            end = solve(self.robot, None, step_target(step), step.choose if known else "least-rotation")
            return end if known else None
        return None


def _key(q: FloatArray | None) -> bytes:
    """Two places that differ by rounding count as one."""
    return b"" if q is None else (np.round(q, 7) + 0.0).tobytes()
