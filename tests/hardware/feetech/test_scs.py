"""Servos of the SCS series: what differs from STS, on the line, in the rite, for other programs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import rustypot
import scservo_sdk
from tests.hardware.bus_kit import BusBench, Moments
from tests.hardware.lines import LoopTransport

import armctl
from armctl.boards import setup_of
from armctl.cli.main import DONE, run
from armctl.errors import BoardError, EnableError, RobotFileError, StateError
from armctl.hardware.board_type import ChannelsToCheck, CheckUp, Verdict
from armctl.hardware.boards import board_type
from armctl.hardware.bus import setup
from armctl.hardware.bus.packets import BusPacket, Instruction
from armctl.hardware.bus.simulated import SimulatedBus
from armctl.hardware.driver import abilities_of
from armctl.hardware.feetech.scs import SCS, TABLE
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock
from armctl.robot import Robot, load_robot

SO101 = (Path(armctl.__file__).parents[2] / "robots/so101.toml").read_text(encoding="utf-8")
STEPS_PER_DEG = 1024 / 300


def as_scs(text: str) -> str:
    """An SO-101 with SCS servos; its joints turn by 100° at most, as far as such a servo does."""
    text = text.replace('kind = "feetech"', 'kind = "feetech_scs"')
    text = text.replace(
        "zero_steps = 2048, steps_per_deg = 11.3778", f"zero_steps = 512, steps_per_deg = {STEPS_PER_DEG}"
    )
    text = re.sub(r"range_steps = \[.*?\]", "range_steps = [1, 1023]", text)
    text = text.replace("limit_deg = [-157.21, 162.79]", "limit_deg = [-140, 140]")
    return text.replace("closed_steps = 1934, open_steps = 3186", "closed_steps = 480, open_steps = 800")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("scs") / "scs.toml"
    path.write_text(as_scs(SO101), encoding="utf-8")
    return load_robot(path)


@pytest.fixture
def arm(robot: Robot) -> BusBench:
    return BusBench(robot, {"volts": 7.4}).open()


def enabled(arm: BusBench) -> BusBench:
    refused = arm.enable()
    assert refused is None, refused
    return arm


# On the line.


class Heard:
    """Stands for the vendor's port: keeps what is written, and answers nothing."""

    is_using = False

    def __init__(self) -> None:
        self.written = bytearray()

    def clearPort(self) -> None:  # noqa: N802
        self.written.clear()

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.written += bytes(packet)
        return len(packet)


def test_our_bytes_are_those_of_the_vendor():
    heard, form = Heard(), SCS.form
    vendor = scservo_sdk.scscl(heard)
    goal = SCS.goal_bytes(300) + TABLE.encode("goal_time", 0) + TABLE.encode("goal_speed", 500)
    vendor.txPacket([0xFF, 0xFF, 1, 9, 3, 42, *goal, 0])
    assert bytes(heard.written) == form.write(1, 42, goal)
    assert bytes(heard.written).hex(" ") == "ff ff 01 09 03 2a 01 2c 00 00 01 f4 a6"
    heard.is_using = False
    vendor.SyncWritePos(1, 300, 0, 500)
    vendor.SyncWritePos(2, 700, 0, 500)
    vendor.groupSyncWrite.txPacket()
    second = SCS.goal_bytes(700) + goal[2:]
    assert bytes(heard.written) == form.sync_write(42, {1: goal, 2: second})


def test_words_begin_with_the_upper_byte():
    answer = BusPacket(
        1,
        0,
        bytes.fromhex("01 00 02 00 00 00 01 f4 00")
        + bytes(7)
        + bytes.fromhex("02 04 80 0a 04 64 4a 19 00 00 01"),
    )
    told = SCS.understood(answer, SCS.telemetry)
    assert (told.goal, told.position, told.on, told.forgot) == (512, 516, True, False)
    assert (told.load, told.voltage, told.temperature, told.current) == (-0.1, 7.4, 25.0, None)


def test_several_are_read_one_after_the_other_and_never_by_a_sync_read(arm: BusBench):
    began = arm.clock.now()
    back = arm.driver.read()
    assert arm.clock.now() - began < 0.012
    assert set(back.positions) == set(range(1, 7)) and None not in back.positions.values()
    assert (back.asked, back.lost) == (12, 0)
    assert not any(one.code == Instruction.SYNC_READ for one in arm.bus.heard)
    arm.bus.loose = 4
    back = arm.ticks(40)
    assert [servo for servo, place in back.positions.items() if place is None] == [5, 6]
    assert "servo 5 does not answer" in back.faults[5]


# The rite.


def test_torque_comes_on_where_it_stands_and_release_takes_all_of_it_at_once(arm: BusBench):
    moments = Moments(arm.bus)
    enabled(arm)
    assert max(steps for _, steps in moments.jumps) <= 1.0
    back = arm.move({1: 600.0, 4: 450.0}, 1.0)
    back = arm.ticks(10)
    assert back.positions[1] == pytest.approx(600, abs=4) and back.positions[4] == pytest.approx(450, abs=6)
    assert {"limit_torque", "scale_torque"}.isdisjoint(abilities_of(arm.driver))
    with pytest.raises(StateError):
        arm.driver.scale_torque(0.5)
    arm.driver.release()
    assert not any(one.driven for one in arm.bus.servos)


def test_a_goal_outside_the_limits_of_the_eeprom_is_refused_before_torque(robot: Robot):
    arm = BusBench(robot, {"volts": 7.4})
    arm.bus.servo(2).put("lowest", 700)
    arm.open()
    refused = arm.enable()
    assert isinstance(refused, EnableError) and "700 … 1023" in str(refused)
    assert not arm.bus.servo(2).driven


