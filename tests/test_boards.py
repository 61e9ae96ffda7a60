from __future__ import annotations

import os
import select
from collections.abc import Iterator
from dataclasses import replace

import pytest

from armctl.boards import (
    AUTOMATIC,
    NO_BOARD,
    SIMULATED,
    SIMULATED_SERIAL,
    UNNUMBERED,
    Boards,
    board_name,
    split_kind,
)
from armctl.errors import PortError
from armctl.hardware.board_type import ARDUINO_MEGA
from armctl.hardware.boards import board_type
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.transport import PortInfo
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

MAESTRO = PortInfo("/dev/ttyACM0", "Pololu Micro Maestro 6-channel", "", "00123", True, None)
MEGA = PortInfo("/dev/ttyACM1", ARDUINO_MEGA, "", "8573", True, None)


def boards(name: str, *ports: PortInfo) -> Boards:
    return Boards(load_robot(name), MonotonicClock().now, lambda: ports)


@pytest.fixture(params=["uzuner", "abaas", "scorbot"])
def simulated(request: pytest.FixtureRequest) -> Iterator[Boards]:
    one = boards(request.param)
    yield one
    one.close()


def test_the_simulated_board_is_of_the_robots_own_kind(simulated: Boards) -> None:
    driver = simulated.driver(SIMULATED)
    identity = driver.open()
    try:
        assert identity.simulated
        assert identity.port == simulated.simulated().port
    finally:
        driver.close()


@pytest.mark.parametrize(
    ("name", "kind"),
    [("uzuner", MaestroDriver), ("abaas", FirmataDriver), ("scorbot", EncoderDriver)],
)
def test_sockets_and_ptys_have_the_board_of_the_robot_file(name: str, kind: type) -> None:
    assert isinstance(boards(name).driver("socket://127.0.0.1:5000"), kind)
    assert isinstance(boards(name, MAESTRO, MEGA).driver(AUTOMATIC), kind)


def test_a_port_may_name_its_board() -> None:
    assert isinstance(boards("abaas").driver("firmata:/dev/ttyUSB0"), FirmataDriver)
    assert isinstance(boards("uzuner", MAESTRO).driver("/dev/ttyACM0"), MaestroDriver)  # as it is listed
    assert split_kind("socket://a:1") == (None, "socket://a:1")
    assert split_kind("encoder:socket://a:1") == (board_type("encoder"), "socket://a:1")


@pytest.mark.parametrize(
    ("name", "port", "said"),
    [
        ("scorbot", "maestro:/dev/ttyACM0", "Scorbot ER-4PC is set up for Arduino with armctl"),
        ("uzuner", "encoder:/dev/ttyACM0", "is set up for Pololu Maestro, this is Arduino with armctl"),
        ("uzuner", "firmata:/dev/ttyACM1", "is set up for Pololu Maestro, this is Arduino with StandardFirm"),
        ("abaas", "firmata:/dev/ttyACM0", "is set up for Arduino with StandardFirmata, this is Pololu"),
        ("abaas", "/dev/ttyACM0", "Abaas 5-DOF arm is set up for Arduino with StandardFirmata, this is Pol"),
    ],
)
def test_one_boards_channels_are_not_anothers(name: str, port: str, said: str) -> None:
    with pytest.raises(PortError, match=said):
        boards(name, MAESTRO, MEGA).driver(port)


def test_automatic_says_what_is_missing() -> None:
    with pytest.raises(PortError, match="no Maestro found"):
        boards("uzuner", MEGA).driver(AUTOMATIC)
    with pytest.raises(PortError, match="Arduino"):
        boards("scorbot", MAESTRO).driver(AUTOMATIC)


def test_calibrations_are_kept_by_serial_number() -> None:
    robot = load_robot("abaas")
    assert board_name(SIMULATED, robot) == SIMULATED_SERIAL
    assert board_name(AUTOMATIC, robot, lambda: [MAESTRO, MEGA]) == "8573"
    assert board_name("firmata:/dev/ttyACM1", robot, lambda: [MEGA]) == "8573"
    assert board_name("socket://127.0.0.1:5000", robot, lambda: [MEGA]) == UNNUMBERED
    with pytest.raises(PortError, match="/dev/nobody: no such port; is the board plugged in"):
        board_name("firmata:/dev/nobody", robot, lambda: [])


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    """A pty: the board's end, and the name of the other."""
    board, port = os.openpty()
    yield board, os.ttyname(port)
    os.close(board)
    os.close(port)


@pytest.mark.parametrize(("name", "on_it"), [("uzuner", MAESTRO), ("abaas", MEGA), ("scorbot", MEGA)])
@pytest.mark.parametrize(
    ("there", "said"),
    [
        ("8573", "board 8573 was there"),
        (UNNUMBERED, "board unnumbered was there"),
        (NO_BOARD, "no board was"),
    ],
)
def test_a_board_that_was_changed_for_another_is_refused(
    name: str, on_it: PortInfo, there: str, said: str, line: tuple[int, str]
) -> None:
    board, device = line
    found = replace(on_it, device=device, serial_number="4711")
    one = Boards(load_robot(name), MonotonicClock().now, lambda: [found], board=there)
    driver = one.driver(device)
    with pytest.raises(PortError, match=rf"{device}: {said}.*, now board 4711 is; it was told nothing"):
        driver.open()
    assert not select.select([board], [], [], 0)[0]  # not one byte reached it


def test_the_board_counts_that_is_there_once_the_port_is_open(line: tuple[int, str]) -> None:
    _, device = line
    before, after = (replace(MAESTRO, device=device, serial_number=number) for number in ("1", "2"))
    listings = iter([[before], [before], [after]])  # which kind, whether usable, what was opened
    one = Boards(load_robot("uzuner"), MonotonicClock().now, lambda: next(listings), board="1")
    with pytest.raises(PortError, match=r"board 1 was there .* now board 2 is"):
        one.driver(device).open()


def test_an_arm_is_connected_to_the_board_that_it_is_calibrated_with() -> None:
    simulator = boards("uzuner")
    device = simulator.simulated().port
    found = replace(MAESTRO, device=device)
    driver = Boards(load_robot("uzuner"), MonotonicClock().now, lambda: [found], board="00123").driver(device)
    try:
        assert driver.open().serial_number == "00123"
    finally:
        driver.close()
        simulator.close()


@pytest.mark.parametrize(("name", "rate"), [("uzuner", 115_200), ("abaas", 57_600), ("scorbot", 115_200)])
def test_a_line_is_opened_at_the_rate_of_the_board(
    name: str, rate: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rates: list[int] = []

    def refused(port: str, *, baud: int) -> None:
        rates.append(baud)
        raise PortError(port)

    monkeypatch.setattr("armctl.hardware.transport.SerialTransport", refused)
    with pytest.raises(PortError):
        boards(name).driver("/dev/ttyUSB7").open()
    assert rates == [rate]
