"""Choosing another robot, as an operator does it, and what a page that watches sees of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from playwright.sync_api import Locator, expect
from tests.browser.kit import PATIENCE_MS, Screen, Screens
from tests.browser.served_arm import ServedArm

from armctl.facts import State
from armctl.robot import Robot
from armctl.ui.scene.arm_model import arm_model
from armctl.ui.tabs.simulation.screen import Trail

pytestmark = pytest.mark.browser
TITLES = {
    "uzuner": "Uzuner 5-DOF arm",
    "abaas": "Abaas 5-DOF arm",
    "scorbot": "Scorbot ER-4PC",
    "mico": "Kinova MICO, 4 joints",
    "humanoid": "Humanoid arm",
}


def choose(page: Screen, served: ServedArm, name: str) -> None:
    page.choose("Robot", TITLES[name])
    page.wait_until(lambda: served.robot.name == name, f"{name} is the present robot")
    wait_for_robot(page, served.robot)


def wait_for_robot(page: Screen, robot: Robot) -> None:
    """The page is the robot's: its joints are listed, its title is in the list, its frames are drawn."""
    last = robot.joints[-1]
    title = re.compile(f"^{re.escape(last.title)} ?{re.escape(last.unit.strip())}$")
    page.page.locator("[name=where] th").filter(has_text=title).wait_for()
    page.wait_until(lambda: page.value("Robot") == robot.title, "the list shows the robot")
    model = arm_model(robot)
    parts = {*model.frames, *(mesh.name for mesh in model.meshes)}
    page.wait_until(lambda: parts_drawn(page) == parts, "the robot's parts are drawn, and no others")


def across(panel: Locator) -> tuple[float, float]:
    """Where a panel begins and how wide it is [px]; how high it is, its tab says."""
    box = panel.bounding_box()
    assert box is not None
    return box["x"], box["width"]


def parts_drawn(page: Screen) -> set[str]:
    names = page.page.evaluate(
        "Object.entries(window.__viserMutable.nodeRefFromName)"
        ".filter(([name, node]) => name.startsWith('/arm/') && node).map(([name]) => name.slice(5))"
    )
    return set(names)


def is_drawn_at_home(page: Screen, robot: Robot) -> bool:
    """Whether the page draws each frame where the home pose, its gripper closed, has it."""
    model = arm_model(robot)
    placed = model.place(robot.pose("home")[None], np.zeros(1))[0, :, :3, 3]
    frames = {name: at for name, at in zip(model.frames, placed, strict=True) if "/" not in name}
    drawn = [page.node(f"/arm/{name}") or [9.0] * 3 for name in frames]
    return float(np.abs(np.array(drawn) - list(frames.values())).max()) < 2e-3


def stands_at(served: ServedArm, pose: str) -> bool:
    return bool(np.allclose(served.now.q_command, served.robot.pose(pose), atol=1e-9))


def slider_range(page: Screen, label: str) -> tuple[float, float]:
    thumb = page.row(label).get_by_role("slider").first
    low, high = thumb.get_attribute("aria-valuemin"), thumb.get_attribute("aria-valuemax")
    assert low is not None
    assert high is not None
    return float(low), float(high)


def done(page: Screen, served: ServedArm, begin: Callable[[], None], is_done: Callable[[], bool]) -> bool:
    """Whether what a click begins is done; not, where this computer stood still and it was ended for that."""
    before = served.now.events
    begin()

    def held_up() -> bool:
        told = [one.text for one in served.now.events if one not in before]
        return any("nothing ran for" in text or "watchdog" in text for text in told)

    page.wait_until(lambda: is_done() or held_up(), "it is done, or the arm says why not")
    return is_done()


def make_ready(page: Screen, served: ServedArm) -> None:
    """Enable or home."""
    button = "Homing" if served.robot.board == "encoder" else "Enable"
    for _ in range(3):
        if done(page, served, lambda: page.click(button), lambda: served.now.state is State.HOLDING):
            return
    raise AssertionError("this computer stood still three times")


