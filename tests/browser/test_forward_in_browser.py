"""The Forward screen as an operator uses it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.browser.ghost_view import wait_for_ghost, wait_for_no_ghost
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm

from armctl.runtime import State

pytestmark = pytest.mark.browser
HOME = [0.0, 90.0, -80.0, -40.0, 0.0]
_TYPE_AND_CLICK = """(box, button) => {
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
  for (const text of ['4', '45']) {
    set.call(box, text);
    box.dispatchEvent(new Event('input', {bubbles: true}));
  }
  button.click();
}"""
REFERENCE, LAST = "Go with respect to reference", "Go with respect to last position"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    with served_arm(tmp_path / "programs") as served:
        yield served


@pytest.fixture
def page(screen: Screen, served: ServedArm) -> Screen:
    screen.open(served.url, until="STOP")
    screen.open_tab("Forward")
    return screen


def stands_at(page: Screen, served: ServedArm, degrees: list[float]) -> None:
    page.wait_until(
        lambda: served.commanded_deg == degrees and served.now.state is State.HOLDING,
        f"the arm stands at {degrees}",
    )


def test_go_with_respect_to_reference(page: Screen, served: ServedArm) -> None:
    page.type_into("Base °", "30")
    page.type_into("Elbow °", "-45.5")
    asked = [30.0, 90.0, -45.5, -40.0, 0.0]
    wait_for_ghost(page, served.robot, np.radians(asked))
    x, _, z = (1000 * served.robot.forward(np.radians(asked))[:3, 3]).tolist()
    page.wait_for_text(f"{x:.1f}")
    page.wait_for_text(f"{z:.1f}")
    assert served.commanded_deg == HOME  # editing moves nothing
    page.screenshot("forward-editing")
    page.click(REFERENCE)
    stands_at(page, served, asked)
    wait_for_no_ghost(page, served.robot)
    assert page.errors == []


def test_go_with_respect_to_last_position(page: Screen, served: ServedArm) -> None:
    for label, value in zip(
        ("Base °", "Shoulder °", "Elbow °", "Wrist pitch °", "Wrist roll °"), (10, -5, 2.5, 0, 1), strict=True
    ):
        page.type_into(label, str(value))
    page.choose("Movement", "Normal movement")
    page.click(LAST)
    stands_at(page, served, [10.0, 85.0, -77.5, -40.0, 1.0])
    page.click(LAST)
    stands_at(page, served, [20.0, 80.0, -75.0, -40.0, 2.0])


def test_a_planned_movement_takes_its_duration(page: Screen, served: ServedArm) -> None:
    page.type_into("Base °", "10")
    page.type_into("Duration s", "0.1")
    page.click(REFERENCE)
    page.wait_for_notification(re.compile(r"shortest possible duration is 0\.4"))
    assert served.commanded_deg == HOME
    page.type_into("Duration s", "2")
    page.click(REFERENCE)
    page.wait_until(lambda: served.now.state is State.MOVING, "the arm moves")
    assert served.now.remaining_s > 1.0
    stands_at(page, served, [10.0, *HOME[1:]])


@pytest.mark.parametrize(
    ("typed", "why"),
    [
        ("", "Shoulder ° is empty"),
        ("nan", "Shoulder °: 'nan' is not a number"),
        ("1e999", "Shoulder °: '1e999' is not a number"),
        ("4,5", "with a point"),
        ("-", "Shoulder °: '-' is not a number"),
    ],
)
def test_what_is_no_number_never_moves_the_arm(page: Screen, served: ServedArm, typed: str, why: str) -> None:
    page.type_into("Base °", "20")
    page.entry("Shoulder °").fill(typed)
    page.pause(300)
    page.wait_for_text(re.compile("Nothing can be sent"))
    for button in (REFERENCE, LAST):
        page.click(button)
        page.wait_for_notification(why)
    assert served.commanded_deg == HOME
    assert served.now.state is State.HOLDING


def test_a_limit_is_named_with_its_value(page: Screen, served: ServedArm) -> None:
    page.type_into("Shoulder °", "150")
    page.click(REFERENCE)
    page.wait_for_notification("Shoulder: 150.00° is outside -3.19° … 146.83°")
    assert served.commanded_deg == HOME
    page.screenshot("forward-limit")


def test_a_click_that_overtakes_a_digit_shows_what_the_server_has(page: Screen, served: ServedArm) -> None:
    """Typing 45 and clicking within 50 ms: the page loses the 5, and must not go on showing it."""
    page.pause(300)
    page.entry("Base °").evaluate(_TYPE_AND_CLICK, page.button(REFERENCE).element_handle())
    page.wait_until(lambda: page.value("Base °") == "4", "the field shows what the server has")
    assert served.commanded_deg[0] <= 4.0
    page.pause(300)
    page.wait_until(lambda: served.now.state is State.HOLDING, "the arm stands")
    page.click(REFERENCE)
    stands_at(page, served, [4.0, *HOME[1:]])


def test_fields_are_filled_and_figures_follow(page: Screen, served: ServedArm) -> None:
    page.click("zero")
    page.wait_until(lambda: page.value("Shoulder °") == "0", "the fields hold the zero pose")
    wait_for_ghost(page, served.robot, np.zeros(5))
    page.wait_for_text("330.00")
    page.wait_for_text("singular")
    page.choose("Show for", "present pose (live)")
    wait_for_no_ghost(page, served.robot)
    page.wait_for_text("well away from singularities")
    page.screenshot("forward-figures")
    page.click("present pose")
    page.wait_until(lambda: page.value("Shoulder °") == "90", "the fields hold the present pose")


def test_a_watching_page_cannot_move_the_arm(screens: Screens, served: ServedArm) -> None:
    first, second = screens(served.url), screens(served.url)
    second.open_tab("Forward")
    second.type_into("Base °", "15")
    second.click(REFERENCE)
    second.wait_for_notification(re.compile("this page is watching"))
    assert served.commanded_deg == HOME
    assert first.errors == []
