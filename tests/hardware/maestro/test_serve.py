"""The simulated board on a real pty: with the driver, and with a client that knows only bytes."""

from __future__ import annotations

from pathlib import Path

import pytest
import serial
from tests.hardware.lines import Fault, FaultyModel

from armctl.errors import BoardError, BoardTimeoutError
from armctl.hardware import ChannelSettings
from armctl.hardware.maestro.codec import MaestroModel
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import (
    ChannelConfig,
    MaestroSettings,
    SerialMode,
    SimulatedMaestro,
    simulated_maestro,
)
from armctl.hardware.simulation import PtyServer
from armctl.hardware.transport import Connection
from armctl.runtime.clock import ManualClock

CHANNELS = [ChannelSettings(0, 700.0, 2300.0, speed=1000.0), ChannelSettings(1, 1000.0, 2000.0)]
PATIENT_S = 5.0  # the pty has a thread of its own, which a busy machine may keep waiting


def connected(port: str, clock: ManualClock, timeout_s: float = PATIENT_S) -> MaestroDriver:
    driver = MaestroDriver(Connection(port, lambda: 0.0, simulated=True), timeout_s=timeout_s)
    driver.open()
    driver.configure(CHANNELS)
    return driver


def test_a_plain_serial_client_with_bytes_from_the_guide(clock: ManualClock):
    with PtyServer(simulated_maestro(), clock.now) as server, serial.Serial(server.port, timeout=5.0) as port:
        port.write(bytes.fromhex("84 02 70 2e"))  # 1500 µs on channel 2
        port.write(bytes.fromhex("90 02"))
        assert port.read(2) == bytes.fromhex("70 17")
        port.write(bytes.fromhex("aa 0c 04 02 00 20 aa 0c 10 02"))  # 1024 µs
        assert port.read(2) == bytes.fromhex("00 10")
        port.write(bytes.fromhex("ff 02 7f 90 02 a1"))
        assert port.read(4) == bytes.fromhex("70 17 00 00")
        port.write(bytes.fromhex("9f 01 02 70 2e a1 90 02"))  # to a Micro an error, which switches off
        assert port.read(4) == bytes.fromhex("10 00 00 00")
        with server.inspect() as board:
            assert [entry.raw.hex(" ") for entry in board.log][:2] == ["84 02 70 2e", "90 02"]
            assert board.log[0].time == clock.now()


def test_a_session_of_the_driver(clock: ManualClock):
    with PtyServer(simulated_maestro(channels=CHANNELS), clock.now) as server:
        driver = connected(server.port, clock)
        driver.write({0: 700.0, 1: 1500.0})
        assert driver.read().positions == {0: 700.0, 1: 1500.0}
        driver.write({0: 2300.0})
        assert driver.read().positions == {0: 700.0, 1: 1500.0}
        clock.advance(0.5)
        assert driver.read().positions == {0: 1200.0, 1: 1500.0}
        driver.stop()
        driver.read()  # an answer: so the board has taken the stop before its time goes on
        clock.advance(5.0)
        assert driver.read().positions == {0: 1200.0, 1: 1500.0}
        with server.inspect() as board:
            assert board.target_us(0) == 1200.0
        driver.release()
        assert driver.read().positions == {0: None, 1: None}
        driver.close()


def test_identity_over_a_link(clock: ManualClock, tmp_path: Path):
    with PtyServer(simulated_maestro(), clock.now, link=tmp_path / "arm") as server:
        driver = MaestroDriver(
            Connection(server.port, lambda: 0.0, simulated=True), model=MaestroModel.MICRO_6
        )
        identity = driver.open()
        driver.close()
    assert identity.port == str(tmp_path / "arm")
    assert identity.kind == "Pololu Micro Maestro 6-channel"
    assert identity.simulated is True
    assert identity.notes == ()


def test_outputs_stay_on_while_clients_come_and_go(clock: ManualClock):
    with PtyServer(simulated_maestro(channels=CHANNELS), clock.now) as server:
        first = connected(server.port, clock)
        first.write({1: 1500.0})
        assert first.read().positions[1] == 1500.0
        first.close()
        second = connected(server.port, clock)
        assert second.read().positions == {0: None, 1: 1500.0}
        second.close()


def test_the_board_gets_the_robots_ranges_and_is_large_enough(clock: ManualClock):
    channels = [ChannelSettings(0, 700.0, 2300.0), ChannelSettings(7, 1000.0, 1900.0)]
    settings = MaestroSettings(channels={1: ChannelConfig(800.0, 2200.0)}, timeout_units=50)
    with PtyServer(simulated_maestro(channels=channels, settings=settings), clock.now) as server:
        with server.inspect() as board:
            assert board.model is MaestroModel.MINI_12
            assert board.settings.timeout_units == 50
            board.feed(bytes.fromhex("84 00 7f 7f 84 01 7f 7f 84 02 7f 7f 84 07 7f 7f"))
            assert [board.target_us(channel) for channel in (0, 1, 2, 7)] == [2300.0, 2200.0, 2000.0, 1900.0]


def test_the_model_can_be_chosen(clock: ManualClock):
    with (
        PtyServer(simulated_maestro(model=MaestroModel.MINI_24), clock.now) as server,
        server.inspect() as board,
    ):
        assert board.model is MaestroModel.MINI_24


def test_the_factory_serial_mode_over_a_pty(clock: ManualClock):
    settings = MaestroSettings(serial_mode=SerialMode.UART_DETECT_BAUD)
    with PtyServer(simulated_maestro(settings=settings), clock.now) as server:
        with pytest.raises(BoardTimeoutError, match="USB Dual Port"):
            connected(server.port, clock)
        serial.Serial(server.port).close()  # the failed open has let go of the port


def test_an_unplugged_board_is_a_board_error_for_every_call(clock: ManualClock):
    faults = FaultyModel(SimulatedMaestro())
    with PtyServer(faults, clock.now, tick_s=0.001) as server:
        driver = connected(server.port, clock)
        driver.write({1: 1500.0})
        driver.read()
        with server.inspect() as model:
            model.unplug()
        for call in (driver.read, driver.stop, driver.release, lambda: driver.write({1: 1500.0})):
            with pytest.raises(BoardError, match="was the board unplugged"):
                call()
        driver.close()
        driver.close()


def test_half_a_reply_over_a_pty(clock: ManualClock):
    faults = FaultyModel(SimulatedMaestro())
    with PtyServer(faults, clock.now) as server:
        driver = connected(server.port, clock, timeout_s=0.3)
        driver.write({1: 1500.0})
        with server.inspect() as model:
            model.inject(Fault.HALF_REPLY)
        with pytest.raises(BoardTimeoutError, match="answered 3 of 6 bytes within 300 ms"):
            driver.read()
        assert driver.read().positions == {0: None, 1: 1500.0}
        driver.close()
