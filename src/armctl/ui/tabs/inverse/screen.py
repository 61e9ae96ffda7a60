"""Inverse: a point in, all joint angles that reach it out; choose one, or let the program choose."""

from __future__ import annotations

import asyncio

import numpy as np
import viser

from armctl.errors import InputError, UnreachableError
from armctl.kinematics import CRITERIA, CRITERION_TEXT, checked_criterion
from armctl.runtime import MoveJoints, MoveTo, Snapshot
from armctl.ui.scene.stage import TargetMark
from armctl.ui.session import Session
from armctl.ui.tabs.inverse.answer import Answer, answer, answer_html, no_curve, solve
from armctl.ui.tabs.inverse.branches import BranchView
from armctl.ui.tabs.inverse.solution_table import PAGE_ROWS
from armctl.ui.tabs.inverse.target import TargetForm
from armctl.ui.widgets.html import LiveHtml, muted, numbers, warned
from armctl.ui.widgets.pager import Pager
from armctl.ui.widgets.plots import LinePlot
from armctl.ui.widgets.preview import Preview
from armctl.ui.widgets.profile_choice import MOVEMENTS, ProfileChoice

_NOTE = "Type where the tool shall be and press <b>Solve</b>. Nothing moves until a Go button is pressed."
_SOLVES_FIRST = "This button solves the changed fields first, then goes at once."
_OLD_LIST = "The list is of the fields as they were: press Solve first."
_MOVED = 1e-4
_DRAG_PAUSE_S = 0.1


