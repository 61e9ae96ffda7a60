"""A program on its way to be run: its steps one by one, and where it is between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.motion.blend import Entry, Leg
from armctl.motion.program import Cursor, Program, Step
from armctl.motion.trajectory import Trajectory

FloatArray = NDArray[np.float64]


class ProgramSource:
    """The program as it is edited now: each pass begins with the newest."""

    def __init__(self, program: Program) -> None:
        self.program = program


@dataclass(frozen=True, slots=True, eq=False)
class PlanState:
    """Up to where a program is planned."""

    q: FloatArray
    """(n,) where the next motion begins [rad]; of a blended one, the point that it turns off from"""
    loops_left: int | None
    """passes that have not begun; None: without end"""
    steps_left: int | None = None
    """how many steps shall still run; None: all"""
    passes: int = 0
    """passes finished"""
    program: Program | None = None
    """of the present pass; None: the next pass takes the newest"""
    cursor: Cursor | None = None
    first: int = 0
    """step that the next pass begins with"""
    percent: float = 100.0
    """what the last speed step asks for"""
    entry: Entry | None = None
    """how the next leg is begun; None: from rest"""
    known: tuple[DrawnStep, ...] = ()
    """steps beyond that are solved already, because a blended motion had to look at them"""

    def begun(self, program: Program, cursor: Cursor) -> PlanState:
        """The next pass begins, with this version, at this place in it."""
        left = None if self.loops_left is None else self.loops_left - 1
        return replace(self, program=program, cursor=cursor, loops_left=left, first=0, percent=100.0)

    @property
    def ended(self) -> bool:
        """Nothing is left."""
        if self.known:
            return False
        if self.steps_left == 0:
            return True
        return self.program is None and self.loops_left == 0


@dataclass(frozen=True, slots=True, eq=False)
class PlannedStep:
    """One step on its way to be run."""

    index: int
    step: Step
    program: Program
    passes: int
    """passes finished before it"""
    percent: float
    before: PlanState
    """the state that planning it began with"""
    trajectory: Trajectory | None = None
    """its motion; None where no joint moves"""
    goes_on: bool = False
    """its motion does not end at rest: that of the next moving step goes on"""
    error: ArmctlError | None = None
    """why it cannot be run"""

    @property
    def moves(self) -> bool:
        """Whether joints move in it."""
        return self.trajectory is not None and self.trajectory.duration > 0

    def again(self, entry: Entry | None) -> PlanState:
        """The state from which this step, of this version of the program, is planned once more.

        Args:
            entry: how its motion, or the next one behind it, is begun.
        """
        before = self.before
        if before.program is None:
            before = before.begun(self.program, Cursor(self.program, before.first))
        return replace(before, entry=entry)


@dataclass(frozen=True, slots=True, eq=False)
class DrawnStep:
    """A step that is drawn from a program, not planned yet."""

    step: PlannedStep
    leg: Leg | None
    """its path, where it moves"""
    after: PlanState
    """the state after it"""
