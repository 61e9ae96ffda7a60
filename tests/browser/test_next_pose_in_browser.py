"""One next pose a page, in a browser: what is drawn and written is what *Go* sends, and no other."""

from __future__ import annotations

import os
import re

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import expect
from tests.browser.ghost_view import arrow_px, ghost_tip_mm, wait_for_no_ghost
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.program import MoveStep
from armctl.protocol import MoveJoints

pytestmark = pytest.mark.browser
TAB = "Manual"
SEQUENCES, STEPS = (300, 12) if os.environ.get("ARMCTL_LONG") else (1, 10)


def line(page: Screen) -> str:
    return page.text("armctl-part[name=next]").replace("−", "-")


def written_mm(page: Screen) -> NDArray[np.float64] | None:
    """X, Y and Z that the line writes; None: there is no next pose."""
    found = re.findall(r"[XYZ] (-?[\d.]+)", line(page))
    return np.array(found, dtype=np.float64) if len(found) == 3 else None


def beside_the_arm_mm(page: Screen) -> NDArray[np.float64] | None:
    """X, Y and Z in the column *next* over the picture; None: there is no such column."""
    rows = page.page.locator("[name=where] tr").all_inner_texts()
    cells = [re.findall(r"-?[\d.]+(?= mm)", row.replace("−", "-")) for row in rows]
    next_ones = [row[1] for row in cells if len(row) == 2]
    return np.array(next_ones, dtype=np.float64) if next_ones else None


def wait_for_next(page: Screen) -> None:
    page.wait_until(lambda: written_mm(page) is not None, "there is a next pose")


def drag_tool(page: Screen, dx: float, dy: float) -> None:
    """Drag the upward arrow at the tool by so many pixels."""
    page.page.evaluate("document.querySelector('#webgl-software-rendering button')?.click()")
    x, y = arrow_px(page, "/tool", 0.035)
    mouse = page.page.mouse
    mouse.move(x, y)
    page.pause(300)
    mouse.down()
    for step in range(1, 6):
        mouse.move(x + dx * step / 5, y + dy * step / 5)
        page.pause(60)
    mouse.up()
    page.pause(300)


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
    watcher.wait_until(lambda: ghost_tip_mm(watcher, theirs) is not None, "it is drawn for who watches")
    assert ghost_tip_mm(watcher, theirs) == pytest.approx(drawn, abs=0.01)
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


class Sequence:
    """What is done to two pages and one arm, at random."""

    def __init__(self, screens: Screens, served: ServedArm, seed: int) -> None:
        self.served, self.random = served, np.random.default_rng(seed)
        self.page, self.other = screens(served.url), screens(served.url)

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

    def other_writes(self) -> None:
        before = written_mm(self.page)
        self.other.open_tab("Manual", "Joints")
        self.other.type_into("Wrist roll °", f"{self.random.uniform(-40, 40):.1f}")
        after = written_mm(self.page)
        assert (before is None) is (after is None)
        assert before is None or np.array_equal(before, after)

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

    def go(self, *, stop: bool = False) -> None:
        tip, go = ghost_tip_mm(self.page), self.page.button("Go")
        if written_mm(self.page) is None or not go.is_enabled():
            return
        assert tip is not None
        self.page.click("Go")
        if stop:
            self.page.page.keyboard.press("Escape")
            self.served.wait_for(self.page, State.HOLDING)
            return
        self.served.wait_for(self.page, State.HOLDING)
        self.page.wait_until(
            lambda: bool(np.abs(self.served.tool_mm - tip).max() < 0.06), "the tool is where the ghost was"
        )

    def looks_true(self) -> None:
        """Ghost, line and numbers say the same, once the page has come to rest."""
        self.page.pause(600)
        written, beside, tip = written_mm(self.page), beside_the_arm_mm(self.page), ghost_tip_mm(self.page)
        assert (written is None) is (tip is None) is (beside is None)
        if written is not None and tip is not None:
            assert written == pytest.approx(tip, abs=0.06) and beside == pytest.approx(tip, abs=0.06)
        else:
            assert line(self.page).startswith("No next pose") and not self.page.is_enabled("Go")


@pytest.mark.parametrize("seed", range(SEQUENCES))
def test_in_random_sequences_what_is_drawn_is_what_go_sends(
    screens: Screens, served: ServedArm, seed: int
) -> None:
    sequence = Sequence(screens, served, seed)
    ways = (
        sequence.slide, sequence.solve, sequence.choose_a_way, sequence.hover, sequence.type_angles,
        sequence.drag, sequence.other_writes, sequence.another_moves, sequence.reload, sequence.forget,
        sequence.go, sequence.go, lambda: sequence.go(stop=True),
    )  # fmt: skip
    for _ in range(STEPS):
        ways[int(sequence.random.integers(len(ways)))]()
        sequence.looks_true()
    assert sequence.page.errors == []