def enable_and_go_home(page: Screen, served: ServedArm) -> None:
    def is_home() -> bool:
        return stands_at(served, "home") and served.now.state is State.HOLDING

    for _ in range(3):
        if served.now.state is not State.HOLDING:
            make_ready(page, served)
        if done(page, served, page.button("Home").click, is_home):
            break
    else:
        raise AssertionError("this computer stood still three times")
    page.wait_until(lambda: is_drawn_at_home(page, served.robot), "the page draws the arm at home")
    page.wait_until(
        lambda: abs((page.node("/floor") or [9.0] * 3)[2] - served.robot.floor_z) < 1e-6,
        "and the floor below it",
    )


def joints_and_pose_are_coupled(page: Screen, served: ServedArm) -> None:
    """Px, Py, Pz fill Q1 … Q5, and Q1 … Q5 the matrix."""
    robot, asked = served.robot, np.array([150.0, -100.0, -590.0])
    page.type_xyz("150", "-100", "-590")

    def reached() -> bool:
        angles = [page.number(f"{joint.title} °") for joint in robot.joints]
        return float(np.abs(1000 * robot.forward(np.radians(angles))[:3, 3] - asked).max()) < 0.05

    page.wait_until(reached, "the angles reach the point")
    page.open_tab("Matrix and Jacobian")
    for text in ("150.00", "−100.00", "−590.00"):
        page.wait_for_text(text)


def a_published_path_that_it_cannot_follow_is_explained(page: Screen, served: ServedArm) -> None:
    del served
    page.choose("Which motion", "Arc (58 points)")
    page.wait_for_text(re.compile("Not for this arm: point 1 of 58: .*Elbow needs"))
    page.click("Show")
    page.wait_for_notification(re.compile("Elbow needs"))


OF_ITS_OWN = {
    ("humanoid", "Forward"): joints_and_pose_are_coupled,
    ("humanoid", "Trajectory"): a_published_path_that_it_cannot_follow_is_explained,
}
"""what is shown of one robot on one tab, and not of Uzuner's"""


def test_each_robot_brings_its_fields_limits_and_figure_and_moves(page: Screen, served: ServedArm) -> None:
    """One after the other on one page, and back to the first: nothing is left of the arms between."""
    control = page.panel("Main")
    place = across(control)
    before = "uzuner"
    for name in ("scorbot", "humanoid", "uzuner"):
        page.open_tab("Main")
        choose(page, served, name)
        served.wait_for(page, State.OFF)
        page.open_tab("Log")
        page.wait_for_text(re.compile(f"robot: {re.escape(TITLES[before])} → {re.escape(TITLES[name])}"))
        page.open_tab("Main")
        enable_and_go_home(page, served)
        page.wait_until(lambda: across(control) == place, "the panel stands where it stood")
        expect(page.page).to_have_title(f"armctl – {TITLES[name]}", timeout=PATIENCE_MS)
        page.screenshot(f"robot-{name}-main")
        page.open_tab("Manual", "Joints")
        for joint, (low, high) in zip(served.robot.joints, np.degrees(served.robot.limits), strict=True):
            if low == high:
                assert page.value(f"{joint.title} °") == "held at 0°", name
                assert page.entry(f"{joint.title} °").is_disabled(), name
            else:
                # a slider shows hundredths of a degree, inside the limits
                shown = np.ceil(100 * low - 1e-4) / 100, np.floor(100 * high + 1e-4) / 100
                limits = slider_range(page, f"{joint.title} °")
                assert limits == pytest.approx(shown, abs=1e-6), (name, joint.title)
        page.screenshot(f"robot-{name}-manual")
        page.open_tab("Jog" if served.robot.gripper is None else "Jog & gripper")
        page.screenshot(f"robot-{name}-jog")
        for tab in ("Trajectory", "Forward", "Inverse", "Simulation"):
            page.open_tab(tab)
            if (name, tab) in OF_ITS_OWN:
                OF_ITS_OWN[name, tab](page, served)
            page.screenshot(f"robot-{name}-{tab.lower()}")
        assert page.errors == [], name
        before = name
    page.open_tab("Log")
    page.page.keyboard.press("Escape")  # the hot key went with the page that was built anew
    page.wait_for_text("STOP (browser page 1)")
    page.screenshot("robot-and-back")
    assert page.errors == []


