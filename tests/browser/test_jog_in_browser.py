"""Jogging joints and tool with held buttons and with the keyboard, and the gripper."""

from __future__ import annotations

import re

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.protocol import MoveGripper

pytestmark = pytest.mark.browser
TAB = "Manual"
SWITCH_ON, SWITCH_OFF = "Keyboard jog is off: press to switch on", "Keyboard jog is ON: press to switch off"


def hold_key(screen: Screen, key: str, presses: int) -> None:
    """Press a key and keep it down: the browser is told of its repeats as a computer's keyboard does it."""
    keyboard = screen.page.keyboard
    for _ in range(presses):
        keyboard.down(key)
    keyboard.up(key)


def test_the_arm_jogs_while_a_button_is_held_and_says_why_where_it_cannot(
    page: Screen, served: ServedArm
) -> None:
    page.open_tab("Jog & gripper")
    page.hold("Shoulder +", 600)
    served.wait_for(page, State.HOLDING)
    assert 90.5 < served.commanded_deg[1] < 110
    assert [served.commanded_deg[i] for i in (0, 2, 3, 4)] == [HOME[i] for i in (0, 2, 3, 4)]
    page.type_into("Gripper %", "30")
    page.click("Set gripper")
    page.wait_for_text(re.compile("Commanded: 30 %"))
    page.screenshot("manual-jog")
    assert served.now.gripper == pytest.approx(0.3)
    served.order(MoveGripper(0.8))  # by somebody else: a slider that nobody edits follows
    page.wait_until(lambda: page.number("Gripper %") == 80, "the slider shows where the gripper is")
    page.type_into("Gripper %", "20")
    served.order(MoveGripper(0.6))
    page.wait_for_text(re.compile("Commanded: 60 %"))
    assert page.number("Gripper %") == 20

    page.open_tab("Tool")
    less, more = (page.button(f"Y {sign}").bounding_box() for sign in "−+")
    assert less is not None and more is not None
    assert less["y"] == more["y"] and less["x"] + less["width"] < more["x"]
    before = served.tool_mm
    page.hold("Y +", 1200)
    served.wait_for(page, State.HOLDING)
    moved = served.tool_mm - before
    assert moved[1] > 5
    assert np.abs(moved[[0, 2]]).max() < 0.1
    assert served.now.cause == "jog finished"
    page.screenshot("jog-tool")
    page.choose("Along the", "tool axes")
    approach = served.robot.forward(served.now.q_command)[:3, 2]
    before = served.tool_mm
    page.hold("Z +", 1200)
    served.wait_for(page, State.HOLDING)
    moved = served.tool_mm - before
    assert moved @ approach > 5
    assert np.linalg.norm(moved - approach * (moved @ approach)) < 0.1

    served.arm.release()
    page.open_tab("Joint")
    page.wait_for_text("The arm is off; enable first.")
    assert not page.is_enabled("Base −")
    page.hold("Base −", 300)
    assert page.notifications() == []
    assert not any("refused" in event.text for event in served.now.events)
    assert page.errors == []


def test_keys_move_the_arm_while_they_are_switched_on_by_the_page_that_operates(
    page: Screen, screens: Screens, served: ServedArm
) -> None:
    def moves_nothing(key: str) -> None:
        before = served.commanded_deg
        hold_key(page, key, 5)
        page.pause(500)
        assert served.commanded_deg == before

    page.open_tab("Jog & gripper", "Keyboard")
    moves_nothing("r")
    page.click(SWITCH_ON)
    page.wait_for_text("25 % of each joint's speed")
    page.entry("Gripper %").click()
    moves_nothing("r")  # it is typed into a field
    page.leave("Gripper %")
    hold_key(page, "r", 1)
    page.wait_until(lambda: served.commanded_deg[0] > 0.3, "the base has turned a step")
    served.wait_for(page, State.HOLDING)
    tap = served.commanded_deg[0]
    assert tap < 3
    hold_key(page, "f", 20)
    served.wait_for(page, State.HOLDING)
    assert served.commanded_deg[0] < tap - 1
    assert served.commanded_deg[1:] == HOME[1:]
    page.screenshot("jog-keys")

    page.choose("Keys move", "Tool, base axes")
    page.wait_for_text("30 mm/s")
    before = served.tool_mm
    hold_key(page, "y", 20)
    let_go = served.now.stamp
    served.wait_for(page, State.HOLDING)
    assert served.now.stamp - let_go < 1.0
    moved = served.tool_mm - before
    assert moved[2] > 1
    assert np.abs(moved[:2]).max() < 0.1

    page.click(SWITCH_OFF)
    page.pause(200)
    moves_nothing("y")

    operator, watcher = page, screens(served.url)
    watcher.open_tab("Manual", "Jog & gripper", "Keyboard")
    expect(watcher.button(SWITCH_ON)).to_be_disabled()
    operator.click(SWITCH_ON)
    watcher.click("Take control")
    watcher.wait_for_text(re.compile(r"Take it from .*\? Press again"))
    watcher.click("Take control")
    operator.wait_until(lambda: operator.button(SWITCH_ON).count() == 1, "its keys are off")
    before = served.commanded_deg
    hold_key(operator, "r", 5)
    operator.pause(500)
    assert served.commanded_deg == before
    assert page.errors == []
