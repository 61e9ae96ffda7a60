"""The simulated boards on a real pty: with their drivers, and with clients that know only bytes."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
import serial
from tests.hardware.encoder.kit import AXES
from tests.hardware.encoder.kit import CHANNELS as AXIS_CHANNELS

from armctl.errors import BoardError
from armctl.hardware import ByteModel, ChannelSettings, Driver
from armctl.hardware.encoder.axes import EncoderSettings
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.simulated import simulated_encoder_board
from armctl.hardware.faults import FaultyModel
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import (
    ChannelConfig,
    MaestroSettings,
    SimulatedMaestro,
    simulated_maestro,
)
from armctl.hardware.pca9685.driver import Pca9685Driver
from armctl.hardware.pca9685.simulated import SimulatedPca9685, SimulatedPca9685Board
from armctl.hardware.simulation import BoardServer
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock, MonotonicClock

SERVOS = [ChannelSettings(9, 1000.0, 2000.0), ChannelSettings(4, 1000.0, 2000.0)]
PATIENT_S = 5.0  # the pty has a thread of its own, which a busy machine may keep waiting


def test_plain_serial_clients(clock: ManualClock, tmp_path: Path):
    link = tmp_path / "firmata"
    with (
        BoardServer(SimulatedFirmata(), clock.now, link=link) as server,
        serial.Serial(server.port, 57600, timeout=PATIENT_S) as port,
    ):
        port.write(bytes.fromhex("f0 6d 09 f7"))
        # The sketch's report of itself may come first: opening a pty does not empty it.
        assert port.read_until(bytes.fromhex("f0 6e 09 01 00 f7"))[-6:].hex(" ") == "f0 6e 09 01 00 f7"
    assert not link.is_symlink()
    with (
        BoardServer(simulated_encoder_board(AXIS_CHANNELS, AXES), clock.now) as server,
        serial.Serial(server.port, timeout=PATIENT_S) as port,
    ):
        port.write(b"1 HELLO*7DF0\n")
        answer = port.readline()
        while not answer.startswith(b"1 "):
            answer = port.readline()
        assert answer.startswith(b"1 ok armctl-encoder 1.3.0 proto=4 axes=6 reset=power*")
    with (
        BoardServer(simulated_maestro(), clock.now) as server,
        serial.Serial(server.port, timeout=5.0) as port,
    ):
        port.write(bytes.fromhex("84 02 70 2e"))  # 1500 µs on channel 2
        port.write(bytes.fromhex("90 02"))
        assert port.read(2) == bytes.fromhex("70 17")
        with server.inspect() as board:
            assert [entry.raw.hex(" ") for entry in board.log][:2] == ["84 02 70 2e", "90 02"]
            assert board.log[0].time == clock.now()


@pytest.mark.parametrize(
    ("board", "driver_of", "channels"),
    [
        (SimulatedMaestro(MaestroModel.MINI_12), partial(MaestroDriver, timeout_s=PATIENT_S), SERVOS),
        (SimulatedFirmata(), partial(FirmataDriver, timeout_s=PATIENT_S), SERVOS),
        (
            simulated_encoder_board(AXIS_CHANNELS, AXES),
            partial(EncoderDriver, settings=EncoderSettings(AXES), timeout_s=PATIENT_S),
            AXIS_CHANNELS,
        ),
        (SimulatedPca9685Board(SimulatedPca9685()), partial(Pca9685Driver, timeout_s=PATIENT_S), SERVOS),
    ],
)
def test_two_sessions_and_an_unplugged_board(board: ByteModel, driver_of, channels):
    now = MonotonicClock().now
    with BoardServer(FaultyModel(board), now, tick_s=0.001) as server:
        driver: Driver = driver_of(Connection(server.port, now, simulated=True))
        for _ in range(2):
            driver.close()
            identity = driver.open()
            assert (identity.port, identity.simulated) == (server.port, True)
            driver.configure(channels)
            wanted = dict.fromkeys((one.channel for one in channels), 1500.0 if channels is SERVOS else None)
            deadline = now() + 20.0
            while driver.read().positions != wanted and now() < deadline:
                driver.write(wanted)
            assert driver.read().positions == wanted
            driver.stop()
            driver.release()
        with server.inspect() as model:
            model.unplug()
        deadline = now() + 20.0
        with pytest.raises(BoardError, match="was the board unplugged"):
            while now() < deadline:
                driver.read()
        for call in (driver.release, driver.stop):
            with pytest.raises(BoardError):
                call()
        driver.close()
        driver.close()


def test_a_maestro_gets_the_robots_ranges_and_is_large_enough():
    channels = [ChannelSettings(0, 700.0, 2300.0), ChannelSettings(7, 1000.0, 1900.0)]
    settings = MaestroSettings(channels={1: ChannelConfig(800.0, 2200.0)}, timeout_units=50)
    board = simulated_maestro(channels, settings=settings)
    assert board.model is MaestroModel.MINI_12
    assert board.settings.timeout_units == 50
    board.feed(bytes.fromhex("84 00 7f 7f 84 01 7f 7f 84 02 7f 7f 84 07 7f 7f"))
    assert [board.target_us(channel) for channel in (0, 1, 2, 7)] == [2300.0, 2200.0, 2000.0, 1900.0]
    assert simulated_maestro(model=MaestroModel.MINI_24).model is MaestroModel.MINI_24
