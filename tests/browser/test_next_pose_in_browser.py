"""One next pose a page, in a browser: what is drawn and written is what *Go* sends, and no other."""

from __future__ import annotations

import json
import os
import re

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Position, expect
from tests.browser.ghost_view import ARROW_M, LOOKED_AT, arrow_px, drag_tool, ghost_tip_mm, wait_for_no_ghost
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.program import MoveStep, PointStep, WaitStep
from armctl.protocol import MoveJoints
from armctl.ui.guard.parts import Parts

pytestmark = pytest.mark.browser
TAB = "Manual"
SEQUENCES, STEPS = (300, 12) if os.environ.get("ARMCTL_LONG") else (1, 6)


def line(page: Screen) -> str:
    return page.text("armctl-part[name=next]").replace("−", "-")


def written_mm(page: Screen) -> NDArray[np.float64] | None:
    """X, Y and Z that the line writes; None: there is no next pose."""
    found = re.findall(r"[XYZ] (-?[\d.]+)", line(page))
    return np.array(found, dtype=np.float64) if len(found) == 3 else None


def wait_for_next(page: Screen) -> None:
    page.wait_until(lambda: written_mm(page) is not None, "there is a next pose")


def test_the_tool_is_dragged_on_any_tab_and_go_sends_exactly_what_is_drawn(
    page: Screen, served: ServedArm
) -> None:
    page.open_tab("Log")
    expect(page.button("Go")).to_be_disabled()
    drag_tool(page, 0, -40)
    wait_for_next(page)
    tip = ghost_tip_mm(page)
    assert tip is not None and tip[2] - served.tool_mm[2] > 5
    assert tip[:2] == pytest.approx(served.tool_mm[:2], abs=1.5)
    assert "dragged tool" in line(page)
    assert served.commanded_deg == HOME  # dragging moves nothing
    expect(page.button("Go")).to_be_enabled()
    page.click("Record")  # where it would go, before it has gone there
    page.wait_until(lambda: len(served.steps) == 1, "it is on the list")
    (step,) = served.steps
    assert isinstance(step, MoveStep)
    recorded = 1000 * served.robot.forward(np.radians(step.joints_deg))[:3, 3]
    assert recorded == pytest.approx(tip, abs=0.1)
    page.screenshot("next-pose-dragged")
    page.click("Go")
    page.wait_until(lambda: written_mm(page) is None, "the arm has come to it")
    assert served.tool_mm == pytest.approx(tip, abs=0.05)
    wait_for_no_ghost(page)
    page.click("Record")  # without one: where the arm is
    page.wait_until(lambda: len(served.steps) == 2, "that is on the list, too")
    assert served.steps[1] == served.steps[0]
    assert page.errors == []


def test_a_pin_of_the_program_before_an_arrow_leaves_it_to_who_drags(page: Screen, served: ServedArm) -> None:
    x, y, z = served.tool_mm.tolist()
    served.put_steps(PointStep(x_mm=x, y_mm=y, z_mm=z + 1000 * ARROW_M))
    page.wait_until(lambda: page.node("/program/pin0") is not None, "the pin is drawn over the arrow")
    drag_tool(page, 0, -40)
    wait_for_next(page)
    assert "dragged tool" in line(page)
    page.page.mouse.click(*arrow_px(page, "/program/pin0", 0.0))  # a click that drags nothing is for the pin
    page.wait_until(lambda: "step 1" in line(page), "its step is chosen")


def test_what_is_pressed_as_the_line_is_lost_is_said_to_be_in_doubt(page: Screen, served: ServedArm) -> None:
    """Nobody presses Enable, waits, and wonders."""
    (shown,) = vars(served.app)["_pages"].values()
    parts: Parts = shown.session.parts
    parts.on("record", lambda _: served.app.server.part_lines.unlink(parts))  # before it is answered
    page.click("Record")
    page.wait_for_text(re.compile("may not have arrived"))
    assert served.steps == ()


