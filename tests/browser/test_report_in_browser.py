"""A fault, the report that the page gives, and the page that replays it."""

from __future__ import annotations

import re
from contextlib import closing

import pytest
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm
from tests.browser.serving import page_port

from armctl.cli.replay import told
from armctl.process.host import Host
from armctl.protocol import MoveJoints, read_recording
from armctl.ui.guard import guarded_server
from armctl.ui.replay import ReplayApp

pytestmark = pytest.mark.browser
TAB = "Main"


def test_a_fault_is_reported_and_replayed(page: Screen, served: ServedArm, screens: Screens) -> None:
    host = served.arm.link
    assert isinstance(host, Host)
    served.order(MoveJoints(served.robot.pose("zero"))).accepted.result(5)
    page.wait_for_text("MOVING")
    host.boards.simulated().close()
    page.wait_for_text("FAULT")
    page.open_tab("Log")
    file = page.download("Download report")
    assert file.name == "uzuner-report.zip"
    recording = read_recording(file)
    assert any("→ fault: " in line for line in told(recording))
    server = guarded_server(port=page_port(), overlay=False)
    with closing(ReplayApp(recording, served.robot, server)):
        replay = screens()
        replay.open(server.links[0], until="Play")
        replay.wait_for_text("FAULT")
        end = replay.node("/arm/tool")
        replay.slide("Time s", 0.0)
        replay.click("Play")
        replay.wait_for_text("MOVING")
        replay.screenshot("replayed")
        assert replay.page.get_by_role("button", name="STOP").count() == 0
        replay.wait_until(lambda: replay.node("/arm/tool") == end, "it was played to its end")
        replay.wait_for_text(re.compile("MoveJoints q"))
        assert replay.errors == []
