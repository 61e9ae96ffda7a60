from __future__ import annotations

import os
import select
import socket
import threading
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import serial

from armctl.errors import BoardError, PortError
from armctl.hardware.simulation import BoardServer, make_link, remove_link
from armctl.hardware.transport import SerialTransport
from armctl.protocol import ManualClock


class Recorder:
    """Sends back what it hears, bit-inverted; speaks unasked and fails when told to."""

    def __init__(self) -> None:
        self.heard = bytearray()
        self.times: list[float] = []
        self.unasked = b""
        self.repeat = 1
        self.gone = False

    def feed(self, data: bytes) -> bytes:
        self.heard += data
        return bytes(byte ^ 0xFF for byte in data) * self.repeat

    def advance(self, now: float) -> bytes:
        if self.gone:
            raise BoardError("gone")
        self.times.append(now)
        said, self.unasked = self.unasked, b""
        return said

    def reset(self) -> None:
        self.heard.clear()


def client(server: BoardServer[Recorder]) -> serial.Serial:
    return serial.Serial(server.port, timeout=5.0)


def test_every_byte_value_passes_untouched_both_ways_while_clients_come_and_go(clock: ManualClock):
    every = bytes(range(256))
    with BoardServer(Recorder(), clock.now) as server:
        for _ in range(3):
            with client(server) as port:
                port.write(every)
                assert port.read(256) == every[::-1]
        with server.inspect() as model:
            assert bytes(model.heard) == every * 3


def test_a_client_that_leaves_the_terminal_as_it_is_gets_no_echo_and_no_translation(clock: ManualClock):
    # pyserial makes the line raw itself; cat, a C program or another language's library may not.
    with BoardServer(Recorder(), clock.now) as server:
        port = os.open(server.port, os.O_RDWR | os.O_NOCTTY)
        sent = b"\x03\x04\r\n\x11\x13\x1a\x7f"
        os.write(port, sent)
        got = b""
        while len(got) < len(sent) and select.select([port], [], [], 5.0)[0]:
            got += os.read(port, 100)
        os.close(port)
        assert got == bytes(byte ^ 0xFF for byte in sent)


def test_an_answer_larger_than_the_ptys_buffer_does_not_wait_for_the_tick(clock: ManualClock):
    with BoardServer(Recorder(), clock.now, tick_s=3600.0) as server, client(server) as port:
        with server.inspect() as model:
            model.repeat = 50_000
        port.write(b"\x0f")
        assert port.read(50_000) == b"\xf0" * 50_000


def test_the_board_lives_by_the_injected_clock(clock: ManualClock):
    with BoardServer(Recorder(), clock.now) as server, client(server) as port:
        port.write(b"\x01")
        port.read(1)
        clock.advance(7.0)
        port.write(b"\x01")
        port.read(1)
        with server.inspect() as model:
            assert model.times[0] == 100.0
            assert model.times[-1] == 107.0
            assert set(model.times) == {100.0, 107.0}


def test_a_link_of_the_users_choice(clock: ManualClock, tmp_path: Path):
    link = tmp_path / "arm"
    with BoardServer(Recorder(), clock.now, link=link) as server:
        assert server.port == str(link)
        with client(server) as port:
            port.write(b"\x01")
            assert port.read(1) == b"\xfe"
        with (
            pytest.raises(PortError, match="already there"),
            BoardServer(Recorder(), clock.now, link=link),
        ):
            pass
        assert link.is_symlink()
    assert not link.is_symlink()


def test_closing_does_not_wait_for_the_tick_and_leaves_nothing_open(clock: ManualClock):
    server = BoardServer(Recorder(), clock.now, tick_s=3600.0)
    threads, descriptors = threading.active_count(), set(os.listdir("/proc/self/fd"))
    with pytest.raises(PortError, match="not being served"):
        _ = server.port
    with server:
        assert server.port.startswith("/dev/pts/")
        assert threading.active_count() == threads + 1
    assert threading.active_count() == threads
    assert set(os.listdir("/proc/self/fd")) == descriptors
    server.close()
    with pytest.raises(PortError, match="not being served"):
        _ = server.port


def test_a_board_that_leaves_the_line_breaks_it_for_its_clients(clock: ManualClock):
    with BoardServer(Recorder(), clock.now, tick_s=0.001) as server:
        line = SerialTransport(server.port)
        with server.inspect() as model:
            model.gone = True
        with pytest.raises(BoardError, match="was the board unplugged"):
            line.read(1, 5.0)
        line.close()
        with server.inspect() as model:
            assert model.gone


