"""The program as a list of rows by key: what is shown of it, and what is done there."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.ui.page_kit import FakePage

from armctl.errors import ArmctlError, ProgramError
from armctl.facts import Said, State
from armctl.motion import Finding
from armctl.program import (
    CommentStep,
    CountStep,
    ElseStep,
    EndStep,
    GridStep,
    IfStep,
    LineStep,
    MoveStep,
    PlaceStep,
    PointStep,
    Program,
    RepeatStep,
    SetStep,
    Step,
    WaitForStep,
    WaitStep,
    WhileStep,
)
from armctl.program.edit import PLACES
from armctl.protocol import MoveJoints, Party, ProgramProgress
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.program_ahead import ProgramAhead
from armctl.ui.tabs.manual.program_editor import ProgramEditor
from armctl.ui.tabs.manual.program_list import PART, ProgramList, row_html, short_words
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.step_form import texts_of

ROBOT = load_robot("uzuner")


class ListPage(FakePage):
    """A page with the list, which operates unless it ``watches``."""

    me = name = "browser page 1"
    watches = False

    def __init__(self, server: GuardedServer, shared: SharedProgram) -> None:
        super().__init__(server, ROBOT, ROBOT.pose("home"))
        ahead: list[ProgramAhead] = []
        self.console.shared = lambda kind: shared if kind is SharedProgram else ahead[0]
        ahead.append(ProgramAhead(self.console))
        self.snapshot.program = self.snapshot.progress = None
        self.shared = shared
        self.editor = ProgramEditor(self.session)
        self.findings: list[Finding] = []
        self.list = ProgramList(self.session, self.editor, lambda: self.findings)
        self.draw()

    def require_operator(self) -> None:
        if self.watches:
            raise ArmctlError("this page is watching")

    def why_not(self, *_: object) -> str | None:
        return "this page is watching" if self.watches else None

    def draw(self) -> None:
        self.list.refresh(self.session.snapshot)

    def put(self, *steps: Step) -> None:
        self.shared.edit(Program(robot="uzuner", name="test", steps=steps))
        self.draw()

    def do(self, what: str, row: int | str, value: str = "") -> None:
        """Do something with a row, from 0, or with a key."""
        key = row if isinstance(row, str) else self.shared.keys[row]
        self.act(lambda: self.parts.done(what, key, value))

    @property
    def rows(self) -> list[str]:
        shown = self.parts.shown_rows(PART)
        assert list(shown) == list(self.shared.keys)
        return list(shown.values())

    @property
    def seconds(self) -> list[float]:
        return [step.seconds for step in self.shared.program.steps if isinstance(step, WaitStep)]

    def marked(self, mark: str) -> list[int]:
        return [number for number, row in enumerate(self.rows) if mark in row]


@pytest.fixture
def shared(tmp_path: Path) -> SharedProgram:
    return SharedProgram("uzuner", tmp_path)


@pytest.fixture
def page(server: GuardedServer, shared: SharedProgram) -> ListPage:
    return ListPage(server, shared)


def waits(*seconds: float) -> tuple[Step, ...]:
    return tuple(WaitStep(seconds=one) for one in seconds)


def test_a_row_says_its_step_escapes_its_note_and_is_indented_in_a_block(page: ListPage) -> None:
    page.put(
        WaitStep(seconds=1, note="<img src=x onerror='alert(1)'>"), RepeatStep(times=2), *waits(3), EndStep()
    )
    assert "<img" not in "".join(page.rows) and "onerror='" not in "".join(page.rows)
    assert "&lt;img src=x" in page.rows[0]
    assert page.marked("--in:1") == [2] and page.marked("--in") == [2]
    assert [re.findall("<b role=gridcell>(.*?)</b>", row) for row in page.rows] == [
        ["Wait"], ["Repeat"], ["Wait"], ["End"]
    ]  # fmt: skip
    assert "Record pose" not in page.parts[PART]
    page.put()
    assert "Record pose" in page.parts[PART] and "role=grid" not in page.parts[PART]


def test_the_end_of_a_block_says_whose_it_is(page: ListPage) -> None:
    page.put(IfStep(watch="button"), RepeatStep(times=2), *waits(3), EndStep(), ElseStep(), EndStep())
    does = [re.findall("class=does[^>]*>(.*?)</span>", row)[0] for row in page.rows]
    assert does == [
        "button = 1",
        "2 times",
        "3 s",
        "of repeat 2 times",
        "of if button = 1",
        "of if button = 1",
    ]
    page.do("step-delete", 1)
    does = [re.findall("class=does[^>]*>(.*?)</span>", row)[0] for row in page.rows]
    assert does == ["button = 1", "3 s", "of if button = 1", "of if button = 1"]


def add_from_menu(page: ListPage, group: str, label: str) -> None:
    page.do("step-menu", "")
    assert "aria-expanded=true" in page.parts[PART]
    assert f"data-key='{group}.{label}'" in page.parts[PART]
    page.do("step-add", f"{group}.{label}")
    assert "aria-expanded=false" in page.parts[PART]


def test_steps_are_added_from_a_menu_nested_and_opened_to_be_edited(page: ListPage) -> None:
    assert "role=group" not in page.parts[PART]
    add_from_menu(page, "Decide and repeat", "While")
    add_from_menu(page, "Decide and repeat", "If")
    add_from_menu(page, "Wait and tell", "Wait")
    assert page.marked("armctl-fields") == [2] and "data-focus" in page.rows[2]
    page.do("step-set", f"{page.shared.keys[2]}.0", "2.5")
    add_from_menu(page, "Decide and repeat", "Else")
    add_from_menu(page, "Decide and repeat", "Count")
    kinds = [WhileStep, IfStep, WaitStep, ElseStep, CountStep, EndStep, EndStep]
    assert [type(step) for step in page.shared.program.steps] == kinds and page.seconds == [2.5]
    assert [row.count("--in:2") for row in page.rows] == [0, 0, 1, 0, 1, 0, 0]
    with pytest.raises(ProgramError, match="else"):
        add_from_menu(page, "Decide and repeat", "Else")
    page.do("step-undo", "")
    assert CountStep not in map(type, page.shared.program.steps)
    page.do("step-menu", "")
    page.do("step-menu", "")
    assert "aria-expanded=false" in page.parts[PART]
    page.do("step-add", "Program.Sing")  # of another version of the page
    page.watches = True
    page.draw()
    assert "step-menu" not in page.parts[PART]
    with pytest.raises(ArmctlError, match="watching"):
        page.do("step-add", "Wait and tell.Wait")


@pytest.mark.parametrize(
    ("step", "label"),
    [
        (SetStep(output="lamp"), "Set output"),
        (WaitForStep(watch="door", timeout_s=1), "Wait until"),
        (WaitStep(seconds=1), "Wait"),
        (MoveStep(joints_deg=(0, 90, 0, 0, 0)), "Record pose"),
        (CommentStep(), "Comment"),
    ],
)
def test_a_row_calls_a_step_as_the_menu_does(step: Step, label: str) -> None:
    assert type(step).button[1] == label
    named = label.removeprefix("Record ").capitalize()
    assert f"<b role=gridcell>{named}</b>" in row_html("7", 0, step, 0)


def test_the_fields_of_a_new_step_open_wherever_it_goes(page: ListPage) -> None:
    page.put(*waits(1, 2, 3))
    page.do("step", 1)
    page.editor.where = PLACES[1]
    add_from_menu(page, "Wait and tell", "Message")
    assert page.marked("armctl-fields") == page.marked("<b role=gridcell>Message") == [1]
    assert page.editor.selected == 2  # what is put before it keeps its order
    page.do("step-done", page.shared.keys[1])
    page.do("step", 1)
    page.editor.where = PLACES[3]
    add_from_menu(page, "Wait and tell", "Wait")
    assert page.seconds == [1, 1, 2, 3] and page.marked("armctl-fields") == [1]


def test_rows_go_into_the_block_that_is_added(page: ListPage) -> None:
    page.put(*waits(1, 2, 3))
    page.editor.rows_inside = "2-3"
    add_from_menu(page, "Decide and repeat", "Repeat")
    assert page.shared.program.steps == (*waits(1), RepeatStep(times=2), *waits(2, 3), EndStep())


def test_a_place_is_touched_in_its_field(page: ListPage) -> None:
    add_from_menu(page, "Decide and repeat", "Grid")
    page.snapshot.q_command = ROBOT.read((20.0, 90, -80, -40, 0))
    x, y, z = (1000 * ROBOT.forward(page.snapshot.q_command)[:3, 3]).tolist()
    page.do("step-touch", f"{page.shared.keys[0]}.1")
    (grid, _) = page.shared.program.steps
    assert isinstance(grid, GridStep)
    assert (grid.row_x_mm, grid.row_y_mm, grid.row_z_mm) == pytest.approx((x, y, z), abs=1e-3)
    add_from_menu(page, "Pick and place", "Place")
    number = [*texts_of(page.shared.program.steps[1], ROBOT)].index("Frame")
    page.do("step-set", f"{page.shared.keys[1]}.{number}", "cell")
    place = page.shared.program.steps[1]
    assert isinstance(place, PlaceStep) and place.in_cell
    assert place.x_mm == pytest.approx(x - grid.x_mm, abs=2e-3)
    page.do("step-touch", f"{page.shared.keys[1]}.0")
    assert page.shared.program.steps[1] == place
    page.do("step-touch", f"{page.shared.keys[0]}.1")  # of a row that is not edited
    page.do("step-touch", f"{page.shared.keys[1]}.90")


def test_in_a_grid_steps_are_offered_at_its_cells(page: ListPage) -> None:
    page.do("step-menu", "")
    assert "In each cell" not in page.parts[PART]
    page.do("step-menu", "")
    add_from_menu(page, "Decide and repeat", "Grid")
    add_from_menu(page, "In each cell", "Place")
    add_from_menu(page, "In each cell", "Line")
    _, place, line, _ = page.shared.program.steps
    assert place == PlaceStep(x_mm=0, y_mm=0, z_mm=0, frame="cell")
    assert isinstance(line, LineStep) and line.in_cell and line.pitch_deg is None
    page.do("step", 3)
    page.do("step-menu", "")
    assert "In each cell" not in page.parts[PART]  # behind its end


def test_one_row_is_selected_and_the_only_stop_of_the_tab_key(page: ListPage) -> None:
    page.put(*waits(1, 2, 3))
    for row in (2, 0, 1):
        page.do("step", row)
        assert page.marked("aria-selected=true") == page.marked("tabindex=0") == [row]
        assert page.marked("data-do=step-delete") == [row] == [page.editor.selected]


def test_rows_are_moved_copied_deleted_and_all_that_is_taken_back(page: ListPage) -> None:
    page.put(*waits(1, 2, 3, 4))
    page.do("step-down", 0)
    assert (page.seconds, page.editor.selected) == ([2, 1, 3, 4], 1)
    page.do("step-up", 3)
    assert (page.seconds, page.editor.selected) == ([2, 1, 4, 3], 2)
    page.do("step-move", 0, page.shared.keys[3])
    assert (page.seconds, page.editor.selected) == ([1, 4, 2, 3], 2)
    page.do("step-move", 3, page.shared.keys[0])
    assert (page.seconds, page.editor.selected) == ([3, 1, 4, 2], 0)
    page.do("step-move", 0)
    assert (page.seconds, page.editor.selected) == ([1, 4, 2, 3], 3)
    page.do("step-move", 1, page.shared.keys[2])  # it is there already
    page.do("step-move", 1, page.shared.keys[1])
    assert page.seconds == [1, 4, 2, 3]
    page.do("step-copy", 1)
    assert (page.seconds, page.editor.selected) == ([1, 4, 4, 2, 3], 2)
    page.do("step-delete", 3)
    assert (page.seconds, page.editor.selected) == ([1, 4, 4, 3], 3)  # the next row
    page.do("step-delete", 3)
    assert (page.seconds, page.editor.selected) == ([1, 4, 4], 2)  # there is none: the last
    page.do("step-undo", 0)
    page.do("step-undo", 0)
    page.do("step-redo", 0)
    assert page.seconds == [1, 4, 4, 3]
    with pytest.raises(ProgramError, match="the first one already"):
        page.do("step-up", 0)


def test_a_click_that_comes_too_late_does_nothing(page: ListPage) -> None:
    page.put(*waits(1, 2, 3))
    gone = page.shared.keys[1]
    page.do("step-delete", 1)
    for what in ("step", "step-edit", "step-delete", "step-copy", "step-up", "step-move"):
        for key in (gone, "", "nonsense"):
            page.do(what, key, page.shared.keys[0])
    page.do("step-move", 0, gone)
    page.do("step-set", f"{gone}.0", "7")
    assert page.seconds == [1, 3]
    page.do("step-edit", 0)
    first = page.shared.keys[0]
    for key in (f"{first}.99", f"{first}.-1", f"{first}.x", first, ".", ""):
        page.do("step-set", key, "7")
    assert page.seconds == [1, 3]


def test_fields_are_in_the_row_that_is_edited_and_saved_as_typed(page: ListPage) -> None:
    page.put(*waits(1, 2))
    page.do("step-edit", 1)
    key = page.shared.keys[1]
    assert page.marked("data-set") == [1]
    page.do("step-set", f"{key}.0", "12,5")
    page.do("step-set", f"{key}.1", "here")
    assert page.shared.program.steps[1] == WaitStep(seconds=12.5, note="here")
    assert page.shared.keys[1] == key  # its focus stays
    page.do("step-set", f"{key}.0", "−1")
    assert page.seconds == [1, 12.5]
    assert "value='−1'" in page.rows[1] and "Wait time s: must be 0 … 86400" in page.rows[1]
    page.do("step-done", f"{key}.0")
    page.do("step", 0)
    assert page.marked("data-set") == [1]  # it is open until it is mended
    page.do("step-discard", key)
    assert page.marked("data-set") == []
    page.do("step-edit", 1)
    assert "value='12.5'" in page.rows[1]
    page.do("step-done", f"{key}.0")
    assert page.marked("data-set") == []
    page.do("step-edit", 1)
    page.do("step", 0)
    assert page.marked("data-set") == []


def test_one_number_of_a_place_is_saved_and_the_fold_of_a_form_opens_and_closes(page: ListPage) -> None:
    page.put(PointStep(x_mm=200, y_mm=0, z_mm=85))
    page.do("step-edit", 0)
    key = page.shared.keys[0]
    page.do("step-set", f"{key}.0:y_mm", "−12,5")
    assert page.shared.program.steps == (PointStep(x_mm=200, y_mm=-12.5, z_mm=85),)
    page.do("step-set", f"{key}.0", "1, 2, 3")  # as one text, too
    assert page.shared.program.steps == (PointStep(x_mm=1, y_mm=2, z_mm=3),)
    page.do("step-set", f"{key}.0:q_mm", "7")
    page.do("step-set", f"{key}.9:y_mm", "7")
    assert page.shared.program.steps == (PointStep(x_mm=1, y_mm=2, z_mm=3),)
    assert page.marked("Choose by") == []
    page.do("step-more", key)
    assert page.marked("Choose by") == [0]
    page.do("step-more", key)
    page.do("step-more", "nonsense")
    assert page.marked("Choose by") == []


def test_a_field_shows_what_counts_also_where_nothing_has_changed(page: ListPage) -> None:
    """The page has what was typed: only a row that is another one is sent."""
    page.put(*waits(1))
    page.do("step-edit", 0)
    before = page.rows[0]
    page.do("step-set", f"{page.shared.keys[0]}.0", "1.0")
    assert page.rows[0] != before and "value='1'" in page.rows[0]


def test_selection_fields_and_rows_are_those_of_their_step_whatever_others_change(page: ListPage) -> None:
    one, two, three = waits(1, 2, 3)
    page.put(one, two, three)
    page.do("step-edit", 1)
    page.do("step-set", f"{page.shared.keys[1]}.0", "x")
    page.put(*waits(8, 9), three, one, two)
    assert page.marked("aria-selected=true") == page.marked("value='x'") == [4] == [page.editor.selected]
    page.put(three, one)
    assert page.marked("data-set") == [] and page.marked("aria-selected=true") == [1]


def test_who_watches_is_offered_nothing_and_refused_what_is_done_all_the_same(page: ListPage) -> None:
    page.put(*waits(1, 2))
    page.do("step-edit", 0)
    page.watches = True
    with pytest.raises(ArmctlError, match="watching"):  # it was being typed
        page.do("step-set", f"{page.shared.keys[0]}.0", "5")
    page.draw()
    for offered in ("data-moves", "data-keys", "data-twice"):
        assert offered not in page.parts[PART]
    assert page.marked("data-set") == page.marked("data-do=step-") == []
    page.do("step", 1)
    assert page.marked("aria-selected=true") == [1]
    for what in ("step-edit", "step-delete", "step-copy", "step-down"):
        with pytest.raises(ArmctlError, match="watching"):
            page.do(what, 0)
    with pytest.raises(ArmctlError, match="watching"):
        page.do("step-move", 0)
    page.do("step-set", f"{page.shared.keys[0]}.0", "5")
    assert page.seconds == [1, 2]
    page.watches = False
    page.draw()
    assert "data-moves" in page.parts[PART] and page.marked("data-do=step-delete") == [1]


def test_the_head_says_which_other_page_has_edited_which_row(page: ListPage) -> None:
    page.put(*waits(1, 2, 3))
    page.do("step-delete", 2)
    assert "edited" not in page.parts[PART]
    other = Party("browser page 2", "<Ada>")
    page.shared.edit(msgspec.structs.replace(page.shared.program, steps=waits(1, 5)[:1] + waits(6)), other)
    page.draw()
    assert "&lt;Ada&gt; edited row 1<" in page.parts[PART]
    page.do("step-copy", 0)
    assert "edited" not in page.parts[PART]


def running(
    page: ListPage, step: int, progress: float | None = None, loops: int | None = 2, loop: int = 0
) -> None:
    program = page.shared.program
    page.snapshot.program = ProgramProgress(
        program.name, step, len(program.steps), loop, loops, program, program
    )
    page.snapshot.progress = progress
    page.draw()


def test_the_running_step_is_marked_and_in_view_and_how_much_of_it_is_over(page: ListPage) -> None:
    page.put(*waits(1, 2, 3, 4))
    keys = page.shared.keys
    running(page, 1, (1 + (1 + 0.5) / 4) / 2, loop=1)
    assert page.marked("aria-current=step") == page.marked("--done:50%") == [1]
    assert f"data-view={keys[1]} " in page.parts[PART]
    assert "runs step 2 of 4, pass 2 of 2" in page.parts[PART]
    running(page, 3, loops=None)
    assert page.marked("aria-current=step") == page.marked("--done:0%") == [3]
    assert f"data-view={keys[3]} " in page.parts[PART]
    page.snapshot.state = State.PAUSED
    page.draw()
    assert "paused at step 4 of 4" in page.parts[PART] and " data-paused" in page.parts[PART]
    page.snapshot.state = State.MOVING
    page.do("step", 2)
    assert f"data-view={keys[2]} " in page.parts[PART]  # who selects looks there, until the next step runs
    running(page, 0, loops=None, loop=1)
    running(page, 1, loops=None, loop=1)
    assert f"data-view={keys[1]} " in page.parts[PART]
    page.snapshot.program = None
    page.draw()
    assert page.marked("aria-current") == []


def test_a_run_that_begins_folds_the_step_that_is_edited_but_not_with_a_refused_value(page: ListPage) -> None:
    page.put(*waits(1, 2))
    page.do("step-edit", 0)
    running(page, 0)
    assert page.marked("data-set") == []
    page.do("step-edit", 1)
    steps = page.shared.program.steps
    page.shared.edit(msgspec.structs.replace(page.shared.program, steps=waits(7) + steps[1:]), None)
    assert page.snapshot.program is not None  # it comes with the next pass
    page.snapshot.program = replace(page.snapshot.program, coming=page.shared.program)
    page.draw()
    assert page.marked("data-set") == [1]
    running(page, 0, loop=1)  # it has come
    assert page.marked("data-set") == [1]
    page.snapshot.program = None
    page.draw()
    page.do("step-set", f"{page.shared.keys[1]}.0", "soon")
    running(page, 0)
    assert page.marked("data-set") == [1] and "value='soon'" in page.rows[1]


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (WaitStep(seconds=0.3), "Wait 0.3 s"),
        (PointStep(x_mm=156.9, y_mm=-83.6, z_mm=263.7), "Point"),
        (PointStep(x_mm=1, y_mm=-2, z_mm=3), "Point 1, −2, 3 mm"),
    ],
)
def test_the_line_says_what_runs_as_far_as_it_has_room(step: Step, words: str) -> None:
    assert short_words(step) == words


def test_another_version_that_runs_marks_no_row(page: ListPage) -> None:
    page.put(*waits(1, 2))
    running(page, 1)
    page.put(*waits(1, 2, 3))
    assert page.marked("aria-current") == []
    assert "Runs another version: step 2 of 2" in page.parts[PART]
    assert page.snapshot.program is not None
    drawing = msgspec.structs.replace(page.shared.program, name="<name>", steps=tuple(waits(1)))
    page.snapshot.program = replace(page.snapshot.program, name=drawing.name, running=drawing, coming=drawing)
    page.draw()
    assert "Runs another program, &lt;name&gt;: step 2 of 2" in page.parts[PART]


def test_findings_stand_at_their_rows_the_worst_first(page: ListPage) -> None:
    page.put(*waits(1, 2, 3))
    warning, error = (
        Finding(Said(what), severity=severity, step=1)
        for what, severity in (("it is <hot>", "warning"), ("it is far", "error"))
    )
    page.findings = [warning, Finding(Said("of no step")), Finding(Said("too late"), step=3)]
    page.draw()
    assert page.marked("armctl-warning") == [1] and "! it is &lt;hot&gt;" in page.rows[1]
    page.findings = [warning, error]
    page.draw()
    assert page.marked("armctl-error") == [1] == page.marked("it is far")
    page.findings = []
    page.draw()
    assert page.marked("<em") == []


def test_only_rows_that_have_changed_are_made_anew(page: ListPage, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def counted(key: str, *more: Any) -> str:
        made.append(key)
        return row_html(key, *more)

    page.put(*waits(*range(500)))
    monkeypatch.setattr("armctl.ui.tabs.manual.program_list.row_html", counted)

    def after(action: Callable[[], None]) -> int:
        made.clear()
        action()
        return len(made)

    assert after(page.draw) <= 1
    assert after(lambda: page.do("step", 250)) <= 3
    assert after(lambda: page.do("step-down", 250)) <= 3
    assert after(lambda: page.do("step-move", 0, page.shared.keys[400])) <= 4
    assert after(lambda: page.do("step-delete", 7)) <= 4
    assert after(lambda: running(page, 3, loops=None)) <= 4


ASIDE = (20.0, *ROBOT.shown(ROBOT.pose("home")).tolist()[1:])


def line_of(page: ListPage) -> str:
    return " ".join(re.sub("<[^>]*>", " ", page.parts["next"]).split())


def test_a_row_that_is_clicked_is_the_next_pose_and_go_sends_it(page: ListPage) -> None:
    page.put(WaitStep(seconds=1), MoveStep(joints_deg=ASIDE))
    page.do("step", 1)
    assert page.next.q is not None and "step 2" in line_of(page)
    assert ROBOT.shown(page.next.q) == pytest.approx(ASIDE)
    page.do("step", 0)  # that moves nothing: what is drawn stays
    assert "step 2" in line_of(page)
    page.go()
    sent = page.sent[-1]
    assert isinstance(sent, MoveJoints) and ROBOT.shown(sent.q) == pytest.approx(ASIDE)


def test_a_step_that_is_edited_meanwhile_is_the_next_pose_as_it_is_then(page: ListPage) -> None:
    page.put(MoveStep(joints_deg=ASIDE))
    page.do("step", 0)
    further = (ASIDE[0] + 10, *ASIDE[1:])
    page.act(lambda: page.put(MoveStep(joints_deg=further)))
    assert page.next.q is not None and ROBOT.shown(page.next.q) == pytest.approx(further)


def test_the_next_pose_stays_that_of_its_step_wherever_that_goes_and_goes_with_it(page: ListPage) -> None:
    further = (ASIDE[0] + 10, *ASIDE[1:])
    page.put(MoveStep(joints_deg=ASIDE), MoveStep(joints_deg=further), WaitStep(seconds=1))
    page.do("step", 1)
    page.do("step", 2)  # that moves nothing
    page.do("step-delete", 0)
    assert page.next.q is not None and ROBOT.shown(page.next.q) == pytest.approx(further)
    assert "step 1" in line_of(page)
    page.do("step-delete", 0)  # in its place is a step that leads nowhere
    assert page.next.q is None and page.editor.leads_nowhere == ""


def test_the_last_step_takes_its_next_pose_along(page: ListPage) -> None:
    page.put(MoveStep(joints_deg=ASIDE))
    page.do("step", 0)
    page.do("step-delete", 0)
    assert page.next.q is None and page.shared.keys == []


def test_a_page_that_is_loaded_anew_calls_no_step_by_an_old_number(
    page: ListPage,
) -> None:
    page.put(MoveStep(joints_deg=ASIDE))
    page.do("step", 0)
    page.next.refresh(page.session.snapshot)
    assert "&quot;words&quot;:&quot;step of a program, as it was&quot;" in page.parts["next"]


def test_a_step_that_leads_nowhere_is_no_next_pose_and_the_list_says_why(page: ListPage) -> None:
    page.put(MoveStep(joints_deg=ASIDE), PointStep(x_mm=5000, y_mm=0, z_mm=0))
    page.do("step", 0)
    assert page.next.q is not None
    page.do("step", 1)
    page.draw()
    assert page.next.q is None
    assert "too far by 4672.6 mm" in page.rows[1] and "too far" not in page.parts[PART]
    assert "1 step cannot run" in page.parts[PART] and line_of(page).startswith("Step 2 cannot run")
    assert "Too far by 4672.6 mm" in line_of(page)
    page.do("step", 0)
    page.draw()
    assert "too far" not in page.rows[1] and page.next.q is not None
