"""A program's steps in the order they run, planned while the ones before them run."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.program import (
    PlannedStep,
    PlanState,
    Program,
    ProgramSource,
    begin_program,
    plan_next,
)
from armctl.robot import Robot
from armctl.runtime.planner import Planner, result_of

FloatArray = NDArray[np.float64]
_MOTIONS_AHEAD = 2
_STEPS_AHEAD = 512

Planned = tuple[list[PlannedStep], PlanState]


@dataclass(frozen=True, slots=True, eq=False)
class BegunProgram:
    """A program that is checked, with its first steps planned."""

    source: ProgramSource
    steps: list[PlannedStep]
    state: PlanState
    """after those steps"""


def begun_program(
    robot: Robot,
    program: Program,
    loops: int | None,
    first: int,
    count: int | None,
    start: FloatArray,
) -> BegunProgram:
    """Check a program and plan its first steps from ``start`` (n,) [rad]."""
    source = ProgramSource(program)
    state = begin_program(robot, program, start, loops=loops, first=first, count=count)
    return BegunProgram(source, *plan_next(robot, source, state))


class ProgramFeed:
    """Hands out the steps and keeps the planner ahead of them. Owned by the controller thread.

    An edit takes effect at the next pass. Where that begins at rest, it is planned anew at once. Where the
    arm would go on into it without a stop, the arm stops there first (``begin_pass_at``).
    """

    def __init__(self, robot: Robot, begun: BegunProgram, planner: Planner, early_s: float) -> None:
        """Begin with the steps that are planned.

        Args:
            robot: the arm.
            begun: the program, and those steps.
            planner: plans the others.
            early_s: how long before it is due a motion may be taken [s]; twice as much is planned.
        """
        self._robot = robot
        self._ahead_s = 2 * early_s
        self._source = begun.source
        self._state: PlanState = begun.state
        self._planner = planner
        self._ready: deque[PlannedStep] = deque(begun.steps)
        self._future: Future[Planned] | None = None
        self._failure: ArmctlError | None = None
        self._over = not begun.steps or begun.steps[-1].error is not None
        self._running_pass = 0
        self._goes_on = False
        """the moving step that was taken last does not end at rest"""
        self._pass_begins: dict[int, PlanState] = {}
        """before the first step of each pass that was taken, from the running one on"""
        self._fill()

    def peek(self) -> PlannedStep | None:
        """The next step, once it is planned; None while it is being planned, or at the end.

        Raises:
            ArmctlError: the planner itself failed, and every step that it had planned before was taken.
        """
        self._fill()
        if self._ready:
            return self._ready[0]
        if self._failure is not None:
            raise self._failure
        return None

    def take(self) -> PlannedStep:
        """The step that ``peek`` showed; it runs now, or follows what runs."""
        step = self._ready.popleft()
        if step.before.program is None:
            self._pass_begins[step.passes] = step.before
        if step.moves:
            self._goes_on = step.goes_on
        self._fill()
        return step

    def begun(self, step: PlannedStep) -> None:
        """A step that was taken runs now."""
        if step.passes != self._running_pass:
            self._running_pass = step.passes
            self._pass_begins = {k: state for k, state in self._pass_begins.items() if k >= step.passes}
            self._drop_outdated()

    def is_outdated(self, step: PlannedStep) -> bool:
        """Whether a step belongs to a later pass than the running one, and to an older version."""
        return step.program is not self._source.program and step.passes > self._running_pass

    def begin_pass_at(self, q: FloatArray, passes: int) -> None:
        """Plan a pass anew, of whose steps some were taken, from where the arm stopped, (n,) [rad]."""
        self._ready.clear()
        self._goes_on = False
        self._plan_from(replace(self._pass_begins[passes], q=q, entry=None))

    @property
    def ended(self) -> bool:
        """No step is left."""
        return self._over and not self._ready

    def update(self, program: Program) -> None:
        """Go on with another version of the program at the next pass."""
        self._source.edit(program)
        self._drop_outdated()

    def drop(self) -> None:
        """Nothing of it will run any more."""
        self._forget_plan()
        self._ready.clear()
        self._failure = None
        self._over = True

    def _fill(self) -> None:
        """Take in what is planned, and ask for more where it is needed."""
        while not self._over:
            if self._future is None:
                if self._state.ended:
                    self._over = True
                if self._over or self._enough():
                    return
                self._future = self._planner.submit(plan_next, self._robot, self._source, self._state)
            if not self._future.done():
                return
            future, self._future = self._future, None
            try:
                steps, state = result_of(future)
            except ArmctlError as cause:
                self._failure = cause
                self._over = True
                return
            self._ready.extend(steps)
            self._state = state
            self._over = not steps or steps[-1].error is not None
            self._drop_outdated()

    def _enough(self) -> bool:
        if len(self._ready) >= _STEPS_AHEAD:
            return True
        motions = [step.trajectory.duration for step in self._ready if step.trajectory is not None]
        return len(motions) >= _MOTIONS_AHEAD and sum(motions) >= self._ahead_s

    def _drop_outdated(self) -> None:
        """Plan anew from the next pass, if it was planned from an older version and begins at rest."""
        goes_on = self._goes_on
        for k, step in enumerate(self._ready):
            if self.is_outdated(step):
                if not goes_on:
                    while len(self._ready) > k:
                        self._ready.pop()
                    self._plan_from(step.before)
                return
            if step.moves:
                goes_on = step.goes_on
        known = self._state.known
        outdated = next((k for k, drawn in enumerate(known) if self.is_outdated(drawn.step)), None)
        if outdated is not None and not goes_on:
            self._plan_from(replace(self._state, known=known[:outdated]))

    def _plan_from(self, state: PlanState) -> None:
        self._forget_plan()
        self._state = state
        self._over, self._failure = False, None

    def _forget_plan(self) -> None:
        if self._future is not None:
            self._future.cancel()
            self._future = None
