"""The simulated board on a real pty: with the driver, and with a client that knows only bytes."""

from __future__ import annotations

from pathlib import Path

import pytest
import serial
from tests.hardware.encoder.kit import AXES, CHANNELS, PLANTS
from tests.hardware.lines import FaultyModel

from armctl.errors import BoardError
from armctl.hardware.encoder.axes import EncoderSettings
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard, simulated_encoder_board
from armctl.hardware.simulation import PtyServer
from armctl.hardware.transport import Connection
from armctl.runtime.clock import ManualClock

PATIENT_S = 5.0  # the pty has a thread of its own, which a busy machine may keep waiting


def connected(port: str, clock: ManualClock) -> EncoderDriver:
    driver = EncoderDriver(
        Connection(port, clock.now, simulated=True), EncoderSettings(AXES), timeout_s=PATIENT_S
    )
    driver.open()
    driver.configure(CHANNELS)
    return driver


def test_a_plain_serial_client(clock: ManualClock):
    with (
        PtyServer(simulated_encoder_board(channels=CHANNELS, axes=AXES), clock.now) as server,
        serial.Serial(server.port, timeout=PATIENT_S) as port,
    ):
        port.write(b"1 HELLO*7DF0\n")
        answer = port.readline()
        while not answer.startswith(b"1 "):
            answer = port.readline()
        assert answer.startswith(b"1 ok armctl-encoder 1.1.0 proto=2 axes=6 reset=power*")


def test_a_session_of_the_driver(clock: ManualClock, tmp_path: Path):
    with PtyServer(
        simulated_encoder_board(channels=CHANNELS, axes=AXES), clock.now, link=tmp_path / "arm"
    ) as server:
        driver = connected(server.port, clock)
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


def test_an_unplugged_board_is_a_board_error_for_every_call(clock: ManualClock):
    faults = FaultyModel(SimulatedEncoderBoard(PLANTS))
    with PtyServer(faults, clock.now, tick_s=0.001) as server:
        driver = connected(server.port, clock)
        with server.inspect() as model:
            model.unplug()
        for call in (driver.read, driver.stop, driver.release, driver.home):
            with pytest.raises(BoardError, match="was the board unplugged"):
                call()
        driver.close()
        driver.close()
