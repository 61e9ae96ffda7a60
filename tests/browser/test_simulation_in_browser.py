"""The Simulation screen as an operator uses it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.browser.kit import Screen
from tests.browser.served_arm import ServedArm, served_arm

from armctl.runtime import State

pytestmark = pytest.mark.browser

HOME = [0.0, 90.0, -80.0, -40.0, 0.0]
IN_SCENE = "name => window.__viserMutable.nodeRefFromName[name] != null"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    with served_arm(tmp_path / "programs") as served:
        yield served


def opened(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="STOP")
    screen.open_tab("Simulation")


def in_scene(screen: Screen, name: str) -> bool:
    return bool(screen.page.evaluate(IN_SCENE, name))


def test_the_twin_runs_the_program_while_the_arm_stands_still(screen: Screen, served: ServedArm) -> None:
    served.put((30.0, *HOME[1:]), tuple(HOME))
    opened(screen, served)
    screen.click("Run on the twin only")
    screen.wait_for_text(re.compile(r"\d\.\d / \d\.\d s · step 2 of 2: pose"))
    screen.wait_until(lambda: in_scene(screen, "/twin"), "the twin is drawn")
    screen.screenshot("simulation-twin")
    screen.wait_for_text(re.compile(r"The twin has finished after \d\.\d s"))
    assert served.commanded_deg == HOME
    assert served.now.state is State.HOLDING
    assert not any("moving" in event.text and "program" in event.text for event in served.now.events)
    assert screen.errors == []


def test_the_twin_goes_to_a_pose_and_can_be_stopped(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    screen.choose("Rehearse", "go to zero")
    screen.click("Run on the twin only")
    screen.wait_for_text(re.compile(r"\d\.\d / \d\.\d s"))
    screen.click("Stop twin")
    screen.wait_for_text("The orange twin rehearses")
    screen.wait_until(lambda: not in_scene(screen, "/twin_path"), "its path is gone")
    assert served.commanded_deg == HOME


def test_the_twin_works_for_a_page_without_an_enabled_arm(screen: Screen, served: ServedArm) -> None:
    served.arm.release()
    opened(screen, served)
    screen.choose("Rehearse", "go to rest")
    screen.click("Run on the twin only")
    screen.wait_for_text(re.compile(r"The twin has finished|\d\.\d / \d\.\d s"))
    assert served.now.state is State.OFF


def test_an_empty_program_and_an_impossible_one_are_refused_in_words(
    screen: Screen, served: ServedArm
) -> None:
    opened(screen, served)
    screen.click("Run on the twin only")
    screen.wait_for_notification("has no steps yet")
    served.put((30.0, *HOME[1:]), (300.0, *HOME[1:]))
    screen.click("Run on the twin only")
    screen.wait_for_notification(re.compile(r"step 2: Base: 300\.00° is outside"))


def test_the_trail_follows_the_arm_and_can_be_cleared_and_hidden(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    assert not in_scene(screen, "/trail")
    served.arm.go_joints([20, 90, -80, -40, 0])
    screen.wait_until(lambda: in_scene(screen, "/trail"), "the trail is drawn")
    screen.click("Clear trail")
    screen.wait_until(lambda: not in_scene(screen, "/trail"), "the trail is gone")


def test_the_workspace_cloud_comes_and_goes(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    screen.tick("Workspace cloud")
    screen.wait_until(lambda: in_scene(screen, "/workspace"), "the cloud is drawn")
    screen.wait_for_text(re.compile("330 mm from the base axis, and from −49 to 493 mm"))
    screen.wait_for_text(re.compile("[0-9]{5} tool points"))
    screen.choose("Coloured by", "manipulability")
    screen.wait_for_text(re.compile("near a singularity"))
    screen.screenshot("simulation-cloud")
    screen.tick("Workspace cloud", on=False)
    screen.wait_until(lambda: not in_scene(screen, "/workspace"), "the cloud is gone")


def test_the_section_follows_the_arm(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    screen.tick("Section")
    dot = screen.page.locator("svg.section-plot circle")
    dot.wait_for()
    screen.wait_until(lambda: in_scene(screen, "/section"), "the section is drawn in the scene")
    screen.wait_for_text(re.compile("exact boundary"))
    dot.scroll_into_view_if_needed()
    screen.screenshot("simulation-section")
    before = float(dot.get_attribute("cx") or "nan")
    served.arm.go_joints([40, 60, -80, -40, 0])
    screen.wait_until(lambda: float(dot.get_attribute("cx") or "nan") > before + 5, "the dot has moved out")

    def turned() -> bool:
        look = "n => window.__viserMutable.nodeRefFromName[n].rotation.z"
        return abs(screen.page.evaluate(look, "/section") - np.radians(40)) < 1e-3

    screen.wait_until(turned, "the plane has turned with the base")
    screen.tick("Section", on=False)
    screen.wait_until(lambda: not in_scene(screen, "/section"), "the section is gone")
    assert screen.errors == []


def test_the_graph_shows_the_motion_in_degrees(screen: Screen, served: ServedArm) -> None:
    opened(screen, served)
    screen.choose("Show", "Base")
    served.arm.go_joints([20, 90, -80, -40, 0])

    def ends_at_20() -> bool:
        (chart,) = screen.page.evaluate(
            "() => Object.values(window.__viserTestpoints.uplots)"
            ".map(u => [u.chart.data.map(line => line[line.length - 1]), u.chart.scales.y.max])"
        )
        (_, commanded, board), top = chart
        return abs(commanded - 20) < 1e-6 and abs(board - 20) < 0.1 and top >= 20

    screen.wait_until(ends_at_20, "both lines end at 20°")
    screen.screenshot("simulation-graph")
