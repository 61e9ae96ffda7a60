"""What lies under the pointer stays there, whatever the arm does and whatever is pressed."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Locator
from tests.browser.kit import Screen
from tests.browser.served_arm import ServedArm

from armctl.facts import State

pytestmark = pytest.mark.browser


def place(target: Locator) -> tuple[float, float]:
    """Where something begins in the page [px]."""
    x, y = target.evaluate("element => { const at = element.getBoundingClientRect(); return [at.x, at.y]; }")
    return round(x), round(y)


def stays(target: Callable[[], Locator], act: Callable[[], object]) -> None:
    before = place(target())
    act()
    assert place(target()) == before


_WATCH = """label => new Promise(done => {
  const seen = new Set();
  let began = Infinity;
  const look = () => {
    for (const one of document.querySelectorAll("label[for]"))
      if (one.offsetParent && one.textContent === label) seen.add(Math.round(one.getBoundingClientRect().y));
    if (seen.size) began = Math.min(began, performance.now());
    if (performance.now() - began > 1500) done(seen.size);
    else requestAnimationFrame(look);
  };
  look();
})"""
"""in how many places a label was since it can be seen"""


def test_what_a_tab_shows_stays_where_it_is_from_its_first_moment_on(page: Screen) -> None:
    for tab, label in (("Manual", "Wrist roll °"), ("Forward", "Movement"), ("Simulation", "Download")):
        page.page.evaluate(f"void (globalThis.armctlPlaces = ({_WATCH})({label!r}))")
        page.open_tab(tab)
        assert page.page.evaluate("globalThis.armctlPlaces") == 1, tab


def test_nothing_moves_away_when_it_is_pressed_or_the_arm_moves(page: Screen, served: ServedArm) -> None:
    page.open_tab("Main", "Who operates")
    stays(lambda: page.tab("Who operates"), lambda: page.open_tab("Arm"))
    stays(lambda: page.tab("Manual"), lambda: page.open_tab("Trajectory"))

    def ask() -> None:
        page.click("Release")
        page.wait_for_text("Drops! Press again")

    stays(lambda: page.button("Enable"), ask)

    page.open_tab("Manual", "Joints")
    page.wait_for_text("The sliders show the arm")

    def slide() -> None:
        page.slide("Base °", 0.9)
        page.wait_for_text("The sliders show the next pose")

    stays(lambda: page.row("Wrist roll °"), slide)

    page.open_tab("Inverse")

    def solve() -> None:
        page.type_xyz("220", "-60", "100")
        page.click("Solve")
        page.wait_for_text("solutions inside the limits")

    stays(lambda: page.row("X mm"), solve)
    stays(lambda: page.button("Go by least energy"), lambda: page.type_xyz("220", "-196", "85"))
    stays(lambda: page.button("Go by least energy"), solve)
    page.type_into("Duration s", "20")

    def go() -> None:
        page.click("Go by least energy")
        served.wait_for(page, State.MOVING)
        page.wait_for_text("The arm is moving; stop first.")

    stays(lambda: page.row("Least energy is"), go)
    page.click("STOP")
    served.wait_for(page, State.HOLDING)