def test_it_outlives_a_reload_and_who_watches_sees_it_and_has_one_of_its_own(
    screens: Screens, served: ServedArm
) -> None:
    page, watcher = screens(served.url), screens(served.url)
    for one in (page, watcher):
        one.open_tab("Manual", "Joints")
    page.type_into("Base °", "30")
    wait_for_next(page)
    drawn = ghost_tip_mm(page)
    theirs = "/theirs"
    watcher.wait_until(
        lambda: ghost_tip_mm(watcher, theirs) == pytest.approx(drawn, abs=0.01), "it is drawn for who watches"
    )
    assert written_mm(watcher) is None
    watcher.type_into("Base °", "-20")
    wait_for_next(watcher)
    assert "This page is watching" in line(watcher) or "this page is watching" in line(watcher)
    expect(watcher.button("Go")).to_be_disabled()
    page.reload(until="Enable")
    wait_for_next(page)
    page.wait_until(lambda: ghost_tip_mm(page) == pytest.approx(drawn, abs=0.01), "it is drawn as before")
    page.wait_until(lambda: served.now.control.operator is not None, "it operates again")
    page.wait_until(lambda: page.is_enabled("Go"), "Go can be pressed")
    page.click("Go")
    served.wait_for_deg(page, [30.0, *HOME[1:]])
    assert written_mm(watcher) is not None  # its own stays, and is planned from where the arm stands now


POSES = (
    (30.0, 80.0, -70.0, -30.0, 10.0), (-25.0, 90.0, -60.0, -50.0, 0.0), (0.0, 100.0, -75.0, -20.0, -15.0),
)  # fmt: skip
"""of the steps of the program [degrees]"""
EDITS = "Delete", "Alt+ArrowUp", "Alt+ArrowDown", "Control+d"
"""keys, and what they do to a row"""
_LOOKS = 40
"""until what is shown has to be true"""
_COLUMNS = """() => {
  const rows = Array.from(document.querySelectorAll("[name=where] tr"), row => Array.from(row.children));
  const [heads, ...figures] = rows.map(cells => cells.slice(1).map(cell => cell.textContent));
  return Object.fromEntries(heads.map((head, at) => [head, figures.map(cells => cells[at])]));
}"""
_PINS = """() => Object.entries(window.__viserMutable.nodeRefFromName)
  .filter(([name, node]) => node && /^\\/program\\/pin\\d+$/.test(name)).map(([name]) => name)
"""
_IS_SCENE = "([x, y]) => document.elementFromPoint(x, y)?.tagName === 'CANVAS'"


