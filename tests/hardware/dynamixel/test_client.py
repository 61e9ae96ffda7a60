"""ROBOTIS' own SDK as a client of the simulated bus, over a pty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import dynamixel_sdk as sdk
import pytest
from dynamixel_sdk import port_handler
from tests.hardware.dynamixel.kit import Rig

from armctl.hardware.bus.simulated import SimulatedBus
from armctl.hardware.dynamixel.make import ACCESS, ALERT, LIMIT, OVERLOAD, RANGE, WATCHDOG_MS
from armctl.hardware.dynamixel.simulated import SimulatedX, factory_memory
from armctl.hardware.simulation import BoardServer
from armctl.protocol import ManualClock

TORQUE, ERRORS, WATCHDOG, GOAL, POSITION = 64, 70, 98, 116, 132
_PATIENT_MS = 2000


@dataclass
class Client:
    """What a program with the SDK has in its hands, and the bus behind it."""

    clock: ManualClock
    server: BoardServer[SimulatedBus]
    port: sdk.PortHandler
    ask: sdk.Protocol2PacketHandler

    def let(self, seconds: float) -> None:
        """Let time pass for the servos."""
        for _ in range(round(seconds / 0.02)):
            self.clock.advance(0.02)
            with self.server.inspect():
                pass

    def write(self, servo: int, address: int, value: int, size: int = 1) -> int:
        send = {1: self.ask.write1ByteTxRx, 2: self.ask.write2ByteTxRx, 4: self.ask.write4ByteTxRx}[size]
        result, error = send(self.port, servo, address, value)
        assert result == sdk.COMM_SUCCESS
        return error

    def read(self, servo: int, address: int, size: int = 4) -> int:
        get = {1: self.ask.read1ByteTxRx, 2: self.ask.read2ByteTxRx, 4: self.ask.read4ByteTxRx}[size]
        value, result, _ = get(self.port, servo, address)
        assert result == sdk.COMM_SUCCESS
        return value


@pytest.fixture
def client(clock: ManualClock, monkeypatch: pytest.MonkeyPatch) -> Iterator[Client]:
    monkeypatch.setattr(port_handler, "LATENCY_TIMER", _PATIENT_MS / 2)
    bus = Rig.of(clock, *(factory_memory(id=number) for number in (1, 2, 3))).bus
    with BoardServer(bus, clock.now) as server:
        port = sdk.PortHandler(server.port)
        assert port.setBaudRate(1_000_000)
        yield Client(clock, server, port, sdk.Protocol2PacketHandler())
        port.closePort()


def test_it_pings_one_and_all(client: Client):
    assert client.ask.ping(client.port, 2) == (1020, sdk.COMM_SUCCESS, 0)
    assert client.ask.broadcastPing(client.port) == ({n: [1020, 45] for n in (1, 2, 3)}, sdk.COMM_SUCCESS)


def test_it_switches_on_and_moves(client: Client):
    assert client.read(1, POSITION) == 2048
    assert client.write(1, GOAL, 2148, 4) == 0
    assert client.write(1, TORQUE, 1) == 0
    client.let(1.0)
    assert client.read(1, POSITION) == pytest.approx(2148, abs=8)  # friction holds it a little before


def test_sync_write_and_sync_read_of_three(client: Client):
    write = sdk.GroupSyncWrite(client.port, client.ask, GOAL, 4)
    for servo in (1, 2, 3):
        client.write(servo, TORQUE, 1)
        assert write.addParam(servo, list((2048 + 100 * servo).to_bytes(4, "little")))
    assert write.txPacket() == sdk.COMM_SUCCESS
    client.read(1, POSITION)  # what was written has been heard by now
    client.let(1.0)
    read = sdk.GroupSyncRead(client.port, client.ask, POSITION, 4)
    assert all(read.addParam(servo) for servo in (1, 2, 3))
    assert read.txRxPacket() == sdk.COMM_SUCCESS
    for servo in (1, 2, 3):
        assert read.getData(servo, POSITION, 4) == pytest.approx(2048 + 100 * servo, abs=8)


def test_it_changes_an_id_but_not_under_torque(client: Client):
    client.write(3, TORQUE, 1)
    assert client.write(3, 7, 30) == ACCESS
    client.write(3, TORQUE, 0)
    assert client.write(3, 7, 30) == 0
    assert client.ask.ping(client.port, 30)[1] == sdk.COMM_SUCCESS
    with client.server.inspect() as bus:
        bus.reset()
        assert [one.id for one in bus.servos] == [1, 2, 30]


def test_it_is_told_why_a_value_is_refused(client: Client):
    assert client.write(1, 52, 1000, 4) == 0
    assert client.write(1, GOAL, 900, 4) == LIMIT
    assert client.read(1, GOAL) == 2048
    assert client.write(1, WATCHDOG, 255) == RANGE
    assert client.write(1, POSITION, 0, 4) == ACCESS


def test_a_silent_program_trips_the_watchdog_and_zero_clears_it(client: Client):
    client.write(1, TORQUE, 1)
    assert client.write(1, WATCHDOG, WATCHDOG_MS // 20) == 0
    client.let(0.4)
    assert client.read(2, POSITION) == 2048  # any instruction feeds it, whoever is meant
    client.let(0.4)
    assert client.read(1, WATCHDOG, 1) == WATCHDOG_MS // 20
    client.let(0.6)
    assert client.read(1, WATCHDOG, 1) == 255
    assert client.write(1, GOAL, 2100, 4) == RANGE
    assert client.write(1, WATCHDOG, 0) == 0
    assert client.write(1, GOAL, 2100, 4) == 0


def test_a_reboot_ends_a_hardware_error_and_nothing_else_does(client: Client):
    client.write(1, TORQUE, 1)
    with client.server.inspect() as bus:
        servo = bus.servo(1)
        assert isinstance(servo, SimulatedX)
        servo.fail(OVERLOAD)
    assert client.read(1, TORQUE, 1) == 0
    client.write(1, TORQUE, 1)
    assert client.read(1, TORQUE, 1) == 0
    assert client.ask.ping(client.port, 1)[2] == ALERT
    assert client.read(1, ERRORS, 1) == OVERLOAD
    assert client.ask.reboot(client.port, 1) == (sdk.COMM_SUCCESS, ALERT)
    client.let(0.6)
    assert client.ask.ping(client.port, 1) == (1020, sdk.COMM_SUCCESS, 0)
    client.write(1, TORQUE, 1)
    assert client.read(1, TORQUE, 1) == 1


def test_reg_write_waits_for_action(client: Client):
    assert client.ask.regWriteTxRx(client.port, 1, GOAL, 4, list((2100).to_bytes(4, "little"))) == (0, 0)
    assert client.read(1, GOAL) == 2048
    client.ask.action(client.port, sdk.BROADCAST_ID)
    assert client.read(1, GOAL) == 2100
