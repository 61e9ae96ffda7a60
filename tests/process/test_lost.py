"""What a client says and does where the arm process is gone or frozen, or a command takes long to encode."""

from __future__ import annotations

import queue
import socket
import subprocess
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.process.kit import ROBOT
from tests.runtime.kit import fails
from websockets.http11 import Request
from websockets.server import ServerProtocol

from armctl.errors import BoardError
from armctl.facts import State
from armctl.motion.trajectory import Sample
from armctl.process import lines as lines_module
from armctl.process import link as link_module
from armctl.process.lines import RemoteLine
from armctl.process.link import Link
from armctl.process.records import SILENCE_S, Codec, Record, Seen, Welcome
from armctl.protocol import Follow, ManualClock, MoveJoints, SetSpeed, Snapshot
from armctl.robot import Robot, load_robot
from armctl.robot.record import robot_record

MOVE = MoveJoints(ROBOT.pose("home"))


class ScriptedLine:
    """An arm process that says what a test lets it say."""

    def __init__(self, robot: Robot, snapshot: Snapshot) -> None:
        self._said: queue.Queue[Record | None] = queue.Queue()
        self.listening = threading.Event()
        """the client waits for the next record"""
        for record in (Welcome("0", "program 1", robot_record(robot)), Seen(replace(snapshot, events=()))):
            self._said.put(record)

    def say(self, record: Record | None) -> None:
        """One more; None: the connection breaks. Returns once the client has taken it."""
        self.listening.clear()
        self._said.put(record)
        assert record is None or self.listening.wait(20)

    def send(self, data: bytes) -> None:
        """Nobody reads it."""

    def receive(self) -> bytes:
        """The next record."""
        if self._said.empty():
            self.listening.set()
        record = self._said.get()
        if record is None:
            raise ConnectionError("the connection was closed")
        return Codec().encode(record)

    def close(self) -> None:
        """The client ends."""
        self._said.put(None)


@pytest.fixture
def killed() -> Iterator[subprocess.Popen[bytes]]:
    """A process that has died of SIGKILL."""
    with subprocess.Popen(["sleep", "60"]) as process:
        process.kill()
        process.wait()
        yield process


@pytest.mark.parametrize(
    ("name", "board_does"),
    [
        ("uzuner", "the pulses stay as they were, unless the board has a timeout of its own"),
        ("abaas", "the pulses stay as they were, unless the board has a timeout of its own"),
        ("scorbot", "its board switches the motors off by itself"),
    ],
)
def test_an_arm_process_that_was_killed_is_a_fault_that_says_what_its_board_does(
    name: str, board_does: str, killed: subprocess.Popen[bytes], holding_snapshot: Snapshot
) -> None:
    robot = load_robot(name)
    assert holding_snapshot.board is not None
    line = ScriptedLine(
        robot, replace(holding_snapshot, board=replace(holding_snapshot.board, simulated=False))
    )
    link = Link(line, robot=robot, process=killed)
    motion = link.submit(MOVE)
    line.say(None)
    words = rf"ended \(killed by signal 9\), and STOP does not reach the arm; {board_does}\. Connect again"
    assert motion.finished.exception(20) is not None
    fails(motion.finished, words)
    assert link.ended and link.snapshot.state is State.FAULT
    assert not link.snapshot.commanded  # where the arm is, nobody knows now
    for ticket in (link.submit(MOVE), link.stop()):
        fails(ticket.finished, words)
    link.close()


def test_an_arm_process_that_says_nothing_is_a_fault_until_it_is_heard_again(
    monkeypatch: pytest.MonkeyPatch, holding_snapshot: Snapshot
) -> None:
    clock = ManualClock()
    monkeypatch.setattr(link_module, "MonotonicClock", SimpleNamespace(now=clock.now))
    line = ScriptedLine(ROBOT, holding_snapshot)
    link = Link(line, robot=ROBOT)
    line.listening.wait(20)
    clock.advance(SILENCE_S)
    assert link.snapshot.state is State.HOLDING
    clock.advance(0.01)
    assert link.snapshot.state is State.FAULT and not link.ended
    assert "it may be frozen, and STOP does not reach the arm; use the switch" in link.snapshot.cause
    line.say(Seen(replace(holding_snapshot, events=())))
    assert link.snapshot.state is State.HOLDING
    link.close()


def test_what_waited_while_the_console_stood_still_does_not_move_the_arm(
    monkeypatch: pytest.MonkeyPatch, holding_snapshot: Snapshot
) -> None:
    clock = ManualClock()
    monkeypatch.setattr(link_module, "MonotonicClock", SimpleNamespace(now=clock.now))
    line = SlowLine(holding_snapshot)
    link = Link(line, robot=ROBOT, beats=False)
    clock.advance(10.0)  # it is still being built
    link.beat()
    clock.advance(SILENCE_S + 0.5)
    words = r"this console stood still for 1\.\d s before it could send that; ask for it again"
    fails(link.submit(MOVE).finished, words)
    link.beat()
    fails(link.submit(MOVE).finished, words)
    stop = link.stop()
    assert not stop.finished.done()
    clock.advance(0.25)
    link.beat()
    moves = link.submit(MOVE)
    assert not moves.finished.done()
    link.close()


