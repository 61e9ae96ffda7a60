"""One arm as a process runs it: its boards and its controller, and the server that clients connect to."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import signal
import sys
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Self

from armctl.boards import ANY_BOARD, Boards
from armctl.errors import ArmctlError, InputError, StateError
from armctl.process.records import (
    MOST_BYTES,
    SILENCE_S,
    Answer,
    Ask,
    Beat,
    Codec,
    End,
    FromClient,
    Hello,
    Logged,
    Record,
    Refused,
    Running,
    Seen,
    Stop,
    Welcome,
    answer,
    light,
    new_events,
)
from armctl.robot import Robot
from armctl.runtime import (
    ArmLink,
    Command,
    Controller,
    Event,
    MonotonicClock,
    Origin,
    Snapshot,
    State,
    Ticket,
)
from armctl.runtime.commands import MovingCommand

_LOGGER = logging.getLogger("armctl.process")
_SWITCH_INTERVAL_S = 2e-4
_WATCH_S = 0.1
_MOST_OPEN = 256
"""commands of one client that wait for their end"""
_MOST_CLIENTS = 64
_BIG = 64 * 1024
"""a record of more bytes is decoded beside the others"""
_MOVES = (State.MOVING, State.PAUSED)


class Host:
    """A robot with its boards and a controller that runs, in this process."""

    def __init__(
        self,
        robot: Robot,
        board: str = ANY_BOARD,
        rate_hz: float = 50.0,
        published: Callable[[], None] | None = None,
    ) -> None:
        """Wire up an arm as it is calibrated with ``board`` (see ``board_name``), without opening a line.

        ``rate_hz``: ticks a second, 10 … 200. ``board``: ``NO_BOARD`` where none was there when the
        calibration was looked up; another real board than that one is refused. ``published`` is called
        after each tick, by the controller's thread.
        """
        # The interpreter's default of 5 ms is what a tick would be late when other threads run Python.
        sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_INTERVAL_S))
        clock = MonotonicClock()
        self.boards = Boards(robot, clock.now, board=board)
        self._controller = Controller(robot, self.boards.driver, clock, rate_hz, published=published)
        self._controller.start()

    @property
    def robot(self) -> Robot:
        """The arm, as it is calibrated."""
        return self._controller.robot

    @property
    def snapshot(self) -> Snapshot:
        """The arm at the last tick."""
        return self._controller.snapshot

    @property
    def ended(self) -> bool:
        """It was closed."""
        return self._controller.ended

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        """Ask for something."""
        return self._controller.submit(command, origin)

    def stop(self, origin: Origin | None = None) -> Ticket:
        """STOP."""
        return self._controller.stop(origin)

    def close(self) -> None:
        """Bring the arm to rest, close the line, take the simulated board away."""
        try:
            self._controller.close()
        finally:
            self.boards.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Server:
    """Serves one arm to its clients; everything but ``tell`` happens on one event loop."""

    def __init__(self, secret: str) -> None:
        self._secret = secret
        self._clients: set[Client] = set()
        self.mover: Client | None = None
        """whose command moves the arm"""
        self._loop = asyncio.get_running_loop()
        self.ended = asyncio.Event()
        self._encoded: dict[bool, tuple[Snapshot, bytes]] = {}
        self.arm: ArmLink

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients)

    def tell(self) -> None:
        """There is a new snapshot; called by the controller's thread."""
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._wake_clients)

    def _wake_clients(self) -> None:
        for client in self._clients:
            client.wake.set()

    def encoded(self, codec: Codec, snapshot: Snapshot) -> bytes:
        """A snapshot as bytes, once for all clients that speak alike."""
        known = self._encoded.get(codec.json)
        if known is None or known[0] is not snapshot:
            known = self._encoded[codec.json] = (snapshot, codec.encode(Seen(light(snapshot))))
        return known[1]

    async def attend(self, receive: Callable[[], Awaitable[bytes | str]], send: Send, codec: Codec) -> None:
        """Serve one client until its connection ends. ``receive`` raises ``EOFError`` then."""
        client = Client(self, send, codec)
        try:
            if len(self._clients) >= _MOST_CLIENTS:
                raise InputError(f"{_MOST_CLIENTS} clients are connected already; close one")
            hello = codec.from_client(await receive())
            if not isinstance(hello, Hello) or hello.secret != self._secret:
                raise InputError("the first record must be a hello with the secret of this arm process")
            client.name = hello.name[:80] or "client"
            joints = self.arm.robot.joint_names
            await send(codec.encode(Welcome(version("armctl"), self.arm.robot.name, joints)))
            self._clients.add(client)
            client.wake.set()
            sender = asyncio.create_task(client.feed())
            try:
                while True:
                    await client.take(await receive())
            finally:
                sender.cancel()
        except (EOFError, ConnectionError):
            pass
        except ArmctlError as refusal:
            _LOGGER.warning("%s: %s", client.name, refusal)
            with suppress(EOFError, ConnectionError):
                await send(codec.encode(Refused(str(refusal))))
        finally:
            self._clients.discard(client)
            self.lost(client, "its connection is gone")

    def lost(self, client: Client, why: str) -> None:
        """A client cannot be asked any more: what moves at its command is stopped."""
        if self.mover is client and self.arm.snapshot.state in _MOVES:
            self.mover = None
            self.arm.stop(Origin(client.name, why))

    async def watch(self) -> None:
        """Stop what a client moves that has become silent."""
        while True:
            await asyncio.sleep(_WATCH_S)
            mover = self.mover
            if mover is not None and self._loop.time() - mover.heard_at > SILENCE_S:
                self.lost(mover, f"it has given no sign of life for {SILENCE_S:g} s")


