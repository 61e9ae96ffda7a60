"""Enable where nobody knows how the arm stands: the page asks, shows a ghost, and nothing jumps unasked."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.ghost_view import LOOKED_AT, wait_for_ghost, wait_for_no_ghost
from tests.browser.kit import Screen, Screens
from tests.browser.serving import serving

from armctl.hardware.boards import channel_settings
from armctl.hardware.maestro.simulated import simulated_maestro
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

pytestmark = pytest.mark.browser
ROBOT = load_robot("uzuner")
LAST_DEG = [40.0, 80.0, -60.0, -30.0, 0.0]


def enable_here(page: Screen) -> None:
    """Press "Yes, enable here" until the servos come on: where answers are late, Enable rightly refuses."""
    late = page.page.locator(".mantine-Notification-root").filter(
        has_text=re.compile("the line is too slow|does not answer in time")
    )
    coming_on = page.page.get_by_text(re.compile(r"enabling: [1-5] of 5 servos on"))
    for _ in range(20):
        page.click("Yes, enable here")
        late.or_(coming_on).locator("visible=true").first.wait_for()
        if late.count() == 0:
            return
        late.first.get_by_role("button").click()
        expect(late).to_have_count(0)
    raise AssertionError("the board's answers are late each time")


def test_the_page_asks_where_the_arm_is(tmp_path: Path, screens: Screens) -> None:
    record = {"robot": "uzuner", "board": "unnumbered", "joints_deg": LAST_DEG, "gripper": 0.2}
    kept = tmp_path / "armctl" / "last-pose" / "uzuner unnumbered.json"
    kept.parent.mkdir(parents=True)
    kept.write_text(json.dumps(record | {"at": time.time() - 3600, "ended": "fault", "moving": True}))
    outputs = ROBOT.output_map
    assert outputs is not None
    page = screens()
    with (
        BoardServer(simulated_maestro(channels=channel_settings(ROBOT)), MonotonicClock().now) as board,
        serving(tmp_path, "--port", board.port) as url,
    ):

        def pulses() -> list[float | None]:
            with board.inspect() as model:
                return [model.position_us(channel) for channel in range(6)]

        page.open(url, until="Enable")
        page.wait_for_text("asks where the arm stands")
        page.click("Enable")
        page.wait_for_text(re.compile(r"Last seen at 40\.0, 80\.0, −60\.0, .* on .*moving.*a fault ended it"))
        page.wait_for_text("The arm was moving when it was last seen")
        page.wait_for_text("Look at the arm")
        wait_for_ghost(page, ROBOT, np.radians(LAST_DEG), LOOKED_AT)
        page.screenshot("enable_last_pose")
        page.click("Cancel")
        wait_for_no_ghost(page, LOOKED_AT)
        assert pulses() == [None] * 6
        page.click("Enable")
        page.type_into("Shoulder °", "400")
        page.wait_for_text("Shoulder: 400.00° is outside")
        page.type_into("Shoulder °", "100")
        typed = [40.0, 100.0, -60.0, -30.0, 0.0]
        wait_for_ghost(page, ROBOT, np.radians(typed), LOOKED_AT)
        enable_here(page)
        page.screenshot("enable_one_by_one")
        page.wait_for_text("HOLDING")
        wanted = [*outputs.outputs(np.radians(typed)).values(), 1200.0]
        assert pulses() == pytest.approx(wanted, abs=0.126)
        wait_for_no_ghost(page, LOOKED_AT)
        page.screenshot("enable_done")
        assert page.errors == []
