"""The program as a list to play on: each step a row, chosen, edited, moved and watched there.

It is a part of the page (``ui/guard/parts.py``), whose rows travel by key, so that it may be long. It stands
in any container that is 250 px wide or more.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Sequence
from functools import partial
from html import escape

import msgspec

from armctl.facts import State
from armctl.motion.preflight import Finding
from armctl.program import Program, Step
from armctl.program.edit import Change, delete, duplicate, move, move_before, places_of, point_in, replace
from armctl.protocol import ProgramProgress, Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.new_step import (
    CELL_GROUP,
    cell_kinds,
    present_pose_deg,
    recorded_kinds,
    tool_point_mm,
)
from armctl.ui.tabs.manual.program_ahead import ProgramAhead
from armctl.ui.tabs.manual.program_editor import EDIT_WAITS, ProgramEditor
from armctl.ui.tabs.manual.program_row import PARTS, PLAIN, RowState, icon_of, row_html
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.step_form import KnownNames, StepEdit, texts_of
from armctl.ui.widgets import html
from armctl.ui.widgets.html import fixed, with_minus

PART = "program"
"""the part, and the list in it"""
_LONG = 20
"""rows, from which on the list has its greatest height"""
_ADD = "Add step"
SAMPLE = "Load a sample"
_EMPTY = """<p>No steps yet. Bring the arm somewhere in <b>Manual</b> and press <b>Record pose</b>, again and
again; then press <b>Run once</b>.</p>"""
_KEYS = (
    "Enter:step-edit Delete:step-delete Alt+ArrowUp:step-up Alt+ArrowDown:step-down Ctrl+d:step-copy "
    "Ctrl+z:step-undo Ctrl+y:step-redo Ctrl+Shift+z:step-redo"
)


class ProgramList:
    """The list on one page, in the present container."""

    def __init__(
        self,
        session: Session,
        editor: ProgramEditor,
        findings: Callable[[], Sequence[Finding]] = lambda: (),
    ) -> None:
        """``findings``: what is known to be wrong with the program that is on the list."""
        self._session, self._editor, self._findings = session, editor, findings
        self._shared = session.console.shared(SharedProgram)
        self._ahead = session.console.shared(ProgramAhead)
        self._edit: StepEdit | None = None
        self._adding = False
        """the menu of new steps is open"""
        self._kinds = recorded_kinds(session.console.robot)
        self._cell_kinds = cell_kinds(session.console.robot)
        self._plain: dict[str, tuple[Step, int, str, str]] = {}
        """rows as they are where nothing is said of them, by key: step, depth, what it is of, HTML"""
        self._lasts: dict[str, str] = {}
        """how long each step takes, by key, as far as that is known"""
        self._version = -1
        self._states: dict[str, RowState] = {}
        """of the rows that are not plain, as drawn"""
        self._view, self._viewed = "", ("", "")
        self._again = 0
        """how often a row was to come into view that was meant to be there already"""
        self._ran = False
        """a program ran at the last look, be it this one or an earlier version of it"""
        self._found: Sequence[Finding] = ()
        """findings whose first error has come into view"""
        session.parts.add(session.gui, PART)
        for do, action in self._actions().items():
            session.on_part(do, partial(self._then_draw, action))
        session.on_part_value("step-set", partial(self._then_draw, self._on_set))
        session.on_part_value("step-move", partial(self._then_draw, self._on_move))

    def _actions(self) -> dict[str, Callable[[str], Awaitable[object] | None]]:
        change, editor = self._change, self._editor
        return {
            "step": self._on_select,
            "step-edit": self._on_edit,
            "step-more": self._on_more,
            "step-done": self._on_done,
            "step-discard": lambda _: self._close(),
            "step-up": partial(change, lambda program, row: move(program, row, -1)),
            "step-down": partial(change, lambda program, row: move(program, row, 1)),
            "step-copy": partial(change, duplicate),
            "step-delete": partial(change, delete),
            "step-menu": lambda _: self._show_menu(not self._adding),
            "step-leave": lambda _: self._show_menu(False),
            "step-add": self._on_add,
            "step-touch": self._on_touch,
            "step-undo": lambda _: editor.undo(),
            "step-redo": lambda _: editor.undo(redo=True),
        }

    async def _then_draw(self, action: Callable[..., Awaitable[object] | None], *given: str) -> None:
        """Do something, and show it at once: whoever types goes on in what the row shows then."""
        try:
            if (work := action(*given)) is not None:
                await work
        finally:
            if not self._session.closed:
                self.refresh(self._session.snapshot)

    # What is done with rows. A key that has gone is a click that came too late.

    async def _change(self, change: Callable[[Program, int], Change], key: str) -> None:
        self._session.require_operator()
        row = self._shared.row(key)
        if row is not None:
            self._editor.select(row)
            await self._editor.change(lambda program: change(program, row))

    def _on_select(self, key: str) -> None:
        row = self._shared.row(key)
        if row is None:
            return
        self._editor.choose(row)
        if self._edit is not None and self._edit.key != key and not self._edit.refusals:
            self._close()

    def _on_edit(self, key: str) -> None:
        self._session.require_operator()
        row = self._shared.row(key)
        if row is not None:
            self._editor.select(row)
            self._open(key)

    def _open(self, key: str) -> None:
        """Open the fields of a row, unless one that is refused is open."""
        if self._edit is None or (self._edit.key != key and not self._edit.refusals):
            self._edit = StepEdit(key)

    def _show_menu(self, adding: bool) -> None:
        self._adding = adding

    async def _on_add(self, key: str) -> None:
        """Put a step of a kind on the list, and open its fields."""
        group, _, label = key.partition(".")
        cell = group == CELL_GROUP
        kind = (self._cell_kinds if cell else self._kinds.get(group, {})).get(label)
        if kind is not None:
            self._show_menu(False)
            before = set(self._shared.keys)
            await self._editor.add_kind(kind, cell=cell)
            replaced = self._shared.keys[self._editor.selected]
            self._open(next((key for key in self._shared.keys if key not in before), replaced))

    async def _on_touch(self, key: str) -> None:
        """Put the place of the tool into a field."""
        row, label = self._field(key)
        if row is None:
            return
        session, robot = self._session, self._session.arm
        session.require_operator()
        tip = tool_point_mm(robot, present_pose_deg(robot, session.snapshot))
        step = self._shared.program.steps[row]
        places = dict(zip(places_of(step)[label], point_in(self._shared.program, row, tip), strict=True))
        await self._editor.change(
            lambda program: replace(program, row, msgspec.structs.replace(step, **places))
        )

    def _field(self, key: str) -> tuple[int | None, str]:
        """Row and label of a field of the row that is edited; None: it is there no more."""
        key, _, number = key.partition(".")
        row, edit = self._shared.row(key), self._edit
        if row is None or edit is None or edit.key != key or not number.isdecimal():
            return None, ""
        labels = [*texts_of(self._shared.program.steps[row], self._session.console.robot)]
        return (row, labels[int(number)]) if int(number) < len(labels) else (None, "")

    def _on_more(self, key: str) -> None:
        """Unfold what is seldom needed of the row that is edited, or fold it."""
        row, edit = self._shared.row(key), self._edit
        if row is not None and edit is not None and edit.key == key:
            edit.more = not edit.unfolded(self._shared.program.steps[row])

    def _on_done(self, key: str) -> None:
        edit = self._edit
        if edit is not None and edit.key == key.partition(".")[0] and not edit.refusals:
            self._close()
            self._again += 1  # its head may have been scrolled away

    def _close(self) -> None:
        self._edit = None

    async def _on_set(self, key: str, text: str) -> None:
        """Take what is typed into a field; ``key``: row and number, and of one with parts ``:part``."""
        whole, _, part = key.partition(":")
        (row, label), edit = self._field(whole), self._edit
        if row is None or edit is None:
            return
        edit.answers += 1  # the field shows what counts, also where the change is refused
        self._session.require_operator()
        step = self._shared.program.steps[row]
        if part:
            taken = edit.take_part(step, label, part, text, self._session.console.robot)
        else:
            taken = edit.take(step, label, text)
        if taken != step:
            await self._editor.change(lambda program: replace(program, row, taken))

    async def _on_move(self, key: str, before: str) -> None:
        row, at = self._shared.row(key), self._shared.row(before)
        if row is None or (at is None and before):
            return
        to = len(self._shared.keys) if at is None else at
        if to not in (row, row + 1):
            await self._change(lambda program, row: move_before(program, row, to), key)

    # What is shown.

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw what has changed."""
        session, shared, editor = self._session, self._shared, self._editor
        may = session.why_not(None, snapshot) is None
        if (edit := self._edit) is not None:
            begins = not self._ran and self._ahead.underway(snapshot) is not None
            if not may or shared.row(edit.key) is None or (begins and not edit.refusals):
                self._close()
        self._ran = snapshot.program is not None
        editor.select(editor.selected)
        states = self._row_states(snapshot, may=may)
        selected = shared.keys[editor.selected] if shared.keys else ""
        running = next((key for key, state in states.items() if state.done is not None), "")
        if self._viewed != (selected, running):
            self._view = running if running and running != self._viewed[1] else selected
            self._viewed = (selected, running)
        self._view_wrong(running=bool(running))
        session.parts.show(PART, self._html(snapshot, running=bool(running), may=may))
        edited, timed = self._version != shared.version, self._lasts is not self._ahead.lasts
        if timed:
            self._lasts, self._plain = self._ahead.lasts, {}
        if edited:
            self._version = shared.version
            editor.follow()
        if edited or timed:
            session.parts.rows(PART, self._all_rows(states))
        else:
            for key in states.keys() | self._states.keys():
                if states.get(key) != self._states.get(key):
                    row = shared.row(key)
                    if row is not None:
                        session.parts.row(PART, key, self._row(key, row, states.get(key, PLAIN)))
        self._states = states

    def _view_wrong(self, *, running: bool) -> None:
        """Once a check has found errors, the first of their rows comes into view."""
        found, keys = self._findings(), self._shared.keys
        if found is not self._found:
            self._found = found
            wrong = sorted(row for row, (severity, _) in _by_step(found).items() if severity == "error")
            if wrong and wrong[0] < len(keys) and not running:
                self._view = keys[wrong[0]]
                self._again += 1

    def _row_states(self, snapshot: Snapshot, *, may: bool) -> dict[str, RowState]:
        """Of the rows that are not plain, by key."""
        shared, keys, editor = self._shared, self._shared.keys, self._editor
        steps = shared.program.steps
        said = _by_step(self._findings())
        if editor.leads_nowhere and (at := shared.row(editor.asked)) is not None:
            said.setdefault(at, ("error", editor.leads_nowhere))
        running = self._ahead.underway(snapshot)
        edit = self._edit
        rows = {row for row in said if row < len(steps)}
        rows |= {self._editor.selected} if steps else set()
        rows |= set() if running is None else {running.step}
        rows |= set() if edit is None or (row := shared.row(edit.key)) is None else {row}
        states: dict[str, RowState] = {}
        for row in rows:
            selected, (severity, finding) = row == self._editor.selected, said.get(row, ("", ""))
            done = int(PARTS * running.share) if running is not None and running.step == row else None
            fields = ""
            if edit is not None and edit.key == keys[row]:
                names = KnownNames(shared.callable, tuple(shared.program.frames), shared.drawings)
                fields = edit.html(steps[row], self._session.console.robot, names)
            inside = snapshot.program.inside if done is not None and snapshot.program is not None else ""
            states[keys[row]] = RowState(selected, selected and may, done, severity, finding, fields, inside)
        return states

    def _all_rows(self, states: dict[str, RowState]) -> Iterable[tuple[str, str]]:
        before, self._plain = self._plain, {}
        shared = self._shared
        for row, (key, step) in enumerate(zip(shared.keys, shared.program.steps, strict=True)):
            plain = before.get(key)
            now = shared.blocks.depths[row], self._of(row)
            if plain is not None and plain[0] is step and plain[1:3] == now:
                self._plain[key] = plain
            yield key, self._row(key, row, states.get(key, PLAIN))

    def _row(self, key: str, row: int, state: RowState) -> str:
        step, depth = self._shared.program.steps[row], self._shared.blocks.depths[row]
        of, lasts = self._of(row), self._lasts.get(key, "")
        if state is not PLAIN:
            return row_html(key, row, step, depth, state, of, lasts)
        if key not in self._plain:
            self._plain[key] = step, depth, of, row_html(key, row, step, depth, state, of, lasts)
        return self._plain[key][3]

    def _of(self, row: int) -> str:
        """What an ``end`` or an ``else`` is of, in words; of other steps empty."""
        steps, blocks = self._shared.program.steps, self._shared.blocks
        if not (steps[row].closes or steps[row].divides):
            return ""
        begin = steps[blocks.whole(row)[0]]
        return f"of {begin.title} {begin.describe()}"

    def _html(self, snapshot: Snapshot, *, running: bool, may: bool) -> str:
        head = f"<div class=armctl-head>{self._headline(snapshot, running=running)}</div>"
        head += self._menu() if may else ""
        if not self._shared.keys:
            sample = html.button("step-sample", SAMPLE, title="Look at one, and run it") if may else ""
            return f"{head}<div class=armctl-none>{_EMPTY}{sample}</div>"
        does = f" data-twice=step-edit data-moves=step-move data-keys='{_KEYS}'" if may else ""
        does += " data-running" * running + " data-paused" * (snapshot.state is State.PAUSED)
        does += " data-long" * (len(self._shared.keys) > _LONG)
        return (
            f"{head}<div class=armctl-steps role=grid aria-label='Steps of the program' data-rows={PART} "
            f"data-view={self._view} data-again={self._again}{does}></div>"
        )

    def _menu(self) -> str:
        """What puts a new step on the list: all kinds, by group."""
        shown = "true" if self._adding else "false"
        button = f"<button type=button data-do=step-menu aria-expanded={shown}>{_ADD} ▾</button>"
        for name, redo in (("Undo", False), ("Redo", True)):
            why, do = self._shared.no_undo(redo=redo), f"step-{name.lower()}"
            button += html.button(do, "", title=name, why=why, kind="bare", icon=name.lower())
        if not self._adding:
            return f"<div class=armctl-add>{button}</div>"
        here = {CELL_GROUP: self._cell_kinds} if self._editor.adds_in_grid else {}
        offered = here | self._kinds
        groups = "".join(
            f"<div role=group aria-label='{escape(group)}'><small>{escape(group)}</small>"
            + "".join(
                html.button("step-add", label, key=f"{group}.{label}", drawn=icon_of(kind))
                for label, kind in kinds.items()
            )
            + "</div>"
            for group, kinds in offered.items()
        )
        menu = f"<div class=armctl-kinds><div>{groups}</div></div>"
        return f"<div class=armctl-add data-leave=step-leave>{button}{menu}</div>"

    def _headline(self, snapshot: Snapshot, *, running: bool) -> str:
        """Name, and in a line that is always there how long it is, or where it runs."""
        program, progress = self._shared.program, snapshot.program
        count = len(program.steps)
        name = f"<b>{escape(program.name)}</b> · {count} step{'' if count == 1 else 's'}"
        if progress is None:
            return f"{name}{self._summary(snapshot)}"
        of = f"step {progress.step + 1} of {progress.steps}, {pass_words(progress)}"
        of += f": {escape(progress.inside)}" if progress.inside else ""
        if running:
            paused = snapshot.state is State.PAUSED
            kind, does = ("warn", "paused at") if paused else ("runs", "runs")
            return f"{name}<span class={kind}>{does} {of}</span>"
        if self._shared.relation(progress) == "coming":
            return f"{name}<span class=runs>runs {of}; <b>{EDIT_WAITS}</b></span>"
        named = progress.running.name
        other = "version" if named == program.name else f"program, {escape(named)}"
        return f"{name}<span class=warn>Runs another {other}: {of}</span>"

    def _summary(self, snapshot: Snapshot) -> str:
        """What is wrong with it, who has edited it, or how long it takes."""
        wrong = sum(finding.severity == "error" for finding in self._findings())
        if wrong := wrong or int(bool(self._editor.leads_nowhere)):
            return f"<span class=bad>{'1 step' if wrong == 1 else f'{wrong} steps'} cannot run</span>"
        edit, found = self._shared.last_edit, self._ahead.rehearsal
        known = found is not None and self._shared.keys and not self._ahead.note
        lasts = f"{fixed(found.duration / snapshot.speed, 1)} s a pass" if found is not None and known else ""
        if edit is not None and edit.by.id != self._session.me:
            lasts = f"{escape(edit.by.name)} edited row {edit.row + 1}{' · ' * bool(lasts)}{lasts}"
            return f"<span role=status title='{lasts}'>{lasts}</span>"
        return f"<span>{lasts or html.EMPTY_LINE}</span>"


def pass_words(at: ProgramProgress) -> str:
    """Which pass of a program runs."""
    return f"pass {at.loop + 1} of {'∞' if at.loops is None else at.loops}"


_ROOM = 22
"""letters that the line has room for behind "Step 12 of 14:" in a small window"""


def short_words(step: Step) -> str:
    """What a step does; of one that takes more room than the line has its kind."""
    kind = f"{step.title[:1].upper()}{step.title[1:]}"
    words = f"{kind} {with_minus(step.describe())}".rstrip()
    return words if len(words) <= _ROOM else kind


def _by_step(findings: Sequence[Finding]) -> dict[int, tuple[str, str]]:
    """Severity and words of what is wrong with each step, the worst first."""
    said: dict[int, tuple[str, str]] = {}
    for finding in sorted(findings, key=lambda finding: finding.severity != "error"):
        if finding.step is not None and finding.step not in said:
            part = f"{finding.part}: " if finding.part else ""
            mend = f" → {finding.mend}" if finding.mend else ""
            said[finding.step] = finding.severity, f"{part}{finding.what}{mend}"
    return said
