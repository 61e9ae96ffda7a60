from __future__ import annotations

import errno
import logging
import os
import socket
import subprocess
import termios
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from armctl.errors import BoardError, BoardTimeoutError, PortError
from armctl.hardware.transport import Connection, PortInfo, SerialTransport


class BarePty:
    """A pty whose far end the test plays itself."""

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._open = True

    def unplug(self) -> None:
        if self._open:
            self._open = False
            os.close(self._slave)
            os.close(self.master)


@pytest.fixture
def pty() -> Iterator[BarePty]:
    bare = BarePty()
    yield bare
    bare.unplug()


@pytest.fixture
def line(pty: BarePty) -> Iterator[SerialTransport]:
    transport = SerialTransport(pty.port, write_timeout_s=0.05)
    yield transport
    transport.close()


def test_bytes_both_ways_untouched(pty: BarePty, line: SerialTransport):
    every = bytes(range(256))
    line.write(every)
    assert os.read(pty.master, 1000) == every
    os.write(pty.master, every)
    assert line.read(256, 2.0) == every
    assert line.name == pty.port


def test_a_short_read_returns_what_came_and_discarded_input_is_gone(pty: BarePty, line: SerialTransport):
    os.write(pty.master, b"ab")
    assert line.read(3, 0.02) == b"ab"
    assert line.read(1, 0.0) == b""
    os.write(pty.master, b"old")
    assert line.read(1, 2.0) == b"o"  # so the rest has arrived too
    line.discard_input()
    assert line.read(2, 0.0) == b""


def test_a_board_that_takes_no_bytes_is_a_timeout(line: SerialTransport):
    with pytest.raises(BoardTimeoutError, match="takes no more bytes; unplug it"):
        line.write(b"x" * 1_000_000)


def test_what_a_board_did_not_take_in_time_is_never_sent_later(pty: BarePty, line: SerialTransport):
    with pytest.raises(BoardTimeoutError, match="takes no more bytes"):
        for setpoint in range(1_000):
            line.write(b"%08d" % setpoint * 1000)
    line.close()
    os.set_blocking(pty.master, False)
    arrived = os.read(pty.master, 1_000_000)
    assert len(arrived) < 4096  # what was at the far end already
    with pytest.raises(BlockingIOError):
        os.read(pty.master, 1)


def test_on_a_network_line_it_is_dropped_with_the_line():
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = SerialTransport(f"socket://127.0.0.1:{server.getsockname()[1]}", write_timeout_s=0.05)
        with server.accept()[0] as board:
            with pytest.raises(BoardTimeoutError, match="takes no more bytes"):
                for _ in range(1_000):
                    line.write(b"x" * 65_536)
            line.close()
            board.settimeout(5.0)
            with pytest.raises(ConnectionResetError):  # an orderly end would bring all of it first
                while board.recv(1_000_000):
                    pass


@pytest.mark.parametrize(
    ("call", "action"),
    [
        (lambda line: line.write(b"x"), "writing to"),
        (lambda line: line.read(1, 0.01), "reading from"),
        (lambda line: line.read(1, 0.05), "reading from"),  # the timeout that pyserial already has
        (lambda line: line.discard_input(), "clearing the input of"),
    ],
)
def test_an_unplug_is_a_board_error_whatever_pyserial_raises(
    pty: BarePty, line: SerialTransport, call, action, caplog: pytest.LogCaptureFixture
):
    pty.unplug()
    caplog.set_level(logging.INFO, "armctl.hardware")
    with pytest.raises(BoardError, match=f"{pty.port}: the line to the board is gone: was the board") as info:
        call(line)
    # Flushing an unplugged port raises an error that is no OSError.
    assert isinstance(info.value.__cause__, termios.error if action.startswith("clearing") else OSError)
    (raw,) = caplog.messages  # pyserial's own words are for the log alone
    assert raw.startswith(f"{action} the port {pty.port} failed: ")
    line.close()
    line.close()


def test_a_port_in_use_says_who_may_hold_it(pty: BarePty, line: SerialTransport):
    with pytest.raises(PortError, match=r"in use by another program .*Maestro Control Center"):
        SerialTransport(line.name)
    line.close()
    SerialTransport(pty.port).close()


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("{folder}/ttyACM9", "ttyACM9: no such port; is the board plugged in"),
        ("{folder}", "a directory, not a port"),
        ("{folder}/file", "cannot be opened as a serial port"),
        ("warp://host", "warp://host: not a port that can be opened"),
        ("loop://", "loop://: not a port that can be opened"),
        ("socket://127.0.0.1:{closed}", r"cannot connect .* is the program at the other end running"),
        *(
            (f"socket://{address}", r"socket://.*: a network address is socket://HOST:PORT, with a port")
            for address in ("x", "127.0.0.1", ":80", "127.0.0.1:", "h:99999", "h:0", "h:x", "[::1", "")
        ),
    ],
)
def test_what_is_no_port(tmp_path: Path, name: str, says: str):
    (tmp_path / "file").touch()
    with socket.create_server(("127.0.0.1", 0)) as server:
        closed = server.getsockname()[1]
    with pytest.raises(PortError, match=says):
        SerialTransport(name.format(folder=tmp_path, closed=closed))


