"""Inverse: a point in, all joint angles that reach it out; choose one, or let the program choose."""

from __future__ import annotations

import asyncio
from html import escape

import numpy as np
import viser

from armctl.errors import ArmctlError, InputError, UnreachableError
from armctl.facts import Need, Reason, State
from armctl.kinematics import CRITERION_TEXT, FROM_START, checked_criterion
from armctl.protocol import Snapshot
from armctl.ui.events import Newest, OneAtATime
from armctl.ui.next_line import Told
from armctl.ui.next_pose import End, Movement, PoseWriter
from armctl.ui.scene.ghost import NEAREST, Preview
from armctl.ui.session import Session
from armctl.ui.tabs.inverse.answer import RankedSolutions, Way, answer, counted, solve
from armctl.ui.tabs.inverse.answer_html import count_html, details_html, notice_html, ways_html
from armctl.ui.tabs.inverse.branches import TAB, BranchView
from armctl.ui.tabs.inverse.curve import EnergyCurveView
from armctl.ui.tabs.inverse.solution_list import SolutionList
from armctl.ui.tabs.inverse.target_form import TargetForm
from armctl.ui.widgets.html import LiveHtml, fixed, muted, refused, sentence, warned
from armctl.ui.widgets.number_field import button_pairs, field_grid
from armctl.ui.widgets.profile_choice import MOVEMENTS, ProfileChoice

_CHANGED = "The fields have changed: press Solve. Go by least energy solves them first."
_MOVED_SINCE = "The arm has moved since: Go by least energy solves anew first."
_JUDGED_BEFORE = "The arm has moved since: press Solve to judge the ways anew."
_WAYS, _LINE = "ways", "ways-line"
_WAY, _GO_SELECTED = "way in Inverse", "Go by the selected one"
"""whose pose it is; among what a page has done, that the arm has come to one"""
_MARK_COLOR = (214, 51, 108)
_MOVED = 1e-4
_LAST = 1e9
"""the order of what stands at the end of a tab"""
_DRAG_PAUSE_S = 0.1


