"""Marks, limits and gripper, without a page."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from armctl.calibration import Calibration, JointCalibration, own_calibration
from armctl.errors import CalibrationError, InputError, StateError
from armctl.robot import load_robot
from armctl.ui.tabs.calibration.shared_calibration import CalibrationWork

ROBOT = load_robot("uzuner")
FILE = own_calibration(ROBOT, "base")


def work(in_force: Calibration | None = None) -> CalibrationWork:
    return CalibrationWork(ROBOT, in_force)


def mark(desk: CalibrationWork, joint: str, *pairs: tuple[float, float]) -> None:
    for output, degrees in pairs:
        desk.add_mark(joint, output, math.radians(degrees))


def saved(**joints: JointCalibration) -> Calibration:
    return Calibration("uzuner", "simulated", "µs", joints, (1100.0, 1900.0), "2026-01-01T10:00:00+00:00")


def test_three_marks_make_a_line_and_two_none() -> None:
    desk = work()
    mark(desk, "base", (1500, 0), (1400, 10))
    assert desk.fit("base") is None
    assert desk.unfinished == ("Base",)
    mark(desk, "base", (1300, 20))
    fit = desk.fit("base")
    assert fit is not None
    assert math.radians(fit.per_rad) == pytest.approx(-10)
    assert fit.zero == pytest.approx(1500)
    assert desk.unfinished == ()
    assert desk.measured().keys() == {"base"}


def test_every_change_raises_the_version_and_what_is_refused_does_not() -> None:
    desk = work()
    versions = [desk.version]
    for change in (
        lambda: desk.add_mark("base", 1500, 0.0),
        lambda: desk.choose("elbow"),
        lambda: desk.set_limit("base", "low", 700),
        lambda: desk.set_jaw("closed", 1200),
        lambda: desk.delete_mark("base", 0),
        desk.clear,
    ):
        change()
        versions.append(desk.version)
    assert versions == sorted(set(versions))
    for refused in (
        lambda: desk.add_mark("base", 1500, math.nan),
        lambda: desk.add_mark("thumb", 1500, 0.0),
        lambda: desk.choose("thumb"),
        lambda: desk.delete_mark("base", 0),
        lambda: desk.set_limit("base", "high", 100),
    ):
        with pytest.raises(InputError):
            refused()
    assert desk.version == versions[-1]


@pytest.mark.parametrize("degrees", [721.0, -1e9, math.inf])
def test_what_no_protractor_shows_is_refused(degrees: float) -> None:
    with pytest.raises(InputError, match=r"is outside ±720°; type the angle that the protractor shows"):
        mark(work(), "base", (1500, degrees))


def test_pressing_twice_makes_one_mark_and_reading_again_another() -> None:
    desk = work()
    mark(desk, "base", (1500, 0))
    with pytest.raises(InputError, match=r"mark 1 says the same already \(1500\.0 µs, 0°\); jog"):
        mark(desk, "base", (1500, 0))
    mark(desk, "base", (1500, 0.4))
    assert len(desk.joint("base").marks) == 2


def test_a_mark_that_does_not_fit_is_named_and_can_be_deleted() -> None:
    desk = work()
    mark(desk, "base", (1300, -20), (1400, -10), (1500, 12), (1600, 10), (1700, 20))
    fit = desk.fit("base")
    assert fit is not None
    assert fit.suspect == 2
    desk.delete_mark("base", 2)
    cleaned = desk.fit("base")
    assert cleaned is not None
    assert cleaned.suspect is None
    assert [mark.output for mark in desk.joint("base").marks] == [1300, 1400, 1600, 1700]


def test_marks_of_one_place_are_refused_in_words() -> None:
    desk = work()
    mark(desk, "base", (1500, 0), (1500, 1), (1500, 2))
    with pytest.raises(CalibrationError, match="all marks are at one place"):
        desk.fit("base")
    with pytest.raises(CalibrationError):
        desk.measured()


def test_safe_limits_are_the_files_until_somebody_sets_them() -> None:
    desk = work()
    assert desk.limits("base") == (FILE.low, FILE.high)
    desk.set_limit("base", "low", 700.0)
    assert desk.limits("base") == (700.0, FILE.high)
    desk.set_limit("base", "high", 2100.0)
    assert desk.measured()["base"] == JointCalibration(FILE.zero, FILE.per_rad, 700.0, 2100.0)
    desk.limits_by_default("base")
    assert desk.limits("base") == (FILE.low, FILE.high)


def test_limits_that_cross_are_refused() -> None:
    desk = work()
    desk.set_limit("base", "low", 1400.0)
    with pytest.raises(InputError, match=r"1300\.0 µs cannot be the upper limit, the lower one is 1400\.0"):
        desk.set_limit("base", "high", 1300.0)
    with pytest.raises(InputError, match=r"cannot be the lower limit, the upper one is 2446"):
        desk.set_limit("base", "low", 2446.0)


def test_limits_set_by_hand_stay_when_the_line_is_measured_anew() -> None:
    desk = work(saved(base=JointCalibration(1500, 500, 800, 2200)))
    assert desk.limits("base") == (800, 2200)
    mark(desk, "base", (1300, -20), (1500, 0), (1700, 20))
    assert desk.limits("base") == (800, 2200)
    desk.limits_by_default("base")
    low, high = desk.limits("base")
    assert low < 800 < 2200 < high
    assert (FILE.low <= low) and (high <= FILE.high)


def test_limits_that_the_line_in_force_needed_go_with_the_new_line() -> None:
    """Else each measuring takes a little more from the joint, and from an encoder's a lot."""
    scorbot = load_robot("scorbot")
    own = own_calibration(scorbot, "waist")
    now = Calibration("scorbot", "7", "counts", {"waist": own})
    desk = CalibrationWork(scorbot, now)
    assert desk.limits("waist") == (own.low, own.high)
    per_deg = 1.1 * math.radians(own.per_rad)
    mark(desk, "waist", *((per_deg * degrees, degrees) for degrees in (-90.0, 0.0, 90.0)))
    assert desk.limits("waist") == pytest.approx((1.1 * own.low, 1.1 * own.high))
    assert desk.measured()["waist"].angles() == pytest.approx(tuple(scorbot.limits[0]))


