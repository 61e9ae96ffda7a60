"""One page of the whole console, without a browser."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

import pytest
from tests.browser.served_arm import served_arm
from tests.ui.guard_kit import PATIENCE_S, RawPage, uuid_of

from armctl.runtime import Snapshot
from armctl.ui.guard.filter import FloodGauge

GARBAGE = ("garbage", "", True, -1e9, 1e9, 10**18, (1.0, 2.0), ())


def test_garbage_for_every_control_gives_at_most_a_refusal(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only a page that is not armctl's own sends values of a wrong type, or far out of range."""
    monkeypatch.setattr(FloodGauge, "CAPACITY", 1e6)
    arrived = threading.Event()

    def look(snapshot: Snapshot) -> None:
        if snapshot.speed == 0.55:
            arrived.set()

    with served_arm(tmp_path) as served, RawPage(served.app.server.get_port()) as page:
        served.console.frame_listeners.append(look)
        page.introduce()
        page.read_until(b"Calibration")
        (client,) = served.app.server.get_clients().values()
        handles = tuple(client.gui._gui_input_handle_from_uuid.values())
        for handle in handles:
            if not handle._impl.is_button:
                for value in GARBAGE:
                    page.set(uuid_of(handle), value)
        (speed,) = (handle for handle in handles if getattr(handle, "label", "") == "Speed %")
        page.set(uuid_of(speed), 55)
        assert arrived.wait(PATIENCE_S)
        assert served.now.q_command.tolist() == served.robot.pose("home").tolist()
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []
