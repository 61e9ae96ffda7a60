"""Somebody else's tool for these servos, as a client of a simulated bus: its table, a scan, and an id."""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# feetech-cli has no types

from __future__ import annotations

from collections.abc import Iterator

import pytest
from feetech_cli.controller import FeetechServoController
from feetech_cli.registers import CONTROL_TABLE
from tests.hardware.bus_kit import BusBench
from tests.hardware.feetech.test_driver import ROBOT

from armctl.hardware.bus.simulated import SimulatedBus
from armctl.hardware.bus.table import Sign
from armctl.hardware.feetech.make import TABLE
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock

PATIENCE_S = 2.0


@pytest.fixture
def server() -> Iterator[BoardServer[SimulatedBus]]:
    with BoardServer(BusBench(ROBOT).bus, MonotonicClock().now, tick_s=1.0) as server:
        yield server


@pytest.fixture
def client(server: BoardServer[SimulatedBus]) -> Iterator[FeetechServoController]:
    one = FeetechServoController(server.port, 1_000_000, timeout=PATIENCE_S, min_id=1, max_id=6)
    assert one.open() == [1, 2, 3, 4, 5, 6]
    yield one
    one.close()


def test_their_table_is_ours() -> None:
    ours = {one.address: one for one in TABLE.registers}
    compared = 0
    for name, theirs in CONTROL_TABLE.items():
        if (own := ours.get(theirs.address)) is None:
            continue
        compared += 1
        assert (own.size, own.kept) == (theirs.size, theirs.area == "eeprom"), name
        if theirs.sign_bit is not None:
            assert (own.sign, own.sign_bit) == (Sign.MAGNITUDE, theirs.sign_bit), name
    assert compared >= 0.9 * len(TABLE.registers)


def test_a_servo_gets_another_id_and_keeps_it(
    server: BoardServer[SimulatedBus], client: FeetechServoController
) -> None:
    assert client.set_id(6, 8) == 8
    with server.inspect() as bus:
        bus.reset()  # the power is cut
        assert [one.id for one in bus.servos] == [1, 2, 3, 4, 5, 8]


def test_several_are_read_and_moved_at_once(
    server: BoardServer[SimulatedBus], client: FeetechServoController
) -> None:
    place = TABLE["present_position"]
    told = client.sync_read([1, 3, 5], place.address, place.size)
    with server.inspect() as bus:
        there = {one: bus.servo(one).get("present_position") for one in (1, 3, 5)}
    assert {one: int.from_bytes(bytes(data), "little") for one, (_, data) in told.items()} == there
    client.sync_write_positions([1, 5], [2100, 1900], velocity=300, acceleration=10)
    assert client.ping(1)  # what was written has been heard by now
    with server.inspect() as bus:
        assert [bus.servo(one).get("goal_position") for one in (1, 5)] == [2100, 1900]
    assert client.read_register(1, "goal_position") == 2100
