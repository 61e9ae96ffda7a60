"""The bars of the motors: rows and columns that stay, limits, signs, and as little as can be is sent."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.ui.page_kit import FakePage, snapshot_of

from armctl.facts import LevelPassed, Quantities, QuantityLimits
from armctl.hardware import BoardIdentity
from armctl.protocol import Snapshot
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.telemetry import TelemetryTable, bar_scale

ROBOT = load_robot("so101")
NOW = Quantities(-0.28, 41.0, 11.9, 0.76)
LIMITS = QuantityLimits(0.8, 70.0, 4.0, 2.0, 12.0)
ELBOW, JAW = "Elbow flex", "Gripper"


def seen(at: float, **quantities: Quantities) -> Snapshot:
    """What the board measures at a time [s]."""
    told = {{"elbow": ELBOW, "jaw": JAW}[name]: one for name, one in quantities.items()}
    return replace(
        snapshot_of(ROBOT), stamp=at, board=BoardIdentity("servo bus", "sim"), quantities=told,
        limits={ELBOW: LIMITS, JAW: LIMITS},
    )  # fmt: skip


@pytest.fixture
def page(server: GuardedServer) -> FakePage:
    page = FakePage(server, ROBOT, np.zeros(ROBOT.n))
    remembered: dict[str, str] = {}

    async def recall(key: str) -> str | None:
        return remembered.get(key)

    page.recall, page.remember = recall, remembered.__setitem__  # type: ignore[attr-defined]
    return page


@pytest.fixture
def table(page: FakePage) -> TelemetryTable:
    return TelemetryTable(page.session, lambda: True)


def show(page: FakePage, table: TelemetryTable, snapshot: Snapshot) -> dict[str, str]:
    """The rows, by title."""
    page.snapshot = snapshot  # type: ignore[assignment]
    page.act(lambda: table.refresh(snapshot))
    return page.parts.shown_rows("telemetry")


def cells(row: str) -> list[str]:
    return re.findall(r"<td[^>]*>([^<]*)</td>", row)


def test_each_motor_has_a_row_with_numbers_units_bars_and_limits(
    page: FakePage, table: TelemetryTable
) -> None:
    rows = show(page, table, seen(1.0, elbow=NOW, jaw=NOW))
    assert list(rows) == [ELBOW, JAW]
    assert cells(rows[ELBOW]) == ["−28 %", "0.76 A", "41 °C", "11.9 V"]
    assert re.findall(r"--v:(\d+);--l:(\d+)", rows[ELBOW]) == [
        ("28", "80"), ("34", "90"), ("53", "90"), ("89", "81"),
    ]  # fmt: skip
    assert page.parts["telemetry"].count("<th>") == 5


def test_of_a_board_that_measures_nothing_nothing_is_shown(page: FakePage, table: TelemetryTable) -> None:
    assert show(page, table, seen(1.0)) == {}
    assert page.parts["telemetry"] == ""


def test_only_what_is_measured_has_a_column(page: FakePage, table: TelemetryTable) -> None:
    rows = show(page, table, seen(1.0, elbow=Quantities(temperature_c=30.0)))
    assert cells(rows[ELBOW]) == ["30 °C"]
    assert re.findall(r"<th>(\w+)</th>", page.parts["telemetry"]) == ["Heat"]


def test_a_servo_that_falls_silent_keeps_its_row_and_every_column_its_place(
    page: FakePage, table: TelemetryTable
) -> None:
    show(page, table, seen(1.0, elbow=NOW, jaw=NOW))
    head = page.parts["telemetry"]
    rows = show(page, table, seen(2.0, jaw=Quantities(load=0.5)))
    assert list(rows) == [ELBOW, JAW] and page.parts["telemetry"] == head
    assert cells(rows[ELBOW]) == ["–"] * 4
    assert cells(rows[JAW]) == ["50 %", "–", "–", "–"]
    rows = show(page, table, replace(seen(3.0), unreachable=True))
    assert list(rows) == [ELBOW, JAW]
    show(page, table, replace(seen(4.0), board=None))
    assert page.parts["telemetry"] == ""


def test_a_level_that_is_passed_has_a_sign_as_well_as_a_colour(page: FakePage, table: TelemetryTable) -> None:
    hot = LevelPassed(ELBOW, "servo 3", "temperature", 62.0, 60.0, 70.0)
    rows = show(page, table, replace(seen(1.0, elbow=NOW, jaw=NOW), levels=(hot,)))
    assert cells(rows[ELBOW])[2] == "⚠ 41 °C" and rows[ELBOW].count("class=warn") == 1
    assert "warn" not in rows[JAW]
    rows = show(page, table, seen(2.0, elbow=replace(NOW, current_a=2.2)))
    assert cells(rows[ELBOW])[1] == "⚠ 2.20 A"


def test_what_only_wavers_is_not_sent_and_nothing_is_sent_more_often_than_five_times_a_second(
    page: FakePage, table: TelemetryTable
) -> None:
    first = show(page, table, seen(1.0, elbow=NOW))
    wavering = replace(NOW, load=-0.29, voltage_v=11.8, current_a=0.77)
    assert show(page, table, seen(2.0, elbow=wavering)) == first
    busy = replace(NOW, load=-0.5)
    shown = show(page, table, seen(3.0, elbow=busy))
    assert cells(shown[ELBOW])[0] == "−50 %"
    assert show(page, table, seen(3.1, elbow=NOW)) == shown
    assert cells(show(page, table, seen(3.2, elbow=NOW))[ELBOW])[0] == "−28 %"


def test_it_is_folded_and_the_browser_remembers_that(page: FakePage, table: TelemetryTable) -> None:
    show(page, table, seen(1.0, elbow=NOW))
    page.act(lambda: page.parts.done("telemetry", ""))
    assert "<table" not in page.parts["telemetry"] and "Motors" in page.parts["telemetry"]
    again = TelemetryTable(page.session, lambda: True)
    show(page, again, seen(2.0, elbow=NOW))
    assert "<table" not in page.parts["telemetry"]


def test_where_it_would_hide_the_arm_it_says_the_worst_of_all_motors(page: FakePage) -> None:
    table = TelemetryTable(page.session, lambda: False)
    weaker = replace(NOW, load=-0.4, voltage_v=11.2, current_a=0.1)
    show(page, table, seen(1.0, elbow=NOW, jaw=weaker))
    assert re.findall(r"<span>([^<]*)</span>", page.parts["telemetry"]) == [
        "−40 %", "0.76 A", "41 °C", "11.2 V",
    ]  # fmt: skip
    hot = replace(NOW, temperature_c=66.0, current_a=2.2)
    levels = (LevelPassed(ELBOW, "servo 3", "temperature", 66.0, 60.0, 70.0),)
    show(page, table, replace(seen(2.0, elbow=hot), levels=levels))
    assert re.findall(r"<span class=warn>([^<]*)</span>", page.parts["telemetry"]) == ["⚠ 2.20 A", "⚠ 66 °C"]
    heavy = LevelPassed(ELBOW, "servo 3", "load", 0.85, 0.8, 0.8)
    told = replace(
        seen(2.5, elbow=replace(NOW, load=0.85, current_a=-2.9), jaw=replace(NOW, load=0.95)), levels=(heavy,)
    )
    show(page, table, told)  # the gripper may push harder than that
    assert re.findall(r"<span class=warn>([^<]*)</span>", page.parts["telemetry"]) == ["⚠ 85 %", "⚠ −2.90 A"]
    page.act(lambda: page.parts.done("telemetry", ""))
    assert "<table" in page.parts["telemetry"]
    again = TelemetryTable(page.session, lambda: False)
    show(page, again, seen(3.0, elbow=NOW))
    assert "<table" in page.parts["telemetry"]  # the browser remembers that, too


def test_where_no_limit_is_known_a_bar_has_no_mark() -> None:
    assert bar_scale("temperature_c", QuantityLimits()) == (None, 80.0)
    assert bar_scale("load", QuantityLimits()) == (None, 1.0)
    assert bar_scale("voltage_v", QuantityLimits(voltage_v=9.0)) == (9.0, 16.0)
