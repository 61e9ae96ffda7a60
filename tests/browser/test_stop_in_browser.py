"""STOP from every place of the page, on every screen, and without a sign of life."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, expect
from tests.browser.kit import PATIENCE_MS, Screen
from tests.browser.served_arm import ServedArm

from armctl.facts import State
from armctl.program import Program, WaitStep
from armctl.protocol import MoveJoints, SetSpeed, TakeControl
from armctl.ui.app import SILENCE_S

pytestmark = pytest.mark.browser

STOPPED = "STOP (browser page 1)"
SILENT = "STOP (browser page 1: the operator's page does not answer)"

_CONTRAST = """button => {
  const light = (colour) => {
    const [r, g, b] = colour.match(/[0-9.]+/g).slice(0, 3).map((part) => {
      const value = part / 255;
      return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const style = getComputedStyle(button);
  const [dark, bright] = [light(style.backgroundColor), light(style.color)].sort((a, b) => a - b);
  return (bright + 0.05) / (dark + 0.05);
}"""
"""of a button's letters against their background, by WCAG 2.2"""


def set_off(served: ServedArm, screen: Screen) -> None:
    """Begin a motion that takes a minute."""
    served.order(SetSpeed(0.05))
    there = served.robot.pose("home") + np.array([1.2 if served.now.q_command[0] < 0.6 else 0.0, 0, 0, 0, 0])
    asked = [served.order(MoveJoints(there))]

    def moves() -> bool:
        if asked[-1].finished.done():  # stopped: on a busy computer the page may seem to hang
            asked.append(served.order(MoveJoints(there)))
        return served.now.state is State.MOVING

    screen.wait_until(moves, "the arm moves")


def stops(screen: Screen) -> Locator:
    """What a person who cannot see, and a test outside, find by the name STOP."""
    return screen.page.get_by_role("button", name="STOP")


def assert_large_and_dark(screen: Screen) -> None:
    (box, size) = (stops(screen).bounding_box(), screen.page.viewport_size)
    assert box is not None and size is not None
    assert box["height"] >= 44 and box["width"] >= 44
    assert box["x"] >= 0 and box["x"] + box["width"] <= size["width"]
    assert box["y"] >= 0 and box["y"] + box["height"] <= size["height"]
    assert stops(screen).evaluate(_CONTRAST) >= 4.5


def in_a_number_field(screen: Screen) -> None:
    screen.open_tab("Inverse")
    screen.entry("X mm").click()


def in_a_text_field(screen: Screen) -> None:
    screen.open_tab("Manual", "Serial motion")
    screen.unfold("Files", "Upload")
    screen.entry("Name").click()


def in_an_open_dropdown(screen: Screen) -> None:
    screen.open_tab("Main")
    screen.press(screen.entry("Port"))
    screen.page.get_by_role("option", name="Simulated board").first.wait_for()


def in_the_command_palette(screen: Screen) -> None:
    screen.page.keyboard.press("Control+K")
    screen.page.get_by_placeholder("Search commands...").wait_for()


def on_the_scene(screen: Screen) -> None:
    size = screen.page.viewport_size
    assert size is not None
    screen.page.mouse.click(size["width"] / 2, size["height"] / 2)


def on_a_button(screen: Screen) -> None:
    screen.button("Pause").focus()


def test_stop_is_one_large_dark_button_in_view_and_escape_from_every_place(
    page: Screen, served: ServedArm
) -> None:
    expect(page.page).to_have_title(f"armctl – {served.robot.title}")
    expect(stops(page)).to_have_count(1)
    assert_large_and_dark(page)
    box = stops(page).bounding_box()
    assert box is not None
    set_off(served, page)
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.page.mouse.down()
    served.wait_for(page, State.HOLDING)
    page.page.mouse.up()
    page.pause(300)
    assert [event.text for event in served.now.events].count(STOPPED) == 1

    for width, height in ((1280, 60), (700, 500), (1920, 1080)):
        page.page.set_viewport_size({"width": width, "height": height})
        expect(stops(page)).to_have_count(1)
        assert_large_and_dark(page)
        set_off(served, page)
        stops(page).click()
        served.wait_for(page, State.HOLDING)
    page.page.set_viewport_size({"width": 1280, "height": 800})

    places: tuple[Callable[[Screen], None], ...] = (
        in_a_number_field,
        in_a_text_field,
        in_an_open_dropdown,
        on_the_scene,
        on_a_button,
        in_the_command_palette,
    )
    before = [event.text for event in served.now.events].count(STOPPED)
    for count, place in enumerate(places, start=1):
        set_off(served, page)
        place(page)
        assert served.now.state is State.MOVING
        page.page.keyboard.press("Escape")
        served.wait_for(page, State.HOLDING)
        page.pause(300)  # longer than the second way of the same press takes, through viser
        assert [event.text for event in served.now.events].count(STOPPED) == before + count, place.__name__
    assert page.errors == []


@pytest.fixture
def phone(browser: Browser, served: ServedArm) -> Iterator[Screen]:
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    screen = Screen(context.new_page())
    screen.page.goto(served.url)
    stops(screen).wait_for()
    yield screen
    context.close()


def test_on_a_phone_the_row_of_tabs_scrolls_to_the_last(phone: Screen) -> None:
    last = phone.page.get_by_role("tab", name="Log", exact=True)
    expect(last).not_to_be_in_viewport()
    last.tap()
    expect(last).to_be_in_viewport(ratio=0.9)
    expect(phone.button("Download report")).to_be_visible(timeout=PATIENCE_MS)
    row = "element => [element.parentElement.scrollWidth, element.offsetLeft + element.offsetWidth]"
    width, end = last.evaluate(row)
    assert width == pytest.approx(end, abs=24)  # nothing to scroll to beyond it
    assert phone.page.evaluate("innerWidth") == 390


_TOP = "element => element.getBoundingClientRect().top"


def test_on_a_phone_a_tab_below_the_open_program_comes_into_view(phone: Screen) -> None:
    phone.page.get_by_role("button", name="Serial motion").first.tap()
    expect(phone.button("Add step ▾")).to_be_visible(timeout=PATIENCE_MS)
    tab = phone.page.get_by_role("tab", name="Inverse", exact=True)
    phone.wait_until_at_rest(tab)
    # Playwright's own tap scrolls by itself.
    tab.evaluate("tab => { tab.scrollIntoView({ block: 'end' }); tab.click() }")
    sheet = tab.evaluate("tab => tab.closest('.mantine-ScrollArea-viewport').getBoundingClientRect().top")
    phone.wait_until(lambda: tab.evaluate(_TOP) < sheet + 20, "the tabs are right below the picture")
    expect(phone.button("Solve")).to_be_in_viewport(ratio=1, timeout=PATIENCE_MS)
    expect(phone.button("Go by least energy")).to_be_in_viewport(ratio=1)
    before = tab.evaluate(_TOP)
    phone.page.get_by_role("tab", name="Forward", exact=True).tap()
    expect(phone.button("Go with respect to reference")).to_be_visible(timeout=PATIENCE_MS)
    assert tab.evaluate(_TOP) == before


def test_on_a_phone_a_list_that_opens_leaves_stop_where_it_is(phone: Screen) -> None:
    phone.page.get_by_role("tab", name="Trajectory", exact=True).tap()
    phone.entry("To").tap()
    option = phone.page.get_by_role("option", name="home", exact=True).locator("visible=true")
    expect(option).to_be_in_viewport(ratio=1)
    expect(stops(phone)).to_be_in_viewport(ratio=1)
    assert phone.page.evaluate("innerWidth") == 390
    option.tap()


def test_on_a_phone_stop_is_in_view_wherever_one_scrolls(phone: Screen, served: ServedArm) -> None:
    for tab in ("Inverse", "Manual"):
        phone.page.get_by_role("tab", name=tab, exact=True).tap()
        set_off(served, phone)
        expect(stops(phone)).to_have_count(1)
        assert_large_and_dark(phone)
        phone.page.mouse.move(300, 700)
        phone.page.mouse.wheel(0, 3000)
        phone.pause(300)
        assert_large_and_dark(phone)
        phone.screenshot(f"stop-phone-{tab.lower()}")
        stops(phone).tap()
        served.wait_for(phone, State.HOLDING)
    assert phone.errors == []


def test_on_a_phone_words_leave_the_picture_to_the_arm_and_can_be_read(
    phone: Screen, served: ServedArm
) -> None:
    state, over = phone.page.locator("#armctl-top .state span"), phone.page.locator("#armctl-over p.cause")
    expect(state).to_have_text("enabling finished")
    expect(state).to_be_in_viewport(ratio=1)
    expect(over).to_be_hidden()
    name = "more letters than there is room for"
    served.arm.run(Program(robot="uzuner", name=name, steps=(WaitStep(seconds=0.1),)))
    expect(over).to_have_text(f"Program '{name}' finished.")
    expect(over).to_be_visible()
    phone.page.get_by_role("tab", name="Manual", exact=True).tap()
    limit = phone.page.locator(".mantine-Slider-markLabel").first
    limit.wait_for()
    assert limit.evaluate("element => parseFloat(getComputedStyle(element).fontSize)") >= 11


def test_a_page_that_hangs_stops_the_arm_within_a_second_and_one_without_its_line_through_viser(
    page: Screen, served: ServedArm
) -> None:
    app = served.app
    served.app.server.stop_lines.attend(app._stop, app._silent, SILENCE_S)
    # the best of a few: on a loaded machine everything comes late, the browser's timers included
    took: list[float] = []
    while not took or (took[-1] > 1.0 and len(took) < 3):
        set_off(served, page)
        page.pause(500)
        began = time.time()
        page.page.evaluate("() => { const end = Date.now() + 1500; while (Date.now() < end); }")
        lines = [event for event in served.now.events if event.text == SILENT and event.stamp > began]
        assert len(lines) == 1
        took.append(lines[0].stamp - began)
    assert 0.4 < took[-1] <= 1.0, took

    set_off(served, page)
    served.app.server.stop_lines.close()
    told = page.page.get_by_role("alert")
    told.filter(has_text="STOP goes over the page's own line").wait_for(timeout=PATIENCE_MS)
    stops(page).click()
    served.wait_for(page, State.HOLDING)
    set_off(served, page)
    page.page.evaluate("globalThis.armctlTell = () => false")  # that line is lost, too
    told.filter(has_text="STOP does not reach the arm. Use the power").wait_for(timeout=PATIENCE_MS)
    page.screenshot("stop-not-connected")
    in_a_number_field(page)
    assert served.now.state is State.MOVING
    page.page.keyboard.press("Escape")
    served.wait_for(page, State.HOLDING)


def test_without_webgl_all_but_the_picture_works(screen: Screen, served: ServedArm) -> None:
    screen.page.add_init_script(
        "const context = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        "  return /webgl/.test(kind) ? null : context.call(this, kind, ...more); };"
    )
    try:
        screen.open(served.url, until="Enable")
        expect(screen.page.locator("#armctl-told p")).to_contain_text("draws no 3D (WebGL)", timeout=20_000)
        screen.open_tab("Inverse")
        screen.type_xyz("220", "-196", "85")
        screen.click("Solve")
        screen.page.get_by_role("option", name="elbow down").click()
        screen.click("Go by the selected one")
        served.wait_for(screen, State.MOVING)
        screen.screenshot("no-webgl")
        screen.click("STOP")
        served.wait_for(screen, State.HOLDING)
        assert served.now.cause.startswith("stopped by")
    finally:
        screen.page.close()  # the script would stay in this window


def test_stop_stands_though_viser_s_page_is_not_as_it_was(screen: Screen, served: ServedArm) -> None:
    # armctl's script for viser's page cannot begin where its name is taken
    screen.page.add_init_script("Object.defineProperty(window, 'armctlViser', { value: {} });")
    screen.open(served.url, until="STOP")
    screen.wait_until(lambda: served.now.control.operator is not None, "the page has come")
    served.order(TakeControl())  # else the motion of a page that does not answer is stopped by itself
    set_off(served, screen)
    screen.page.keyboard.press("Escape")
    served.wait_for(screen, State.HOLDING)
    assert served.now.cause.startswith("stopped by")
    assert any("armctlViser" in one or "viser's page" in one for one in screen.errors)
    screen.page.close()  # the window would keep that script
