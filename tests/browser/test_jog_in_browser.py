"""Jogging the tool with held buttons, and joints and tool with the keyboard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm

from armctl.runtime import State

pytestmark = pytest.mark.browser

HOME = [0.0, 90.0, -80.0, -40.0, 0.0]
SWITCH_ON, SWITCH_OFF = "Keyboard jog is off: press to switch on", "Keyboard jog is ON: press to switch off"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    with served_arm(tmp_path / "programs") as served:
        yield served


def opened(screen: Screen, tab: str) -> None:
    screen.open_tab("Manual")
    screen.open_tab("Jog & gripper")
    screen.open_tab(tab)


def tool_mm(served: ServedArm) -> np.ndarray:
    return 1000 * served.robot.forward(served.now.q_command)[:3, 3]


def stands(screen: Screen, served: ServedArm) -> None:
    screen.wait_until(lambda: served.now.state is State.HOLDING, "the arm stands")


def hold_key(screen: Screen, key: str, presses: int) -> None:
    """Press a key and keep it down: the browser is told of its repeats as a computer's keyboard does it."""
    keyboard = screen.page.keyboard
    for _ in range(presses):
        keyboard.down(key)
    keyboard.up(key)


def test_a_held_button_moves_the_tool_along_its_axis(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="STOP")
    opened(screen, "Tool")
    before = tool_mm(served)
    screen.hold("Y +", 1200)
    stands(screen, served)
    moved = tool_mm(served) - before
    assert moved[1] > 5
    assert np.abs(moved[[0, 2]]).max() < 0.1
    assert served.now.cause == "jog finished"
    screen.screenshot("jog-tool")
    screen.choose("Along the", "tool axes")
    approach = served.robot.forward(served.now.q_command)[:3, 2]
    before = tool_mm(served)
    screen.hold("Z +", 1200)
    stands(screen, served)
    moved = tool_mm(served) - before
    assert moved @ approach > 5
    assert np.linalg.norm(moved - approach * (moved @ approach)) < 0.1
    assert screen.errors == []


def test_keys_move_nothing_until_they_are_switched_on(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="STOP")
    opened(screen, "Keyboard")
    hold_key(screen, "r", 5)
    screen.pause(500)
    assert served.commanded_deg == HOME
    screen.click(SWITCH_ON)
    screen.wait_for_text("25 % of each joint's speed")
    screen.pause(200)
    hold_key(screen, "r", 1)
    screen.wait_until(lambda: served.commanded_deg[0] > 0.3, "the base has turned a step")
    stands(screen, served)
    tap = served.commanded_deg[0]
    assert tap < 3
    hold_key(screen, "f", 20)
    stands(screen, served)
    assert served.commanded_deg[0] < tap - 1
    assert served.commanded_deg[1:] == HOME[1:]
    screen.screenshot("jog-keys")
    screen.click(SWITCH_OFF)
    screen.pause(200)
    after = served.commanded_deg
    hold_key(screen, "r", 5)
    screen.pause(500)
    assert served.commanded_deg == after
    assert screen.errors == []


def test_keys_move_the_tool_and_stop_when_let_go(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="STOP")
    opened(screen, "Keyboard")
    screen.click(SWITCH_ON)
    screen.click("Tool, base axes")
    screen.wait_for_text("30 mm/s")
    before = tool_mm(served)
    hold_key(screen, "y", 20)
    let_go = served.now.stamp
    stands(screen, served)
    assert served.now.stamp - let_go < 1.0
    moved = tool_mm(served) - before
    assert moved[2] > 1
    assert np.abs(moved[:2]).max() < 0.1


def test_keys_typed_into_a_field_move_nothing(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="STOP")
    opened(screen, "Keyboard")
    screen.click(SWITCH_ON)
    box = screen.entry("Gripper %")
    box.click()
    for _ in range(5):
        screen.page.keyboard.down("r")
    screen.page.keyboard.up("r")
    screen.pause(500)
    assert served.commanded_deg == HOME


def test_a_page_that_watches_has_no_keys(screens: Screens, served: ServedArm) -> None:
    operator, watcher = screens(served.url), screens(served.url)
    opened(watcher, "Keyboard")
    watcher.click(SWITCH_ON)
    watcher.wait_for_notification("this page is watching")
    opened(operator, "Keyboard")
    operator.click(SWITCH_ON)
    watcher.click("Take control")
    operator.wait_until(lambda: operator.button(SWITCH_ON).count() == 1, "its keys are off")
    hold_key(operator, "r", 5)
    operator.pause(500)
    assert served.commanded_deg == HOME
