"""The live target as an operator uses it: first on the twin, then on the arm."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm

from armctl.runtime import SetSpeed, State

pytestmark = pytest.mark.browser

HOME = [0.0, 90.0, -80.0, -40.0, 0.0]
PLACE = """name => {
  const node = window.__viserMutable.nodeRefFromName[name];
  return node == null ? null : node.getWorldPosition(node.position.clone()).toArray();
}"""

ARROW = """name => {
  // Where on the screen the middle of the target's upward arrow is.
  const node = window.__viserMutable.nodeRefFromName[name];
  const camera = window.__viserMutable.camera ?? window.__viserMutable.cameraControl.camera;
  const world = node.localToWorld(node.position.clone().set(0, 0, 0.07));
  const p = world.project(camera);
  const box = document.querySelector("canvas").getBoundingClientRect();
  return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height];
}"""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    with served_arm(tmp_path / "programs") as served:
        yield served


def opened(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="STOP")
    screen.open_tab("Simulation")


def place_of(screen: Screen, name: str) -> np.ndarray | None:
    """Where something is in the page's scene [m]."""
    place = screen.page.evaluate(PLACE, name)
    return None if place is None else np.array(place)


def put_target(screen: Screen, axis: str, mm: float) -> None:
    screen.type_into(f"Target {axis} mm", f"{mm:g}")
    screen.click("Put target there")


def tool_mm(served: ServedArm) -> np.ndarray:
    return 1000 * served.robot.forward(served.now.q_command)[:3, 3]


def test_the_twin_follows_while_the_arm_stands(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    screen.choose("Live target", "the twin follows")
    tip = f"/live_twin/f{len(served.robot.chain.rows)}"
    screen.wait_until(lambda: place_of(screen, tip) is not None, "the twin is drawn")
    start = place_of(screen, tip)
    assert start is not None
    put_target(screen, "Y", 80)

    def there() -> bool:
        place = place_of(screen, tip)
        return place is not None and abs(1000 * float(np.linalg.norm(place - start)) - (80 - 3.62)) < 0.5

    screen.wait_until(there, "the twin is at the target")
    screen.screenshot("live-target-twin")
    assert served.commanded_deg == HOME
    assert served.now.state is State.HOLDING
    put_target(screen, "X", 500)
    screen.wait_for_text(re.compile("too far by .* mm: .*following the nearest point"))
    screen.choose("Live target", "off")
    screen.wait_until(lambda: place_of(screen, "/live_twin") is None, "the twin is gone")
    assert screen.errors == []


def test_the_arm_follows_and_stop_ends_it(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    screen.choose("Live target", "THE ARM follows")
    screen.wait_until(lambda: served.now.state is State.MOVING, "the arm is led")
    screen.pause(300)
    assert served.commanded_deg == HOME
    put_target(screen, "Y", 80)
    screen.wait_until(lambda: bool(abs(tool_mm(served)[1] - 80) < 0.01), "the arm is at the target")
    screen.screenshot("live-target-arm")
    screen.click("STOP")
    screen.wait_until(lambda: served.now.state is State.HOLDING, "the arm stands")
    screen.wait_until(lambda: screen.value("Live target") == "off", "the switch is off")
    before = served.commanded_deg
    screen.pause(700)
    assert served.commanded_deg == before
    assert screen.errors == []


def test_dragging_the_arrows_leads_the_arm(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    screen.dismiss_graphics_warning()
    screen.choose("Live target", "THE ARM follows")
    screen.wait_until(lambda: served.now.state is State.MOVING, "the arm is led")
    screen.pause(500)
    x, y = screen.page.evaluate(ARROW, "/live_target")
    before = tool_mm(served)
    mouse = screen.page.mouse
    mouse.move(x, y)
    screen.pause(300)
    mouse.down()
    for step in range(1, 11):
        mouse.move(x, y - 4 * step)
        screen.pause(60)
    mouse.up()
    screen.pause(600)
    after = tool_mm(served)
    assert after[2] - before[2] > 5
    assert np.abs(after - before)[:2].max() < 1
    assert screen.number("Target Z mm") == pytest.approx(after[2], abs=0.2)
    screen.screenshot("live-target-dragged")


def test_leaving_the_page_stops_the_arm(screens: Screens, served: ServedArm) -> None:
    screen = screens(served.url)
    screen.open_tab("Simulation")
    screen.choose("Live target", "THE ARM follows")
    served.arm.controller.submit(SetSpeed(0.05))
    put_target(screen, "Y", 150)
    screen.wait_until(lambda: bool(served.now.velocity_command.any()), "the arm moves")
    screen.page.close()
    watcher = screens(served.url)
    watcher.wait_until(lambda: served.now.state is State.HOLDING, "the arm stands")
    assert tool_mm(served)[1] < 140


def test_only_an_enabled_arm_and_its_operator(screens: Screens, served: ServedArm) -> None:
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


def test_a_page_that_hangs_leads_nothing(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    served.arm.controller.submit(SetSpeed(0.05)).result(5)
    screen.choose("Live target", "THE ARM follows")
    put_target(screen, "Y", 200)
    screen.wait_until(lambda: bool(served.now.velocity_command.any()), "the arm moves")
    screen.page.evaluate("() => { const end = Date.now() + 4500; while (Date.now() < end); }")
    screen.wait_until(lambda: screen.value("Live target") == "off", "the switch is off")
    assert served.now.state is State.HOLDING
    assert tool_mm(served)[1] < 60
