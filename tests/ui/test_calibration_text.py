"""The words of the wizard."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from armctl.calibration import Calibration, CalibrationStore, JointCalibration, check_pose
from armctl.robot import load_robot, shipped_robots
from armctl.ui import CalibrationInForce
from armctl.ui.tabs.calibration.joint import (
    STEPS,
    fit_html,
    limits_html,
    marks_html,
    slow_duration,
    slow_speeds,
)
from armctl.ui.tabs.calibration.points import numbered
from armctl.ui.tabs.calibration.screen import (
    check_pose_html,
    draft_html,
    earlier_versions,
    in_force_html,
    kept_html,
    overview_html,
)
from armctl.ui.tabs.calibration.shared_calibration import CalibrationWork, SharedCalibration

ROBOT = load_robot("uzuner")
LINE = JointCalibration(1500, 500, 800, 2200)


def plain(html: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html)).strip()


def measured(*pairs: tuple[float, float]) -> CalibrationWork:
    work = CalibrationWork(ROBOT, None)
    for output, degrees in pairs:
        work.add_mark("base", output, math.radians(degrees))
    return work


def test_what_is_in_force_is_named_with_its_board_and_its_note_as_text() -> None:
    said = plain(in_force_html(None, "simulated"))
    assert said == "In force: the robot file This arm is not calibrated on the simulated board."
    made = Calibration("uzuner", "77", "µs", {"base": LINE}, None, "2026-03-01T12:00:00+00:00", "<b>horn</b>")
    html = in_force_html(made, "77")
    assert "<b>horn" not in html
    assert re.search(r"calibration of 2026-0\d-\d\d \d\d:\d\d “&lt;b&gt;horn", html)
    assert "1 joint of this arm on board 77" in plain(html)
    assert "one calibration for all such boards" in in_force_html(None, "unnumbered")
    assert "none is there yet" in in_force_html(None, None)


def test_marks_show_residuals_once_there_is_a_line() -> None:
    work = measured((1400, 10), (1500, 0))
    assert "1 more mark needed" in fit_html(work, "base")
    assert "1400.0 10.00 2 1500.0 0.00" in plain(marks_html(work.joint("base").marks, None, "µs"))
    work = measured((1400, 10), (1500, 0.3), (1600, -10))
    said = plain(marks_html(work.joint("base").marks, work.fit("base"), "µs"))
    assert "1500.0 0.30 0.20" in said
    assert "No marks yet" in marks_html((), None, "µs")


def test_the_line_is_told_beside_the_robot_files() -> None:
    work = measured((1400, 10), (1500, 0), (1600, -10), (1700, -20))
    said = plain(fit_html(work, "base"))
    assert "sign − +" in said
    assert "offset (at 0°) 1500.0 µs 1479.9 µs" in said
    assert "scale 10.000 µs/° 9.000 µs/°" in said
    assert "Base turns the other way than uzuner says." in said


def test_an_encoders_home_is_told() -> None:
    work = CalibrationWork(load_robot("scorbot"), None)
    for counts, degrees in ((0, 1.0), (1400, 11), (2800, 21)):
        work.add_mark(work.chosen, counts, math.radians(degrees))
    assert "home (0 counts) is at 1.00° 0.00°" in plain(fit_html(work, work.chosen))
    assert "scale 140.000 counts/°" in plain(fit_html(work, work.chosen))


def test_a_wrong_mark_is_named_in_the_table_and_in_words() -> None:
    work = measured((1300, -20), (1400, -10), (1500, 15), (1600, 10), (1700, 20))
    assert "Mark 3 does not fit" in plain(fit_html(work, "base"))
    assert "✗" in marks_html(work.joint("base").marks, work.fit("base"), "µs")
    assert "✗" in overview_html(work)


def test_marks_without_a_line_are_told_and_break_nothing() -> None:
    work = measured((1500, 0), (1500, 1), (1500, 2))
    assert "All marks are at one place" in plain(fit_html(work, "base"))
    assert "no line" in overview_html(work)
    assert "All marks are at one place" in plain(limits_html(work, "base"))


def test_limits_say_where_they_come_from() -> None:
    work = CalibrationWork(ROBOT, None)
    assert plain(limits_html(work, "base")) == "554.0 … 2446.0 µs (as the robot file allows)"
    work.set_limit("base", "low", 700)
    assert plain(limits_html(work, "base")) == "700.0 … 2446.0 µs (set here)"
    saved = Calibration("uzuner", "simulated", "µs", {"base": LINE})
    assert plain(limits_html(CalibrationWork(ROBOT, saved), "base")) == "800.0 … 2200.0 µs (as in force)"


def test_limits_by_new_marks_are_not_called_those_in_force() -> None:
    now = Calibration("uzuner", "77", "µs", {"base": JointCalibration(1480, 515, 600, 2380)})
    work = CalibrationWork(ROBOT, now)
    assert plain(limits_html(work, "base")).endswith("(as in force)")
    for output, degrees in ((1340, -20), (1500, 0), (1660, 20)):
        work.add_mark("base", output, math.radians(degrees))
    assert plain(limits_html(work, "base")).endswith("(as in force, by the new marks)")
    work.limits_by_default("base")
    assert plain(limits_html(work, "base")).endswith("(as the robot file allows)")


def test_what_saving_takes_from_the_joints_is_told_before(tmp_path: Path) -> None:
    desk = SharedCalibration(CalibrationInForce(ROBOT, "simulated", CalibrationStore(tmp_path)), lambda: 0.0)
    assert "There is nothing to save yet" in plain(draft_html(desk))
    desk.work.set_limit("base", "low", 1000)
    assert "Base: −53.33° … 107.26° instead of −102.80°" in plain(draft_html(desk))
    assert "Nothing was saved" in kept_html(())


def test_the_version_before_the_one_in_force_is_offered_first(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    for note in ("a", "b", "<c>"):
        store.save(Calibration("uzuner", "1", "µs", {"base": LINE}, None, "2026-03-01T12:00:00+00:00", note))
    versions = store.versions("uzuner", "1")
    labels = earlier_versions(versions)
    assert list(labels.values()) == [2, 1, None]
    assert "“b”" in next(iter(labels))
    assert str(versions[0].path.parent) in plain(kept_html(versions))
    assert earlier_versions(()) == {"robot file, no calibration": None}


@pytest.mark.parametrize("name", shipped_robots())
def test_the_test_pose_says_what_one_should_see(name: str) -> None:
    robot = load_robot(name)
    said = plain(check_pose_html(check_pose(robot)))
    assert all(joint.title in said for joint in robot.joints)
    assert "mm from the base" in said


@pytest.mark.parametrize("name", shipped_robots())
def test_steps_are_slow(name: str) -> None:
    robot = load_robot(name)
    for step in STEPS.values():
        way = np.zeros(robot.n)
        way[0] = math.radians(step)
        assert abs(way[0]) / slow_duration(robot, way) <= math.radians(10.0) + 1e-12
    assert (slow_speeds(robot) <= 0.15 * robot.speed_limits).all()


def test_a_list_of_nothing_has_one_hidden_entry() -> None:
    assert numbered(0) == ("1",)
    assert numbered(3) == ("1", "2", "3")
