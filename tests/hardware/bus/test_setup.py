"""Setting servos up on a simulated bus: scan, differences, ids, EEPROM, nudges, LeRobot's files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.hardware.bus_kit import BusBench, TimedLoop

from armctl.errors import BoardError, BoardTimeoutError, InputError
from armctl.hardware.bus.lerobot import changed, read_kept, write_kept
from armctl.hardware.bus.setup import BusSetup, differences
from armctl.hardware.faults import Fault
from armctl.hardware.feetech.make import FEETECH
from armctl.hardware.servos import Difference
from armctl.robot import load_robot

ROBOT = load_robot("so101")
NAMES = dict(zip(ROBOT.outputs.channels, ROBOT.joint_names, strict=True)) | {6: "gripper"}
BAUD = 1_000_000


class Desk:
    """A bus on a desk, and whoever sets it up."""

    def __init__(self) -> None:
        self.bench = BusBench(ROBOT)
        self.bus, self.opened = self.bench.bus, list[int]()
        self.setup = BusSetup(FEETECH, self._open, self.bench.clock.now, 0.008)

    def _open(self, baud: int):
        self.opened.append(baud)
        return TimedLoop(self.bench.faulty, self.bench.clock, baud)

    def told(self) -> list[Difference]:
        found = self.setup.scan([BAUD], range(12))
        return differences(found, self.bench.setup.channels, BAUD, NAMES)

    def cut_power(self) -> None:
        self.bus.reset()


@pytest.fixture
def desk() -> Iterator[Desk]:
    yield Desk()


def test_a_scan_lists_who_answers_and_changes_nothing(desk: Desk):
    shares: list[float] = []
    found = desk.setup.scan([BAUD], range(12), progress=shares.append)
    assert [(one.id, one.model, one.voltage, one.on) for one in found] == [
        (servo, "STS3215", 12.0, False) for servo in range(1, 7)
    ]
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert desk.told() == []
    assert all(one.code in (1, 2) for one in desk.bus.heard)  # pings and reads


def test_a_scan_looks_at_each_rate_and_can_be_ended(desk: Desk):
    desk.setup.scan([BAUD, 115_200], range(2))
    assert desk.opened == [BAUD, 115_200]

    def end(_: float) -> None:
        raise InputError("ended")

    with pytest.raises(InputError):
        desk.setup.scan([BAUD], range(200), progress=end)


def test_a_new_servo_gets_its_id_which_outlives_a_power_cut(desk: Desk):
    desk.bus.servo(6).put("id", 1)
    desk.bus.servos[:] = desk.bus.servos[5:]  # alone on the bus
    found = desk.setup.change_id(BAUD, 1, 6)
    assert found.id == 6
    desk.cut_power()
    assert [one.id for one in desk.bus.servos] == [6]
    assert desk.bus.servos[0].get("lock") == 1


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [(1, 253, InputError), (9, 10, BoardTimeoutError), (1, 2, BoardError)],
)
def test_an_id_that_cannot_be_given_changes_nothing(desk: Desk, old: int, new: int, error: type[Exception]):
    with pytest.raises(error):
        desk.setup.change_id(BAUD, old, new)
    assert [one.id for one in desk.bus.servos] == [1, 2, 3, 4, 5, 6]


def test_no_eeprom_is_written_under_torque(desk: Desk):
    desk.bus.servo(2).written(40, b"\1")
    with pytest.raises(BoardError, match="torque of servo 2 is on"):
        desk.setup.write(BAUD, 2, "lowest", 100)
    assert desk.bus.servo(2).get("lowest") == 0


@pytest.mark.parametrize("servo", [1, 4])
def test_a_nudge_shows_the_servo_and_leaves_it_limp_where_it_was(desk: Desk, servo: int):
    one = desk.bus.servo(servo)
    before, farthest = one.shaft, [0.0]
    drive = one.drive

    def watched(dt: float) -> float:
        farthest.append(abs(one.shaft - before))
        return drive(dt)

    one.drive = watched  # type: ignore[method-assign]
    desk.setup.nudge(BAUD, servo)
    assert 3 < max(farthest) <= 2.2 * 4096 / 360
    assert not one.driven and one.get("torque_limit") == 300


def test_a_nudge_of_an_arm_that_holds_or_of_more_than_two_degrees_is_refused(desk: Desk):
    with pytest.raises(InputError, match="2 °"):
        desk.setup.nudge(BAUD, 1, 5.0)
    desk.bus.servo(1).written(40, b"\1")
    with pytest.raises(BoardError, match="it holds an arm"):
        desk.setup.nudge(BAUD, 1)


# What differs.


def test_a_loose_plug_is_told_by_the_first_servo_behind_it(desk: Desk):
    desk.bus.loose = 3
    told = desk.told()
    assert [one.servo for one in told] == [4, 5, 6]
    assert all("plug before servo 4" in one.cure for one in told)


def test_a_servo_with_another_id_is_told_with_the_command_that_mends_it(desk: Desk):
    desk.bus.servo(3).put("id", 9)
    told = desk.told()
    assert told[0].servo == 3 and "armctl servos id 9 3" in told[0].cure
    assert told[-1] == Difference(9, told[-1].what, told[-1].cure)


@pytest.mark.parametrize(
    ("register", "number", "words"),
    [
        ("mode", 1, "mode 1"),
        ("phase", 28, "several turns"),
        ("highest", 2500, "cut off"),
        ("offset", 7, "offset"),
    ],
)
def test_what_another_tool_left_in_the_eeprom_is_named(desk: Desk, register: str, number: int, words: str):
    desk.bus.servo(5).put(register, number)
    told = desk.told()
    assert [one.servo for one in told] == [5] and words in told[0].what


# LeRobot's files.


def test_a_saved_calibration_is_lerobots_and_restores_what_was_changed(desk: Desk, tmp_path: Path):
    found = {one.id: one for one in desk.setup.scan([BAUD], range(12))}
    file = tmp_path / "so101.json"
    write_kept(file, {name: found[servo] for servo, name in NAMES.items()})
    assert json.loads(file.read_text())["wrist_roll"] == {
        "id": 5, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 4095,
    }  # fmt: skip
    desk.setup.write(BAUD, 5, "offset", -120)
    desk.setup.write(BAUD, 5, "lowest", 700)
    one = desk.setup.look(BAUD, 5)
    assert one is not None
    differ = changed(read_kept(file)["wrist_roll"], one)
    assert differ == [("offset", 0, -120), ("lowest", 0, 700)]
    for register, wanted, _ in differ:
        desk.setup.write(BAUD, 5, register, wanted)
    desk.cut_power()
    again = desk.setup.look(BAUD, 5)
    assert again is not None and changed(read_kept(file)["wrist_roll"], again) == []


def test_an_id_whose_confirmation_is_lost_is_told_as_it_is(desk: Desk):
    desk.bus.servos[:] = desk.bus.servos[:1]
    servo = desk.bus.servos[0]
    written = servo.written

    def lost(address: int, data: bytes) -> int:
        if address == 5:
            desk.bench.faulty.inject(Fault.DROP_REPLY, 1)
        return written(address, data)

    servo.written = lost  # type: ignore[method-assign]
    assert desk.setup.change_id(BAUD, 1, 6).id == 6
    assert servo.get("lock") == 1


def test_an_id_that_was_not_taken_leaves_the_eeprom_locked(desk: Desk):
    servo = desk.bus.servo(1)
    written = servo.written
    servo.written = lambda address, data: 0 if address == 5 else written(address, data)  # type: ignore[method-assign]
    with pytest.raises(BoardError):
        desk.setup.change_id(BAUD, 1, 9)
    assert servo.get("lock") == 1 and servo.id == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[]", "not a calibration of LeRobot"),
        ('{"a": {"id": 1}}', "not a calibration of LeRobot"),
        ('{"a": {"id": 300, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 9}}', "252"),
        (
            '{"a": {"id": 1, "drive_mode": 0, "homing_offset": 0, "range_min": 4000, "range_max": 90}}',
            "crosses the end of the turn",
        ),
        (
            '{"a": {"id": 1, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 9},'
            ' "b": {"id": 1, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 9}}',
            "two motors have the id 1",
        ),
    ],
)
def test_a_file_that_is_no_calibration_is_refused_by_name(tmp_path: Path, text: str, words: str):
    file = tmp_path / "bad.json"
    file.write_text(text)
    with pytest.raises(InputError, match=words) as refused:
        read_kept(file)
    assert "bad.json" in str(refused.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="cannot be read"):
        read_kept(tmp_path / "none.json")
