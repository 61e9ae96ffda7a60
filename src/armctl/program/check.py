"""What is wrong with a program, found before it is run."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import replace

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.documents import Document
from armctl.errors import ArmctlError
from armctl.facts import NoSteps, OtherRobot, Reason
from armctl.kinematics.velocity import NEAR
from armctl.motion.clearance import sources
from armctl.motion.preflight import Finding, isotropy_of, passes, preflight
from armctl.motion.trajectory import JoinedTrajectory, Trajectory
from armctl.program.base_steps import MotionStep, Step
from armctl.program.program import PROGRAM_FILES, Blocks, Cursor, Program
from armctl.program.steps import AnyStep, EndStep, MoveStep, RepeatStep
from armctl.robot import CarriedPart, Robot
from armctl.robot.body.arm_body import Openings


def check_program(
    program: Program,
    robot: Robot,
    *,
    motions: bool = True,
    start: ArrayLike | None = None,
    payload_kg: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Finding]:
    """What is wrong with a program for an arm, in the order of the steps; without errors it may be run.

    A blended step is checked as if it stopped: a corner that is refused when it is run
    becomes a stop, and warnings that only a corner gives are missed.
    ``motions``: also plan and check every motion whose start is known, of a block in two passes (slower).
    ``start``: (n,) where the first begins [rad]; None: not known. As it begins, the gripper is where that of
    ``robot`` is, and carries the same (``Robot.gripping``, ``Robot.carrying``).
    ``payload_kg``: None: as in the robot file.
    ``progress`` is called with the steps checked and all steps; what it raises ends the check.
    """
    findings: list[Finding] = []
    if program.robot != robot.name:
        findings.append(Finding(OtherRobot(program.robot, robot.name)))
    if not program.steps:
        findings.append(Finding(NoSteps()))
    wrong = dict(_value_findings(program, robot))
    broken = Blocks.of(program.steps).findings
    in_steps = [Finding(why, step=index) for index, why in wrong.items()]
    in_steps += [Finding(why, step=index) for index, why in broken]
    if motions and not broken:
        begin = None if start is None else robot.chain.checked(start)
        walk = _Walk(program, robot, wrong, payload_kg)
        walk.run(begin, progress)
        in_steps += walk.found
    return findings + sorted(in_steps, key=lambda finding: -1 if finding.step is None else finding.step)


_STEPS: msgspec.json.Decoder[tuple[Step, ...]] = msgspec.json.Decoder(tuple[AnyStep, ...])


def _has_plain_values(steps: Sequence[Step]) -> bool:
    """Whether all steps hold what a file could: right types, in range, finite. 10,000 steps take 10 ms."""
    try:
        return _STEPS.decode(msgspec.json.encode(steps)) == tuple(steps)  # what is not finite becomes null
    except (msgspec.MsgspecError, TypeError, ValueError):
        return False


def _is_sound(steps: Sequence[Step], robot: Robot) -> bool:
    """Whether no step is wrong in itself: all at once, or the start of a long program waits for it."""
    if not _has_plain_values(steps):
        return False
    try:
        for step in steps:
            if not isinstance(step, MoveStep):
                step.check(robot)
        poses = np.array([step.joints_deg for step in steps if isinstance(step, MoveStep)], dtype=np.float64)
        for corner in (poses.min(axis=0), poses.max(axis=0)) if len(poses) else ():
            robot.check_limits(robot.read(corner))
        if len(poses) and not robot.chain.keeps_turns(robot.read(poses)).all():
            return False
    except (ArmctlError, ValueError):  # poses of different lengths
        return False
    return True


def _value_findings(program: Program, robot: Robot) -> Iterator[tuple[int, Reason]]:
    for index, step in () if _is_sound(program.steps, robot) else enumerate(program.steps):
        try:
            # A file's values were checked when it was decoded; a program made in Python is checked here only.
            Document(PROGRAM_FILES, msgspec.to_builtins(step)).convert(type(step))
            step.check(robot)
        except ArmctlError as cause:
            yield index, cause.reason


_Key = tuple[bytes, Openings, CarriedPart | None]
_TOGETHER, _ALONE = 32, 2
"""So many motions are checked at once, and so few one by one: 10,000 steps take a quarter of the time."""


class _Walk:
    """Plans from step to step, two passes of each block; what was walked from the same place, once."""

    def __init__(
        self, program: Program, robot: Robot, skipped: Container[int], payload_kg: float | None
    ) -> None:
        """``skipped``: indices of the steps that are wrong in themselves."""
        self.program, self.robot, self.skipped, self.payload_kg = program, robot, skipped, payload_kg
        self.found: list[Finding] = []
        """motions that cannot be planned, and what the pre-flight found in the others"""
        self._planned: list[tuple[int, MotionStep, Trajectory]] = []
        """motions that the pre-flight has not seen yet, each from where the one before ends"""
        self._known: dict[tuple[int, bytes, Openings, CarriedPart | None], FloatArray | None] = {}
        """where a step or a block ends that was entered somewhere"""
        self._reported: set[tuple[int, str, str]] = set()

    def run(self, q: FloatArray | None, progress: Callable[[int, int], None] | None) -> None:
        """Walk through the program from ``q`` (n,) [rad]; None: not known."""
        steps, cursor, done = self.program.steps, Cursor(self.program), 0
        passes: list[tuple[int, _Key, bool]] = []
        """of the open blocks: the ``repeat``, where it was entered, and whether it is the first pass"""
        second = False  # inside a second pass; the blocks in it are walked through once
        while (index := cursor.advance()) is not None:
            step, done = steps[index], max(done, index + 1)
            if isinstance(step, MotionStep):
                q = self._after(index, step, q)
                if progress is not None:
                    progress(done, len(steps))
            elif index not in self.skipped and (effect := step.effect).opening is not None:
                self._look_at(self._planned)
                self._planned = []
                self.robot = self.robot.gripping(effect.opening).carrying(effect.part)
            elif isinstance(step, RepeatStep):
                if (index, *self._key(q)) in self._known:
                    q = self._known[index, *self._key(q)]
                    cursor.leave(index)
                else:
                    passes.append((index, self._key(q), True))
            elif isinstance(step, EndStep):
                begin, entered, first = passes.pop()
                repeat = steps[begin]
                again = first and not second and isinstance(repeat, RepeatStep) and repeat.times > 1
                if again and self._key(q) != entered:
                    passes.append((begin, entered, False))
                    second = True
                else:
                    second = second and first
                    self._known[begin, *entered] = q
                    cursor.leave(begin)
        self._look_at(self._planned)

    def _key(self, q: FloatArray | None) -> _Key:
        """Where the arm and its gripper are, and what it carries; rounding makes no other place."""
        place = b"" if q is None else (np.round(q, 7) + 0.0).tobytes()
        return place, self.robot.openings, self.robot.part

    def _add(self, index: int, step: MotionStep, trajectory: Trajectory) -> None:
        if self._planned:
            _, last, before = self._planned[-1]
            follows = last.leads_tool == step.leads_tool and np.array_equal(before.end, trajectory.start)
            if len(self._planned) == _TOGETHER or not follows:
                self._look_at(self._planned)
                self._planned = []
        self._planned.append((index, step, trajectory))

    def _look_at(self, planned: list[tuple[int, MotionStep, Trajectory]]) -> None:
        """Run the pre-flight: over all at once, and where that finds something, over ever fewer."""
        if len(planned) > _ALONE:
            if not self._clear_together([trajectory for _, _, trajectory in planned], planned[0][1]):
                half = len(planned) // 2
                self._look_at(planned[:half])
                self._look_at(planned[half:])
            return
        for index, step, trajectory in planned:
            for one in preflight(self.robot, trajectory, self.payload_kg, tool_path=step.leads_tool):
                fact = (index, one.kind, one.part)
                if fact not in self._reported:  # the same of a block's second pass
                    self._reported.add(fact)
                    self.found.append(replace(one, step=index))

    def _clear_together(self, trajectories: list[Trajectory], step: MotionStep) -> bool:
        """Whether nothing is found in motions that follow each other, nor touched at their start."""
        robot, motion = self.robot, JoinedTrajectory(trajectories)
        start = robot.body_frames(motion.start[None])
        if any((source.gaps(start) < source.closed[:, None]).any() for source in sources(robot)):
            return False
        ends = np.array([trajectory.end for trajectory in trajectories])
        if isotropy_of(robot, robot.jacobian(ends))[0].min() < NEAR:
            return False
        return passes(robot, motion, self.payload_kg, tool_path=step.leads_tool, warned=False)

    def _after(self, index: int, step: MotionStep, q: FloatArray | None) -> FloatArray | None:
        """Where a moving step ends that starts at ``q``; None where that is not known."""
        if index in self.skipped:
            return None
        key = (index, *self._key(q))
        if key not in self._known:
            self._known[key] = None
            try:
                if q is None:
                    self._known[key] = step.end(self.robot)
                else:
                    trajectory = step.plan(self.robot, q, checked=False)
                    self._known[key] = trajectory.end
                    self._add(index, step, trajectory)
                    for reason in step.left_out(self.robot, q):
                        self.found.append(Finding(reason, severity="warning", step=index))
            except ArmctlError as cause:
                refusal = Finding(cause.reason, step=index)
                if refusal not in self.found:
                    self.found.append(refusal)
        return self._known[key]