class InverseScreen:
    """Target, solutions, energy curve, and the two ways to go."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._preview = Preview(session.ghost)
        self._mark = TargetMark(session.client.scene, "/inverse_mark")
        self._answer: Answer | None = None
        self._answered: tuple[str | bool, ...] = ()
        self._asked = 0
        self._dragging = False
        self._drag_pending = False
        self._build()

    def _build(self) -> None:
        session, gui = self._session, self._session.gui
        LiveHtml(gui, _NOTE)
        self._form = TargetForm(session, self._on_drag)
        self._fill = gui.add_button_group("Fill with", ("present position",))
        self._solve = gui.add_button("Solve", icon=viser.Icon.TARGET)
        self._result = LiveHtml(gui)
        self._stale = LiveHtml(gui)
        self._nearest = gui.add_button("Take nearest point", color="orange", visible=False)
        self._criterion = gui.add_dropdown("Least energy is", CRITERIA, initial_value=CRITERIA[0])
        self._criterion_note = LiveHtml(gui, muted(CRITERION_TEXT[CRITERIA[0]]))
        self._movement = ProfileChoice(session, MOVEMENTS)
        self._solves_first = LiveHtml(gui, warned(_SOLVES_FIRST))
        self._go_least = gui.add_button("Go by least energy", icon=viser.Icon.PLAYER_PLAY)
        tabs = gui.add_tab_group()
        with tabs.add_tab("List"):
            self._list = LiveHtml(gui, muted("Nothing is solved yet."))
            self._pager = Pager(session, PAGE_ROWS, self._on_row)
            self._form.watch.watch(self._pager.attach_row_edit)
            self._selected = LiveHtml(gui)
            self._old_list = LiveHtml(gui, warned(_OLD_LIST))
            self._go_selected = gui.add_button("Go by the selected one", icon=viser.Icon.PLAYER_PLAY)
        with tabs.add_tab("Energy curve"):
            self._curve_note = LiveHtml(gui, muted("Nothing is solved yet."))
            self._curve = LinePlot(gui)
        with tabs.add_tab("Branches"):
            self._branches = BranchView(session, self._show_ghost)
        for note in (self._stale, self._solves_first, self._old_list):
            note.visible = False
        session.on(self._fill.on_click, self._on_fill)
        session.on(self._solve.on_click, self._on_solve)
        session.on(self._nearest.on_click, self._on_nearest)
        session.on(self._criterion.on_update, self._on_criterion)
        session.on(self._go_least.on_click, self._on_go_least)
        session.on(self._go_selected.on_click, self._on_go_selected)

    def refresh(self, snapshot: Snapshot) -> None:
        """Tell when the result is out of date; hide the ghost once the arm has come to it."""
        stale = self._out_of_date(snapshot)
        self._stale.visible = bool(stale)
        self._stale.show(warned(stale))
        self._solves_first.visible = self._old_list.visible = self._fields_changed
        self._preview.refresh(snapshot)
        if not self._preview.shown and not self._branches.as_ghosts:
            self._mark.hide()

    @property
    def _fields_changed(self) -> bool:
        """Whether the fields are not those that the result shown was solved for."""
        return self._answer is not None and self._form.texts != self._answered

    def _out_of_date(self, snapshot: Snapshot) -> str:
        """Why the result shown is not that of the present fields and pose; empty where it is."""
        found = self._answer
        if found is None:
            return ""
        if self._fields_changed:
            return "The fields have changed since: press Solve."
        moved = float(np.abs(found.table.start - snapshot.q_command).max()) > _MOVED
        if moved and self._criterion.value == "least-travel":
            return "The arm has moved since, and least travel depends on it: press Solve."
        return ""

    async def _on_fill(self) -> None:
        self._form.fill_tool(self._session.snapshot.q_command)

    async def _on_solve(self) -> None:
        self._form.watch.show_held()  # nothing moves, so a lost digit only has to be seen
        await self._update()

    async def _on_nearest(self) -> None:
        found = self._answer
        if found is not None and found.solutions.nearest_m is not None:
            self._form.fill(found.solutions.nearest_m)
            await self._update()

    async def _on_criterion(self) -> None:
        criterion = checked_criterion(self._criterion.value)
        self._criterion_note.show(muted(CRITERION_TEXT[criterion]))
        found = self._answer
        if found is None:
            return
        self._asked += 1
        asked, start = self._asked, self._session.snapshot.q_command
        again = await asyncio.to_thread(answer, self._robot, found.solutions, criterion, start)
        if asked == self._asked:
            self._show(again)

    async def _on_drag(self) -> None:
        """Solve while the target is dragged: one at a time, always the newest place."""
        self._drag_pending = True
        if self._dragging:
            return
        self._dragging = True
        try:
            while self._drag_pending:
                self._drag_pending = False
                await self._update()
                await asyncio.sleep(_DRAG_PAUSE_S)
        finally:
            self._dragging = False

    async def _update(self) -> None:
        """Solve what the fields hold and show it, unless something newer was asked for meanwhile."""
        target, texts = self._form.target(), self._form.texts
        self._asked += 1
        asked, start = self._asked, self._session.snapshot.q_command
        found = await asyncio.to_thread(solve, self._robot, target, self._criterion.value, start)
        if asked == self._asked:
            self._answered = texts
            self._show(found)

    def _show(self, found: Answer) -> None:
        self._answer = found
        self._stale.visible = False
        self._result.show(answer_html(self._robot, found))
        self._nearest.visible = not found.solutions.success and found.solutions.nearest_m is not None
        self._pager.reset(len(found.table), 1 if found.solutions.success else None)
        self._draw_list()
        self._draw_curve(found)
        self._branches.show(found)
        self._mark.show(found.solutions.target.position)
        self._show_ghost()

    def _show_ghost(self) -> None:
        """The one of least energy, else the nearest; none beside the ghosts of all branches."""
        found = self._answer
        shown = None
        if found is not None and not self._branches.as_ghosts:
            shown = found.best if found.solutions.success else found.solutions.nearest_q
        if shown is None:
            self._preview.hide()
        else:
            self._preview.show(shown, self._session.snapshot.q_command)

    def _draw_curve(self, found: Answer) -> None:
        if found.curve is None:
            self._curve_note.show(muted(no_curve(found)))
            self._curve.clear()
            return
        self._curve_note.show(muted("Every solution as the free joint turns; drag across the plot to zoom."))
        self._curve.show(found.curve)

    def _draw_list(self) -> None:
        found = self._answer
        if found is None or not len(found.table):
            self._list.show(muted("There is no solution."))
            self._selected.show("")
            return
        page, row = self._pager.page, self._pager.row
        count = f"{len(found.table)} solution{'' if len(found.table) == 1 else 's'}"
        where = f"page {page + 1} of {self._pager.pages} · {count}, least energy first"
        self._list.show(muted(where) + found.table.html(page, row))
        if row is None:
            self._selected.show(muted(f"No row is selected: type a row from 1 to {len(found.table)}."))
            return
        angles = numbers(np.degrees(found.table.q(row)).tolist(), 2)
        self._selected.show(f"<div>selected row {row}: will go to θ = (<b>{angles}</b>)°</div>")

    def _on_row(self) -> None:
        self._draw_list()
        found, row = self._answer, self._pager.row
        if self._branches.as_ghosts or found is None or row is None:
            return
        if found.solutions.success:
            self._preview.show(found.table.q(row), self._session.snapshot.q_command)

    async def _on_go_least(self) -> None:
        self._form.watch.require_settled()
        profile, duration = self._movement.checked()
        target, criterion = self._form.target(), self._criterion.value
        if self._answer is None or self._out_of_date(self._session.snapshot):
            await self._update()
            if self._answer is not None and self._answer.best is None:
                raise UnreachableError(self._answer.why_not)
        await self._session.submit(MoveTo(target, criterion, duration, profile))

    async def _on_go_selected(self) -> None:
        self._form.watch.require_settled()
        found, row = self._answer, self._pager.row
        if found is None:
            raise InputError("there is nothing to go to: press Solve first")
        if not found.solutions.success:
            raise UnreachableError(found.why_not)
        if self._fields_changed:
            raise InputError("the fields have changed since the list was made: press Solve first")
        if row is None:
            raise InputError(f"no row is selected: type a row from 1 to {len(found.table)}")
        profile, duration = self._movement.checked()
        await self._session.submit(MoveJoints(found.table.q(row), duration, profile))
