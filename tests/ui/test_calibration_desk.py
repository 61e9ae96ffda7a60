"""What is in force, saved and reverted; marks that survive a new arm."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import msgspec
import pytest

from armctl.calibration import CalibrationStore, JointCalibration
from armctl.errors import CalibrationError, PortError, StateError
from armctl.robot import load_robot
from armctl.ui import CalibrationInForce
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration

ROBOT = load_robot("uzuner")
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
