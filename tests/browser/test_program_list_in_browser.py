"""The list of Serial motion as an operator uses it: by mouse, by keyboard, while others edit, as it runs."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from playwright.sync_api import Locator, Position, expect
from tests.browser.ghost_view import arrow_px
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.program import (
    CallStep,
    EndStep,
    MessageStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    Step,
    WaitStep,
    save_program,
)
from armctl.protocol import Enable, Party

pytestmark = pytest.mark.browser
TAB = "Manual"
OTHER = Party("browser page 2", "browser page 2")
_SHOWN = (
    """list => Array.from(list.children, row => [row.dataset.key, row.querySelector(".nth").textContent])"""
)
_CHANGES = """list => {
  const seen = {added: 0, removed: 0, rows: new Set()};
  const rowOf = node => (node.nodeType === 1 ? node : node.parentElement)?.closest("[role=row]")?.dataset.key;
  new MutationObserver(changes => {
    for (const {type, target, addedNodes, removedNodes} of changes) {
      if (target === list && type === "childList") {
        seen.added += addedNodes.length;
        seen.removed += removedNodes.length;
      } else if (rowOf(target)) seen.rows.add(rowOf(target));
    }
  }).observe(list, {subtree: true, childList: true, attributes: true, characterData: true});
  window.changesSeen = () => ({added: seen.added, removed: seen.removed, rows: seen.rows.size});
  window.forgetChanges = () => (seen.added = seen.removed = 0, seen.rows.clear());
}"""


def waits(*seconds: float) -> list[Step]:
    return [WaitStep(seconds=one) for one in seconds]


def steps_list(page: Screen) -> Locator:
    return page.page.get_by_role("grid", name="Steps of the program")


def rows(page: Screen) -> Locator:
    return steps_list(page).get_by_role("row")


_WORD = Position(x=44, y=12)
"""where the kind of a step is written, in a row: the buttons of one that is selected are at its right"""


def show(page: Screen, served: ServedArm, *steps: Step) -> None:
    served.put_steps(*steps)
    page.open_tab("Serial motion")
    expect(rows(page)).to_have_count(len(steps))


def selected(page: Screen) -> int:
    """The row that is selected, from 0."""
    return page.page.evaluate("""() => Array.from(document.querySelectorAll(".armctl-steps > *"))
        .findIndex(row => row.getAttribute("aria-selected") === "true")""")


def focused(page: Screen) -> int:
    """The row that has the focus, from 0; -1: none has."""
    return page.page.evaluate("""() => Array.from(document.querySelectorAll(".armctl-steps > *"))
        .indexOf(document.activeElement)""")


def drag(page: Screen, row: int, to: int) -> None:
    """Take a row by its grip and drop it before another one; behind the last, if there is no such row."""
    grip = rows(page).nth(row).locator("[data-grip]").bounding_box()
    count = rows(page).count()
    goal = rows(page).nth(min(to, count - 1)).bounding_box()
    assert grip is not None and goal is not None
    mouse, x = page.page.mouse, grip["x"] + grip["width"] / 2
    mouse.move(x, grip["y"] + grip["height"] / 2)
    mouse.down()
    mouse.move(x, goal["y"] + (3 if to < count else goal["height"] - 3), steps=3)
    mouse.up()


@dataclass
class Model:
    """What a list is, as plain Python: the seconds that each row waits."""

    rows: list[float]
    at: int = 0
    undo: list[list[float]] = field(default_factory=list[list[float]])
    redo: list[list[float]] = field(default_factory=list[list[float]])

    def edit(self, rows: list[float], at: int) -> None:
        self.undo.append(self.rows)
        self.redo, self.rows, self.at = [], rows, at

    def move(self, row: int, to: int) -> None:
        """Before the row ``to``."""
        rest = self.rows[:row] + self.rows[row + 1 :]
        at = to - (to > row)
        self.edit([*rest[:at], self.rows[row], *rest[at:]], at)


def plays(dice: random.Random, page: Screen, model: Model) -> Iterator[str]:
    """Do a hundred things on the page and the model; the name of each."""
    press = page.page.keyboard.press
    for _ in range(100):
        count, at = len(model.rows), model.at
        what = dice.choice("click down up home end lower higher copy delete undo redo drag drag".split())
        match what:
            case "click":
                model.at = dice.randrange(count)
                rows(page).nth(model.at).click(position=_WORD)
            case "down" | "up":
                model.at = max(0, at - 1) if what == "up" else min(count - 1, at + 1)
                press("ArrowUp" if what == "up" else "ArrowDown")
            case "home" | "end":
                model.at = 0 if what == "home" else count - 1
                press(what.title())
            case "lower" if at < count - 1:
                model.move(at, at + 2)
                press("Alt+ArrowDown")
            case "higher" if at > 0:
                model.move(at, at - 1)
                press("Alt+ArrowUp")
            case "copy" if count < 12:
                model.edit([*model.rows[: at + 1], *model.rows[at:]], at + 1)
                press("Control+d")
            case "delete" if count > 3:
                model.edit(model.rows[:at] + model.rows[at + 1 :], min(at, count - 2))
                press("Delete")
            case "undo" if model.undo:
                model.redo.append(model.rows)
                model.rows, model.at = model.undo.pop(), -1
                press("Control+z")
            case "redo" if model.redo:
                model.undo.append(model.rows)
                model.rows, model.at = model.redo.pop(), -1
                press(dice.choice(["Control+y", "Control+Shift+Z"]))
            case "drag":
                row, to = dice.randrange(count), dice.randrange(count + 1)
                if to not in (row, row + 1):
                    model.move(row, to)
                else:
                    model.at = row  # it was clicked
                drag(page, row, to)
            case _:
                continue
        yield what


@pytest.mark.parametrize("seed", [1, 2])
def test_whatever_is_done_the_list_is_what_a_plain_list_would_be(
    page: Screen, served: ServedArm, seed: int
) -> None:
    model = Model([1, 2, 3, 4, 5, 6, 7])
    page.page.set_viewport_size(
        {"width": 1280, "height": 1500}
    )  # the whole list is in view: rows are dragged
    show(page, served, *waits(*model.rows))
    rows(page).nth(0).click(position=_WORD)
    done: list[str] = []
    for what in plays(random.Random(seed), page, model):
        done.append(what)

        def agrees() -> bool:
            program = served.edited
            if [getattr(step, "seconds", None) for step in program.program.steps] != model.rows:
                return False
            shown = steps_list(page).evaluate(_SHOWN)
            numbered = [[key, str(number)] for number, key in enumerate(program.keys, 1)]
            at = selected(page)
            return shown == numbered and at == focused(page) and model.at in (at, -1)

        page.wait_until(agrees, f"{model.rows}, row {model.at} after {done}")
        model.at = selected(page)
    page.page.set_viewport_size({"width": 1280, "height": 800})
    assert len(set(done)) >= 10
    assert page.notifications() == [] and page.errors == []


def test_a_step_is_edited_in_its_row_as_people_write_and_a_wrong_value_stays_with_its_reason(
    page: Screen, served: ServedArm
) -> None:
    show(page, served, *waits(1, 2), PointStep(x_mm=200, y_mm=0, z_mm=85))
    rows(page).nth(1).click(position=_WORD)
    page.page.keyboard.press("Enter")
    expect(page.entry("Wait time s")).to_be_focused()
    page.page.keyboard.insert_text("12,5")  # what was there is selected
    page.page.keyboard.press("Enter")
    page.wait_until(lambda: served.steps[1] == WaitStep(seconds=12.5), "it is saved")
    expect(rows(page).nth(1)).to_be_focused()
    expect(steps_list(page).locator("[data-set]")).to_have_count(0)

    rows(page).nth(2).dblclick(position=_WORD)
    expect(steps_list(page).get_by_label("X mm")).to_be_focused()
    page.page.keyboard.insert_text("−199,5")
    page.page.keyboard.press("Tab")
    page.wait_until(lambda: getattr(served.steps[2], "x_mm", None) == -199.5, "one number of the point")
    expect(steps_list(page).get_by_label("X mm")).to_have_value("−199.5")
    expect(steps_list(page).get_by_label("Y mm")).to_be_focused()
    page.page.keyboard.press("Control+z")  # of the field, not of the list
    steps_list(page).get_by_label("X mm").fill("200")
    page.click("More fields")
    page.type_into("Pitch °", "−30")
    page.wait_until(lambda: getattr(served.steps[2], "pitch_deg", None) == -30, "a real minus is read")
    page.type_into("Duration s", "2,25")
    page.wait_until(
        lambda: getattr(served.steps[2], "duration_s", None) == 2.25, "it is saved when it is left"
    )
    page.wait_until(lambda: page.value("Duration s") == "2.25", "and shown as it is kept")
    steps_list(page).get_by_label("Profile").select_option("quintic")
    page.wait_until(lambda: getattr(served.steps[2], "profile", None) == "quintic", "a choice is saved")

    step = served.steps[2]
    page.type_into("Blend mm", "wide", leave=False)
    page.page.keyboard.press("Enter")
    why = steps_list(page).get_by_text("Blend mm: 'wide' is not a number")
    why.wait_for()
    field = steps_list(page).get_by_label("Blend mm")
    expect(field).to_have_attribute("aria-invalid", "true")
    assert field.get_attribute("aria-describedby") == why.get_attribute("id")
    page.page.keyboard.press("Escape")  # that is STOP, and closes nothing
    rows(page).nth(0).click(position=_WORD)
    expect(rows(page).nth(0)).to_have_attribute("aria-selected", "true")
    assert page.value("Blend mm") == "wide" and served.steps[2] == step
    page.screenshot("program-refused-field")
    page.click("Discard")
    expect(steps_list(page).locator("[data-set]")).to_have_count(0)
    assert served.steps[2] == step
    assert page.notifications() == [] and page.errors == []


def test_buttons_in_the_selected_row_do_what_keys_do(page: Screen, served: ServedArm) -> None:
    show(page, served, *waits(1, 2, 3))
    rows(page).nth(0).click(position=_WORD)
    words, time = (rows(page).nth(0).locator(part) for part in (".does", ".lasts"))
    pencil, before = page.button("Edit row 1").bounding_box(), words.bounding_box()
    assert pencil is not None and before is not None and before["x"] + before["width"] <= pencil["x"]
    expect(time).to_be_hidden()  # the buttons have its place
    page.click("Edit row 1")
    expect(page.entry("Wait time s")).to_have_value("1")
    expect(time).to_be_visible()
    for button, after in (
        ("Move row 1 down", [2, 1, 3]),
        ("Move row 2 up", [1, 2, 3]),
        ("Duplicate row 1", [1, 1, 2, 3]),
    ):
        box = page.button(button).bounding_box()
        assert box is not None and min(box["width"], box["height"]) >= 28
        page.click(button)
        page.wait_until(lambda after=after: list(served.steps) == waits(*after), button)
    rows(page).nth(1).click(position=_WORD)
    page.click("Delete row 2")
    page.wait_until(lambda: list(served.steps) == waits(1, 2, 3), "it is deleted")


def test_a_block_is_added_filled_and_moved_by_keyboard_alone(page: Screen, served: ServedArm) -> None:
    keyboard, one = page.page.keyboard, WaitStep(seconds=1)
    show(page, served, one)
    menu = page.button("Add step ▾")
    menu.focus()
    keyboard.press("Enter")
    expect(menu).to_have_attribute("aria-expanded", "true")
    keyboard.press("Escape")
    expect(menu).to_have_attribute("aria-expanded", "false")
    keyboard.press("Enter")
    expect(menu).to_have_attribute("aria-expanded", "true")
    page.screenshot("program-menu")
    kinds = page.page.get_by_role("group", name="Decide and repeat", exact=True)
    for _ in range(30):
        keyboard.press("Tab")
        if kinds.get_by_role("button", name="Repeat", exact=True).evaluate(
            "it => it === document.activeElement"
        ):
            break
    keyboard.press("Enter")
    times = steps_list(page).get_by_label("Times")
    expect(times).to_be_focused()
    keyboard.insert_text("3")
    keyboard.press("Enter")
    block = RepeatStep(times=3), EndStep()
    page.wait_until(lambda: served.steps == (one, *block), "the block is there, as often as was typed")
    expect(rows(page).nth(1)).to_be_focused()
    expect(rows(page).nth(2)).to_contain_text("of repeat 3 times")
    keyboard.press("Alt+ArrowUp")
    page.wait_until(lambda: served.steps == (*block, one), "it is moved whole")
    keyboard.press("ArrowDown")
    keyboard.press("Alt+ArrowDown")
    page.wait_until(lambda: served.steps == (block[0], one, block[1]), "its end alone")
    keyboard.press("Control+z")
    keyboard.press("Control+z")
    page.wait_until(lambda: served.steps == (one, *block), "both are taken back")
    assert page.notifications() == [] and page.errors == []


def test_focus_scroll_and_what_is_being_typed_survive_what_others_change(
    page: Screen, served: ServedArm
) -> None:
    steps = waits(*range(1, 61))
    show(page, served, *steps)
    rows(page).nth(40).click(position=_WORD)
    expect(page.button("Delete row 41")).to_be_visible()
    before = steps_list(page).evaluate("list => list.scrollTop")
    assert before > 0
    served.put_steps(*steps[:50], by=OTHER)
    expect(rows(page)).to_have_count(50)
    assert focused(page) == selected(page) == 40
    assert steps_list(page).evaluate("list => list.scrollTop") == before
    page.wait_for_text("browser page 2 edited row 51")

    page.page.keyboard.press("Enter")
    expect(page.entry("Wait time s")).to_be_focused()
    page.page.keyboard.insert_text("7,")
    steps = [WaitStep(seconds=99), *steps[30:50], *steps[:30]]
    served.put_steps(*steps, by=OTHER)
    page.wait_for_text("browser page 2 edited row 1")
    expect(page.entry("Wait time s")).to_be_focused()
    assert page.value("Wait time s") == "7,"
    page.page.keyboard.insert_text("5")
    page.page.keyboard.press("Enter")
    page.wait_until(lambda: served.steps[11] == WaitStep(seconds=7.5), "it goes to its own step")
    expect(page.page.get_by_text("browser page 2 edited")).to_have_count(0)
    expect(rows(page).nth(11)).to_be_focused()
    served.put_steps(*steps[:11], *steps[12:], by=OTHER)  # the row that has the focus goes
    page.wait_until(lambda: focused(page) == selected(page) == 11, "the row after it has the focus")
    assert page.errors == []


def test_of_a_long_list_one_row_is_changed_and_no_other_is_touched(page: Screen, served: ServedArm) -> None:
    steps = waits(*range(2000))
    show(page, served, *steps)
    rows(page).nth(3).click(position=_WORD)
    steps_list(page).evaluate(_CHANGES)
    page.page.keyboard.press("Alt+ArrowDown")
    page.wait_until(lambda: selected(page) == 4, "the row has moved")
    seen = page.page.evaluate("changesSeen()")
    assert seen["added"] == seen["removed"] <= 1 and seen["rows"] <= 2
    page.page.evaluate("forgetChanges()")
    served.put_steps(*served.steps[:1500], WaitStep(seconds=5000), *served.steps[1501:], by=OTHER)
    page.wait_for_text("browser page 2 edited row 1501")
    seen = page.page.evaluate("changesSeen()")
    assert (seen["added"], seen["removed"], seen["rows"]) == (0, 0, 1)
    expect(rows(page).nth(1500)).to_contain_text("5000 s")
    page.page.keyboard.press("End")
    expect(rows(page).nth(1999)).to_be_focused()
    expect(rows(page).nth(1999)).to_be_in_viewport()


def test_the_running_step_is_marked_and_in_view_and_findings_stand_at_their_rows(
    page: Screen, served: ServedArm
) -> None:
    moves = [MoveStep(joints_deg=(2.0 + k, *HOME[1:])) for k in range(2)]
    steps = [RepeatStep(times=9), EndStep()] * 20
    show(page, served, moves[0], *steps, moves[1], PointStep(x_mm=999, y_mm=0, z_mm=100))
    page.click("Check")
    finding = rows(page).nth(42).locator("em")
    expect(finding).to_contain_text("too far by 671.0 mm")
    expect(rows(page).locator("em")).to_have_count(1)
    rows(page).nth(42).click(position=_WORD)
    page.page.keyboard.press("Delete")
    expect(rows(page).locator("em")).to_have_count(0)
    page.page.keyboard.press("Home")
    page.click("Loop")
    runs = steps_list(page).locator("[aria-current=step]")
    for row in (41, 0):
        page.wait_until(
            lambda row=row: rows(page).nth(row).get_attribute("aria-current") == "step", f"row {row + 1} runs"
        )
        expect(runs).to_be_in_viewport()
    page.screenshot("program-runs")
    page.click("STOP")
    served.wait_for(page, State.HOLDING)
    expect(runs).to_have_count(0)


def test_a_page_that_watches_sees_the_edits_and_is_offered_none(
    page: Screen, screens: Screens, served: ServedArm
) -> None:
    show(page, served, *waits(1, 2, 3))
    watcher = screens(served.url)
    watcher.open_tab("Manual", "Serial motion")
    expect(rows(watcher)).to_have_count(3)
    rows(watcher).nth(1).dblclick()
    expect(rows(watcher).nth(1)).to_have_attribute("aria-selected", "true")
    expect(steps_list(watcher).locator("button, [data-set]")).to_have_count(0)
    assert not rows(watcher).nth(1).locator("[data-grip]").is_visible()
    watcher.page.keyboard.press("Delete")
    watcher.page.keyboard.press("Control+d")
    rows(page).nth(2).click(position=_WORD)
    page.page.keyboard.press("Control+d")
    expect(rows(watcher)).to_have_count(4)
    watcher.wait_for_text(re.compile("browser page 1 edited row 4"))
    assert selected(watcher) == 1
    assert list(served.steps) == waits(1, 2, 3, 3)
    expect(page.page.get_by_text("edited row")).to_have_count(0)
    assert watcher.notifications() == [] and watcher.errors == []


def test_a_click_on_a_pin_in_the_scene_selects_its_step_and_makes_it_the_next_pose(
    page: Screen, served: ServedArm
) -> None:
    aside, up = (-20.0, *HOME[1:]), (HOME[0], HOME[1] + 10, *HOME[2:])
    served.order(Enable())
    served.wait_for(page, State.HOLDING)
    show(page, served, MoveStep(joints_deg=up), MoveStep(joints_deg=aside), MoveStep(joints_deg=up))
    page.wait_until(lambda: page.node("/program/pin1") is not None, "there are two pins")
    assert page.node("/program/pin2") is None  # two steps lead to one place
    over = page.page.locator("canvas[data-armctl-pressable]")

    def left_alone() -> bool:
        """Beside both pins; where they are changes as long as the page is being built."""
        x, y = arrow_px(page, "/program/pin1", 0.0)
        away_x, away_y = arrow_px(page, "/program/pin0", 0.0)
        page.page.evaluate("window.__viserMutable.requestRender()")
        page.page.mouse.move(2 * x - away_x, 2 * y - away_y)
        page.pause()
        return over.count() == 0

    page.wait_until(left_alone, "nothing can be pressed beside the pins")
    at = arrow_px(page, "/program/pin1", 0.0)
    page.page.mouse.move(*at)
    expect(over).to_have_css("cursor", "pointer")
    page.page.mouse.click(*at)
    page.wait_until(lambda: selected(page) == 1, "its step is selected")
    expect(page.page.locator("armctl-part[name=next] p")).to_contain_text("step 2")
    page.click("Go")
    served.wait_for_deg(page, list(aside))
    page.unfold("More", "Delete")
    page.tick("Show tool path", on=False)
    page.wait_until(lambda: page.node("/program/pin0") is None, "the pins are gone")


def test_a_press_in_the_scene_offers_a_pose_and_steps_at_that_place(page: Screen, served: ServedArm) -> None:
    served.order(Enable())
    served.wait_for(page, State.HOLDING)
    show(page, served, MoveStep(joints_deg=(-20.0, *HOME[1:])))
    page.wait_until(lambda: page.node("/program/pin0") is not None, "there is a pin")
    page.pause(300)
    at = arrow_px(page, "/program/pin0", 0.0)
    menu = page.page.get_by_label("What to do there")
    page.page.mouse.click(*at, button="right")
    expect(menu).to_be_visible()
    page.page.mouse.click(at[0] - 120, at[1] + 40)  # anywhere else
    expect(menu).to_have_count(0)
    page.page.mouse.move(*at)  # a drag turns the view
    page.page.mouse.down(button="right")
    page.page.mouse.move(at[0] + 30, at[1], steps=3)
    page.page.mouse.up(button="right")
    page.pause(300)
    expect(menu).to_have_count(0)
    at = arrow_px(page, "/program/pin0", 0.0)
    page.page.mouse.click(*at, button="right")
    page.click("Add as a point")
    page.wait_until(lambda: len(served.steps) == 2, "the step is there")
    added, tip = served.steps[1], 1000 * served.robot.forward(np.radians([-20.0, *HOME[1:]]))[:3, 3]
    assert isinstance(added, PointStep)
    assert (added.x_mm, added.y_mm, added.z_mm) == pytest.approx(tip.tolist(), abs=0.06)
    page.page.mouse.click(*at, button="right")
    page.click("Next pose here")
    expect(page.page.locator("armctl-part[name=next] p")).to_contain_text("pointed at in the scene")
    page.click("Go")
    page.wait_until(lambda: bool(np.abs(served.tool_mm - tip).max() < 0.06), "the tool is there")
    assert page.errors == []


def test_a_click_on_a_link_shows_a_ring_at_its_joint_and_another_one_takes_it_away(
    page: Screen, served: ServedArm
) -> None:
    served.order(Enable())
    served.wait_for(page, State.HOLDING)
    page.wait_until(lambda: page.node("/tool") is not None, "the scene is there")
    page.pause(300)
    (x, y), (u, v) = arrow_px(page, "/arm/link1", 0.0), arrow_px(page, "/arm/link2", 0.0)
    at = 0.5 * (x + u), 0.5 * (y + v)  # on the upper arm
    page.page.mouse.click(*at)
    page.wait_until(lambda: page.node("/ring") is not None, "there is a ring")
    page.screenshot("ring")
    page.page.mouse.click(*at)
    page.wait_until(lambda: page.node("/ring") is None, "it is gone")
    assert served.commanded_deg == HOME and page.errors == []


def test_a_message_waits_for_ok_and_the_list_shows_where_in_a_called_program_it_is(
    page: Screen, screens: Screens, served: ServedArm
) -> None:
    library = served.edited.library
    library.folder.mkdir(parents=True, exist_ok=True)
    save_program(Program(robot="uzuner", steps=tuple(waits(0.1, 60))), library.path("rest a while"))
    show(page, served, MessageStep(text="Load <b>a part</b>"), CallStep(program="rest a while"))
    served.order(Enable()).result(20)
    guest = screens(served.url)
    page.click("Run once")
    card, other = (
        one.page.get_by_role("alertdialog", name="Message of the program") for one in (page, guest)
    )
    expect(card).to_contain_text("Load <b>a part</b>")
    expect(other).to_contain_text("Load <b>a part</b>")
    ok = other.get_by_role("button", name="OK")
    expect(ok).to_have_attribute("aria-disabled", "true")
    card.get_by_role("button", name="OK").click()
    expect(card).to_have_count(0)
    expect(other).to_have_count(0)
    expect(rows(page).nth(1)).to_contain_text("in 'rest a while', step 2")
    served.console.controller.stop().result(20)
