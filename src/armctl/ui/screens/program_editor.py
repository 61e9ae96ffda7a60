"""The selected row, and changes of the program by the page that operates."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING

from armctl.errors import StateError
from armctl.motion.program import Program, Step
from armctl.motion.program_check import check_program
from armctl.runtime import UpdateProgram
from armctl.ui.widgets.step_edit import Change
from armctl.ui.widgets.step_list import page_of

if TYPE_CHECKING:
    from armctl.ui.session import Session

EDIT_WAITS = "the edit takes effect at the next pass"


class ProgramEditor:
    """What the parts of the serial motion share on one page."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._desk = session.console.programs
        self.selected = 0
        """index of the selected row"""
        self.page = 0
        """of the list, from 0"""

    @property
    def step(self) -> Step | None:
        """The selected step; None where the list is empty."""
        steps = self._desk.program.steps
        return steps[self.selected] if self.selected < len(steps) else None

    def select(self, row: int) -> None:
        """Select a row, from 0, and turn to its page."""
        self.selected, self.page = row, page_of(row)

    async def change(self, change: Callable[[Program], Change]) -> None:
        """Change the list and the selection; a program that runs goes on with the change at its next pass.

        Raises:
            ArmctlError: this page does not operate, the change cannot be made, or the arm cannot go on
                with it.
        """
        self._session.require_operator()
        changed, selected = change(self._desk.program)
        runs = await self._take_over(lambda: self._desk.edit(lambda _: changed))
        self.select(selected)
        if runs:
            await self._warn(changed)

    async def undo(self) -> None:
        """Take the last change back.

        Raises:
            ArmctlError: as ``change``; also where there is none.
        """
        self._session.require_operator()
        await self._take_over(self._desk.undo)

    async def redo(self) -> None:
        """Make the change again that was taken back last.

        Raises:
            ArmctlError: as ``change``; also where there is none.
        """
        self._session.require_operator()
        await self._take_over(self._desk.redo)

    async def _take_over(self, edit: Callable[[], None]) -> bool:
        """Edit; if the arm runs what is edited, it is given the new version, too, and this is true."""
        desk = self._desk
        runs = desk.relation(self._session.snapshot.program) in ("running", "coming")
        edit()
        if not runs:
            return False
        try:
            await self._session.submit(UpdateProgram(desk.program))
        except StateError:
            if self._session.snapshot.program is None:  # it has ended meanwhile
                return False
            raise
        return True

    async def _warn(self, program: Program) -> None:
        """Say before the next pass that the arm would stop in it; nobody has checked an edit as Run does."""
        findings = await asyncio.to_thread(check_program, program, self._session.console.robot)
        errors = [finding for finding in findings if finding.severity == "error"]
        if errors and self._desk.program is program:
            self._session.notify("The next pass would stop there", f"{errors[0]}; edit it, or Undo", "yellow")