@pytest.fixture
def no_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows."""
    monkeypatch.setattr("armctl.hardware.simulation.open_pseudo_terminal", lambda: None)


def dialled(server: BoardServer[Recorder]) -> socket.socket:
    address = urlsplit(server.port)
    assert (address.scheme, address.hostname) == ("socket", "127.0.0.1")
    return socket.create_connection(("127.0.0.1", address.port), timeout=5.0)


@pytest.mark.usefixtures("no_terminals")
def test_without_terminals_it_is_served_on_a_port_of_this_computer(clock: ManualClock):
    every = bytes(range(256))
    with BoardServer(Recorder(), clock.now, tick_s=3600.0) as server:
        with dialled(server) as rude:  # leaves answers unread, so that the line is reset
            rude.sendall(every)
            rude.recv(1)
        with dialled(server) as first, dialled(server) as second:
            second.sendall(b"\x01")  # waits until the first one has left
            first.sendall(every)
            assert received(first, 256) == every[::-1]
            first.close()
            assert received(second, 1) == b"\xfe"
            with server.inspect() as model:
                assert bytes(model.heard) == every * 2 + b"\x01"
                model.repeat = 50_000
            second.sendall(b"\x0f")
            assert received(second, 50_000) == b"\xf0" * 50_000


@pytest.mark.usefixtures("no_terminals")
def test_without_terminals_a_board_leaves_and_comes_back(clock: ManualClock, tmp_path: Path):
    with BoardServer(Recorder(), clock.now, tick_s=0.001) as server:
        with dialled(server) as line:
            with server.inspect() as model:
                model.gone = True
            assert line.recv(1) == b""
        while server.address is not None:
            os.sched_yield()
        with server.inspect() as model:
            model.gone = False
        while server.address is None:
            os.sched_yield()
        transport = SerialTransport(server.port)
        assert transport._serial._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        transport.write(b"\x01")
        assert transport.read(1, 5.0) == b"\xfe"
        transport.close()
    with pytest.raises(PortError, match="leave out --link"):
        BoardServer(Recorder(), clock.now, link=tmp_path / "arm").__enter__()


def received(line: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = line.recv(count - len(data))
        assert part
        data += part
    return data


def test_a_board_that_comes_back_is_served_again_at_its_link(clock: ManualClock, tmp_path: Path):
    link = tmp_path / "arm"
    with BoardServer(Recorder(), clock.now, link=link, tick_s=0.001) as server:
        line = SerialTransport(server.port)
        with server.inspect() as model:
            model.gone = True
        with pytest.raises(BoardError, match="was the board unplugged"):
            line.read(1, 5.0)
        line.close()
        while server.address is not None:
            os.sched_yield()
        assert not link.is_symlink()
        descriptors = set(os.listdir("/proc/self/fd"))
        link.symlink_to("/dev")  # in its way: it waits until that is gone
        with server.inspect() as model:
            model.gone = False
            seen = len(model.times)
        while len(model.times) < seen + 3:
            os.sched_yield()
        assert server.address is None
        link.unlink()
        while server.address is None:
            os.sched_yield()
        with client(server) as port:
            port.write(b"\x01")
            assert port.read(1) == b"\xfe"
        assert len(os.listdir("/proc/self/fd")) == len(descriptors) + 2
    assert not link.is_symlink()


def test_a_link_in_the_way_that_is_taken_away_meanwhile_is_told_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Path, "is_symlink", lambda path: True)  # it was, when that was asked
    with pytest.raises(PortError, match="no link can be made there"):
        make_link(tmp_path / "arm", str(tmp_path))


GONE = "/dev/pts/999999"


@pytest.mark.parametrize("left_over", [None, GONE, "{folder}"])  # the last one is our own device by chance
def test_a_link_points_to_the_device_until_it_is_removed(tmp_path: Path, left_over: str | None):
    device, path = str(tmp_path), tmp_path / "arm"
    if left_over is not None:
        path.symlink_to(left_over.format(folder=tmp_path))
    make_link(path, device)
    assert os.readlink(path) == device
    remove_link(path, "/dev/pts/8")  # another one's link
    assert path.is_symlink()
    remove_link(path, device)
    assert not path.is_symlink()
    remove_link(path, device)


def test_a_place_where_no_link_can_be_made(tmp_path: Path):
    with pytest.raises(PortError, match="no link can be made there"):
        make_link(tmp_path / "missing" / "arm", "/dev/pts/7")


def test_a_file_a_folder_and_foreign_links_are_left_alone(tmp_path: Path):
    (tmp_path / "file").write_text("precious")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "file")
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    (tmp_path / "live").symlink_to("/dev/pts")
    for name in ("file", "folder", "link", "dangling", "live"):
        with pytest.raises(PortError, match=f"{name}: already there, and not a left-over"):
            make_link(tmp_path / name, "/dev/pts/7")
    assert (tmp_path / "file").read_text() == "precious"
    assert os.readlink(tmp_path / "dangling") == str(tmp_path / "nothing")