Send = Callable[[bytes], Awaitable[None]]


class Client:
    """One connection."""

    def __init__(self, server: Server, send: Send, codec: Codec) -> None:
        self.name = "client"
        self.wake = asyncio.Event()
        """there is something to send"""
        self._server, self._send, self._codec = server, send, codec
        self._loop = asyncio.get_running_loop()
        self.heard_at = self._loop.time()
        self._answers: deque[Answer] = deque()
        self._open = 0
        self._stops = 0
        self._told: Event | None = None
        self._running: Running | None = None
        self._seen: Snapshot | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def feed(self) -> None:
        """Send what is new: the newest snapshot, and behind it the answers that belong to it."""
        encode = self._codec.encode
        while True:
            await self.wake.wait()
            self.wake.clear()
            answers = [self._answers.popleft() for _ in range(len(self._answers))]
            snapshot = self._server.arm.snapshot
            if snapshot is not self._seen:
                self._seen = snapshot
                for record in self._changes(snapshot):
                    await self._send(encode(record))
                await self._send(self._server.encoded(self._codec, snapshot))
            for one in answers:
                await self._send(encode(one))

    def _changes(self, snapshot: Snapshot) -> list[Record]:
        changes: list[Record] = []
        events = new_events(snapshot.events, self._told)
        if events:
            self._told = events[-1]
            changes.append(Logged(events))
        progress, told = snapshot.program, self._running
        if progress is not None and (
            told is None or told.running is not progress.running or told.coming is not progress.coming
        ):
            self._running = Running(progress.running, progress.coming)
            changes.append(self._running)
        return changes

    async def take(self, data: bytes | str) -> None:
        """Carry out one record."""
        self.heard_at = self._loop.time()
        if len(data) <= _BIG:
            record = self._codec.from_client(data)
            self._carry_out(record, self._command(record))
            return
        task = asyncio.create_task(self._take_big(data, self._stops))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _take_big(self, data: bytes | str, stops: int) -> None:
        """Decode a program beside what comes after it, so that a STOP never waits for that."""

        def decoded() -> tuple[FromClient, Command | ArmctlError | None]:
            record = self._codec.from_client(data)
            return record, self._command(record)

        try:
            record, command = await asyncio.to_thread(decoded)
        except ArmctlError as refusal:
            _LOGGER.warning("%s: %s", self.name, refusal)
            return
        if isinstance(record, Ask) and stops != self._stops:
            command = StateError("stopped before it began")
        self._carry_out(record, command)

    def _command(self, record: FromClient) -> Command | ArmctlError | None:
        """The command of an ``Ask``, or what is wrong with it."""
        if not isinstance(record, Ask):
            return None
        try:
            return self._codec.command(record)
        except ArmctlError as refusal:
            return refusal

    def _carry_out(self, record: FromClient, command: Command | ArmctlError | None) -> None:
        arm = self._server.arm
        match record:
            case Ask(number, _, who, note):
                if self._open >= _MOST_OPEN:
                    command = StateError(f"{self._open} commands wait for their end already; wait for them")
                if not isinstance(command, Command):
                    self._put(answer(number, command))
                    return
                ticket = arm.submit(command, Origin(who or self.name, note))
                if isinstance(command, MovingCommand):
                    ticket.accepted.add_done_callback(self._began)
                self._follow(number, ticket)
            case Stop(number, who, note):
                self._stops += 1
                self._follow(number, arm.stop(Origin(who or self.name, note)))
            case End():
                self._server.ended.set()
            case Beat():
                pass
            case Hello():
                raise InputError("a hello comes once, at the beginning")

    def _began(self, accepted: Future[None]) -> None:
        if accepted.exception() is None:
            self._loop.call_soon_threadsafe(setattr, self._server, "mover", self)

    def _follow(self, number: int, ticket: Ticket) -> None:
        """Send both answers of a ticket; they come from the controller's thread."""
        self._open += 1

        def accepted(future: Future[None]) -> None:
            if future.exception() is None:
                self._loop.call_soon_threadsafe(self._put, answer(number, None, accepted=True))

        def finished(future: Future[None]) -> None:
            self._loop.call_soon_threadsafe(self._close, answer(number, future.exception()))

        ticket.accepted.add_done_callback(accepted)
        ticket.finished.add_done_callback(finished)

    def _close(self, last: Answer) -> None:
        self._open -= 1
        self._put(last)

    def _put(self, record: Answer) -> None:
        self._answers.append(record)
        self.wake.set()