class Sequence:
    """What is done to two pages and one arm, at random."""

    def __init__(self, screens: Screens, served: ServedArm, seed: int) -> None:
        self.served, self.random = served, np.random.default_rng(seed)
        self.page, self.other = screens(served.url), screens(served.url)
        self.robot, self.done = served.robot, list[str]()
        served.put_steps(*(MoveStep(joints_deg=pose) for pose in POSES), WaitStep(seconds=0.1))

    # What is shown.

    def kept(self, page: Screen) -> NDArray[np.float64] | None:
        """(5,) the next pose in full, as the page keeps it for itself while it is loaded anew [rad]."""
        kept = page.page.locator("[data-keep=recall]")
        if kept.count() == 0:
            return None
        return np.array(json.loads(kept.get_attribute("data-kept") or "")["q"])

    def figures(self, page: Screen) -> dict[str, list[float]]:
        """Numbers of each column beside the arm: five joints [degrees], then the tool [mm]."""
        columns: dict[str, list[str]] = page.page.evaluate(_COLUMNS)
        return {
            head: [float(re.sub(r"[^-.\d]", "", one.replace("−", "-"))) for one in column[:8]]
            for head, column in columns.items()
        }

    def told(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Five joints [degrees] and the tool [mm] at ``q`` (5,) [rad]."""
        return np.append(np.degrees(q), 1000 * self.robot.forward(q)[:3, 3])

    def led_to(self, row: int) -> NDArray[np.float64] | None:
        """(5,) where a step of the program leads, from 0 [rad]; None: that depends on where the arm stood."""
        moves = [step for step in self.served.steps[: row + 1] if isinstance(step, MoveStep)]
        return np.radians(moves[-1].joints_deg) if moves else None

    # What is done.

    def slide(self) -> None:
        self.page.open_tab("Manual", "Joints")
        joint = self.served.robot.joints[int(self.random.integers(5))]
        low, high = np.degrees([joint.lower, joint.upper])
        self.page.type_into(f"{joint.title} °", f"{self.random.uniform(low + 1, high - 1):.2f}")

    def solve(self) -> None:
        self.page.open_tab("Inverse")
        x, y, z = self.random.uniform((120, -150, 60), (260, 150, 250)).round(1)
        self.page.type_xyz(str(x), str(y), str(z))
        self.page.click("Solve")
        self.page.pause(400)

    def choose_a_way(self) -> None:
        self.page.open_tab("Inverse")
        cards = self.page.page.locator(".armctl-card:not([aria-disabled=true])").locator("visible=true")
        if cards.count():
            cards.nth(int(self.random.integers(cards.count()))).click()

    def hover(self) -> None:
        self.page.open_tab("Inverse")
        cards = self.page.page.locator(".armctl-card").locator("visible=true")
        if cards.count():
            cards.nth(int(self.random.integers(cards.count()))).hover()
            self.page.pause(400)
            self.looks_true()
            self.page.page.mouse.move(300, 300)

    def type_angles(self) -> None:
        self.page.open_tab("Forward")
        self.page.type_into("Base °", f"{self.random.uniform(-60, 60):.1f}")

    def drag(self) -> None:
        drag_tool(self.page, 0, float(self.random.uniform(-40, 40)))

    def step(self) -> None:
        """Click a row of the program."""
        self.row()

    def row(self) -> bool:
        rows = self.page.page.locator(".armctl-steps > [role=row]")
        if not (count := rows.count()):
            return False
        rows.nth(int(self.random.integers(count))).click(position=Position(x=44, y=12))
        self.page.pause(400)
        return True

    def edit_steps(self) -> None:
        if self.row():
            self.looks_true()
            self.page.page.keyboard.press(EDITS[int(self.random.integers(len(EDITS)))])

    def record(self) -> None:
        if self.page.is_enabled("Record"):
            self.page.click("Record")

    def undo(self) -> None:
        button = ("Undo", "Redo")[int(self.random.integers(2))]
        if self.page.is_enabled(button):
            self.page.click(button)

    def pin(self) -> None:
        """Click a pin in the scene."""
        pins: list[str] = self.page.page.evaluate(_PINS)
        if not pins:
            return
        at = arrow_px(self.page, pins[int(self.random.integers(len(pins)))], 0.0)
        if self.page.page.evaluate(_IS_SCENE, at):
            self.page.page.mouse.click(*at)
            self.page.pause(400)

    def fill_with(self) -> None:
        self.page.open_tab("Forward")
        self.page.click(("rest", "home")[int(self.random.integers(2))])

    def go_to_pose(self) -> None:
        """A pose by its name, at once."""
        self.page.open_tab("Main")
        name = ("rest", "zero")[int(self.random.integers(2))]
        if not self.page.is_enabled(name):
            return
        self.page.click(name)
        self.page.wait_until(
            lambda: bool(np.abs(self.served.now.q_command - self.robot.pose(name)).max() < 1e-6),
            f"the arm is at {name}",
        )
        self.served.wait_for(self.page, State.HOLDING)

    def other_writes(self) -> None:
        before = self.kept(self.page)
        self.other.open_tab("Manual", "Joints")
        self.other.type_into("Wrist roll °", f"{self.random.uniform(-40, 40):.1f}")
        after = self.kept(self.page)
        assert (before is None) is (after is None)
        assert before is None or np.array_equal(before, after)

    def other_goes(self) -> None:
        """The other page takes control, and gives it back."""
        for page in (self.other, self.page):
            if page.button("Take control").is_visible():
                page.click("Take control")  # it asks
                page.click("Take control")
            page.wait_until(lambda page=page: not page.button("Take control").is_visible(), "it operates")
            if page is self.other:
                self.looks_true()
                self.go(page)

    def another_moves(self) -> None:
        pose = np.radians([self.random.uniform(-45, 45), 90.0, self.random.uniform(-84, -40), -40.0, 0.0])
        self.served.wait_for(self.page, State.HOLDING)
        self.served.order(MoveJoints(pose)).finished.result(20)

    def reload(self) -> None:
        before = ghost_tip_mm(self.page)
        self.page.reload(until="Enable")
        if before is not None:
            wait_for_next(self.page)
            self.page.wait_until(
                lambda: ghost_tip_mm(self.page) == pytest.approx(before, abs=0.05), "it is drawn as before"
            )
        self.page.wait_until(lambda: self.served.now.control.operator is not None, "a page operates")

    def forget(self) -> None:
        if written_mm(self.page) is not None:
            self.page.click("Forget the next pose")

    def go(self, page: Screen | None = None, *, stop: bool = False) -> None:
        page = page or self.page
        other = self.other if page is self.page else self.page
        q, others = self.kept(page), self.kept(other)
        if q is None or not page.button("Go").is_enabled():
            return
        page.click("Go")
        if stop:
            page.page.keyboard.press("Escape")
            self.served.wait_for(page, State.HOLDING)
            return
        page.wait_until(
            lambda: bool(np.abs(self.served.now.q_command - q).max() < 1e-6), "the arm is where the ghost was"
        )
        self.served.wait_for(page, State.HOLDING)
        page.pause(400)
        left = self.kept(other)
        if others is not None and np.abs(self.served.now.q_command - others).max() > 1e-3:
            assert left is not None and np.array_equal(left, others)

    def stop(self) -> None:
        self.go(stop=True)

    def looks_true(self) -> None:
        """On both pages ghost, line and numbers say the same, once they have come to rest.

        Scene and line come to a page on two websockets: on a busy computer one may be late.
        """
        self.page.pause(400)
        for _ in range(_LOOKS):
            try:
                return self.look()
            except AssertionError:
                self.page.pause(250)
        return self.look()

    def look(self) -> None:
        for page in (self.page, self.other):
            self.looks_true_on(page)
        operator = [page for page in (self.page, self.other) if page.button("Take control").count() == 0]
        if len(operator) == 1:
            watcher = self.other if operator[0] is self.page else self.page
            theirs, drawn = ghost_tip_mm(watcher, "/theirs"), ghost_tip_mm(operator[0])
            assert (theirs is None) is (drawn is None)
            assert theirs is None or theirs == pytest.approx(drawn, abs=0.05)

    def looks_true_on(self, page: Screen) -> None:
        q, tip, said, figures = self.kept(page), ghost_tip_mm(page), line(page), self.figures(page)
        now, *_ = figures.values()
        assert now == pytest.approx(self.told(self.served.now.q), abs=0.06)  # in the board's steps
        if (looked_at := figures.pop("looked at", figures.pop("nearest", None))) is not None:  # for the next
            assert looked_at[5:] == pytest.approx(ghost_tip_mm(page, LOOKED_AT), abs=0.06)
            figures["next"] = [] if q is None else self.told(q).tolist()
        if q is None:
            assert tip is None and not figures.get("next")
            assert said.startswith("No next pose") and not page.is_enabled("Go")
            return
        assert tip is not None and tip == pytest.approx(self.told(q)[5:], abs=0.05)
        assert written_mm(page) == pytest.approx(tip, abs=0.06)
        assert figures["next"] == pytest.approx(self.told(q).tolist(), abs=0.06)
        if (step := re.search(r"step (\d+)", said)) is not None:
            ends = self.led_to(int(step[1]) - 1)
            assert int(step[1]) <= len(self.served.steps)
            assert ends is None or q == pytest.approx(ends, abs=1e-4)


@pytest.mark.parametrize("seed", range(SEQUENCES))
def test_in_random_sequences_what_is_drawn_is_what_go_sends(
    screens: Screens, served: ServedArm, seed: int
) -> None:
    sequence = Sequence(screens, served, seed)
    ways = (
        sequence.slide, sequence.solve, sequence.choose_a_way, sequence.hover, sequence.type_angles,
        sequence.drag, sequence.other_writes, sequence.another_moves, sequence.reload, sequence.forget,
        sequence.step, sequence.step, sequence.edit_steps, sequence.record, sequence.undo, sequence.pin,
        sequence.fill_with, sequence.go_to_pose, sequence.go, sequence.go, sequence.stop, sequence.other_goes,
    )  # fmt: skip
    try:
        for _ in range(STEPS):
            way = ways[int(sequence.random.integers(len(ways)))]
            sequence.done.append(way.__name__)
            way()
            sequence.looks_true()
    except Exception as broken:
        broken.add_note(f"done: {', '.join(sequence.done)}")
        raise
    assert sequence.page.errors == [] and sequence.other.errors == []
