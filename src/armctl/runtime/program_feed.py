"""A program's steps in the order they run, planned while the ones before them run."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.program import (
    PlannedStep,
    PlanState,
    Program,
    ProgramSource,
    begin_program,
    plan_again,
    plan_next,
)
from armctl.robot import Robot
from armctl.runtime.planner import Planner, result_of

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
    start: NDArray[np.float64],
) -> BegunProgram:
    """Check a program and plan its first steps from ``start`` (n,) [rad]."""
    source = ProgramSource(program)
    state = begin_program(robot, program, start, loops=loops, first=first, count=count)
    return BegunProgram(source, *plan_next(robot, source, state))


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    """Where the arm may leave what is planned, which an edit has outdated."""

    step: PlannedStep | None
    """the first step that does not begin then; None: what is planned stays, what is drawn does not"""
    state: PlanState
    """before it"""


@dataclass(frozen=True, slots=True, eq=False)
class _Detour:
    """What is planned in the place of an outdated part."""

    turns: Sequence[_Turn]
    future: Future[tuple[int, list[PlannedStep], PlanState] | None]


class ProgramFeed:
    """Hands out the steps and keeps the planner ahead of them. Owned by the controller thread.

    An edit takes effect at the next pass. Where that begins at rest, it is planned anew from there. Where
    the present pass turns into it without a stop, its last steps are planned anew, too, from the last one
    at which the arm can still turn off or be braked; until that is done the arm goes on as it was planned.
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
        """the moving step that began last does not end at rest"""
        self._handed: deque[PlannedStep] = deque()
        """moving steps that were taken and have not begun"""
        self._detour: _Detour | None = None
        self._tried: tuple[int, Program] | None = None
        """the pass and the version of the last detour"""
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
        if step.moves:
            self._handed.append(step)
        self._fill()
        return step

    def begun(self, step: PlannedStep) -> None:
        """A step that was taken runs now, and all that were taken before it are over."""
        if step.moves:
            while self._handed.popleft() is not step:
                pass
            self._goes_on = step.goes_on
        if step.passes != self._running_pass:
            self._running_pass = step.passes
            self._drop_outdated()

    def turn_back(self) -> PlannedStep | None:
        """Go over to what an edit made necessary, once it is planned.

        Returns:
            A step that was taken and that must not begin any more, nor those taken after it; None: there
            is no such step.
        """
        if self._detour is None or not self._detour.future.done():
            return None
        detour, self._detour = self._detour, None
        try:
            found = result_of(detour.future)
        except ArmctlError as cause:
            self._failure, self._over = cause, True
            return None
        withdrawn = None if found is None else self._changed_to(detour.turns[found[0]], *found[1:])
        self._drop_outdated()  # it may have been edited once more, or another pass runs by now
        return withdrawn

    def _changed_to(self, turn: _Turn, steps: list[PlannedStep], state: PlanState) -> PlannedStep | None:
        """Run other steps from a turn on, unless it has begun by now; gives what ``turn_back`` gives."""
        step, withdrawn = turn.step, None
        if step in self._handed:
            _drop_from(self._handed, step)
            self._ready.clear()
            withdrawn = step
        elif step in self._ready:
            _drop_from(self._ready, step)
        elif step is not None:
            return None
        self._ready.extend(steps)
        self._plan_from(state)
        return withdrawn

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
        self._forget_plans()
        self._ready.clear()
        self._failure = None
        self._over = True

    def _fill(self) -> None:
        """Take in what is planned, and ask for more where it is needed."""
        while not self._over and self._detour is None:
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
        """Plan anew from the first pass that was planned from an older version."""
        if self._detour is not None:
            return
        goes_on = self._goes_on
        for step in chain(self._handed, self._ready):
            if self._is_outdated(step):
                if goes_on:
                    self._ask_for_detour()
                else:
                    _drop_from(self._ready, step)
                    self._plan_from(step.before)
                return
            if step.moves:
                goes_on = step.goes_on
        known = self._state.known
        for k, drawn in enumerate(known):
            if self._is_outdated(drawn.step):
                if goes_on:
                    self._ask_for_detour()
                else:
                    self._plan_from(replace(self._state, known=known[:k]))
                return

    def _is_outdated(self, step: PlannedStep) -> bool:
        return step.program is not self._source.program and step.passes > self._running_pass

    def _plan_from(self, state: PlanState) -> None:
        self._forget_plans()
        self._state = state
        self._over, self._failure = False, None

    def _forget_plans(self) -> None:
        for future in (self._future, None if self._detour is None else self._detour.future):
            if future is not None:
                future.cancel()
        self._future = self._detour = None

    def _ask_for_detour(self) -> None:
        """Once a pass and version: what cannot be left now cannot be left nearer to the end of the pass."""
        tried = self._running_pass, self._source.program
        turns = self._turns()
        if not turns or self._tried == tried:
            return
        self._forget_plans()
        self._tried = tried
        future = self._planner.submit(plan_again, self._robot, self._source, [turn.state for turn in turns])
        self._detour = _Detour(turns, future)

    def _turns(self) -> list[_Turn]:
        """Where the rest of the present pass may be planned anew, the latest first, ever farther apart."""
        turns = [
            _Turn(step, step.again(step.before.entry))
            for step in chain(self._handed, self._ready)
            if step.moves and step.passes == self._running_pass
        ]
        known = self._state.known
        if known and known[0].step.passes == self._running_pass:
            turns.append(_Turn(None, known[0].step.again(self._state.entry)))
        turns.reverse()
        return [turns[2**k - 1] for k in range(len(turns).bit_length()) if 2**k <= len(turns)]


def _drop_from(steps: deque[PlannedStep], first: PlannedStep) -> None:
    while steps.pop() is not first:
        pass