def test_no_address_of_pyserials_overwrites_a_file(pty: BarePty, tmp_path: Path):
    file = tmp_path / "precious"
    file.write_text("kept")
    with pytest.raises(PortError, match="not a port that can be opened"):
        SerialTransport(f"spy://{pty.port}?file={file}")
    assert file.read_text() == "kept"


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.EACCES, r"no permission to open it; run `sudo usermod -aG dialout \$USER`, then log out"),
        (errno.EBUSY, "in use by another program"),
        (errno.EIO, "nothing is at the other end"),
        (errno.ENODEV, "plug the board in again"),
    ],
)
def test_errors_of_the_system_bring_advice(monkeypatch: pytest.MonkeyPatch, number: int, advice: str):
    def refuse(*_args: object, **_options: object) -> None:
        raise serial.SerialException(number, "could not open port")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(PortError, match=f"/dev/nowhere: .*{advice}"):
        SerialTransport("/dev/nowhere")


def test_a_socket():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer_once() -> None:
            client, _ = server.accept()
            with client:
                client.sendall(client.recv(16)[::-1])

        far_end = threading.Thread(target=answer_once)
        far_end.start()
        line = SerialTransport(f"socket://127.0.0.1:{server.getsockname()[1]}")
        line.write(b"abc")
        assert line.read(3, 2.0) == b"cba"
        far_end.join()
        with pytest.raises(BoardError, match="the line to the board is gone"):
            line.read(1, 2.0)
        line.close()


# Where a driver finds its board.


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


def refuse(serial_number: str | None) -> None:
    raise PortError(f"not board {serial_number}")


def test_a_line_is_closed_where_its_board_is_refused():
    closed = []

    class Line:
        def close(self) -> None:
            closed.append(self)

    with pytest.raises(PortError, match="not board None"):
        Connection(Line, lambda: 0.0, accept=refuse).open()
    assert len(closed) == 1
    Connection(Line, lambda: 0.0, accept=refuse, simulated=True).open()  # a simulated board is ours


def test_what_is_listed_as_no_use_or_as_another_board_is_not_opened():
    """Opening the line of an Arduino would let its servos go."""
    ttl = PortInfo("/dev/ttyACM1", "Pololu Micro Maestro 6-channel", "", "1", False, "this is the TTL port")
    with pytest.raises(PortError, match="/dev/ttyACM1: this is the TTL port"):
        port("/dev/ttyACM1", ttl).open()
    mega = PortInfo("/dev/ttyACM0", "Arduino Mega 2560", "", "4711", True, "")
    with pytest.raises(PortError, match="not board 4711"):
        Connection("/dev/ttyACM0", lambda: 0.0, lambda: [mega], refuse).open()


def opens(device: str) -> bool:
    """Whether another user's program can open a device: root is never kept out."""
    shell = ["/bin/sh", "-c", f": 2>/dev/null <>{device}"]
    return subprocess.run(shell, user=65534 if os.getuid() == 0 else None, check=False).returncode == 0


def test_a_device_is_kept_from_programs_that_ask_for_no_lock(monkeypatch: pytest.MonkeyPatch):
    """A pty stands for the device; as a pty it is left open, for its server would keep it locked."""
    master, slave = os.openpty()
    device = os.ttyname(slave)
    os.chmod(device, 0o666)
    for pseudo, free in ((True, True), (False, False)):
        monkeypatch.setattr("armctl.hardware.transport.is_pseudo_terminal", lambda _, pseudo=pseudo: pseudo)
        line = SerialTransport(device)
        assert opens(device) is free
        line.close()
    os.close(slave)
    os.close(master)


@pytest.mark.parametrize("refusal", [None, ValueError, NotImplementedError])
def test_an_adapter_is_asked_to_hold_no_answer_back(
    monkeypatch: pytest.MonkeyPatch, refusal: type[Exception] | None
) -> None:
    """A device whose driver cannot is used all the same; a pty, which has no driver, is not asked."""
    master, slave = os.openpty()
    asked: list[bool] = []

    def ask(_: serial.Serial, low_latency_settings: bool) -> None:
        asked.append(low_latency_settings)
        if refusal is not None:
            raise refusal("not here")

    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", ask)
    SerialTransport(os.ttyname(slave)).close()
    assert asked == []
    monkeypatch.setattr("armctl.hardware.transport.is_pseudo_terminal", lambda _: False)
    line = SerialTransport(os.ttyname(slave))
    assert asked == [True]
    line.write(b"?")
    assert os.read(master, 1) == b"?"
    line.close()
    os.close(slave)
    os.close(master)
