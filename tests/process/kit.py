"""An arm served inside the test's own process, on a socket, and clients of it."""

from __future__ import annotations

import asyncio
import itertools
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import msgspec
import numpy as np
from websockets.sync.client import ClientConnection, connect

from armctl.boards import ANY_BOARD
from armctl.errors import ArmctlError
from armctl.process.lines import LocalLine, ProcessLine, hand_over
from armctl.process.link import Link
from armctl.process.records import (
    SILENCE_S,
    Answer,
    Ask,
    Codec,
    FromArm,
    Hello,
    Record,
    Seen,
    Stop,
    Welcome,
    error_of,
)
from armctl.process.server import serve_arm
from armctl.protocol import Command, Connect, Enable, Snapshot
from armctl.robot import Robot, load_robot

ROBOT = load_robot("uzuner")
SECRET = "secret"
HOME = ROBOT.pose("home")
PATIENCE_S = 20.0
Address = Path | tuple[str, int]


@contextmanager
def served(
    folder: Path | None, robot: Robot = ROBOT, pin: str = "", silence_s: float = SILENCE_S
) -> Iterator[Address]:
    """The address of an arm that is served until its last client has gone."""
    address: Future[str] = Future()
    path = None if folder is None else folder / "arm.sock"

    def run() -> None:
        asyncio.run(
            serve_arm(robot, ANY_BOARD, 50.0, path, SECRET, address.set_result, pin, silence_s=silence_s)
        )

    thread = threading.Thread(target=run)
    thread.start()
    said = address.result(PATIENCE_S)
    at = ("127.0.0.1", int(said)) if folder is None else Path(said)
    keeper = Link(LocalLine(at, SECRET), "keeper", robot)
    try:
        yield at
    finally:
        keeper.close()  # the last one that owns it
        thread.join()


def websocket(address: Address, source: str = "127.0.0.1") -> ClientConnection:
    """A websocket whose other end the arm process has been handed, as the page server does it."""
    assert isinstance(address, Path)
    with socket.create_server(("127.0.0.1", 0)) as door:
        ours = socket.create_connection(door.getsockname(), source_address=(source, 0))
        theirs, _ = door.accept()

    def give() -> None:
        request = b""
        while b"\r\n\r\n" not in request and (data := theirs.recv(65536)):
            request += data
        hand_over(address, SECRET, theirs, request)
        theirs.close()

    thread = threading.Thread(target=give)
    thread.start()
    try:
        return connect(
            "ws://arm/api", sock=ours, compression=None, ping_interval=None, max_size=None, close_timeout=0.2
        )
    finally:
        thread.join()


class WebSocketLine:
    """A websocket as a line."""

    def __init__(self, address: Address, *, text: bool = False, source: str = "127.0.0.1") -> None:
        self.socket, self._text = websocket(address, source), text

    def send(self, data: bytes) -> None:
        self.socket.send(data, text=self._text)

    def receive(self) -> bytes:
        data = self.socket.recv(timeout=PATIENCE_S)
        return data if isinstance(data, bytes) else data.encode()

    def close(self) -> None:
        self.socket.close()


R = TypeVar("R", bound=Record)


class Client:
    """Says and hears records one by one; nothing goes on by itself."""

    def __init__(
        self, line: ProcessLine, name: str = "c", *, json: bool = False, watch: bool = False
    ) -> None:
        self.line, self.codec = line, Codec(json=json)
        self.seen: list[FromArm] = []
        self.address: Address
        self._numbers = itertools.count(1)
        self.say(Hello(name, watch))
        self.id = self.hear(Welcome).you
        self.snapshot = self.hear(Seen).snapshot

    @classmethod
    def remote(
        cls,
        address: Address,
        name: str = "c",
        *,
        json: bool = False,
        watch: bool = False,
        source: str = "127.0.0.1",
    ) -> Client:
        """One on a websocket, from an address of this computer."""
        client = cls(WebSocketLine(address, text=json, source=source), name, json=json, watch=watch)
        client.address = address
        return client

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.line.close()

    def say(self, record: Record) -> None:
        self.line.send(self.codec.encode(record))

    def next(self) -> FromArm:
        record = self.codec.from_arm(self.line.receive())
        self.seen.append(record)
        if isinstance(record, Seen):
            self.snapshot = record.snapshot
        return record

    def hear(self, kind: type[R]) -> R:
        """The next record of a kind."""
        while not isinstance(record := self.next(), kind):
            pass
        return record

    def until(self, condition: Callable[[Snapshot], bool]) -> Snapshot:
        """The next snapshot of which this is true."""
        while not condition(self.snapshot):
            self.next()
        return self.snapshot

    def ask(self, command: Command) -> int:
        """Ask for something, without waiting for an answer."""
        number = next(self._numbers)
        self.say(Ask(number, command))
        return number

    def ask_raw(self, command: str, **values: object) -> int:
        """The same in another program's words."""
        number = next(self._numbers)
        record = {"type": "ask", "id": number, "command": {"command": command, **values}}
        self.line.send((msgspec.json if self.codec.json else msgspec.msgpack).encode(record))
        return number

    def stop(self) -> int:
        number = next(self._numbers)
        self.say(Stop(number))
        return number

    def outcome(self, number: int) -> ArmctlError | None:
        """What became of it."""
        while True:
            record = self.hear(Answer)
            if record.id == number and record.finished:
                return error_of(record)

    def does(self, command: Command) -> None:
        error = self.outcome(self.ask(command))
        if error is not None:
            raise error

    def enables(self) -> None:
        """Connect the simulated board, and stand at home."""
        if self.snapshot.board is None:
            self.does(Connect("sim"))
        self.does(Enable(HOME))

    def turned(self, degrees: float) -> np.ndarray:
        """Home, with the base turned."""
        return HOME + np.radians([degrees, 0, 0, 0, 0])
