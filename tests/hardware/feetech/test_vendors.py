"""The vendor's SDK and rustypot as clients of a simulated bus, over a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rustypot
import scservo_sdk
from tests.hardware.bus_kit import BusBench
from tests.hardware.feetech.test_driver import ROBOT

from armctl.hardware.bus.simulated import SimulatedBus
from armctl.hardware.bus.table import Sign
from armctl.hardware.feetech.make import TABLE
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock

BAUD = 1_000_000
PATIENCE_MS = 2000.0  # a busy computer answers late


@pytest.fixture
def server() -> Iterator[BoardServer[SimulatedBus]]:
    with BoardServer(BusBench(ROBOT).bus, MonotonicClock().now, tick_s=1.0) as server:
        yield server


@pytest.fixture
def vendor(
    server: BoardServer[SimulatedBus], monkeypatch: pytest.MonkeyPatch
) -> Iterator[scservo_sdk.sms_sts]:
    monkeypatch.setattr("scservo_sdk.port_handler.LATENCY_TIMER", PATIENCE_MS)
    port = scservo_sdk.PortHandler(server.port)
    assert port.openPort()
    yield scservo_sdk.sms_sts(port)
    port.closePort()


def test_the_vendor_finds_reads_moves_and_renames_a_servo(
    server: BoardServer[SimulatedBus], vendor: scservo_sdk.sms_sts
):
    assert [vendor.ping(one) for one in (1, 6)] == [(777, 0, 0)] * 2
    assert vendor.ReadPos(1) == (2048, 0, 0)
    assert vendor.WritePosEx(1, 2300, 2400, 50)[0] == 0
    with server.inspect() as bus:
        servo = bus.servo(1)
        told = [servo.get(one) for one in ("goal_position", "goal_speed", "acceleration", "torque")]
        assert told == [2300, 2400, 50, 1]
    assert vendor.unLockEprom(1)[0] == vendor.write1ByteTxRx(1, TABLE["id"].address, 9)[0] == 0
    assert vendor.LockEprom(9)[0] == 0
    assert vendor.ping(9)[0] == 777
    with server.inspect() as bus:
        bus.reset()
        assert [one.id for one in bus.servos] == [9, 2, 3, 4, 5, 6]


def test_the_vendor_reads_and_writes_several_servos_at_once(
    server: BoardServer[SimulatedBus], vendor: scservo_sdk.sms_sts
):
    group = scservo_sdk.GroupSyncRead(vendor, TABLE["present_position"].address, 4)
    assert all(group.addParam(one) for one in range(1, 7))
    assert group.txRxPacket() == 0
    read = [group.getData(one, TABLE["present_position"].address, 2) for one in range(1, 7)]
    with server.inspect() as bus:
        assert read == [one.get("present_position") for one in bus.servos]
    for one, goal in ((1, 2100), (5, 1900)):
        assert vendor.SyncWritePosEx(one, goal, 300, 10)
    assert vendor.groupSyncWrite.txPacket() == 0
    assert vendor.ping(1)[0] == 777  # what was written has been heard by now
    with server.inspect() as bus:
        assert [bus.servo(one).get("goal_position") for one in (1, 5)] == [2100, 1900]


def test_what_is_written_behind_the_lock_is_forgotten_at_the_next_power_cut(
    server: BoardServer[SimulatedBus], vendor: scservo_sdk.sms_sts
):
    assert vendor.write1ByteTxRx(2, TABLE["p_gain"].address, 16)[0] == 0
    assert vendor.read1ByteTxRx(2, TABLE["p_gain"].address)[0] == 16
    with server.inspect() as bus:
        bus.reset()
    assert vendor.read1ByteTxRx(2, TABLE["p_gain"].address)[0] == 32


def test_rustypot_reads_the_same_registers(server: BoardServer[SimulatedBus]):
    other = rustypot.Sts3215PyController(server.port, BAUD, PATIENCE_MS / 1000)
    try:
        assert other.ping(1) and other.ping(6)
        with server.inspect() as bus:
            servo = bus.servo(4)
            own = {
                name: servo.get(name) for name in ("present_position", "present_voltage", "p_gain", "hottest")
            }
        assert other.read_raw_present_position(4)[0] == own["present_position"]
        assert other.read_present_voltage(4)[0] == own["present_voltage"]
        assert other.read_p_coefficient(4)[0] == own["p_gain"]
        assert other.read_max_temperature_limit(4)[0] == own["hottest"]
        other.write_torque_enable(4, True)
        with server.inspect() as bus:
            assert bus.servo(4).driven
    finally:
        other.close()


def test_our_table_is_that_of_rustypot():
    """Address, size and sign of every register up to the last of ours; two that it takes for unsigned."""
    signs = {Sign.NONE: None}
    ours = {one.address: (one.size, signs.get(one.sign, one.sign_bit)) for one in TABLE.registers}
    theirs = {
        one.addr: (one.size, one.sign_bit)
        for one in rustypot.Sts3215PyController.definition().registers()
        if one.addr < TABLE.size
    }
    differ = {address for address, found in theirs.items() if ours.get(address) != found}
    assert differ == {TABLE["goal_time"].address, TABLE["present_current"].address}
