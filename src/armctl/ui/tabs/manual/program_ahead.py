"""What the program on the list would do from where the arm stands, for all pages that look at it."""

from __future__ import annotations

import asyncio
import time
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.lazy_dataclass import dataclass
from armctl.motion.trajectory import JoinedTrajectory
from armctl.program import Program, SavedPrograms
from armctl.program.rehearsal import Rehearsal, rehearse
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.console import Console
from armctl.ui.events import OneAtATime
from armctl.ui.scene.ghost import SAME_RAD
from armctl.ui.session import Session
from armctl.ui.tabs.manual.program_editor import EMPTY
from armctl.ui.tabs.manual.shared_program import SharedProgram

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


class ProgramAhead:
    """One pass of it, worked out beside the event loop while somebody looks. Event loop only."""

    def __init__(self, console: Console) -> None:
        self._console, self._shared = console, console.shared(SharedProgram)
        self.rehearsal: Rehearsal | None = None
        self.motion: JoinedTrajectory | None = None
        """of the rehearsal"""
        self.keys: tuple[str, ...] = ()
        """of the program's steps, as it was rehearsed"""
        self.note = EMPTY
        """why there is no rehearsal, or why it ends before the program; empty: it is whole"""
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
