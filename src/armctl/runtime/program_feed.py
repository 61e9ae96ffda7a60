"""Hands a program's steps to who runs it, planned ahead, off the controller thread."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from dataclasses import replace

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.program import Program
from armctl.program.feed import PlannedStep, PlanState, ProgramSource, begin_program, decided, plan_next
from armctl.robot import Robot
from armctl.runtime.planner import Submit, result_of

_MOTIONS_AHEAD = 2
_STEPS_AHEAD = 512


Begun = tuple[ProgramSource, list[PlannedStep], PlanState]
"""a program that is checked, its first steps, planned, and the state after them"""


def begun_program(
    robot: Robot, start: FloatArray, program: Program, loops: int | None, first: int, count: int | None
) -> Begun:
    """Check a program and plan its first steps from ``start`` (n,) [rad]."""
    source = ProgramSource(program)
    closed, opened = robot.openings
    opening = closed if closed == opened else None
    state = begin_program(
        robot, program, start, loops=loops, first=first, count=count, opening=opening, whole=source.whole()
    )
    return (source, *plan_next(robot, source, state))


class ProgramFeed:
    """Hands out the steps, and keeps the planner ahead; an edit takes effect at the next pass, from rest."""

    def __init__(self, robot: Robot, begun: Begun, submit: Submit, early_s: float) -> None:
        """``early_s``: how long before it is due a motion may be taken [s]; twice as much is planned."""
        self._robot = robot
        self._ahead_s = 2 * early_s
        self._source, steps, self._state = begun
        self._submit = submit
        self._ready: deque[PlannedStep] = deque()
        self._future: Future[tuple[list[PlannedStep], PlanState]] | None = None
        self._failure: ArmctlError | None = None
        self._over = False
        self._running_pass = 0
        self._goes_on = False
        """the moving step that was taken last does not end at rest"""
        self._pass_begins: dict[int, PlanState] = {}
        """before the first step of each pass that was taken, from the running one on"""
        self._take_in(steps, self._state)
        self._fill()

    def peek(self) -> PlannedStep | None:
        """The next step; None: not planned yet, or the end. Raises why planning failed, after its steps."""
        self._fill()
        if self._ready:
            return self._ready[0]
        if self._failure is not None:
            raise self._failure
        return None

    def take(self) -> None:
        """Take the step that ``peek`` showed; it runs now, or follows what runs."""
        step = self._ready.popleft()
        if step.before.program is None:
            self._pass_begins[step.passes] = step.before
        if step.moves:
            self._goes_on = step.goes_on
        self._fill()

    def decide(self, holds: bool) -> None:
        """Go on behind the step that was taken last, which asks."""
        self._plan_from(decided(self._state, holds))
        self._fill()

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
        self._ready.clear()
        self._plan_from(self._state)
        self._over = True

    def _fill(self) -> None:
        """Take in what is planned, and ask for more where it is needed."""
        while not self._over:
            if self._future is None:
                self._over = self._state.ended
                if self._over or self._state.asks or self._enough():
                    return
                try:
                    self._future = self._submit(plan_next, self._robot, self._source, self._state)
                except ArmctlError as cause:
                    self._fail(cause)
                    return
            if not self._future.done():
                return
            future, self._future = self._future, None
            try:
                steps, state = result_of(future)
            except ArmctlError as cause:
                self._fail(cause)
                return
            self._take_in(steps, state)
            self._drop_outdated()

    def _fail(self, cause: ArmctlError) -> None:
        self._failure, self._over = cause, True

    def _take_in(self, steps: list[PlannedStep], state: PlanState) -> None:
        self._ready.extend(steps)
        self._state = state
        self._over = not steps or steps[-1].error is not None

    def _enough(self) -> bool:
        if len(self._ready) >= _STEPS_AHEAD:
            return True
        motions = [step.trajectory.duration for step in self._ready if step.trajectory is not None]
        return len(motions) >= _MOTIONS_AHEAD and sum(motions) >= self._ahead_s

    def _drop_outdated(self) -> None:
        """Plan anew from the next pass, if that is of an older version, at rest, and none of it was taken."""
        goes_on, ready, known = self._goes_on, self._ready, self._state.known
        for k, step in enumerate([*ready, *known]):
            if self.is_outdated(step):
                if step.before.program is None and not goes_on:
                    beyond = k - len(ready)
                    while len(ready) > k:
                        ready.pop()
                    self._plan_from(
                        replace(self._state, known=known[:beyond]) if beyond >= 0 else step.before
                    )
                return
            if step.moves:
                goes_on = step.goes_on

    def _plan_from(self, state: PlanState) -> None:
        if self._future is not None:
            self._future.cancel()
            self._future = None
        self._state = state
        self._over, self._failure = False, None
