"""The simulated board on a pty, over the serial library and the driver as it is used."""

from __future__ import annotations

from pathlib import Path

import pytest
import serial
from tests.hardware.lines import FaultyModel

from armctl.errors import BoardError
from armctl.hardware import ChannelSettings
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.simulation import PtyServer
from armctl.hardware.transport import Connection
from armctl.runtime.clock import MonotonicClock

CHANNELS = [ChannelSettings(9, 1000.0, 2000.0), ChannelSettings(22, 1000.0, 2000.0)]


@pytest.fixture
def real_clock() -> MonotonicClock:
    return MonotonicClock()


def connected(port: str, clock: MonotonicClock) -> FirmataDriver:
    driver = FirmataDriver(Connection(port, clock.now, ports=list, simulated=True), timeout_s=2.0)
    identity = driver.open()
    assert identity.port == port
    driver.configure(CHANNELS)
    return driver


def test_any_client_can_open_it(tmp_path: Path, real_clock: MonotonicClock):
    link = tmp_path / "firmata"
    with (
        PtyServer(SimulatedFirmata(), real_clock.now, link=link) as server,
        serial.Serial(server.port, 57600, timeout=5) as port,
    ):
        assert server.port == str(link)
        port.write(bytes.fromhex("f0 6d 09 f7"))
        # The sketch's report of itself may come first: opening a pty does not empty it.
        assert port.read_until(bytes.fromhex("f0 6e 09 01 00 f7"))[-6:].hex(" ") == "f0 6e 09 01 00 f7"
    assert not link.is_symlink()


def test_a_session_over_a_pty(real_clock: MonotonicClock):
    with PtyServer(SimulatedFirmata(), real_clock.now) as server:
        driver = connected(server.port, real_clock)
        wanted = {9: 1200.0, 22: 1800.0}
        deadline = real_clock.now() + 20.0
        while driver.read().positions != wanted and real_clock.now() < deadline:
            driver.write(wanted)
        while real_clock.now() < deadline:
            assert driver.read().errors == ()
            with server.inspect() as board:
                if all(board.pulses(pin) for pin in wanted):
                    break
        for pin, pulse_us in wanted.items():
            with server.inspect() as board:
                assert {pulse.width_us for pulse in board.pulses(pin)} == {pulse_us}
        driver.release()
        driver.close()
        with server.inspect() as board:
            assert board.mode(9) == board.mode(22) == 1


def test_the_next_client_finds_the_pins_as_they_were_left(real_clock: MonotonicClock):
    with PtyServer(SimulatedFirmata(), real_clock.now) as server:
        driver = connected(server.port, real_clock)
        deadline = real_clock.now() + 20.0
        while driver.read().positions[9] is None and real_clock.now() < deadline:
            driver.write({9: 1234.0})
        driver.close()
        again = connected(server.port, real_clock)
        assert again.read().positions == {9: 1234.0, 22: None}
        again.close()


def test_an_unplugged_board_is_a_board_error(real_clock: MonotonicClock):
    faults = FaultyModel(SimulatedFirmata())
    with PtyServer(faults, real_clock.now, tick_s=0.001) as server:
        driver = connected(server.port, real_clock)
        with server.inspect() as model:
            model.unplug()
        deadline = real_clock.now() + 20.0
        with pytest.raises(BoardError, match=r"was the board unplugged"):
            while real_clock.now() < deadline:
                driver.read()
        with pytest.raises(BoardError):
            driver.write({9: 1500.0})
        driver.close()
        driver.close()
