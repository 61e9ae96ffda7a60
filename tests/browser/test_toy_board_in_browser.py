"""A board of somebody else's package runs a program from the page: nothing of armctl names it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from tests.architecture.toy_board import toy_board
from tests.browser.kit import Screens
from tests.browser.serving import serving

from armctl.hardware.board_type import Setup
from armctl.hardware.boards import board_type
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

pytestmark = pytest.mark.browser


def test_it_is_enabled_and_runs_a_recorded_program(
    tmp_path: Path, screens: Screens, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path))  # where `armctl serve` finds the package
    with (
        toy_board(tmp_path) as robot_file,
        BoardServer(board_type("toy").simulated(Setup(), {}), MonotonicClock().now) as toy,
        serving(tmp_path, "--robot", str(robot_file), "--port", toy.port) as url,
    ):
        outputs = load_robot(robot_file).output_map
        assert outputs is not None

        def stands_at(degrees: list[float]) -> bool:
            wanted = {
                channel: round(value) for channel, value in outputs.outputs(np.radians(degrees)).items()
            }
            with toy.inspect() as model:
                now: dict[int, int] = dict(vars(model)["outputs"])
            return {channel: now.get(channel) for channel in wanted} == wanted

        page = screens()
        page.open(url, until="Enable")
        page.wait_for_text("Toy board")
        page.click("Enable")
        page.click("It is at the rest pose")
        page.wait_until(lambda: stands_at([0, 110, -80, -70, 0]), "the toy holds the rest pose")
        page.wait_for_text("HOLDING")
        page.open_tab("Manual", "Serial motion")
        page.click("Record pose")
        page.open_tab("Main")
        page.click("Home")
        page.wait_until(lambda: stands_at([0, 90, -80, -40, 0]), "the toy holds the home pose")
        page.wait_for_text("HOLDING")
        page.open_tab("Manual")
        page.click("Record pose")
        page.click("Run once")
        page.wait_for_text("MOVING")
        page.wait_until(lambda: stands_at([0, 90, -80, -40, 0]), "the program has come to its end")
        page.wait_for_text("HOLDING")
        page.screenshot("toy_board")
        assert page.errors == []