def test_a_page_that_watches_follows_but_may_not_choose_and_one_that_closes_meanwhile_harms_nobody(
    page: Screen, served: ServedArm, screens: Screens
) -> None:
    watcher = screens(served.url)
    watcher.wait_for_text(re.compile("This page is watching; press"))
    expect(watcher.entry("Robot")).to_be_disabled()
    assert served.robot.name == "uzuner"
    choose(page, served, "mico")
    watcher.wait_for_notification(re.compile("browser page 1 chose Kinova MICO"))
    wait_for_robot(watcher, served.robot)
    enable_and_go_home(page, served)
    watcher.wait_until(lambda: is_drawn_at_home(watcher, served.robot), "the watcher sees it")
    watcher.screenshot("robot-watcher")
    watcher.click("Take control")
    watcher.wait_for_text("Take it from browser page 1? Press again")
    watcher.click("Take control")
    page.wait_for_notification(re.compile("This page watches now: browser page 2 operates the arm"))
    choose(watcher, served, "abaas")
    wait_for_robot(page, served.robot)
    assert page.errors == watcher.errors == []

    watcher.entry("Robot").click()
    watcher.page.get_by_role("option", name=TITLES["mico"], exact=True).click()
    watcher.page.close()
    page.wait_for_text("nobody")
    page.wait_until(lambda: served.app.robots.opening is None, "the change has ended, one way or the other")
    wait_for_robot(page, served.robot)
    page.click("Take control")
    choose(page, served, "uzuner")
    enable_and_go_home(page, served)
    assert page.errors == []


def test_a_moving_arm_is_not_left_an_unsaved_program_asks_and_nothing_of_the_arm_before_is_left(
    page: Screen, served: ServedArm
) -> None:
    served.put((100, 90, -80, -40, 0), (-100, 90, -80, -40, 0))
    page.open_tab("Manual", "Serial motion")
    page.click("Loop")
    served.wait_for(page, State.MOVING)
    page.open_tab("Main")
    page.wait_for_text("The arm moves; wait until it stands, or press STOP, then choose another robot.")
    expect(page.entry("Robot")).to_be_disabled()
    page.screenshot("robot-refused")
    page.click("STOP")
    served.wait_for(page, State.HOLDING)
    page.choose("Robot", TITLES["mico"])
    page.wait_for_text(re.compile("The program .*test.* is not saved"))
    page.screenshot("robot-unsaved")
    page.click("Stay with this robot")
    page.wait_until(lambda: page.value("Robot") == TITLES["uzuner"], "the list is set back")
    assert served.robot.name == "uzuner"
    page.choose("Robot", TITLES["mico"])
    page.click("Change without saving")
    page.wait_until(lambda: served.robot.name == "mico", "the robot is changed")
    assert served.steps == ()  # the program is another arm's

    wait_for_robot(page, served.robot)
    enable_and_go_home(page, served)

    def tool_is_at(name: str) -> bool:
        away = served.robot.forward(served.now.q_command)[:3, 3] - served.robot.point(name)
        return float(np.linalg.norm(away)) < 1e-6

    for name in ("P0", "P1"):
        page.click(name)
        page.wait_until(partial(tool_is_at, name), f"the tool is at {name}")
        served.wait_for(page, State.HOLDING)
    trail = served.console.shared(Trail).since(0)
    assert np.linalg.norm(trail - served.robot.point("P0"), axis=1).min() < 5e-3
    assert len(trail) > 100
    page.wait_until(lambda: page.node("/trail") is not None, "the trail is drawn")
    page.screenshot("robot-points")
    choose(page, served, "uzuner")
    assert len(served.console.shared(Trail).since(0)) < 2  # nothing of the other arm's path is left
