"""`armctl serve` as it runs: the arm process dies, the page says so and starts another one."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen
from tests.browser.serving import serving

from armctl.process import registry

pytestmark = pytest.mark.browser


def test_a_killed_arm_process_is_told_and_started_anew(
    screen: Screen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    folder = registry.runtime_folder()
    assert folder is not None
    with serving(tmp_path) as link:
        screen.open(link, until="STOP")
        screen.click("Enable")
        screen.wait_for_text("HOLDING")
        ((_, note),) = registry.running(folder)
        os.kill(note.pid, signal.SIGKILL)
        told = "he arm process ended (killed by signal 9), and STOP does not reach the arm"
        expect(screen.page.locator("#armctl-bar p")).to_contain_text(told, timeout=1000)
        screen.wait_for_text(f"t{told}")
        screen.wait_for_text("FAULT")
        assert not screen.is_enabled("Release")
        screen.screenshot("arm-process-killed")
        screen.click("Connect")
        screen.wait_for_text("A new arm process was started. Press Enable again.")
        expect(screen.page.locator("#armctl-bar p")).to_be_hidden()
        screen.screenshot("arm-process-anew")
        screen.click("Enable")
        screen.wait_for_text("HOLDING")
        ((_, note),) = registry.running(folder)
        assert screen.errors == []
    assert list(folder.iterdir()) == []
