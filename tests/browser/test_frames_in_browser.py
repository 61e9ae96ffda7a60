"""A frame is taught by three presses, chosen by a step, and its program goes where it is."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.kit import Screen
from tests.browser.served_arm import ServedArm

from armctl.program import FrameStep, PointStep

pytestmark = pytest.mark.browser
TAB = "Manual"
TOUCHES = {"Origin": (180, -60, 60), "On +x": (180, 40, 60), "On the +y side": (110, 0, 60)}


def test_a_frame_is_taught_and_what_is_recorded_below_it_is_given_in_it(
    page: Screen, served: ServedArm
) -> None:
    page.open_tab("Frames")
    page.type_into("Frame name", "tray")
    for label, point in TOUCHES.items():
        q = served.robot.inverse(np.array(point) / 1000).best()
        served.go_deg(page, np.degrees(q).tolist())
        page.click(label)
        page.pause(150)
    page.wait_for_notification("Frame taught")
    frame = served.edited.program.frames["tray"]
    assert (frame.x_mm, frame.y_mm, frame.z_mm) == pytest.approx((180, -60, 60), abs=0.1)
    assert frame.rz_deg == pytest.approx(90, abs=0.1)
    page.wait_until(lambda: page.node("/user_frames/0") is not None, "its axes stand in the scene")
    place = page.node("/user_frames/0")
    assert place == pytest.approx((0.18, -0.06, 0.06), abs=1e-4)
    page.click("Add as step")
    page.wait_until(lambda: served.steps == (FrameStep(frame="tray"),), "the step is on the list")
    page.click("Point")
    page.wait_until(lambda: len(served.steps) == 2, "a point is recorded")
    step = served.steps[1]
    assert isinstance(step, PointStep)
    assert (step.x_mm, step.y_mm, step.z_mm) == pytest.approx((60, 70, 0), abs=0.2)
    assert page.errors == []