def test_a_press_that_waited_behind_a_busy_page_server_does_not_outlive_a_stop_pressed_after_it(
    monkeypatch: pytest.MonkeyPatch, holding_snapshot: Snapshot
) -> None:
    """STOP has a line and a thread of its own; nobody can say which of the two was pressed first."""
    clock = ManualClock()
    monkeypatch.setattr(link_module, "MonotonicClock", SimpleNamespace(now=clock.now))
    line = SlowLine(holding_snapshot)
    link = Link(line, robot=ROBOT, beats=False)
    link.beat()
    clock.advance(0.5)  # a page is being built
    assert not link.submit(MOVE).finished.done()
    clock.advance(0.3)
    link.stop()
    clock.advance(0.2)
    fails(link.submit(MOVE).finished, r"this console stood still for 0\.5 s before it could send that")
    link.beat()
    clock.advance(0.3)
    link.beat()
    link.stop()
    clock.advance(0.05)  # from one sign of life to the next
    assert not link.submit(MOVE).finished.done()
    link.close()


class Laborious:
    """A trajectory of a caller's own that is being sampled until ``go_on``."""

    duration = 1.0
    start = end = ROBOT.pose("home")

    def __init__(self) -> None:
        self.begun, self.go_on = threading.Event(), threading.Event()

    def sample(self, t: object) -> Sample:
        self.begun.set()
        assert self.go_on.wait(20)
        q = np.tile(self.start, (np.size(t), 1))
        return Sample(q, 0 * q, 0 * q, 0 * q)


def test_stop_does_not_wait_for_a_command_that_is_being_encoded_and_drops_it(
    holding_snapshot: Snapshot,
) -> None:
    link, trajectory = Link(ScriptedLine(ROBOT, holding_snapshot), "stranger", beats=False), Laborious()
    with ThreadPoolExecutor(2) as pool:
        asked = pool.submit(link.submit, Follow(trajectory))
        assert trajectory.begun.wait(20)
        try:
            stopped = pool.submit(link.stop).result(20)
        finally:
            trajectory.go_on.set()
        fails(asked.result(20).finished, "stopped before it began")
    assert not stopped.finished.done()
    link.close()
    fails(stopped.finished, "closed")


def test_a_network_that_is_pulled_out_ends_what_waits_for_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_PING_S", "_GONE_S", "_GOODBYE_S"):
        monkeypatch.setattr(lines_module, name, 0.05)
    with socket.create_server(("127.0.0.1", 0)) as door, ThreadPoolExecutor(1) as pool:
        opened = pool.submit(RemoteLine, f"http://127.0.0.1:{door.getsockname()[1]}", None)
        wire, _ = door.accept()
        with wire:
            protocol = ServerProtocol()
            protocol.receive_data(wire.recv(65536))
            (request,) = protocol.events_received()
            assert isinstance(request, Request)
            protocol.send_response(protocol.accept(request))
            wire.sendall(b"".join(protocol.data_to_send()))
            line = opened.result(20)
            with pytest.raises(ConnectionError):  # from here on the other end says nothing
                pool.submit(line.receive).result(20)
            wire.shutdown(socket.SHUT_RDWR)
            line.close()


def test_a_connection_that_an_arm_process_takes_with_it_as_it_dies_is_made_anew() -> None:
    """It was handed over, and nobody answers; the console serves the next one itself."""
    with socket.create_server(("127.0.0.1", 0)) as door, ThreadPoolExecutor(1) as pool:
        door.settimeout(20)
        address = f"127.0.0.1:{door.getsockname()[1]}"

        def answer(*words: str) -> None:
            wire, _ = door.accept()
            with wire:
                assert wire.recv(65536).startswith(b"GET /api ")
                wire.sendall("\r\n".join(words).encode())

        opened = pool.submit(RemoteLine, f"http://{address}", None)
        answer()
        answer("HTTP/1.1 503 No", "Content-Length: 7", "", "restart")
        with pytest.raises(BoardError, match=f"{address}: restart"):
            opened.result(20)
        opened = pool.submit(RemoteLine, f"http://{address}", None)
        for _ in range(3):
            answer()
        with pytest.raises(BoardError, match=f"{address}: it ends each connection without"):
            opened.result(20)


class SlowLine(ScriptedLine):
    """Takes nothing more once ``full`` is set, until it is let go on."""

    def __init__(self, snapshot: Snapshot) -> None:
        super().__init__(ROBOT, snapshot)
        self.full, self.stuck, self.go_on = threading.Event(), threading.Event(), threading.Event()
        self.sent: list[bytes] = []

    def send(self, data: bytes) -> None:
        if self.full.is_set():
            self.stuck.set()
            assert self.go_on.wait(20)
        self.sent.append(data)
        super().send(data)


def test_stop_drops_the_motions_that_wait_behind_a_slow_line(holding_snapshot: Snapshot) -> None:
    line = SlowLine(holding_snapshot)
    link = Link(line, robot=ROBOT, beats=False)
    line.full.set()
    link.submit(SetSpeed(0.5))
    assert line.stuck.wait(20)  # it is on its way; what follows has to wait
    motion, speed = link.submit(MOVE), link.submit(SetSpeed(0.4))
    stopped = link.stop()
    fails(motion.finished, "stopped before it began")
    line.go_on.set()
    link.close()
    for ticket in (speed, stopped):
        fails(ticket.finished, "closed")
    assert not any(b"move-joints" in data for data in line.sent)
