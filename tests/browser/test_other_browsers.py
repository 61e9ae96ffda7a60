"""The main job, STOP, the next pose and lists in Firefox and in WebKit."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from tests.browser.other_browsers import Automation, Firefox, OtherScreen, WebKit
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module", params=[Firefox, WebKit])
def other(request: pytest.FixtureRequest) -> Iterator[Automation]:
    kind: Callable[[], Automation] = request.param
    browser = kind()
    yield browser
    browser.close()


@pytest.fixture
def page(other: Automation, served: ServedArm) -> Iterator[OtherScreen]:
    screen = OtherScreen(other)
    screen.open(served.url, until="Enable")
    yield screen
    screen.leave()


def test_a_point_is_solved_drawn_as_next_pose_and_gone_to(page: OtherScreen, served: ServedArm) -> None:
    page.open_tab("Inverse")
    for axis, value in zip("XYZ", ("220", "-196", "85"), strict=True):
        page.type_into(f"{axis} mm", value)
    page.click("Solve")
    page.wait_for_text("way in Inverse")
    best = np.degrees(served.robot.inverse([0.22, -0.196, 0.085]).best("least-rotation"))
    assert served.commanded_deg == HOME  # solving moves nothing
    page.click("Go")
    page.wait_until(
        lambda: bool(np.allclose(served.commanded_deg, best, atol=0.02)), "it goes where it shows"
    )


def test_stop_ends_a_motion_on_the_way(page: OtherScreen, served: ServedArm) -> None:
    page.open_tab("Forward")
    page.type_into("Base °", "100")
    page.click("Go")
    page.wait_until(lambda: served.now.state is State.MOVING, "the arm moves")
    page.click("STOP")
    page.wait_until(lambda: served.now.state is State.HOLDING, "the arm holds")
    assert served.commanded_deg[0] < 99.0


def test_steps_are_recorded_duplicated_deleted_and_brought_back(page: OtherScreen, served: ServedArm) -> None:
    page.open_tab("Manual")
    page.click("Record pose")
    page.wait_until(lambda: len(served.steps) == 1, "one step")
    served.arm.go_joints([40.0, *HOME[1:]])
    page.click("Record pose")
    page.wait_until(lambda: len(served.steps) == 2, "two steps")
    page.pick_row(0)
    page.click("Duplicate row 1")
    page.wait_until(lambda: len(served.steps) == 3, "three steps")
    page.wait_for_text("3 steps")
    page.click("Delete row 2")
    page.wait_until(lambda: len(served.steps) == 2, "two again")
    page.wait_for_text("2 steps")
    page.click("Undo")
    page.wait_until(lambda: len(served.steps) == 3, "the step is back")
    page.wait_for_text("3 steps")
    page.click("Run once")
    page.wait_until(lambda: (0, 2) in served.steps_run, "the last of the three runs")


def test_all_parts_of_the_page_have_one_font(page: OtherScreen) -> None:
    fonts = page.run("""
      const parts = ["#armctl-top b", "label[for]", ".mantine-Input-input", ".mantine-Button-label"];
      return parts.map((part) => getComputedStyle(document.querySelector(part)).fontFamily);
    """)
    assert len(set(fonts)) == 1, fonts
