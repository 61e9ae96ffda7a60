from __future__ import annotations

import os

import pytest

from armctl.errors import PortError
from armctl.hardware.transport import Connection, PortInfo


def port(line, *listed: PortInfo) -> Connection:
    return Connection(line, lambda: 0.0, lambda: listed)


def test_only_a_device_restarts_its_board_when_it_is_opened():
    board, other = os.openpty()
    try:
        assert port("/dev/ttyACM0").restarts_board
        assert not port(os.ttyname(other)).restarts_board
        assert not port("socket://127.0.0.1:5000").restarts_board
        assert not port(lambda: None).restarts_board
    finally:
        os.close(board)
        os.close(other)


def test_what_is_listed_as_no_use_is_not_opened():
    ttl = PortInfo("/dev/ttyACM1", "Pololu Micro Maestro 6-channel", "", "1", False, "this is the TTL port")
    with pytest.raises(PortError, match="/dev/ttyACM1: this is the TTL port"):
        port("/dev/ttyACM1", ttl).open()


def test_a_line_is_closed_where_its_board_is_refused():
    closed = []

    class Line:
        def close(self) -> None:
            closed.append(self)

    def refuse(serial_number: str | None) -> None:
        raise PortError(f"not board {serial_number}")

    with pytest.raises(PortError, match="not board None"):
        Connection(Line, lambda: 0.0, accept=refuse).open()
    assert len(closed) == 1
    Connection(Line, lambda: 0.0, accept=refuse, simulated=True).open()  # a simulated board is ours


def test_a_board_that_is_listed_as_another_one_is_not_opened():
    """Opening the line of an Arduino would let its servos go."""

    def refuse(serial_number: str | None) -> None:
        raise PortError(f"not board {serial_number}")

    mega = PortInfo("/dev/ttyACM0", "Arduino Mega 2560", "", "4711", True, "")
    with pytest.raises(PortError, match="not board 4711"):
        Connection("/dev/ttyACM0", lambda: 0.0, lambda: [mega], refuse).open()
