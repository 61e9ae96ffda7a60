"""Setting servos up on a simulated bus: scan, differences, ids, EEPROM, nudges, LeRobot's files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.hardware.bus_kit import BusBench, TimedLoop

from armctl.errors import BoardError, BoardTimeoutError, InputError
from armctl.facts.servos import ServoAtBaud, ServoChanged, ServoRange, ServoSilent, ServoStranger
from armctl.hardware.bus.differences import differences
from armctl.hardware.bus.lerobot import changed, read_kept, write_kept
from armctl.hardware.bus.setup import BusSetup
from armctl.hardware.faults import Fault
from armctl.hardware.feetech.make import FEETECH
from armctl.hardware.servo_records import KeptSettings, ServoRecords
from armctl.hardware.servos import Difference, Mend
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
    assert told[0].fact == ServoSilent(3, "elbow_flex", stranger=9)
    assert told[0].mend == Mend(9, BAUD, new_id=3)
    assert told[-1] == Difference(9, ServoStranger(9))


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


@pytest.mark.parametrize(
    ("register", "number"), [("mode", 1), ("phase", 28), ("highest", 2500), ("status_level", 0)]
)
def test_the_cure_of_a_register_is_written_locked_and_ends_the_difference(
    desk: Desk, register: str, number: int
):
    servo = desk.bus.servo(5)
    servo.put(register, number)
    (told,) = desk.told()
    assert told.mend is not None and told.mend.carry_out(desk.setup) is not None
    assert desk.told() == [] and servo.get("lock") == 1
    desk.cut_power()
    assert desk.told() == []


def test_limits_are_widened_only_as_far_as_the_joint_needs(desk: Desk):
    desk.bus.servo(5).put("highest", 2500)
    desk.bus.servo(5).put("lowest", 10)
    (told,) = desk.told()
    assert told.fact == ServoRange(5, 10, 2500, 259.0, 3901.0)
    assert told.mend == Mend(5, BAUD, numbers=(("highest", 3901),))


def test_a_register_that_is_not_kept_or_not_there_is_refused_by_name(desk: Desk):
    for name in ("torque", "colour"):
        with pytest.raises(InputError, match=f"keeps no '{name}'; it keeps .*offset"):
            desk.setup.write(BAUD, 5, name, 1)


# Baud rates.


def test_a_servo_that_is_set_to_another_rate_is_looked_for_at_that(desk: Desk):
    found = desk.setup.change_baud(57_600, 3, BAUD)
    assert (found.baud, desk.bus.servo(3).get("baud"), desk.bus.servo(3).get("lock")) == (BAUD, 0, 1)
    assert desk.opened == [57_600, BAUD]
    with pytest.raises(InputError, match="9600 baud"):
        desk.setup.change_baud(BAUD, 3, 9_600)
    desk.bus.servo(3).written(40, b"\1")
    with pytest.raises(BoardError, match="torque of servo 3 is on"):
        desk.setup.change_baud(BAUD, 3, 57_600)


def test_a_servo_at_another_rate_is_a_difference_with_its_cure(desk: Desk):
    (one,) = desk.setup.scan([57_600], [3])
    channels = [one for one in desk.bench.setup.channels if one.channel == 3]
    (told,) = differences([one], channels, BAUD, NAMES)
    assert told.fact == ServoAtBaud(3, 57_600, BAUD) and told.mend == Mend(3, 57_600, new_baud=BAUD)


# What was kept as right.


def test_what_another_program_changed_since_it_was_kept_is_named_with_what_it_was(desk: Desk, tmp_path: Path):
    records, found = ServoRecords(tmp_path), desk.setup.scan([BAUD], range(12))
    assert records.load("so101", "A1") == {}
    records.keep("so101", "A1", found)
    desk.bus.servo(4).put("offset", -120)
    kept = records.load("so101", "A1")
    told = differences(desk.setup.scan([BAUD], range(12)), desk.bench.setup.channels, BAUD, NAMES, kept)
    assert [one.fact for one in told] == [ServoChanged(4, "offset", 0, -120)]
    assert told[0].mend == Mend(4, BAUD, numbers=(("offset", 0),))
    one = desk.setup.look(BAUD, 4)
    assert one is not None
    kept = records.keep("so101", "A1", [one])
    assert kept[4].offset == -120 and kept[3].offset == 0 and len(kept) == 6
    assert differences([*found[:3], one, *found[4:]], desk.bench.setup.channels, BAUD, NAMES, kept) == []
    assert records.load("so101", "B2") == {}


def test_a_record_that_cannot_be_read_is_refused_by_its_file(desk: Desk, tmp_path: Path):
    records = ServoRecords(tmp_path)
    records.keep("so101", "A1", desk.setup.scan([BAUD], [1]))
    (file,) = tmp_path.glob("*/*.toml")
    text = file.read_text()
    for bad, words in (
        (text.replace("mode", "mood"), "mood"),
        (text.replace("servos.1", "servos.one"), "servos.one"),
        (text.replace("A1", "B2"), "board B2"),
    ):
        file.write_text(bad)
        with pytest.raises(InputError, match=words) as refused:
            records.load("so101", "A1")
        assert file.name in str(refused.value)


@pytest.mark.parametrize(
    ("robot", "register", "number", "words"),
    [
        ("so101", None, 0, None),
        ("so101", "offset", -120, "its homing offset is -120, and was 0"),
        ("so101", "lowest", 300, "its lowest position is 300, and was 0"),
        ("so101", "highest", 3800, "its highest position is 3800, and was 4095"),
        ("so101", "mode", 1, "its operating mode is 1, and was 0"),
        ("open_manipulator_x", None, 0, None),
        ("open_manipulator_x", "homing_offset", 77, "its homing offset is 77, and was 0"),
        ("open_manipulator_x", "min_position_limit", 300, "its lowest position is 300, and was 0"),
        ("open_manipulator_x", "operating_mode", 1, "its operating mode is 1, and was 3"),
    ],
)
def test_a_change_by_another_program_is_named_at_connect_and_nothing_is_written(
    robot: str, register: str | None, number: int, words: str | None
):
    mode = 3 if robot == "open_manipulator_x" else 0
    bench = BusBench(robot, kept=lambda _: dict.fromkeys(range(1, 20), KeptSettings(0, 0, 4095, mode)))
    second = bench.ids[1]
    if register is not None:
        bench.bus.servo(second).put(register, number)
    told = [one for one in bench.open().identity.earlier if "another program has changed it" in one]
    assert len(told) == (words is not None)
    assert all(one.startswith(f"servo {second}: {words}") for one in told)
    assert register is None or bench.bus.servo(second).get(register) == number


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
