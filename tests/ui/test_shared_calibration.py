"""Marks, limits and gripper without a page; saved, reverted, and taken over by a new arm."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from armctl.calibration import Calibration, CalibrationStore, JointCalibration, own_calibration
from armctl.errors import CalibrationError, InputError, PortError, StateError
from armctl.robot import load_robot
from armctl.ui import CalibrationInForce
from armctl.ui.tabs.calibration.shared_calibration import CalibrationWork, SharedCalibration

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
    with pytest.raises(CalibrationError, match="nothing to calibrate"):
        _ = desk.map


def test_a_joint_that_is_held_is_not_the_first_to_be_chosen() -> None:
    humanoid = load_robot("humanoid")
    held = [joint.name for joint in humanoid.joints if joint.lower == joint.upper]
    assert held
    assert CalibrationWork(humanoid, None).chosen not in held
    assert np.isfinite(humanoid.limits).all()


NOON = 1_767_268_800.0


@pytest.fixture
def store(tmp_path: Path) -> CalibrationStore:
    return CalibrationStore(tmp_path)


def desk(store: CalibrationStore, board: str | None = "00123456") -> SharedCalibration:
    return SharedCalibration(CalibrationInForce(ROBOT, board, store), lambda: NOON)


def measure(one: SharedCalibration, joint: str = "base", zero: float = 1510.0, per_deg: float = -9.5) -> None:
    for degrees in (-40, -15, 10, 45):
        one.work.add_mark(joint, zero + per_deg * degrees, math.radians(degrees))


def save(one: SharedCalibration, note: str = "") -> Path:
    return asyncio.run(one.save(note)).path


def test_what_is_saved_is_in_force_at_the_next_desk(store: CalibrationStore, tmp_path: Path) -> None:
    first = desk(store)
    assert first.in_force is None
    measure(first)
    path = save(first, "new horn")
    assert path.is_file()
    assert path.is_relative_to(tmp_path)
    second = desk(store)
    assert second.in_force is not None
    assert second.in_force.note == "new horn"
    now = CalibrationInForce(ROBOT, "00123456", store).robot.output_map
    assert now is not None
    assert math.radians(now.per_rad[0]) == pytest.approx(-9.5)
    assert desk(store, "another board").in_force is None


def test_what_was_not_measured_stays_as_in_force(store: CalibrationStore) -> None:
    first = desk(store)
    measure(first)
    first.work.set_jaw("closed", 1200.0)
    save(first)
    second = desk(store)
    measure(second, "elbow", 1450, 10.2)
    drawn = second.draft()
    assert second.in_force is not None
    assert drawn.joints["base"] == second.in_force.joints["base"]
    assert drawn.joints.keys() == {"base", "elbow"}
    assert drawn.gripper == (1200.0, second.work.map.gripper_open)


def test_nothing_is_saved_twice_and_nothing_out_of_nothing(store: CalibrationStore) -> None:
    first = desk(store)
    with pytest.raises(StateError, match="there is nothing to save yet: a joint needs three marks"):
        first.draft()
    first.work.add_mark("base", 1500, 0.0)
    with pytest.raises(StateError, match=r"nothing to save yet \(Base: too few marks\)"):
        first.draft()
    first.work.clear()
    measure(first)
    save(first)
    second = desk(store)
    second.adopt(first)
    with pytest.raises(StateError, match="everything is saved"):
        second.draft()


def test_a_measurement_that_leaves_nothing_of_a_joint_is_not_saved(store: CalibrationStore) -> None:
    one = desk(store)
    measure(one, "base", 5000, 20)
    with pytest.raises(CalibrationError, match="Base: its limits"):
        one.draft()
    assert store.versions("uzuner", "00123456") == ()


def test_marks_go_on_at_the_new_desk_of_the_same_arm_only(store: CalibrationStore) -> None:
    first = desk(store)
    measure(first)
    first.points.add(dict.fromkeys(range(5), 1500.0), ROBOT.forward(ROBOT.pose("home"))[:3, 3])
    same, other = desk(store), desk(store, "another board")
    nameless = desk(store, None)
    for one in (same, other, nameless):
        one.adopt(first)
    assert len(same.work.joint("base").marks) == 4
    assert len(same.points.touches) == 1
    assert not other.work.joint("base").marks
    assert not nameless.work.joint("base").marks
    nameless.adopt(desk(store, None))


def test_reverting_brings_an_earlier_one_or_the_robot_file_back(store: CalibrationStore) -> None:
    one = desk(store)
    measure(one)
    save(one, "first")
    two = desk(store)
    measure(two, zero=1600)
    save(two, "second")
    three = desk(store)
    assert [version.note for version in three.versions()] == ["second", "first"]
    asyncio.run(three.revert(three.versions()[1].number))
    back = desk(store)
    assert back.in_force is not None
    assert back.in_force.note == "first"
    asyncio.run(back.revert(None))
    assert desk(store).in_force is None
    assert len(desk(store).versions()) == 4
    with pytest.raises(StateError, match="the robot file is in force already"):
        asyncio.run(desk(store).revert(None))


def test_an_earlier_one_that_no_longer_fits_is_not_brought_back(store: CalibrationStore) -> None:
    one = desk(store)
    measure(one)
    drawn = one.draft()
    impossible = JointCalibration(1500, 500, 3000, 3100)
    broken = store.save(msgspec.structs.replace(drawn, joints={"base": impossible}))
    store.forget("uzuner", "00123456", "2026-01-01T00:00:00+00:00")
    with pytest.raises(CalibrationError, match="nothing is left"):
        asyncio.run(desk(store).revert(broken.number))
    assert desk(store).in_force is None


def test_without_a_board_nothing_is_kept(store: CalibrationStore) -> None:
    one = desk(store, None)
    measure(one)
    with pytest.raises(StateError, match="there is none to keep a calibration for; connect it first"):
        one.draft()
    with pytest.raises(StateError, match="no board was found"):
        asyncio.run(one.revert(None))
    assert one.versions() == ()


def test_what_is_in_force_depends_on_the_board_at_the_port(store: CalibrationStore) -> None:
    one = CalibrationInForce.of(ROBOT, "sim", store)
    assert one.board == "simulated"
    assert one.robot is ROBOT
    assert asyncio.run(one.holds_for("sim"))
    assert not asyncio.run(one.holds_for("socket://127.0.0.1:5000"))
    assert CalibrationInForce.of(ROBOT, "socket://127.0.0.1:5000", store).board == "unnumbered"
    with pytest.raises(PortError, match="/dev/nobody: no such port"):
        asyncio.run(one.holds_for("/dev/nobody"))


@pytest.mark.parametrize("port", ["auto", "/dev/nobody"])
def test_a_program_may_start_before_its_board_is_plugged_in(store: CalibrationStore, port: str) -> None:
    assert CalibrationInForce.of(ROBOT, port, store).board is None


def test_what_somebody_else_saved_meanwhile_is_not_overwritten(store: CalibrationStore) -> None:
    first, second = desk(store), desk(store)
    measure(first)
    measure(second, "elbow", 1450.0, 10.2)
    save(first)
    with pytest.raises(StateError, match="was saved since it was opened; press Disconnect and Connect"):
        save(second)
    assert len(store.versions("uzuner", "00123456")) == 1
    third = desk(store)
    third.adopt(second)
    save(third)
    kept = store.load("uzuner", "00123456")
    assert kept is not None and set(kept.joints) == {"base", "elbow"}


def test_an_arm_runs_by_what_is_in_force_until_something_else_is_saved(store: CalibrationStore) -> None:
    one = CalibrationInForce(ROBOT, "simulated", store)
    assert asyncio.run(one.holds_for("sim"))
    other = desk(store, "simulated")
    measure(other)
    save(other)
    assert not asyncio.run(one.holds_for("sim"))