def test_a_servo_that_started_anew_and_was_switched_on_by_a_goal_is_switched_off_again(arm: BusBench):
    enabled(arm)
    one = arm.bus.servo(3)
    one.restart()
    one.written(TABLE["goal_position"].address, TABLE.encode("goal_position", 530))
    assert one.driven
    back = arm.ticks(2)
    assert not one.driven and "servo 3 has switched its torque off" in back.faults[3]


def test_a_servo_of_the_other_series_gets_no_torque(robot: Robot):
    arm = BusBench(robot, {"volts": 7.4})
    arm.bus.servo(1).put("big_endian", 0)
    notes = arm.open().identity.earlier
    assert any("servo 1: it is of the STS series (register 2)" in one for one in notes)
    refused = arm.enable()
    assert isinstance(refused, EnableError) and refused.channel == 1


def test_a_torque_percent_is_refused_because_such_servos_know_none(tmp_path: Path):
    path = tmp_path / "scs.toml"
    path.write_text(
        as_scs(SO101).replace("open_steps = 800", "open_steps = 800, torque_percent = 40"), encoding="utf-8"
    )
    with pytest.raises(RobotFileError, match="torque_percent"):
        load_robot(path)


def test_a_nudge_is_refused_because_it_could_not_be_weak(arm: BusBench):
    board = board_type("feetech_scs")
    desk = board.servo_setup(
        lambda _: LoopTransport(arm.bus, arm.clock.now, arm.clock.advance), arm.clock.now
    )
    assert desk is not None
    with pytest.raises(BoardError, match="turn the joint by hand"):
        desk.nudge(1_000_000, 3)
    assert [one.model for one in desk.scan([1_000_000], range(8))] == ["SCS0009"] * 6
    assert desk.change_id(1_000_000, 6, 7).id == 7
    assert arm.bus.servo(7).get("lock") == 1


def test_the_check_up_tells_the_series_apart(arm: BusBench):
    line = LoopTransport(arm.bus, arm.clock.now, arm.clock.advance)
    assert board_type("feetech").ask(line, arm.clock.now) is None
    found = board_type("feetech_scs").ask(line, arm.clock.now)
    assert found is not None and found.details[0] == "servo 1: SCS0009"
    told = board_type("feetech_scs").examine(
        CheckUp(line, arm.clock.now, ChannelsToCheck(arm.setup.channels))
    )
    assert [one.check for one in told if one.verdict is not Verdict.OK] == ["watchdog"]


# Other programs.


@pytest.fixture
def server(robot: Robot) -> Iterator[BoardServer[SimulatedBus]]:
    model = board_type("feetech_scs").simulated(setup_of(robot), {})
    assert isinstance(model, SimulatedBus)
    with BoardServer(model, MonotonicClock().now, tick_s=1.0) as served:
        yield served


def test_the_vendor_finds_reads_moves_and_renames_a_servo(
    server: BoardServer[SimulatedBus], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("scservo_sdk.port_handler.LATENCY_TIMER", 2000.0)
    port = scservo_sdk.PortHandler(server.port)
    assert port.openPort()
    vendor = scservo_sdk.scscl(port)
    try:
        assert vendor.ping(1) == (1284, 0, 0)
        assert vendor.ReadPos(5) == (512, 0, 0)
        assert vendor.WritePos(1, 600, 0, 300)[0] == 0
        with server.inspect() as bus:
            told = [bus.servo(1).get(one) for one in ("goal_position", "goal_speed", "torque")]
            assert told == [600, 300, 1]
        assert vendor.unLockEprom(1)[0] == vendor.write1ByteTxRx(1, TABLE["id"].address, 9)[0] == 0
        assert vendor.LockEprom(9)[0] == 0
        with server.inspect() as bus:
            bus.reset()
            assert [one.id for one in bus.servos] == [9, 2, 3, 4, 5, 6]
    finally:
        port.closePort()


def test_rustypot_reads_the_same_registers(server: BoardServer[SimulatedBus]):
    other = rustypot.Scs0009PyController(server.port, 1_000_000, 2.0)
    try:
        with server.inspect() as bus:
            one = bus.servo(5)
            own = {name: one.get(name) for name in ("present_position", "present_voltage", "p_gain")}
        (raw,) = other.read_raw_present_position(5)  # as it would be of a servo of the other series
        assert int.from_bytes(raw.to_bytes(2, "little"), "big") == own["present_position"]
        assert other.read_p_coefficient(5) == [own["p_gain"]]
        assert other.read_present_voltage(5) == [own["present_voltage"]]
        assert rustypot.Scs0009PyController.definition().word_order == "big"
    finally:
        other.close()


def test_our_table_is_that_of_rustypot():
    """One register that neither Feetech's table nor its SDK has, and one that Feetech does not use."""
    ours = {one.address: one.size for one in TABLE.registers}
    theirs = {
        one.addr: one.size
        for one in rustypot.Scs0009PyController.definition().registers()
        if one.addr < TABLE.size
    }
    assert {address for address in theirs if ours.get(address) != theirs[address]} == {41}
    assert set(ours) - set(theirs) == {TABLE["big_endian"].address}


def test_armctl_servos_lists_a_simulated_bus(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(setup, "_SIMULATED_PING_S", 0.002)
    path = tmp_path / "scs.toml"
    path.write_text(as_scs(SO101), encoding="utf-8")
    assert run(["servos", "--port", "sim", "--robot", str(path)]) == DONE
    told = capsys.readouterr().out
    assert "6 servos, 0 differences" in told and "SCS0009, firmware 3.5" in told