# A connection on the local socket: length and record.


async def attend_stream(server: Server, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Serve one client on a stream; each record has its length in front, four bytes, the lowest last."""

    async def receive() -> bytes:
        try:
            size = int.from_bytes(await reader.readexactly(4))
            if size > MOST_BYTES:
                raise InputError(f"a record of {size} bytes is too large; {MOST_BYTES} at most")
            return await reader.readexactly(size)
        except (asyncio.IncompleteReadError, OSError) as cause:
            raise EOFError from cause

    async def send(data: bytes) -> None:
        writer.write(len(data).to_bytes(4) + data)
        await writer.drain()

    try:
        await server.attend(receive, send, Codec())
    finally:
        writer.close()


# Garbage: what lives from the start is never looked at, the rest only while the arm stands.

_COLLECT_EVERY_S = 5.0
_MOST_YOUNG = 200_000


async def collect_at_rest(arm: ArmLink) -> None:
    """Collect garbage while nothing moves; in a long motion only what is young, when there is much of it."""
    gc.collect()
    gc.freeze()
    gc.disable()
    while True:
        await asyncio.sleep(_COLLECT_EVERY_S)
        if arm.snapshot.state not in _MOVES:
            gc.collect()
        elif gc.get_count()[0] > _MOST_YOUNG:
            gc.collect(0)


async def serve_arm(
    robot: Robot, board: str, rate_hz: float, address: Path | None, secret: str, ready: Callable[[str], None]
) -> None:
    """Serve an arm until a client ends it, the last one has gone, or SIGTERM comes.

    ``address`` is the path of a Unix socket; None: a port of the loopback address. ``ready`` is called with
    the address.
    """
    server = Server(secret)
    arm = Host(robot, board, rate_hz, server.tell)
    server.arm = arm
    with suppress(NotImplementedError):  # Windows
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, server.ended.set)
    connections: set[asyncio.Task[None]] = set()

    def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async def attend() -> None:
            try:
                await attend_stream(server, reader, writer)
            finally:
                if not server.clients:
                    server.ended.set()

        task = asyncio.create_task(attend())
        connections.add(task)
        task.add_done_callback(connections.discard)

    try:
        if address is None:
            listener = await asyncio.start_server(connected, "127.0.0.1", 0)
            ready(str(listener.sockets[0].getsockname()[1]))
        else:
            old = os.umask(0o177)
            try:
                listener = await asyncio.start_unix_server(connected, address)
            finally:
                os.umask(old)
            ready(str(address))
        chores = [asyncio.create_task(server.watch()), asyncio.create_task(collect_at_rest(arm))]
        await server.ended.wait()
        listener.close()
        for chore in chores:
            chore.cancel()
    finally:
        await asyncio.to_thread(arm.close)
        if address is not None:
            address.unlink(missing_ok=True)
