"""What the program on the list would do from where the arm stands, for all pages that look at it."""

from __future__ import annotations

import asyncio
import time
from typing import NamedTuple, Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.facts import State
from armctl.lazy_dataclass import dataclass
from armctl.motion.trajectory import JoinedTrajectory
from armctl.program import Program, SavedPrograms
from armctl.program.base_steps import MotionStep
from armctl.program.rehearsal import Rehearsal, rehearse
from armctl.protocol import ProgramProgress, Snapshot
from armctl.robot import Robot
from armctl.ui.console import Console
from armctl.ui.events import OneAtATime
from armctl.ui.scene.ghost import SAME_RAD
from armctl.ui.session import Session
from armctl.ui.tabs.manual.program_editor import EMPTY
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.html import fixed

MOST_STEPS, LONGEST_S = 300, 600.0
"""of a pass that are worked out"""
BUDGET_S = 1.0
"""of the processor: a step takes from 1 ms to 100, and other pages wait for the same interpreter"""


@dataclass(frozen=True, eq=False)
class _ToRehearse:
    robot: Robot
    program: Program
    library: SavedPrograms
    """which it may call"""
    start: FloatArray
    opening: float | None


class Underway(NamedTuple):
    """The step that runs, of the program on the list."""

    step: int
    share: float
    """of it that is over, 0..1"""
    left: float | None
    """until it is over, at the present speed [s]; None: not known"""
    at: float | None
    """in the rehearsal [s]; None: it is not rehearsed"""


class _Span(NamedTuple):
    """A step in the rehearsal, with all that it is made of."""

    step: int
    begins: float
    ends: float


def _spans(found: Rehearsal | None) -> list[_Span]:
    spans: list[_Span] = []
    for step in () if found is None else found.steps:
        ends = step.begins + step.duration
        if spans and spans[-1].step == step.index:
            spans[-1] = spans[-1]._replace(ends=ends)
        else:
            spans.append(_Span(step.index, step.begins, ends))
    return spans


class _Clock:
    """How long the step that runs has been running, on the clock of the rehearsal."""

    def __init__(self) -> None:
        self._step: tuple[Rehearsal | None, int, int] | None = None
        self._spans: list[_Span] = []
        self._nth = -1
        """of the spans"""
        self._passed = self._stamp = 0.0

    def see(self, snapshot: Snapshot, at: ProgramProgress, found: Rehearsal | None) -> Underway:
        """Look at every snapshot, once or more often."""
        step = found, at.loop, at.step
        if self._step is None or self._step[0] is not found:
            self._spans, self._nth = _spans(found), -1
        if step != self._step:
            again = self._step is None or at.loop != self._step[1]
            self._nth = self._next(at.step, -1 if again else self._nth)
            self._step, self._passed, self._stamp = step, 0.0, snapshot.stamp
        moves = isinstance(at.running.steps[at.step], MotionStep)
        speed = snapshot.speed if moves else 1.0
        if snapshot.state is State.MOVING:
            self._passed += speed * max(snapshot.stamp - self._stamp, 0.0)
        self._stamp = snapshot.stamp
        share = 0.0
        if snapshot.progress is not None and at.loops is not None:  # which is told of all passes
            share = min(max((snapshot.progress * at.loops - at.loop) * at.steps - at.step, 0.0), 1.0)
        if self._nth < 0:
            return Underway(at.step, share, None, None)
        span = self._spans[self._nth]
        lasts = span.ends - span.begins
        if not share or not moves:
            share = min(self._passed / lasts, 1.0) if lasts > 0.0 else 1.0
        return Underway(at.step, share, (1.0 - share) * lasts / speed, span.begins + share * lasts)

    def _next(self, step: int, after: int) -> int:
        """The next span of a step, or its first one; -1: it has none."""
        found = [nth for nth, span in enumerate(self._spans) if span.step == step]
        return next((nth for nth in found if nth > after), found[0] if found else -1)


class ProgramAhead:
    """One pass of it, worked out beside the event loop while somebody looks. Event loop only."""

    def __init__(self, console: Console) -> None:
        self._console, self._shared = console, console.shared(SharedProgram)
        self.rehearsal: Rehearsal | None = None
        self.motion: JoinedTrajectory | None = None
        """of the rehearsal"""
        self.lasts: dict[str, str] = {}
        """how long each step takes at full speed, in words, by key"""
        self.keys: tuple[str, ...] = ()
        """of the program's steps, as it was rehearsed"""
        self.note = EMPTY
        """why there is no rehearsal, or why it ends before the program; empty: it is whole"""
        self._clock = _Clock()
        self._asked: _ToRehearse | None = None
        self._working = OneAtATime(self._work)

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Of the present arm; nothing is worked out yet."""
        del before
        return cls(console)

    def look(self, session: Session, snapshot: Snapshot, *, from_here: bool = True) -> None:
        """A page looks at it: have it worked out anew where the program is another one.

        ``from_here``: where the arm stands elsewhere, too; what a step leads to hardly depends on that.
        """
        asked, program = self._asked, self._shared.program
        start = self._console.last_known.standing(snapshot)
        if asked is not None and asked.program is program:
            moved = asked.robot is not session.held or float(np.abs(asked.start - start).max()) >= SAME_RAD
            if snapshot.busy or not (from_here and moved):
                return
        self._asked = _ToRehearse(session.held, program, self._shared.library, start.copy(), snapshot.gripper)
        session.spawn(self._working.run())

    def underway(self, snapshot: Snapshot) -> Underway | None:
        """The step that runs; None: the arm does not run what is on the list."""
        at = snapshot.program
        if at is None or self._shared.relation(at) != "running":
            return None
        return self._clock.see(snapshot, at, self.rehearsal)

    async def _work(self) -> None:
        asked, keys = self._asked, tuple(self._shared.keys)
        if asked is None:
            return
        found, note = None, EMPTY
        try:
            if asked.program.steps:
                found, note = await asyncio.to_thread(_rehearsed, asked)
        except asyncio.CancelledError:  # the page that asked is gone: another one asks again
            self._asked = None
            raise
        if asked is self._asked:
            self.rehearsal, self.note, self.keys = found, note, keys
            self.motion = None if found is None else found.trajectory
            self.lasts = {
                keys[one.step]: f"{fixed(one.ends - one.begins, 1)} s"
                for one in reversed(_spans(found))
                if one.step < len(keys)
            }


def _rehearsed(asked: _ToRehearse) -> tuple[Rehearsal | None, str]:
    end = time.thread_time() + BUDGET_S
    try:
        found = rehearse(
            asked.robot, asked.library.link(asked.program), asked.start, asked.opening, longest_s=LONGEST_S,
            most_steps=MOST_STEPS, as_far=True, go_on=lambda: time.thread_time() < end,
        )  # fmt: skip
    except ArmctlError as refusal:
        return None, str(refusal)
    if found.broken is not None:
        return found, f"step {found.broken.index + 1}: {found.broken.place.words}{found.broken.error}"
    count = len(found.steps)
    first = f"the first {count} step{'' if count == 1 else 's'} of a pass"
    return found, first if found.cut else ""