def test_limits_by_default_follow_the_marks_that_come_after() -> None:
    desk = work()
    desk.set_limit("base", "low", 900.0)
    desk.limits_by_default("base")
    assert desk.limits("base") == (FILE.low, FILE.high)
    mark(desk, "base", (1340, -20), (1500, 0), (1660, 20))
    assert desk.measured()["base"].angles() == pytest.approx(tuple(ROBOT.limits[0]))


def test_limits_by_default_without_marks_are_those_of_the_line_in_force() -> None:
    desk = work(saved(base=JointCalibration(1500, math.degrees(8.0), 800, 2200)))
    desk.limits_by_default("base")
    assert desk.measured()["base"].angles() == pytest.approx(tuple(ROBOT.limits[0]))


def test_only_limits_set_keeps_the_line_in_force() -> None:
    desk = work(saved(base=JointCalibration(1500, 500, 800, 2200)))
    desk.set_limit("base", "low", 900)
    assert desk.measured() == {"base": JointCalibration(1500, 500, 900, 2200)}


def test_the_gripper_is_closed_and_open_at_two_outputs() -> None:
    desk = work()
    assert desk.jaw("closed") == desk.map.gripper_closed
    desk.set_jaw("closed", 1150.0)
    assert (desk.jaw("closed"), desk.jaw("open")) == (1150.0, desk.map.gripper_open)
    with pytest.raises(
        InputError, match=r"the gripper is closed at 1150\.0 µs; move it before you call it open"
    ):
        desk.set_jaw("open", 1150.2)
    assert work(saved()).jaw("open") == 1900.0


def test_another_desk_goes_on_with_all_of_it() -> None:
    first, second = work(), work(saved())
    mark(first, "elbow", (1500, 3))
    first.choose("elbow")
    first.set_jaw("open", 1800.0)
    second.take_over(first)
    assert second.joint("elbow") == first.joint("elbow")
    assert (second.chosen, dict(second.jaws)) == ("elbow", {"open": 1800.0})
    second.delete_mark("elbow", 0)
    assert len(first.joint("elbow").marks) == 1


def test_an_arm_without_outputs_has_nothing_to_calibrate() -> None:
    desk = CalibrationWork(replace(ROBOT, output_map=None), None)
    with pytest.raises(StateError, match="nothing to calibrate"):
        _ = desk.map


def test_a_joint_that_is_held_is_not_the_first_to_be_chosen() -> None:
    humanoid = load_robot("humanoid")
    held = [joint.name for joint in humanoid.joints if joint.lower == joint.upper]
    assert held
    assert CalibrationWork(humanoid, None).chosen not in held
    assert np.isfinite(humanoid.limits).all()
