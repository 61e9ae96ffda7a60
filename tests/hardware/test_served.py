"""The simulated boards on a real pty: with their drivers, and with clients that know only bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import serial
from tests.hardware.encoder.kit import AXES
from tests.hardware.encoder.kit import CHANNELS as AXIS_CHANNELS
from tests.hardware.lines import FaultyModel

from armctl.errors import BoardError
from armctl.hardware import ByteModel, ChannelSettings, Driver
from armctl.hardware.encoder.axes import EncoderSettings
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.simulated import simulated_encoder_board
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
from armctl.hardware.simulation import PtyServer
from armctl.hardware.transport import Connection
from armctl.runtime.clock import ManualClock, MonotonicClock

SERVOS = [ChannelSettings(0, 700.0, 2300.0, speed=1000.0), ChannelSettings(1, 1000.0, 2000.0)]
PINS = [ChannelSettings(9, 1000.0, 2000.0), ChannelSettings(22, 1000.0, 2000.0)]
PATIENT_S = 5.0  # the pty has a thread of its own, which a busy machine may keep waiting


def maestro(port: str, now: Callable[[], float], timeout_s: float = PATIENT_S) -> MaestroDriver:
    driver = MaestroDriver(Connection(port, now, simulated=True), timeout_s=timeout_s)
    return opened(driver, port, SERVOS)


def firmata(port: str, now: Callable[[], float]) -> FirmataDriver:
    return opened(FirmataDriver(Connection(port, now, simulated=True), PATIENT_S), port, PINS)


def encoder(port: str, now: Callable[[], float]) -> EncoderDriver:
    connection = Connection(port, now, simulated=True)
    return opened(EncoderDriver(connection, EncoderSettings(AXES), PATIENT_S), port, AXIS_CHANNELS)


def opened(driver, port: str, channels):
    identity = driver.open()
    assert (identity.port, identity.simulated) == (port, True)
    driver.configure(channels)
    return driver


def test_plain_serial_clients(clock: ManualClock, tmp_path: Path):
    link = tmp_path / "firmata"
    with (
        PtyServer(SimulatedFirmata(), clock.now, link=link) as server,
        serial.Serial(server.port, 57600, timeout=PATIENT_S) as port,
    ):
        port.write(bytes.fromhex("f0 6d 09 f7"))
        # The sketch's report of itself may come first: opening a pty does not empty it.
        assert port.read_until(bytes.fromhex("f0 6e 09 01 00 f7"))[-6:].hex(" ") == "f0 6e 09 01 00 f7"
    assert not link.is_symlink()
    with (
        PtyServer(simulated_encoder_board(AXIS_CHANNELS, AXES), clock.now) as server,
        serial.Serial(server.port, timeout=PATIENT_S) as port,
    ):
        port.write(b"1 HELLO*7DF0\n")
        answer = port.readline()
        while not answer.startswith(b"1 "):
            answer = port.readline()
        assert answer.startswith(b"1 ok armctl-encoder 1.1.0 proto=2 axes=6 reset=power*")
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


def test_a_session_with_a_maestro(clock: ManualClock, tmp_path: Path):
    with PtyServer(simulated_maestro(SERVOS), clock.now, link=tmp_path / "arm") as server:
        driver = maestro(server.port, clock.now)
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
        driver.close()
        again = maestro(server.port, clock.now)
        assert again.read().positions == {0: 1200.0, 1: 1500.0}  # outputs stay on while clients come and go
        again.release()
        assert again.read().positions == {0: None, 1: None}
        again.close()


def test_a_session_with_an_arduino():
    now = MonotonicClock().now
    with PtyServer(SimulatedFirmata(), now) as server:
        driver = firmata(server.port, now)
        wanted = {9: 1200.0, 22: 1800.0}
        deadline = now() + 20.0
        while driver.read().positions != wanted and now() < deadline:
            driver.write(wanted)
        while now() < deadline:
            assert driver.read().errors == ()
            with server.inspect() as board:
                if all(board.pulses(pin) for pin in wanted):
                    break
        for pin, pulse_us in wanted.items():
            with server.inspect() as board:
                assert {pulse.width_us for pulse in board.pulses(pin)} == {pulse_us}
        driver.close()
        again = firmata(server.port, now)
        assert again.read().positions == wanted
        again.release()
        again.close()
        with server.inspect() as board:
            assert board.mode(9) == board.mode(22) == 1


def test_a_session_with_an_encoder_board(clock: ManualClock, tmp_path: Path):
    board = simulated_encoder_board(AXIS_CHANNELS, AXES)
    with PtyServer(board, clock.now, link=tmp_path / "arm") as server:
        driver = encoder(server.port, clock.now)
        driver.home()
        readback = driver.read()
        for _ in range(1000):
            clock.advance(0.02)
            readback = driver.read()
            if readback.homing is not None and readback.homing.done:
                break
        assert readback.errors == ()
        for _ in range(50):
            driver.write({0: 100.0})
            driver.read()
            clock.advance(0.02)
        driver.stop()
        assert driver.read().positions[0] == 100.0
        driver.release()
        assert driver.read().powered is False
        driver.close()
        with server.inspect() as board:
            assert board.axes[0].place == pytest.approx(100.0, abs=0.5)


@pytest.mark.parametrize(
    ("board", "connected"),
    [
        (SimulatedMaestro(), maestro),
        (SimulatedFirmata(), firmata),
        (simulated_encoder_board(AXIS_CHANNELS, AXES), encoder),
    ],
)
def test_an_unplugged_board_is_a_board_error(board: ByteModel, connected: Callable[..., Driver]):
    now = MonotonicClock().now
    with PtyServer(FaultyModel(board), now, tick_s=0.001) as server:
        driver = connected(server.port, now)
        driver.read()
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
