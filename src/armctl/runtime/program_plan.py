"""A program's steps in the order they run, each moving one planned while the one before it runs."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.motion import MoveStep, PointStep, Program, Step, Trajectory
from armctl.runtime.planner import Planner, planned

FloatArray = NDArray[np.float64]
_MOTIONS_AHEAD = 2
_STEPS_AHEAD = 16


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """One step on its way to be run."""

    index: int
    loop: int
    """passes finished before it"""
    step: Step
    future: Future[Trajectory] | None
    """its plan; None where nothing is to be planned"""

    @property
    def ready(self) -> bool:
        """It can be run now."""
        return self.future is None or self.future.done()


class ProgramPlan:
    """Hands out the steps and keeps the planner ahead of them."""

    def __init__(
        self, program: Program, loops: int | None, first: int, start: FloatArray, planner: Planner
    ) -> None:
        self._program = program
        self._loops = loops
        self._planner = planner
        self._next = first
        self._loop = 0
        self._start: FloatArray | None = start
        self._last: Future[Trajectory] | None = None
        self._ahead: deque[PlannedStep] = deque()

    def take(self) -> PlannedStep | None:
        """The next step, once it is ready; None while it is being planned, or at the end."""
        self._fill()
        if not self._ahead or not self._ahead[0].ready:
            return None
        step = self._ahead.popleft()
        self._fill()
        return step

    @property
    def ended(self) -> bool:
        """No step is left."""
        return not self._ahead and self._over

    def drop(self) -> None:
        """Nothing of it will run any more."""
        for step in self._ahead:
            if step.future is not None:
                step.future.cancel()
        self._ahead.clear()
        self._loop, self._next = 0, 0
        self._loops = 0

    @property
    def _over(self) -> bool:
        return self._loops is not None and self._loop >= self._loops

    def _fill(self) -> None:
        while not self._over and len(self._ahead) < _STEPS_AHEAD:
            step = self._program.steps[self._next]
            future: Future[Trajectory] | None = None
            if isinstance(step, MoveStep | PointStep):
                if sum(ahead.future is not None for ahead in self._ahead) >= _MOTIONS_AHEAD:
                    return
                start = self._where()
                if start is None:
                    return
                future = self._last = self._planner.step(start, step)
            self._ahead.append(PlannedStep(self._next, self._loop, step, future))
            self._next += 1
            if self._next >= len(self._program.steps):
                self._next = 0
                self._loop += 1

    def _where(self) -> FloatArray | None:
        """Where the next motion starts; None while the one before it is being planned, or was refused."""
        if self._last is not None:
            if not self._last.done():
                return None
            last, self._last = self._last, None
            try:
                self._start = planned(last).end
            except ArmctlError:
                self._start = None  # told when the step's turn comes
        return self._start
