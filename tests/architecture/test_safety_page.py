"""docs/safety.md promises nothing that no test holds, and every number in it is the one in the code."""

from __future__ import annotations

import ast
import functools
import inspect
import math
import re
from pathlib import Path

import pytest
from tests.hardware.bus_kit import LEAD_S

from armctl.hardware.board_type import BoardType
from armctl.hardware.boards import board_type
from armctl.hardware.dynamixel.make import WATCHDOG_MS
from armctl.hardware.encoder import driver as encoder_driver
from armctl.hardware.encoder import messages
from armctl.hardware.encoder import simulated as encoder_simulated
from armctl.process import link as arm_link
from armctl.process import records, server
from armctl.program.program import MOST_STEPS, PROGRAM_FILES
from armctl.protocol import clock, commands
from armctl.robot.file import ROBOT_FILES
from armctl.robot.parts import MOST_JOINTS
from armctl.robot.urdf.reading import URDF_FILES
from armctl.runtime import (
    Controller,
    controller,
    core,
    last_pose,
    monitor,
    pin,
    power,
    releasing,
    state,
)
from armctl.ui import app
from armctl.ui.guard import stop_line
from armctl.ui.tabs.manual import sticks

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
TICK_S = 1 / inspect.signature(Controller).parameters["rate_hz"].default
_HANG = re.search(
    r"WDTCSR = .*WDP1\) \| _BV\(WDP0\); // (\d+) ms to the interrupt",
    (ROOT / "firmware/encoder/reset_cause.cpp").read_text(encoding="utf-8"),
)
assert _HANG is not None
NUMBERS = {
    "tick": TICK_S,
    "jog gap": state.JOG_GAP_S,
    "jog": commands.JOG_EXPIRY_S,
    "hand rests": sticks.RESTS_S,
    "follow": commands.FOLLOW_EXPIRY_S,
    "stream": commands.STREAM_EXPIRY_S,
    "closing": controller._STOPPING_S,
    "page silent": app.SILENCE_S + stop_line._CHECK_S,
    "program silent": records.SILENCE_S + server._WATCH_S,
    "records": server._MOST_A_SECOND,
    "orphan": server._HOLD_S,
    "link silent": records.SILENCE_S,
    "busy": arm_link._BUSY_S,
    "gap": monitor.GAP_S,
    "after gap": clock.AFTER_GAP_S,
    "late": monitor._LATE_S,
    "doubtful": monitor._DOUBTFUL_FAILURES,
    "trusted": monitor._OFF_READINGS,
    "board silent": monitor._SILENCE_S,
    "rate shown": monitor._RATE_SHOWN,
    "rate stops": monitor._RATE_TOO_HIGH,
    "rate time": monitor._RATE_S,
    "off readings": monitor._OFF_READINGS,
    "off seen": monitor._OFF_READINGS * TICK_S,
    "edges": messages.MOST_LOST_EDGES,
    "slow disk": last_pose._SLOW_DISK_S,
    "unsent": core._UNSENT_S,
    "confirmed": power._CONFIRMED_S,
    "slow line": BoardType.slowest_answer_s,
    "slow firmata": board_type("firmata").slowest_answer_s,
    "sure": monitor._SURE_READINGS,
    "servo interval": power._INTERVAL_S,
    "letting down": releasing.LETTING_DOWN_S,
    "tolerance": math.degrees(power.ADOPT_TOLERANCE_RAD),
    "pin": pin.FIRST_WAIT_S,
    "pin at most": pin.LONGEST_WAIT_S,
    "program bytes": PROGRAM_FILES.most_bytes,
    "robot bytes": ROBOT_FILES.most_bytes,
    "urdf bytes": URDF_FILES.most_bytes,
    "steps": MOST_STEPS,
    "joints": MOST_JOINTS,
    "encoder brakes": encoder_driver.WATCHDOG_MS / 1000 - encoder_simulated._LONGEST_BRAKING_S,
    "watchdog": encoder_driver.WATCHDOG_MS / 1000,
    "hang": int(_HANG[1]) / 1000,
    "bus watchdog": WATCHDOG_MS / 1000,
    "lead": LEAD_S,
}
"""what stands behind each number of the tables, in seconds, degrees, bytes or shares"""
ROUNDED_UP = {"page silent"}
"""and which of them the page gives a little larger"""
UNITS = {"": 1, " s": 1, " ms": 1e-3, " min": 60, " %": 0.01, "°": 1, " KiB": 1024, " MiB": 1024 * 1024}
NUMBER = re.compile(
    rf"(?P<value>\d[\d,]*(?:\.\d+)?)(?P<unit>{'|'.join(sorted(UNITS, reverse=True))})"
    r"(?:<!-- (?P<key>[a-z ]+) -->)?"
)

LINK = re.compile(r"\[(?P<words>[a-z0-9 ]+)\]\((?P<path>\.\./tests/[\w/]+\.py)\)")
"""a test: its name in words, and its file"""


def rows() -> list[list[str]]:
    """The cells of every row of every table."""
    lines = [line for line in PAGE.splitlines() if line.startswith("|")]
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in table if row[-1] != "held by" and set(row[-1]) != {"-"}]


@functools.cache
def defined(path: Path) -> set[str]:
    """The test functions of a file."""
    nodes = ast.parse(path.read_text(encoding="utf-8")).body
    return {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0][:40])
def test_every_line_names_tests_that_are_there(row: list[str]) -> None:
    assert len(row) == 5
    held_by = [LINK.fullmatch(link) for link in row[-1].split("; ")]
    for link in held_by:
        assert link is not None, row[-1]
        test = f"test_{link['words'].replace(' ', '_')}"
        assert test in defined(ROOT / "docs" / link["path"]), f"{link['path']}::{test}"


def test_every_number_is_the_one_in_the_code() -> None:
    found: set[str] = set()
    for row in rows():
        for cell in row[:-1]:
            for number in NUMBER.finditer(re.sub(r"`[^`]*`", "", cell)):
                key = number["key"]
                assert key in NUMBERS, f"{number[0]!r} in {cell!r}"
                said, is_so = float(number["value"].replace(",", "")) * UNITS[number["unit"]], NUMBERS[key]
                if key in ROUNDED_UP:
                    assert is_so <= said <= 1.1 * is_so, cell
                else:
                    assert said == pytest.approx(is_so, rel=1e-9), cell
                found.add(key)
    assert found == set(NUMBERS)
