"""The arm process: one arm, served to clients on a local socket and on websockets that are handed over."""

from __future__ import annotations

import asyncio
import gc
import itertools
import logging
import os
import signal
import socket
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from websockets.exceptions import WebSocketException
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import OPEN
from websockets.server import ServerProtocol

from armctl.errors import ArmctlError, InputError, StateError
from armctl.process.host import Host
from armctl.process.link import hands_of
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
    Recall,
    Recalled,
    Record,
    Refused,
    Running,
    Seen,
    Stop,
    Trust,
    Welcome,
    answer,
    light,
    new_events,
    robot_record,
)
from armctl.robot import Robot
from armctl.runtime import ArmLink, Arrive, Command, Event, Leave, Origin, Snapshot, State, Ticket
from armctl.runtime.black_box import packed
from armctl.runtime.commands import MovingCommand

_LOGGER = logging.getLogger("armctl.process")
_WIRE = logging.getLogger("armctl.process.wire")
_WIRE.setLevel(logging.ERROR)  # a client that hangs up is no news
_WATCH_S = 0.1
_MOST_OPEN = 256
"""commands of one client that wait for their end"""
_MOST_CLIENTS = 64
_MOST_A_SECOND = 1000
"""records of one client; more are a flood"""
_BIG = 64 * 1024
"""a record of more bytes is decoded beside the others"""
_MOVES = (State.MOVING, State.PAUSED)

Receive = Callable[[], Awaitable[bytes]]
"""the next record; ``EOFError``: the connection has ended"""
Send = Callable[[bytes], Awaitable[None]]


class Server:
    """Serves one arm to its clients; everything but ``tell`` happens on one event loop."""

    def __init__(self, secret: str) -> None:
        self.arm: ArmLink
        self.mover: Client | None = None
        """whose command moves the arm"""
        self.ended = asyncio.Event()
        self._secret = secret
        self._clients: set[Client] = set()
        self._ids = itertools.count(1)
        self._loop = asyncio.get_running_loop()
        self._encoded: dict[bool, tuple[Snapshot, bytes]] = {}

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

    async def attend(
        self, receive: Receive, send: Send, *, let_in: bool, line: HandedOver | None = None
    ) -> None:
        """Serve one client until its connection ends.

        ``let_in``: it has shown its token at the door; else it has to know the secret of this process.
        ``line`` tells when it gives a sign of life by itself.
        """
        client: Client | None = None
        codec = Codec()
        try:
            first = await receive()
            codec = Codec(json=first[:1] == b"{")
            client = await self._admitted(codec, first, receive, send, let_in)
            if line is not None:
                line.alive = client.alive
            while True:
                client.take(await receive())
        except (EOFError, ConnectionError):
            pass
        except ArmctlError as refusal:
            _LOGGER.warning("%s: %s", "a client" if client is None else client.name, refusal)
            with suppress(EOFError, ConnectionError):
                await send(codec.encode(Refused(str(refusal))))
        finally:
            if client is not None:
                self._clients.discard(client)
                client.leave()
                if client.owns and not any(one.owns for one in self._clients):
                    self.ended.set()

    async def _admitted(
        self, codec: Codec, first: bytes, receive: Receive, send: Send, let_in: bool
    ) -> Client:
        hello, trust = codec.from_client(first), None
        if isinstance(hello, Trust):
            trust, hello = hello, codec.from_client(await receive())
        if not let_in and (trust is None or trust.secret != self._secret):
            raise InputError("who connects here must know the secret of this arm process")
        if not isinstance(hello, Hello):
            raise InputError("the first record must be a hello")
        if len(self._clients) >= _MOST_CLIENTS:
            raise StateError(f"{_MOST_CLIENTS} clients are connected already; close one")
        owns = trust is not None and not trust.relays
        client = Client(self, codec, send, hello, f"{hello.name[:40]}, program {next(self._ids)}", owns=owns)
        await send(codec.encode(Welcome(version("armctl"), client.id, robot_record(self.arm.robot))))
        self._clients.add(client)
        client.begin()
        return client

    async def watch(self) -> None:
        """Stop what a client moves that has become silent."""
        while True:
            await asyncio.sleep(_WATCH_S)
            mover = self.mover
            if mover is not None and self._loop.time() - mover.heard_at > SILENCE_S:
                mover.stop(f"no sign of life for {SILENCE_S:g} s")


