"""Pages for everybody: axe-core on every tab in both themes, and the main job by the keyboard alone."""

from __future__ import annotations

import re
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.program import MoveStep, PointStep
from armctl.protocol import Release, SetSpeed
from armctl.ui.tabs import TABS

pytestmark = pytest.mark.browser
_NAMED = (
    "() => [...document.querySelectorAll('#root p > label[for]')].every((one) => one.dataset.armctlNamed)"
)
_FOCUSED = """() => {
  const one = document.activeElement;
  return one.getAttribute("aria-label") || one.title || one.textContent.trim();
}"""
_MOST_TABS = 150


def violations(page: Screen, rules: list[str], within: str | None = None) -> list[str]:
    """What axe-core calls serious or critical, each with the first element that it is about.

    ``within``: a CSS selector; None: on the whole page.
    """
    page.page.wait_for_function(_NAMED)
    options = {"resultTypes": ["violations"], "runOnly": rules}
    found: list[dict[str, Any]] = Axe().run(page.page, within, options).response["violations"]
    return [
        f"{one['id']}: {one['nodes'][0]['html'][:200]}"
        for one in found
        if one["impact"] in ("serious", "critical")
    ]


def use_theme(page: Screen, theme: str) -> None:
    """The button names the theme that it brings."""
    if page.button(f"{theme} theme").count():
        page.click(f"{theme} theme")
    scheme = f":root[data-mantine-color-scheme={theme.lower()}]"
    page.page.locator(scheme).wait_for(state="attached")


def tab_to(page: Screen, name: str) -> None:
    """Press the tab key until what has this name has the focus."""
    for _ in range(_MOST_TABS):
        page.page.keyboard.press("Tab")
        if page.page.evaluate(_FOCUSED) == name:
            return
    raise AssertionError(f"the tab key does not come to {name!r}")


def open_what_is_folded(page: Screen, served: ServedArm) -> None:
    """A step that is edited and one that is wrong, the graph of the program, and the ways to a point."""
    served.put_steps(MoveStep(joints_deg=(20.0, *HOME[1:])), PointStep(x_mm=5000, y_mm=0, z_mm=0))
    page.click("Check")
    page.wait_for_text(re.compile("too far"))
    page.click("Graph")
    page.click("Program")
    page.page.get_by_label("Steps of the program").get_by_role("row").first.click()
    page.click("Edit row 1")
    page.open_tab("Inverse")
    page.type_xyz("220", "-196", "85")
    page.click("Solve")
    page.page.get_by_role("option", name="elbow down").wait_for()


def test_axe_finds_nothing_serious_on_any_tab_in_either_theme_and_the_keyboard_alone_does_the_main_job(
    page: Screen, served: ServedArm
) -> None:
    open_what_is_folded(page, served)
    for theme, rules in (("Light", ["wcag2a", "wcag2aa", "wcag21aa"]), ("Dark", ["color-contrast"])):
        use_theme(page, theme)
        for number, tab in enumerate(TABS):
            page.open_tab(tab.label)
            panel = f"[data-dock-group]:has([role=tab][title='{tab.label}'])"  # around it all is as it was
            assert page.page.locator(panel).count()
            assert violations(page, rules, panel if number else None) == [], (theme, tab.label)
    use_theme(page, "Light")
    page.page.keyboard.press("Control+K")
    page.wait_for_text("Slow down, and hold")
    assert violations(page, ["color-contrast"]) == []
    page.page.keyboard.press("Escape")
    use_theme(page, "Dark")
    served.put_steps()
    page.page.reload()  # the browser remembers the theme
    page.page.locator(":root[data-mantine-color-scheme=dark]").wait_for(state="attached")

    page.wait_until(lambda: served.now.control.operator is not None, "the page operates again")
    served.order(Release()).result(10)
    page.wait_for_text("OFF")
    page.page.wait_for_function(_NAMED)
    keyboard = page.page.keyboard
    tab_to(page, "Enable")
    keyboard.press("Enter")
    served.wait_for(page, State.HOLDING)
    tab_to(page, "Inverse")
    keyboard.press("Enter")
    page.button("Solve").wait_for()
    page.page.wait_for_function(_NAMED)
    for axis, value in zip("XYZ", ("220", "-60", "100"), strict=True):
        tab_to(page, f"{axis} mm")
        keyboard.press("Control+A")
        keyboard.type(value, delay=20)
        page.pause()
    tab_to(page, "Go by least energy")
    page.pause(300)  # a click that comes with an edit is refused
    keyboard.press("Space")
    page.wait_until(
        lambda: bool(abs(served.tool_mm - [220, -60, 100]).max() < 0.01), "the tool is at the point"
    )


_FILLED = """() => [...document.querySelectorAll("#root .mantine-Button-root, armctl-part button")]
  .filter((one) => {
    const seen = one.checkVisibility({visibilityProperty: true});
    const on = seen && !one.disabled && one.ariaDisabled !== "true";
    return on && getComputedStyle(one).backgroundColor === "rgb(24, 100, 171)";
  }).map((one) => one.textContent.trim())"""


def test_of_all_buttons_one_is_filled_at_most(page: Screen, screens: Screens, served: ServedArm) -> None:
    """What is to be done next: Enable, Go, Resume, Take control, or else what a tab is for."""

    def filled(page: Screen, inverse: str) -> None:
        for tab in TABS:
            page.open_tab(tab.label)
            assert len(page.page.evaluate(_FILLED)) <= 1, tab.label
        page.open_tab("Inverse")
        page.wait_until(lambda: page.page.evaluate(_FILLED) == [inverse], f"{inverse} alone is filled")

    filled(page, "Solve")
    page.open_tab("Manual", "Joints")
    page.slide("Base °", 0.7)
    page.wait_until(lambda: page.is_enabled("Go"), "there is a next pose")
    filled(page, "Go")
    watcher = screens(served.url)
    filled(watcher, "Take control")
    served.order(SetSpeed(0.05)).result(10)
    page.click("Go")
    served.wait_for(page, State.MOVING)
    page.click("Pause")
    served.wait_for(page, State.PAUSED)
    filled(page, "Resume")
    page.click("STOP")
    served.wait_for(page, State.HOLDING)
    page.click("Forget the next pose")
    served.order(Release()).result(10)
    served.wait_for(page, State.OFF)
    filled(page, "Enable")
