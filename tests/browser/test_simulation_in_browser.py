"""The Simulation screen as an operator uses it."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import expect
from tests.browser.drawing import DRAW_ONCE
from tests.browser.kit import Screen
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State

pytestmark = pytest.mark.browser
TAB = "Simulation"
DARK, WHITE = 60, 245
"""of 255: what the ground of a label is as, in either theme"""


def shown(page: Screen, name: str, there: bool = True) -> None:
    page.wait_until(lambda: (page.node(name) is not None) is there, f"{name} is drawn: {there}")


def test_the_twin_is_exported_and_runs_what_can_be_run_while_the_arm_stands_still(
    page: Screen, served: ServedArm
) -> None:
    page.wait_for_text("has no steps yet")
    assert not page.is_enabled("Run on the twin only")
    served.put((30.0, *HOME[1:]), (300.0, *HOME[1:]))
    page.click("Run on the twin only")
    page.wait_for_notification(re.compile(r"step 2: Base: 300\.00° is outside"))

    served.put((30.0, *HOME[1:]), tuple(HOME))
    with page.page.expect_download() as download:
        page.click("Export")
    saved = Path(download.value.path())
    assert download.value.suggested_filename.startswith("uzuner-") and saved.stat().st_size < 2e6
    assert "Step 2 of 2: pose" in saved.read_text(encoding="utf-8")
    with page.page.expect_download() as download:
        page.choose("Rehearse", "go to zero")
        page.click("Export")
    assert download.value.suggested_filename == "uzuner-go-to-zero.html"
    page.choose("Rehearse", "the program of Serial motion")

    page.click("Run on the twin only")
    page.wait_for_text(re.compile(r"\d\.\d / \d\.\d s · step 2 of 2: pose"))
    shown(page, "/twin")
    page.screenshot("simulation-twin")
    page.wait_for_text(re.compile(r"The twin has finished after \d\.\d s"))
    assert served.commanded_deg == HOME
    assert served.now.state is State.HOLDING
    assert not any("moving" in event.text and "program" in event.text for event in served.now.events)

    served.arm.release()
    served.wait_for(page, State.OFF)
    before = served.commanded_deg
    page.choose("Rehearse", "go to zero")
    page.click("Run on the twin only")
    page.wait_for_text(re.compile(r"\d\.\d / \d\.\d s"))
    page.click("Stop twin")
    expect(page.button("Stop twin")).to_be_disabled()
    page.wait_for_text("The orange twin rehearses")
    shown(page, "/twin_path", False)
    assert served.commanded_deg == before
    assert served.now.state is State.OFF
    assert page.errors == []


_PLACES = """() => {
  const node = window.__viserMutable.nodeRefFromName["/shell"];
  let places = [];
  node?.traverse((one) => {
    const found = one.geometry?.attributes.position;
    if (found) places = Array.from(found.array);
  });
  return places;
}"""


_GRAPH = """() => {
  const all = (what) => Array.from(document.querySelectorAll(`armctl-part[name=joint-angles] .plot ${what}`));
  return [
    all("svg path:not(.grid)").map((path) => parseFloat(path.getAttribute("d").split(",").at(-1))),
    all("small").map((one) => [parseFloat(one.style.top), one.textContent]),
  ];
}"""


def cut_at(page: Screen, served: ServedArm, degrees: float) -> bool:
    """Whether the shell is drawn on the far side of the plane of the arm with its base at an angle only."""
    places = np.array(page.page.evaluate(_PLACES)).reshape(-1, 3)
    if len(places) < 1000:
        return False
    tip = served.robot.forward(np.radians([degrees, 90, -80, -40, 0]))[:2, 3]
    left = np.array([-tip[1], tip[0]]) / np.linalg.norm(tip)
    beside = places[:, :2] @ left
    return bool(beside.min() > -1e-3 or beside.max() < 1e-3) and float(np.abs(beside).max()) > 0.2


def test_the_arm_is_seen_in_trail_workspace_section_and_graph(page: Screen, served: ServedArm) -> None:
    assert page.node("/trail") is None
    served.go_deg(page, [20, 90, -80, -40, 0])
    shown(page, "/trail")
    page.click("Clear trail")
    shown(page, "/trail", False)

    page.tick("Workspace cloud")
    shown(page, "/workspace")
    page.wait_for_text(re.compile("330 mm from the base axis, and heights from −49 to 493 mm"))
    page.wait_for_text(re.compile("[0-9]{5} tool points"))
    page.choose("Coloured by", "manipulability")
    page.wait_for_text(re.compile("near a singularity"))
    page.screenshot("simulation-cloud")
    page.tick("Workspace cloud", on=False)
    shown(page, "/workspace", False)

    page.tick("Workspace")
    for degrees in (20.0, -35.0):  # it is cut anew where the arm comes to rest
        served.go_deg(page, [degrees, 90, -80, -40, 0])
        page.wait_until(lambda degrees=degrees: cut_at(page, served, degrees), "it is cut in the arm's plane")
    page.screenshot("simulation-shell")
    page.tick("Workspace", on=False)
    shown(page, "/shell", False)

    served.go_deg(page, [20, 90, -80, -40, 0])
    page.tick("Section")
    dot = page.page.locator("svg.section-plot circle")
    dot.wait_for()
    shown(page, "/section")
    page.wait_for_text(re.compile("exact boundary"))
    dot.scroll_into_view_if_needed()
    page.screenshot("simulation-section")
    before = float(dot.get_attribute("cx") or "nan")
    served.go_deg(page, [40, 60, -80, -40, 0])
    page.wait_until(lambda: float(dot.get_attribute("cx") or "nan") > before + 5, "the dot has moved out")

    def turned() -> bool:
        look = "n => window.__viserMutable.nodeRefFromName[n].rotation.z"
        return abs(page.page.evaluate(look, "/section") - np.radians(40)) < 1e-3

    page.wait_until(turned, "the plane has turned with the base")
    page.tick("Section", on=False)
    shown(page, "/section", False)

    page.choose("Show", "Base")
    served.go_deg(page, [20, 90, -80, -40, 0])

    def ends_at_20() -> bool:
        """By the numbers at the side of the graph."""
        ends, sides = page.page.evaluate(_GRAPH)
        tops, values = np.array([[y, float(text.replace("−", "-"))] for y, text in sides]).T
        ends = np.polyval(np.polyfit(tops, values, 1), ends)
        return len(ends) == 2 and bool(np.abs(ends - 20).max() < 0.3)

    page.wait_until(ends_at_20, "both lines end at 20°")
    page.screenshot("simulation-graph")
    assert page.errors == []


def test_names_in_the_scene_are_light_on_dark_in_the_dark_theme(page: Screen) -> None:
    """viser draws them black on white whatever the theme."""

    def picture() -> NDArray[np.uint8]:
        page.page.evaluate(DRAW_ONCE)
        taken = page.page.locator("canvas[data-engine]").screenshot()
        with Image.open(io.BytesIO(taken)) as image:
            return np.asarray(image.convert("L"))

    page.click("Dark theme")
    page.page.locator("[data-mantine-color-scheme=dark]").first.wait_for()
    plain = picture()
    page.tick("Joint names")
    page.wait_until(lambda: 0.001 < (picture() != plain).mean() < 0.05, "names are written in the scene")
    named = picture()
    written = np.abs(named.astype(int) - plain) > 20
    assert (named[written] > WHITE).mean() < 0.1 < (named[written] < DARK).mean()
