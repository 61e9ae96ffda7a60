"""Runs a program: moves, waits and gripper steps, with pause, resume and stop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, InputError, ProgramError
from armctl.motion import GripperStep, Program, WaitStep, check_program
from armctl.robot import Robot
from armctl.runtime.activity import ActivityView, Setpoint
from armctl.runtime.gripper import GripperMover
from armctl.runtime.mover import PathMover
from armctl.runtime.planner import Planner, planned
from armctl.runtime.program_plan import PlannedStep, ProgramPlan
from armctl.runtime.snapshot import ProgramProgress

FloatArray = NDArray[np.float64]


class ProgramRunner:
    """One program on its way. At most one step is begun a tick, so that an empty loop cannot hang it."""

    def __init__(
        self,
        robot: Robot,
        program: Program,
        loops: int | None,
        first: int,
        start: FloatArray,
        planner: Planner,
        gripper: GripperMover,
        speed: float,
    ) -> None:
        """Check what can be checked at once, ask for the first plans and begin if they are there.

        Args:
            robot: the arm.
            program: what to run.
            loops: how often; None: for ever.
            first: index of the step that the first pass begins with.
            start: (n,) where the arm stands [rad].
            planner: solves the steps.
            gripper: obeys the gripper steps.
            speed: override.

        Raises:
            InputError: ``loops`` or ``first`` that cannot be.
            ProgramError: another robot's program, no steps, or a step outside the limits.
        """
        findings = check_program(program, robot, motions=False)
        if findings:
            raise ProgramError(f"{program.name}: {findings[0]}")
        if not 0 <= first < len(program.steps):
            raise InputError(f"{program.name} has no step {first + 1}; it has {len(program.steps)}")
        if loops is not None and loops < 1:
            raise InputError(f"a program runs once or more often, not {loops} times")
        self._robot = robot
        self._program = program
        self._loops = loops
        self._speed = speed
        self._gripper = gripper
        self._plan = ProgramPlan(program, loops, first, start, planner)
        self._index, self._loop = first, 0
        self._mover: PathMover | None = None
        self._wait_left = 0.0
        self._gripping = False
        self._begun = False
        self._paused = False
        self._stopped = False
        self._error: ArmctlError | None = None
        self._begin_next()

    @property
    def label(self) -> str:
        """What it is."""
        return f"program {self._program.name!r}"

    @property
    def begun(self) -> bool:
        """Its first step has begun."""
        return self._begun

    @property
    def standing(self) -> bool:
        """The joints are at rest now."""
        return self._mover is None or self._mover.standing

    @property
    def done(self) -> bool:
        """All passes are over, or it was stopped or refused, and the joints are at rest."""
        if self._stopped or self._error is not None:
            return self._mover is None or self._mover.done
        return not self._busy and self._begun and self._plan.ended

    @property
    def error(self) -> ArmctlError | None:
        """Which step could not be run, and why."""
        return self._error

    @property
    def pausable(self) -> bool:
        """Yes."""
        return True

    @property
    def notice(self) -> str | None:
        """Nothing is held back."""
        return None

    @property
    def gripping(self) -> bool:
        """A gripper step is running."""
        return self._gripping

    def set_speed(self, fraction: float) -> None:
        """Go towards this speed override; waits are not shortened or stretched."""
        self._speed = fraction
        if self._mover is not None:
            self._mover.set_speed(fraction)

    def pause(self) -> None:
        """Stand on the path, or stop the time of a wait."""
        self._paused = True
        self._gripper.held = self._gripping
        if self._mover is not None:
            self._mover.pause()

    def resume(self) -> None:
        """Go on."""
        self._paused = False
        self._gripper.held = False
        if self._mover is not None:
            self._mover.resume()

    def stop(self) -> None:
        """Slow down and drop the rest."""
        self._stopped = True
        self._gripper.held = False
        self._plan.drop()
        if self._mover is not None:
            self._mover.stop()

    def halt(self) -> None:
        """No setpoint is sent for now: go on from rest."""
        if self._mover is not None:
            self._mover.halt()

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds; None where no joint moves."""
        sample = None
        if self._mover is not None:
            sample = self._mover.advance(now, dt)
            if self._mover.done:
                self._mover = None
        elif self._wait_left > 0 and not self._paused:
            self._wait_left -= dt
        if self._gripping and not self._gripper.moving:
            self._gripping = False
        if not (self._busy or self._paused or self._stopped or self._error is not None):
            self._begin_next()
        return sample

    def view(self) -> ActivityView:
        """What is shown: goal and progress of the running step, and where the program is."""
        program = ProgramProgress(
            self._program.name, self._index, len(self._program.steps), self._loop, self._loops
        )
        if self._mover is None:
            return ActivityView(None, 0.0, max(self._wait_left, 0.0), program)
        moving = self._mover.view()
        return ActivityView(moving.goal, moving.progress, moving.remaining_s, program)

    @property
    def _busy(self) -> bool:
        return self._mover is not None or self._wait_left > 0 or self._gripping

    def _begin_next(self) -> None:
        step = self._plan.take()
        if step is None:
            if self._plan.ended:
                self._loop = self._loops or 0
            return
        self._index, self._loop = step.index, step.loop
        try:
            self._begin(step)
        except ArmctlError as cause:
            self._plan.drop()
            self._error = ProgramError(f"{self._program.name}: step {step.index + 1}: {cause}")
            self._error.__cause__ = cause
            return
        self._begun = True

    def _begin(self, planned_step: PlannedStep) -> None:
        step = planned_step.step
        if planned_step.future is not None:
            trajectory = planned(planned_step.future)
            self._mover = PathMover(self._robot, trajectory, self._speed)
            if self._mover.done:  # the arm is there already
                self._mover = None
        elif isinstance(step, WaitStep):
            self._wait_left = step.seconds
        elif isinstance(step, GripperStep):
            self._gripper.move_to(step.open_percent / 100)
            self._gripping = True
