"""`armctl serve` as it runs: a robot file of one's own, and an arm process that dies."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen
from tests.browser.serving import serving

from armctl.process import registry
from armctl.robot import load_robot, robots_folder

pytestmark = pytest.mark.browser
UZUNER = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")


def one_may_choose_another_and_its_own_again_only_if_it_can_be_read(screen: Screen, own: Path) -> None:
    mico = load_robot("mico").title
    assert screen.value("Robot") == "The lab's arm"
    own.write_text(UZUNER.replace("limit_deg = [-102.8, 107.26]", "limit_deg = [107.26, -102.8]"))
    screen.choose("Robot", mico)
    screen.wait_for_text("Elbow")
    screen.wait_until(lambda: screen.value("Robot") == mico, "the page is MICO's")
    screen.wait_until(lambda: screen.button("P0").is_visible(), "MICO's points are there")
    screen.choose("Robot", "The lab's arm")
    screen.wait_for_notification(
        re.compile(r"lab_arm\.toml: line \d+: joints\.base\.limit_deg = \[107\.26, -102\.8\]")
    )
    screen.wait_until(lambda: screen.value("Robot") == mico, "the present robot stays")


def test_a_robot_file_of_ones_own_is_in_the_list_and_a_killed_arm_process_is_told_and_started_anew(
    screen: Screen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    folder = registry.runtime_folder()
    assert folder is not None
    own = tmp_path / "lab_arm.toml"
    own.write_text(UZUNER.replace("Uzuner 5-DOF arm", "The lab's arm").replace('"uzuner"', '"lab_arm"'))
    with serving(tmp_path, "--robot", str(own)) as link:
        screen.open(link, until="Enable")
        one_may_choose_another_and_its_own_again_only_if_it_can_be_read(screen, own)
        screen.click("Enable")
        screen.wait_for_text("HOLDING")
        screen.wait_until(
            lambda: len(list(registry.running(folder))) == 1, "the first arm's process has ended"
        )
        ((_, note),) = registry.running(folder)
        os.kill(note.pid, signal.SIGKILL)
        told = "he arm process ended (killed by signal 9), and STOP does not reach the arm"
        expect(screen.page.locator("#armctl-told p")).to_contain_text(told)
        screen.wait_for_text(f"t{told}")
        screen.wait_for_text("FAULT")
        assert not screen.is_enabled("Release")
        screen.screenshot("arm-process-killed")
        screen.click("Connect")
        screen.wait_for_text("A new arm process was started. Press Enable again.")
        expect(screen.page.locator("#armctl-told p")).to_be_hidden()
        screen.screenshot("arm-process-anew")
        screen.click("Enable")
        screen.wait_for_text("HOLDING")
        ((_, note),) = registry.running(folder)
        assert screen.errors == []
    assert list(folder.iterdir()) == []
