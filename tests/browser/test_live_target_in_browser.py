"""The live target as an operator uses it: first on the twin, then on the arm."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.browser.ghost_view import arrow_px
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.protocol import Enable, SetSpeed

pytestmark = pytest.mark.browser
TAB = "Simulation"


def put_target(page: Screen, axis: str, mm: float) -> None:
    page.type_into(f"Target {axis} mm", f"{mm:g}", by_key=True)
    page.click("Put target there")


def test_the_twin_follows_while_the_arm_stands_then_the_arm_until_stop(
    page: Screen, served: ServedArm
) -> None:
    page.choose("Live target", "the twin follows")
    start = served.tool_mm

    def led_mm(by: float) -> bool:
        """Whether the twin is drawn so far beside the arm; it is there before it is where it belongs."""
        tip = page.node("/live_twin/tool")
        return tip is not None and bool(abs(np.linalg.norm(1000 * np.array(tip) - start) - by) < 0.5)

    page.wait_until(lambda: led_mm(0), "the twin is drawn where the arm is")
    put_target(page, "Y", 80)
    page.wait_until(lambda: led_mm(80 - start[1]), "the twin is at the target")
    page.screenshot("live-target-twin")
    assert served.commanded_deg == HOME
    assert served.now.state is State.HOLDING
    put_target(page, "X", 500)
    page.wait_for_text(re.compile("too far by .* mm: .*following the nearest point"))
    page.choose("Live target", "off")
    page.wait_until(lambda: page.node("/live_twin") is None, "the twin is gone")

    page.choose("Live target", "THE ARM follows")
    served.wait_for(page, State.MOVING)
    page.pause(300)
    assert served.commanded_deg == HOME
    put_target(page, "Y", 80)
    page.wait_until(lambda: bool(abs(served.tool_mm[1] - 80) < 0.01), "the arm is at the target")
    page.screenshot("live-target-arm")
    page.click("STOP")
    served.wait_for(page, State.HOLDING)
    page.wait_until(lambda: page.value("Live target") == "off", "the switch is off")
    before = served.commanded_deg
    page.pause(700)
    assert served.commanded_deg == before
    assert page.errors == []


def test_dragging_the_arrows_leads_the_arm_and_a_page_that_hangs_leads_nothing(
    page: Screen, served: ServedArm
) -> None:
    page.dismiss_graphics_warning()
    page.choose("Live target", "THE ARM follows")
    served.wait_for(page, State.MOVING)
    page.pause(500)
    x, y = arrow_px(page, "/live_target", 0.07)
    before = served.tool_mm
    mouse = page.page.mouse
    mouse.move(x, y)
    page.pause(300)
    mouse.down()
    for step in range(1, 11):
        mouse.move(x, y - 4 * step)
        page.pause(60)
    mouse.up()
    page.pause(600)
    after = served.tool_mm
    assert after[2] - before[2] > 5
    assert np.abs(after - before)[:2].max() < 1
    assert page.number("Target Z mm") == pytest.approx(after[2], abs=0.2)
    page.screenshot("live-target-dragged")
    page.click("STOP")
    served.wait_for(page, State.HOLDING)
    page.wait_until(lambda: page.value("Live target") == "off", "the switch is off")

    served.go_deg(page, HOME)
    served.order(SetSpeed(0.05)).result(5)
    page.choose("Live target", "THE ARM follows")
    put_target(page, "Y", 200)
    page.wait_until(lambda: bool(served.now.velocity_command.any()), "the arm moves")
    page.page.evaluate("() => { const end = Date.now() + 4500; while (Date.now() < end); }")
    page.wait_until(lambda: page.value("Live target") == "off", "the switch is off")
    assert served.now.state is State.HOLDING
    assert served.tool_mm[1] < 60


def test_only_the_operator_leads_an_enabled_arm_and_leaving_the_page_stops_it(
    screens: Screens, served: ServedArm
) -> None:
    operator, watcher = screens(served.url), screens(served.url)
    watcher.open_tab("Simulation")
    watcher.choose("Live target", "THE ARM follows")
    watcher.wait_for_notification("this page is watching")
    assert watcher.value("Live target") == "off"
    served.arm.release()
    operator.open_tab("Simulation")
    operator.choose("Live target", "THE ARM follows")
    operator.wait_for_notification("a live target needs the arm holding, it is off")
    assert operator.value("Live target") == "off"

    served.order(Enable(served.robot.pose("home"))).result(10)
    operator.choose("Live target", "THE ARM follows")
    served.order(SetSpeed(0.05))
    put_target(operator, "Y", 150)
    operator.wait_until(lambda: bool(served.now.velocity_command.any()), "the arm moves")
    operator.page.close()
    watcher.wait_until(lambda: served.now.state is State.HOLDING, "the arm stands")
    assert served.tool_mm[1] < 140