class Client:
    """One connection."""

    def __init__(
        self, server: Server, codec: Codec, send: Send, hello: Hello, id: str, *, owns: bool
    ) -> None:
        self.id, self.name, self.owns = id, hello.name or id, owns
        self.beats = hello.beats
        self.wake = asyncio.Event()
        """there is something to send"""
        self._server, self._codec, self._send, self._watches = server, codec, send, hello.watch
        self._loop = asyncio.get_running_loop()
        self.heard_at = self._loop.time()
        self._answers: deque[Answer | Recalled] = deque()
        self._open = self._stops = self._taken = 0
        self._recalling = False
        self._second = 0.0
        self._told: Event | None = None
        self._running: Running | None = None
        self._seen: Snapshot | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    def begin(self) -> None:
        """It is let in: say so to the arm, and send it what happens."""
        if not self.owns:  # who owns the arm speaks for its pages
            self._server.arm.submit(Arrive(self.name, self._watches), Origin(self.id))
        self._begin(self._feed())
        self.wake.set()

    def leave(self) -> None:
        """Its connection is gone: what moves at its command is stopped."""
        for task in self._tasks:
            task.cancel()
        if not self.owns:
            self._server.arm.submit(Leave("its connection is gone"), Origin(self.id))
        if self._server.mover is self:
            self.stop("its connection is gone")

    def stop(self, why: str) -> None:
        """Stop what moves at its command."""
        self._server.mover = None
        if self._server.arm.snapshot.state in _MOVES:
            self._server.arm.stop(Origin(self.name, why))

    def alive(self) -> None:
        """A sign of life that its line gives by itself."""
        if not self.beats:
            self.heard_at = self._loop.time()

    def take(self, data: bytes) -> None:
        """Carry out one record."""
        now = self.heard_at = self._loop.time()
        if now - self._second > 1.0:
            self._second, self._taken = now, 0
        self._taken += 1
        if self._taken > _MOST_A_SECOND:
            raise InputError(f"more than {_MOST_A_SECOND} records in a second; send less")
        if len(data) > _BIG:
            self._begin(self._take_big(data, self._stops))
        else:
            record = self._codec.from_client(data)
            self._carry_out(record, self._command(record))

    async def _take_big(self, data: bytes, stops: int) -> None:
        """Decode a program beside what comes after it, so that a STOP never waits for that."""

        def decoded() -> tuple[FromClient, Command | ArmctlError | None]:
            record = self._codec.from_client(data)
            return record, self._command(record)

        try:
            record, command = await asyncio.to_thread(decoded)
        except ArmctlError as refusal:
            _LOGGER.warning("%s: %s", self.name, refusal)
            await self._send(self._codec.encode(Refused(str(refusal))))
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

    def _origin(self, who: str, note: str) -> Origin:
        return Origin(who or self.name, note) if self.owns else Origin(self.id)

    def _carry_out(self, record: FromClient, command: Command | ArmctlError | None) -> None:
        arm = self._server.arm
        match record:
            case Ask(number, _, who, note):
                if self._open >= _MOST_OPEN:
                    command = StateError(f"{self._open} commands wait for their end already; wait for them")
                if not isinstance(command, Command):
                    self._put(answer(number, command))
                    return
                ticket = arm.submit(command, self._origin(who, note))
                if isinstance(command, MovingCommand):
                    ticket.accepted.add_done_callback(self._began)
                self._follow(number, ticket)
            case Stop(number, who, note):
                self._stops += 1
                self._follow(number, arm.stop(self._origin(who, note)))
            case End():
                if not self.owns:
                    raise InputError("only who started the arm may end it")
                self._server.ended.set()
            case Recall(number):
                if not self._recalling:  # one at a time
                    self._recalling = True
                    self._begin(self._recall(number))
            case Beat():
                pass
            case Trust() | Hello():
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

    async def _recall(self, number: int) -> None:
        """Send the last minute, packed beside the event loop."""
        try:
            content = await asyncio.to_thread(lambda: packed(self._server.arm.black_box()))
        finally:
            self._recalling = False
        self._put(Recalled(number, content))

    def _put(self, record: Answer | Recalled) -> None:
        self._answers.append(record)
        self.wake.set()

    def _begin(self, work: Awaitable[None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _feed(self) -> None:
        """Send what is new: the newest snapshot, and behind it the answers that belong to it."""
        encode = self._codec.encode
        with suppress(EOFError, ConnectionError):  # who receives from it learns that, too
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


# A connection on the local socket: each record has its length in front, four bytes, the highest first.


async def attend_stream(server: Server, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Serve one client of the local socket."""

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
        await server.attend(receive, send, let_in=False)
    finally:
        writer.close()


# A websocket that the page server has let in and handed over: its file descriptor and its request. From here
# on it is ours alone, so nothing that the page server does can hold up what comes on it.

_PING_S = 0.25
_MOST_MESSAGE = 4 * 1024 * 1024


class HandedOver:
    """The messages of one websocket; ``websockets`` knows the protocol, without input and output."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._protocol = ServerProtocol(max_size=_MOST_MESSAGE, logger=_WIRE)
        self._messages: deque[bytes] = deque()
        self._parts = bytearray()
        self._text = True
        self.alive: Callable[[], None] = lambda: None
        """called when its line gives a sign of life"""

    async def open(self, request: bytes) -> None:
        """Answer its request."""
        self._protocol.receive_data(request)
        asked = self._protocol.events_received()
        if not asked or not isinstance(asked[0], Request):
            raise EOFError
        self._protocol.send_response(self._protocol.accept(asked[0]))
        await self._flush()

    async def receive(self) -> bytes:
        """The next message; ``EOFError`` behind the last one."""
        while not self._messages:
            try:
                data = await self._reader.read(_BIG)
            except OSError as cause:
                raise EOFError from cause
            if data:
                self._protocol.receive_data(data)
            else:
                self._protocol.receive_eof()
            self.alive()
            for event in self._protocol.events_received():
                self._take(event)
            await self._flush()
            if not self._messages and (not data or self._protocol.state is not OPEN):
                raise EOFError
        return self._messages.popleft()

    async def send(self, data: bytes) -> None:
        """Send a message."""
        if self._protocol.state is not OPEN:
            raise EOFError
        if data[:1] == b"{":
            self._protocol.send_text(data)
        else:
            self._protocol.send_binary(data)
        await self._flush()

    async def ping(self) -> None:
        """Have the other end give a sign of life, for ever."""
        while self._protocol.state is OPEN:
            self._protocol.send_ping(b"")
            await self._flush()
            await asyncio.sleep(_PING_S)

    def close(self) -> None:
        """Say goodbye, and close."""
        if self._protocol.state is OPEN:
            self._protocol.send_close(1000)
            for data in self._protocol.data_to_send():
                self._writer.write(data)
        self._writer.close()

    def _take(self, event: object) -> None:
        if isinstance(event, Frame) and event.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
            self._parts += event.data
            if len(self._parts) > _MOST_MESSAGE:
                raise InputError(f"a message is larger than {_MOST_MESSAGE} bytes")
            if event.fin:
                self._messages.append(bytes(self._parts))
                self._parts.clear()

    async def _flush(self) -> None:
        try:
            for data in self._protocol.data_to_send():
                if data:
                    self._writer.write(data)
                elif self._writer.can_write_eof():
                    self._writer.write_eof()
            await self._writer.drain()
        except OSError as cause:
            raise EOFError from cause


async def attend_websocket(server: Server, line: socket.socket, request: bytes) -> None:
    """Serve one client of a websocket that is handed over with its request."""
    reader, writer = await asyncio.open_connection(sock=line)
    websocket = HandedOver(reader, writer)
    pings: asyncio.Task[None] | None = None
    try:
        await websocket.open(request)
        pings = asyncio.create_task(websocket.ping())
        await server.attend(websocket.receive, websocket.send, let_in=True, line=websocket)
    except (EOFError, WebSocketException):
        pass
    finally:
        if pings is not None:
            pings.cancel()
        websocket.close()


class _Hands:
    """Takes connections that are handed over."""

    def __init__(self, server: Server, address: Path, secret: str) -> None:
        self._server, self._secret = server, secret.encode()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(str(hands_of(address)))
        self._tasks: set[asyncio.Task[None]] = set()
        asyncio.get_running_loop().add_reader(self._socket, self._take)

    def close(self) -> None:
        """Take no more."""
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _take(self) -> None:
        try:
            data, descriptors, _, _ = socket.recv_fds(self._socket, _BIG, 4)
        except OSError:
            return
        secret, _, request = data.partition(b"\n")
        if len(descriptors) != 1 or secret != self._secret:
            for descriptor in descriptors:
                os.close(descriptor)
            return
        line = socket.socket(fileno=descriptors[0])
        task = asyncio.create_task(attend_websocket(self._server, line, request))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


# Garbage: what lives from the start is never looked at, the rest only while the arm stands.

_COLLECT_EVERY_S = 5.0
_MOST_YOUNG = 200_000


async def collect_at_rest(arm: ArmLink) -> None:
    """Collect garbage while nothing moves; in a long motion only what is young, when there is much of it."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        while True:
            await asyncio.sleep(_COLLECT_EVERY_S)
            if arm.snapshot.state not in _MOVES:
                gc.collect()
            elif gc.get_count()[0] > _MOST_YOUNG:
                gc.collect(0)
    finally:
        gc.enable()


async def serve_arm(
    robot: Robot,
    board: str,
    rate_hz: float,
    address: Path | None,
    secret: str,
    ready: Callable[[str], None],
    pin: str = "",
) -> None:
    """Serve an arm until a client ends it, the last one that owns it has gone, or SIGTERM comes.

    ``address`` is the path of a Unix socket; None: a port of the loopback address. ``ready`` is called with
    the address.
    """
    server = Server(secret)
    loop = asyncio.get_running_loop()
    with suppress(NotImplementedError, RuntimeError, ValueError):  # Windows; not on the main thread
        loop.add_signal_handler(signal.SIGTERM, server.ended.set)
    arm = server.arm = Host(robot, board, rate_hz, server.tell, pin)
    connections: set[asyncio.Task[None]] = set()

    def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = loop.create_task(attend_stream(server, reader, writer))
        connections.add(task)
        task.add_done_callback(connections.discard)

    hands: _Hands | None = None
    try:
        if address is None:
            listener = await asyncio.start_server(connected, "127.0.0.1", 0)
        else:
            before = os.umask(0o177)
            try:
                listener = await asyncio.start_unix_server(connected, address)
                hands = _Hands(server, address, secret)
            finally:
                os.umask(before)
        chores = [loop.create_task(server.watch()), loop.create_task(collect_at_rest(arm))]
        ready(str(listener.sockets[0].getsockname()[1] if address is None else address))
        await server.ended.wait()
        listener.close()
        for task in (*chores, *connections):
            task.cancel()
    finally:
        await asyncio.to_thread(arm.close)
        if hands is not None:
            hands.close()
        for path in () if address is None else (address, hands_of(address)):
            path.unlink(missing_ok=True)
