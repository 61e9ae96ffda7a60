"""Two pages and one arm: who operates, who watches, and a teacher's PIN."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm

from armctl.protocol import Origin

pytestmark = pytest.mark.browser

PIN = "4711"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    """A console whose teacher has a PIN."""
    with served_arm(tmp_path / "files", pin=PIN) as served:
        yield served


def operator(served: ServedArm) -> str | None:
    party = served.now.control.operator
    return None if party is None else party.name


def logged(served: ServedArm, text: str) -> bool:
    return any(text in event.text for event in served.now.events)


def opened(screens: Screens, served: ServedArm) -> tuple[Screen, Screen]:
    """Two pages; the first operates, and both show who is there."""
    pages = screens(served.url), screens(served.url)
    for page in pages:
        page.open_tab("Who operates")
    assert operator(served) == "browser page 1"
    return pages


def test_control_is_asked_for_told_logged_and_locked_and_the_lock_opens_for_the_teacher_alone(
    screens: Screens, served: ServedArm
) -> None:
    first, second = opened(screens, served)
    first.type_into("Your name", "Ada")
    second.type_into("Your name", "Bob")
    second.wait_for_text("Operator: Ada")
    first.wait_for_text("1 watching")
    second.wait_for_text("WATCHING: Ada operates the arm")
    for page in (first, second):
        page.open_tab("Arm")
    second.wait_for_text("This page is watching; press 'Take control' first.")
    expect(second.button("Home")).to_be_disabled()
    second.wait_for_text("Press Take control at the top.")
    second.click("Take control")
    second.wait_for_text("Take it from Ada? Press again")
    assert operator(served) == "Ada"
    second.click("Take control")
    first.wait_for_text("This page watches now: Bob operates the arm.")
    second.wait_for_text("This page now operates the arm.")
    second.wait_for_text("Press Enable at the top.")
    assert operator(served) == "Bob"
    assert logged(served, "Bob has taken control of the arm; Ada watches now")
    first.wait_for_text("Operator: Bob")
    expect(first.button("Take control")).to_be_visible()
    expect(second.page.get_by_role("button", name="Take control", exact=True)).to_have_count(0)
    first.screenshot("people-watcher")
    second.screenshot("people-operator")
    first.wait_for_text("WATCHING: Bob operates the arm")
    expect(first.button("Home")).to_be_disabled()
    expect(second.page.locator("#armctl-watching")).to_be_hidden()
    first.click("STOP")  # everybody's
    first.wait_until(lambda: logged(served, "STOP (browser page 1)"), "who watches stops it")

    for page in (first, second):
        page.open_tab("Who operates")
    second.click("Lock control")
    first.wait_for_text("Control is locked by the operator.")
    first.click("Take control")
    first.click("Take control")
    first.wait_for_text("Bob has locked control; ask for it to be unlocked, or give the teacher's PIN")
    first.type_into("Teacher's PIN", "0000")
    first.click("Take control of the arm")
    first.wait_for_text("that is not the teacher's PIN")
    second.wait_for_text("Wrong PINs in the last hour:")
    second.wait_for_text("Ada: 1 · pages at 127.0.0.1")
    first.wait_until(lambda: first.value("Teacher's PIN") == "", "the PIN does not stay on the screen")
    first.type_into("Teacher's PIN", PIN)
    first.click("Take control of the arm")
    second.wait_for_text("This page watches now: Ada operates the arm.")
    assert not logged(served, PIN)
    assert served.now.control.operates("browser page 1")
    served.console.controller.stop(Origin("test")).result(5)
    first.page.close()
    second.wait_until(lambda: operator(served) is None, "control is free")
    assert logged(served, "Ada no longer operates: the operator's page is gone; control is free")
