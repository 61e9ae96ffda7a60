"""A program's steps in the order they run, planned while the ones before them run."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future

from armctl.errors import ArmctlError
from armctl.motion import PlannedStep, PlanState, Program
from armctl.runtime.planner import BegunProgram, Planner, result_of

_MOTIONS_AHEAD = 2
_STEPS_AHEAD = 512

Planned = tuple[list[PlannedStep], PlanState]


class ProgramFeed:
    """Hands out the steps and keeps the planner ahead of them. Owned by the controller thread."""

    def __init__(self, begun: BegunProgram, planner: Planner, early_s: float) -> None:
        """Begin with the steps that are planned.

        Args:
            begun: the program, and those steps.
            planner: plans the others.
            early_s: how long before it is due a motion may be taken [s]; twice as much is planned.
        """
        self._ahead_s = 2 * early_s
        self._source = begun.source
        self._state: PlanState = begun.state
        self._planner = planner
        self._ready: deque[PlannedStep] = deque(begun.steps)
        self._future: Future[Planned] | None = None
        self._failure: ArmctlError | None = None
        self._over = not begun.steps or begun.steps[-1].error is not None
        self._running_pass = 0
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
        self._running_pass = step.passes
        self._fill()
        return step

    @property
    def ended(self) -> bool:
        """No step is left."""
        return self._over and not self._ready

    def update(self, program: Program) -> None:
        """Go on with another version of the program at the next pass that can still be planned anew."""
        self._source.program = program
        self._drop_outdated()

    def drop(self) -> None:
        """Nothing of it will run any more."""
        if self._future is not None:
            self._future.cancel()
            self._future = None
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
                self._future = self._planner.ahead(self._source, self._state)
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
        """Plan anew from the first pass that was planned from an older version and begins at rest."""
        for k, step in enumerate(self._ready):
            outdated = step.program is not self._source.program and step.passes > self._running_pass
            # "before" has no program where the step begins a pass: it takes the newest one there
            if outdated and step.before.program is None and step.before.entry is None:
                self._state = step.before
                for _ in range(len(self._ready) - k):
                    self._ready.pop()
                if self._future is not None:
                    self._future.cancel()
                    self._future = None
                self._over, self._failure = False, None
                return