class InverseScreen:
    """Target, solutions, energy curve, and two ways to go: to the very configuration that is shown."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._writer = PoseWriter(session, _WAY, self._how, self._on_end, self._settled)
        self._looked_at = Preview(session.ghost, TAB, "target")
        scene = session.client.scene
        self._mark = scene.add_icosphere("/inverse_mark", 0.006, color=_MARK_COLOR, visible=False)
        self._answer: RankedSolutions | None = None
        self._answered: tuple[str | None, ...] = ()
        self._number, self._ghost_is_old, self._marked = 0, False, False  # the number of the answer
        self._newest, self._one_at_a_time = Newest(), asyncio.Lock()
        self._judging = OneAtATime(self._judge_selected)
        gui = session.gui
        rare = None
        if self._robot.orients_tool:  # below all others, so that its ways are in view
            with gui.add_folder("Quaternion and target", order=_LAST, expand_by_default=False):
                rare = field_grid(gui)
                session.on(rare.on_submit, self._on_solve)
        with field_grid(gui) as entered:  # Enter in a field is Solve
            self._form = TargetForm(session, OneAtATime(self._solve_dragged).run, rare)
        with button_pairs(gui):  # all buttons stand above the answer: it moves none of them
            self._solve = gui.add_button("Solve", icon=viser.Icon.TARGET)
            fill = gui.add_button("present position", color="gray")
            go_least = gui.add_button("Go by least energy", icon=viser.Icon.PLAYER_PLAY, color="gray")
            go_selected = gui.add_button(_GO_SELECTED, icon=viser.Icon.PLAYER_PLAY, color="gray")
            self._offers = (  # why is told in the line below
                session.needs(Need.HOLDING, go_selected, also=self._not_selected, told=False),
                session.needs(Need.HOLDING, go_least, also=self._no_least, told=False),
            )
        session.parts.add(gui, _LINE)
        session.parts.show(_LINE, _line_of(""))
        self._notice = LiveHtml(gui, visible=False)
        self._nearest = gui.add_button("Take nearest point", visible=False)
        session.parts.add(gui, _WAYS)
        self._curve = EnergyCurveView(session, self._select)
        self._all = gui.add_folder("Solutions", expand_by_default=False, visible=False)
        with self._all:
            self._curve.add_slider()
            self._list = SolutionList(session, self._on_row)
            self._pager = self._list.pager
            self._form.watch.watch(self._pager.attach_row_edit)
            self._details = LiveHtml(gui)
        self._of_branches = gui.add_folder("Branches", expand_by_default=False, visible=False)
        with self._of_branches:
            self._branches = BranchView(session, self._show_ghost)
        own_first = sorted(self._robot.energy.criteria, key=lambda one: one != self._robot.criterion)
        with gui.add_folder("Criterion and movement"):
            self._criterion = gui.add_dropdown("Least energy is", own_first)
            self._movement = ProfileChoice(gui, session.on, MOVEMENTS)
            self._criterion_note = LiveHtml(gui, muted(_criterion_text(own_first[0])))
        session.on(fill.on_click, self._on_fill)
        session.on(self._solve.on_click, self._on_solve)
        session.on(entered.on_submit, self._on_solve)
        session.on_part("way", self._on_way)
        session.on_part("look-way", self._on_look)
        session.on(self._nearest.on_click, self._on_nearest)
        session.on(self._criterion.on_update, self._on_criterion)
        session.on(self._movement.choice.on_update, self._choose_again)
        session.on(go_least.on_click, self._on_go_least)
        session.on(go_selected.on_click, self._on_go_selected)

    def refresh(self, snapshot: Snapshot) -> None:
        """Tell when the result is out of date."""
        if snapshot.state is not State.MOVING:  # a field that changes all the time cannot be typed into
            self._form.following.follow(self._session.next.shown(snapshot.q_command))
        self._branches.refresh()
        fresh = self._answered and not self._out_of_date(snapshot)
        self._solve.color = "gray" if fresh else None  # what to do is below then
        self._session.parts.show(_LINE, _line_of(self._line_html(snapshot)))
        if self._fields_changed is not self._ghost_is_old:
            self._ghost_is_old = self._fields_changed
            if self._ghost_is_old:
                self._writer.hide()  # neither button goes there before it has solved
                self._looked_at.hide()
            elif not self._writer.taken:
                self._show_selected()
        self._looked_at.refresh(snapshot.q_command)
        if not (self._writer.shown or self._looked_at.shown or self._branches.as_ghosts):
            self._marked = False
        self._mark.visible = self._marked and snapshot.program is None  # its ghost is away meanwhile

    def _how(self) -> Movement:
        return self._movement.checked()

    def _on_end(self, why: End) -> None:
        if why == "arrived":
            self._session.obeyed.add(_GO_SELECTED)  # Go in the line has done what that does

    def _settled(self) -> None:
        self._form.watch.require_settled()

    def _on_fill(self) -> None:
        self._session.next.clear()
        self._form.following.resume()
        self._form.following.follow(self._session.snapshot.q_command)

    def _line_html(self, snapshot: Snapshot) -> str:
        """That the answer is out of date, or why no button goes; else how many ways there are."""
        stale = self._out_of_date(snapshot) or self._judged_before(snapshot)
        if stale:
            return warned(stale)
        why = next((offer.why for offer in self._offers if offer.why is not None), None)
        unmet = self._answer is not None and not self._answer.solutions.success  # told below
        if why is not None and not unmet:
            return escape(sentence(why))
        return "" if self._answer is None or not self._answered else count_html(self._answer)

    @property
    def _fields_changed(self) -> bool:
        return self._answer is not None and self._form.texts != self._answered

    def _out_of_date(self, snapshot: Snapshot) -> str:
        """Why the result shown is not that of the present fields and pose; empty where it is."""
        found = self._answer
        if found is None:
            return ""
        if self._fields_changed:
            return _CHANGED
        moved = float(np.abs(found.start - snapshot.q_command).max()) > _MOVED
        return _MOVED_SINCE if moved and self._criterion.value in FROM_START else ""

    def _judged_before(self, snapshot: Snapshot) -> str:
        """That what is refused is told of ways from another pose; empty: it is not."""
        found = self._answer
        if found is None or not found.ways.refuse_some:
            return ""
        if np.abs(found.start - snapshot.q_command).max() <= _MOVED:
            return ""
        return _JUDGED_BEFORE

    async def _on_solve(self) -> None:
        self._form.watch.show_held()  # nothing moves, so a lost digit only has to be seen
        await self._update()

    async def _on_nearest(self) -> None:
        if self._answer is not None and self._answer.solutions.nearest_m is not None:
            self._form.following.edit()
            self._form.point.put(self._answer.solutions.nearest_m)
            await self._update()

    async def _on_criterion(self) -> None:
        self._criterion_note.show(muted(_criterion_text(self._criterion.value)))
        await self._choose_again()

    async def _choose_again(self) -> None:
        found = self._answer
        if found is None or not self._answered:
            return
        is_newest, start = self._newest.begin(), self._session.snapshot.q_command
        criterion, profile = self._criterion.value, self._movement.profile
        held = self._session.held
        self._writer.begin()
        async with self._one_at_a_time, self._session.console.precedence.turn():
            if not is_newest():
                return
            again = await self._session.work_out(answer, held, found.solutions, criterion, start, profile)
        if is_newest():
            row = self._pager.row if np.array_equal(again.order, found.order) else None
            self._show(again)
            if row is not None and not self._writer.overtaken:
                self._select(row)

    async def _solve_dragged(self) -> None:
        await self._update()
        await asyncio.sleep(_DRAG_PAUSE_S)

    async def _update(self) -> RankedSolutions | None:
        """Solve what the fields hold and show it; None if something newer was asked for meanwhile."""
        is_newest, start = self._newest.begin(), self._session.snapshot.q_command
        self._form.following.follow(self._session.next.shown(start))
        self._form.following.edit()  # the answer is that of these fields
        try:
            target, texts = self._form.target(), self._form.texts
        except ArmctlError as refusal:
            self._forget(refusal)
            raise
        criterion, profile, held = self._criterion.value, self._movement.profile, self._session.held
        self._writer.begin()
        async with self._one_at_a_time, self._session.console.precedence.turn():
            if not is_newest():
                return None
            found = await self._session.work_out(solve, held, target, criterion, start, profile)
        if not is_newest():
            return None
        self._answered = texts
        self._show(found)
        return found

    async def _on_go_least(self) -> None:
        self._form.watch.require_settled()
        self._movement.checked()
        found = self._present_answer(self._session.snapshot)
        if found is None:
            found = await self._update()
            if found is None or self._writer.overtaken:
                what = "target" if found is None else "next pose"
                raise InputError(f"the {what} was changed while it was solved; look at it, then press again")
        if found.next is None or found.why_not:
            raise UnreachableError(found.why_not or "there is no solution")
        await self._writer.go(found.next)

    async def _on_go_selected(self) -> None:
        self._form.watch.require_settled()
        why = self._not_selected(self._session.snapshot)
        if why is not None:
            raise UnreachableError(why)
        found, row = self._answer, self._pager.row
        if found is None or row is None:  # then there was a reason
            return
        self._movement.checked()
        self._on_row()
        await self._writer.go(found.q(row))

    def _present_answer(self, snapshot: Snapshot) -> RankedSolutions | None:
        """The answer for the present fields, criterion and pose; None: it has to be solved first."""
        found = self._answer
        stale = found is None or self._out_of_date(snapshot) or found.criterion != self._criterion.value
        return None if stale else found

    def _no_least(self, snapshot: Snapshot) -> Reason | None:
        """Why there is no configuration of least energy to go to, as far as it is known."""
        found = self._present_answer(snapshot)
        return None if found is None else found.why_not

    def _not_selected(self, snapshot: Snapshot) -> str | None:
        """Why the selected row cannot be gone to, apart from the state of the arm; None: it can."""
        del snapshot
        found = self._answer
        if found is None:
            return "nothing is solved yet; press Solve first"
        if not found.solutions.success:
            return "there is no solution; the reason stands below"
        if self._fields_changed:
            return "the fields have changed since the list was made; press Solve first"
        if self._pager.row is None:
            return f"no row is selected; type a row from 1 to {len(found.solutions)}"
        return None

    def _select(self, row: int) -> None:
        """Select a row for the operator, wherever it was chosen."""
        self._pager.select(row)
        self._on_row()

    def _way(self, key: str) -> Way | None:
        """The way of the present answer with this key; a click on one before it comes too late."""
        ways = () if self._answer is None or not self._answered else self._answer.choices
        return next((way for i, way in enumerate(ways) if key == f"{self._number}.{i}"), None)

    def _on_way(self, key: str) -> None:
        """Choose a way."""
        way = self._way(key)
        if way is not None and way.row is not None:
            self._looked_at.hide()
            self._select(way.row)

    def _on_look(self, key: str) -> None:
        """Look at a way; empty: no more."""
        way = self._way(key)
        if way is None:
            self._looked_at.hide()
        else:
            self._looked_at.show(way.q, self._session.next.shown(self._session.snapshot.q_command))

    def _forget(self, refusal: ArmctlError) -> None:
        """What the fields hold cannot be solved: no answer of others stays beside them."""
        self._answered = ()
        self._nearest.visible = self._mark.visible = self._marked = False
        self._all.visible = self._of_branches.visible = False
        self._tell(refused(f"{refusal}."))
        self._list.reset(None)
        self._curve.forget()
        self._branches.forget()
        self._session.parts.show(_WAYS, "")
        self._writer.hide()
        self._looked_at.hide()

    def _show(self, found: RankedSolutions) -> None:
        solutions = found.solutions
        self._answer, self._ghost_is_old = found, False
        self._number += 1
        self._tell(notice_html(self._robot, found))
        self._all.visible = solutions.success
        self._all.label = f"{counted(len(solutions))} inside the limits"
        self._details.show(details_html(self._robot, found))
        self._nearest.visible = solutions.nearest_away_m > 0.0
        self._list.reset(found)
        self._draw_list(found)
        self._of_branches.visible = solutions.success or bool(found.verdicts)
        self._branches.show(found)
        self._mark.position = solutions.target.position
        self._mark.visible = self._marked = True
        if not self._writer.overtaken:
            self._show_ghost()
        self._curve.show(found, self._pager.row)

    def _tell(self, notice: str) -> None:
        """What the ways below do not tell; mostly nothing."""
        self._notice.show(notice)
        self._notice.visible = bool(notice)

    def _show_ghost(self) -> None:
        """Where *Go by least energy* goes is the next pose; what only comes nearest is looked at."""
        found = self._answer
        goal = None if found is None or found.why_not else found.next
        if goal is None:
            self._writer.hide(None if found is None else _why_none(found))
        else:
            self._writer.show(goal)
        nearest = None if found is None or goal is not None else found.solutions.nearest_q
        if found is not None and goal is None and found.solutions.success:
            nearest = found.best
        if nearest is None or self._branches.as_ghosts:
            self._looked_at.hide()
        else:
            label = None if found is None or found.solutions.success else NEAREST
            self._looked_at.show(nearest, self._session.snapshot.q_command, label)

    def _show_selected(self) -> None:
        """The selected row is the next pose; of the first one and of none, that of least energy."""
        found, row = self._answer, self._pager.row
        exact = row == 1 and found is not None and found.instead is None  # it may lie between two rows
        if found is None or row is None or exact or not found.solutions.success:
            self._show_ghost()
        else:
            self._writer.show(found.q(row))

    def _draw_list(self, found: RankedSolutions) -> None:
        """The cards and the list; whether the arm may go to the selected row is told once it is known."""
        row = self._pager.row
        self._session.parts.show(_WAYS, ways_html(found, row, self._number))
        self._list.draw()
        if row is not None and found.solutions.success and found.ways.known(found.q(row)) is None:
            self._session.spawn(self._judging.run())

    async def _judge_selected(self) -> None:
        """Judge the way to the selected row, from where the arm stood when it was solved."""
        found, row = self._answer, self._pager.row
        if found is None or row is None or not found.solutions.success:
            return
        await asyncio.to_thread(found.ways.refused, found.q(row))
        if found is self._answer and row == self._pager.row:
            self._list.draw()

    def _on_row(self) -> None:
        found, row = self._answer, self._pager.row
        if found is None:
            return
        self._draw_list(found)
        self._curve.mark(row)
        if row is not None and found.solutions.success:
            self._writer.show(found.q(row))


def _criterion_text(criterion: str) -> str:
    return f"Least energy is the {CRITERION_TEXT[checked_criterion(criterion)]}."


def _line_of(content: str) -> str:
    """As high whatever it says: what lies below it stays in its place."""
    return f"<div class=armctl-count>{content}</div>"


def _why_none(found: RankedSolutions) -> Told:
    """What the line under the scene says where the arm does not go to what was solved."""
    away = 1000 * found.solutions.nearest_away_m
    if away > 0.0:
        return Told("Out of reach", f"nearest point: {fixed(away, 1)} mm away; see Inverse", bad=True)
    return Told("The arm cannot go there", "Inverse says why", bad=True)
