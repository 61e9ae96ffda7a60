"""How records come to the arm process, and what is sent to its clients.

They come on its local socket, and on websockets that are handed over to it.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import os
import socket
from collections import defaultdict, deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from websockets.exceptions import WebSocketException
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import OPEN
from websockets.server import ServerProtocol

from armctl.errors import InputError
from armctl.process.limits import source_of
from armctl.process.lines import hands_of
from armctl.process.records import (
    MOST_BYTES,
    MOST_ELSE,
    MOST_OF_PROGRAM,
    Answer,
    Codec,
    Located,
    Logged,
    Recalled,
    Running,
    new_events,
)
from armctl.process.snapshots import SnapshotWriter
from armctl.program import Program
from armctl.protocol import Event, Snapshot

_WIRE = logging.getLogger("armctl.process.wire")
_WIRE.setLevel(logging.ERROR)  # a client that hangs up is no news
_READ_BYTES = 64 * 1024
_PING_S, _LINGER_S = 0.25, 0.5
_READ_AT_ONCE, _READ_SLOWLY_S = 128 * 1024, 0.004
_FLOODS_WAIT, _FLOOD_WAITS_S = 32, 3.0
_MOST_UNREAD = 64 * 1024
"""bytes that the system keeps of a client's flood before it has to wait; else it takes megabytes"""
MOST_UNSENT = 16 * 1024 * 1024
"""bytes that wait for a client that does not read"""


class RecordConnection(Protocol):
    """Carries the records of one client both ways."""

    alive: Callable[[int], None]
    """called when the line gives a sign of life, with the number of frames that are no record"""
    admit: Callable[[int], Awaitable[None]]
    """awaited where a record has more than ``MOST_ELSE`` bytes, with those that are there; may refuse it"""

    async def receive(self) -> bytes:
        """The next record; ``EOFError``: the connection has ended. Never waits for its reader."""
        ...

    async def send(self, data: bytes) -> None:
        """Send a record; waits for a slow reader. ``EOFError`` or ``ConnectionError``: it has ended."""
        ...

    def abort(self) -> None:
        """End it at once; who waits in ``receive`` gets ``EOFError``."""
        ...


def nobody(_: int) -> None:
    """Nobody wants to know of signs of life yet."""


async def nothing_large(_: int) -> None:
    """Nobody has said who it is yet."""
    raise InputError(f"a first record of more than {MOST_ELSE >> 10} KiB is no hello")


class StreamConnection:
    """One on the local socket: each record has its length in front, four bytes, the highest first.

    A length of 0 is a sign of life of somebody else's line, whose records are relayed.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self.alive: Callable[[int], None] = nobody
        self.admit: Callable[[int], Awaitable[None]] = nothing_large

    async def receive(self) -> bytes:
        """The next record."""
        try:
            while not (size := int.from_bytes(await self._reader.readexactly(4))):
                self.alive(1)
            if size > MOST_BYTES:
                raise InputError(f"a record of {size} bytes is too large; {MOST_BYTES} at most")
            if size > MOST_ELSE:
                await self.admit(size)
            return await self._reader.readexactly(size)
        except (asyncio.IncompleteReadError, OSError) as cause:
            raise EOFError from cause

    async def send(self, data: bytes) -> None:
        """Send a record."""
        self._writer.write(len(data).to_bytes(4) + data)
        await self._writer.drain()

    def abort(self) -> None:
        """End it at once."""
        self._writer.transport.abort()

    async def finish(self) -> None:
        """End it behind what was sent, once the other end has had the time to read it."""
        _write_eof(self._writer)
        await _read_out(self._reader)

    def close(self) -> None:
        """End it."""
        self._writer.close()


class WebSocketConnection:
    """A websocket that the page server has let in and handed over.

    From here on it is ours alone, so nothing that the page server does can hold up what comes on it.
    ``websockets`` knows the protocol, without input and output.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._protocol = ServerProtocol(max_size=MOST_OF_PROGRAM, logger=_WIRE)
        self._messages: deque[bytes] = deque()
        self._parts = bytearray()
        self._held = 0
        """about so many bytes of the message that is not whole yet"""
        self.alive: Callable[[int], None] = nobody
        self.admit: Callable[[int], Awaitable[None]] = nothing_large

    async def open(self, request: bytes) -> None:
        """Answer its request."""
        self._protocol.receive_data(request)
        asked = self._protocol.events_received()
        if not asked or not isinstance(asked[0], Request):
            raise EOFError
        self._protocol.send_response(self._protocol.accept(asked[0]))
        self._write()

    async def receive(self) -> bytes:
        """The next message."""
        while not self._messages:
            try:
                data = await self._reader.read(_READ_BYTES)
            except OSError as cause:
                raise EOFError from cause
            if data:
                self._protocol.receive_data(data)
            else:
                self._protocol.receive_eof()
            events = self._protocol.events_received()
            self._write()  # without waiting: STOP of a client that does not read must arrive
            if self._writer.transport.get_write_buffer_size() > MOST_UNSENT:
                raise EOFError  # it pings, and does not read the answers
            for event in events:
                self._take(event)
            self._held = len(self._parts) if events else self._held + len(data)
            if self._held > MOST_ELSE:
                await self.admit(self._held)
            self.alive(len(events) - len(self._messages))
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
        self._write()
        await self._writer.drain()

    async def ping(self) -> None:
        """Have the other end give a sign of life, for ever."""
        while self._protocol.state is OPEN:
            self._protocol.send_ping(b"")
            self._write()
            await asyncio.sleep(_PING_S)

    def abort(self) -> None:
        """End it at once."""
        self._writer.transport.abort()

    async def finish(self) -> bool:
        """Say goodbye, behind what was sent, once the other end has had the time to read it.

        Whether it goes on sending all the same.
        """
        if self._protocol.state is OPEN:
            self._protocol.send_close(1000)
            self._write()
        return await _read_out(self._reader)

    def close(self) -> None:
        """End it, and keep nothing of what came: the garbage collector looks at it late."""
        self._writer.close()
        self.forget()

    def forget(self) -> None:
        """Nothing more is read, and nothing is kept of what came."""
        self._messages.clear()
        self._parts.clear()
        self._protocol, self._reader = ServerProtocol(), asyncio.StreamReader()

    def _take(self, event: object) -> None:
        if isinstance(event, Frame) and event.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
            self._parts += event.data  # bounded: the protocol refuses what is larger than a program
            if event.fin:
                self._messages.append(bytes(self._parts))
                self._parts.clear()

    def _write(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self._writer.write(data)
            else:
                _write_eof(self._writer)


def _write_eof(writer: asyncio.StreamWriter) -> None:
    """Say that nothing more comes, where the other end is still there to hear it."""
    if writer.can_write_eof() and not writer.is_closing():
        with suppress(OSError):
            writer.write_eof()


async def _read_out(reader: asyncio.StreamReader) -> bool:
    """Read what still comes: closed with input unread, it would be reset, and what was sent last lost.

    A flood is read slowly, as it would cost as much as serving it. Whether it still comes at the end.
    """
    size = 0
    with suppress(OSError):
        try:
            async with asyncio.timeout(_LINGER_S):
                while data := await reader.read(_READ_BYTES):
                    size += len(data)
                    if size > _READ_AT_ONCE:
                        await asyncio.sleep(_READ_SLOWLY_S)
        except TimeoutError:
            return size > _READ_AT_ONCE
    return False


Attend = Callable[[RecordConnection, bool, str], Awaitable[None]]
"""serves a client until its connection ends; True: it has shown its token at the door of the page server; and
which computer it comes from, as far as is known"""


async def attend_stream(attend: Attend, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Serve one client of the local socket."""
    stream = StreamConnection(reader, writer)
    try:
        await attend(stream, False, "")
        await stream.finish()
    finally:
        stream.close()


async def attend_websocket(
    attend: Attend, line: socket.socket, request: bytes, floods: asyncio.Semaphore
) -> None:
    """Serve one client of a websocket that is handed over with its request.

    One that is shut out and goes on sending has to wait, instead of connecting anew at once: so many
    ``floods`` wait at a time.
    """
    source = source_of(line.getpeername())
    reader, writer = await asyncio.open_connection(sock=line)
    websocket = WebSocketConnection(reader, writer)
    pings: asyncio.Task[None] | None = None
    try:
        await websocket.open(request)
        pings = asyncio.create_task(websocket.ping())
        await attend(websocket, True, source)
        if await websocket.finish() and not floods.locked():
            async with floods:
                copy = line.dup()
                websocket.close()
                await asyncio.sleep(_FLOOD_WAITS_S)
                copy.close()
    except (EOFError, WebSocketException):
        _WIRE.debug("a websocket was broken off", exc_info=True)
    finally:
        if pings is not None:
            pings.cancel()
        websocket.close()


class ConnectionHandover:
    """Takes connections that are handed over (``hand_over``), with the request that came on each."""

    def __init__(self, attend: Attend, address: Path, secret: str) -> None:
        self._attend, self._secret = attend, secret.encode()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(str(hands_of(address)))
        self._floods = asyncio.Semaphore(_FLOODS_WAIT)
        self._tasks: set[asyncio.Task[None]] = set()
        asyncio.get_running_loop().add_reader(self._socket, self._take)

    def close(self) -> None:
        """Take no more."""
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _take(self) -> None:
        try:
            data, descriptors, _, _ = socket.recv_fds(self._socket, 2 * _READ_BYTES, 4)
        except OSError:
            return
        secret, _, request = data.partition(b"\n")
        if len(descriptors) != 1 or not hmac.compare_digest(secret, self._secret):
            for descriptor in descriptors:
                os.close(descriptor)
            return
        line = socket.socket(fileno=descriptors[0])
        line.setblocking(False)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _MOST_UNREAD)
        task = asyncio.create_task(attend_websocket(self._attend, line, request, self._floods))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


# What is sent: the newest snapshot, what has changed beside it, and answers. A record for all clients is
# encoded once. Memory stays bounded whatever they read: a client that does not read its answers is shut out,
# and few clients at a time have a large record under way.


_MOST_ANSWERS, _MOST_LETTERS = 4096, 256 * 1024
"""answers that a client does not read, and letters of their errors; then it is shut out"""
_LARGE, _LARGE_AT_ONCE = 64 * 1024, 6
"""larger records are sent to so many clients at once: each has a copy in memory until it has read it"""
_READ_S = 5.0
"""how long a client may take to read such a one"""


class Broadcast:
    """Encodes what all clients get, once for all that speak alike."""

    def __init__(self) -> None:
        self.large = asyncio.Semaphore(_LARGE_AT_ONCE)
        self._writers = defaultdict[Codec, SnapshotWriter](SnapshotWriter)
        self._snapshots: dict[Codec, tuple[Snapshot, bytes]] = {}
        self._programs: dict[bool, tuple[Running, bytes]] = {}

    def snapshot(self, codec: Codec, snapshot: Snapshot) -> bytes:
        """A snapshot without what changes rarely."""
        known = self._snapshots.get(codec)
        if known is None or known[0] is not snapshot:
            known = self._snapshots[codec] = (snapshot, self._writers[codec](codec, snapshot))
        return known[1]

    def programs(self, codec: Codec, running: Running) -> bytes:
        """The program that runs."""
        known = self._programs.get(codec.json)
        if known is None or not _same(known[0], running.running, running.coming):
            known = self._programs[codec.json] = (running, codec.encode(running))
        return known[1]


class Outbox:
    """What waits to be sent to one client."""

    def __init__(self, line: RecordConnection, codec: Codec, broadcast: Broadcast, *, bounded: bool) -> None:
        """``bounded``: it may be anybody's; else an owner's, who reads."""
        self.wake = asyncio.Event()
        """there is something to send"""
        self._line, self._codec, self._broadcast, self._bounded = line, codec, broadcast, bounded
        self._answers: deque[Answer] = deque()
        self._letters = 0
        self._told: Event | None = None
        self._running: Running | None = None
        self._seen: Snapshot | None = None

    def put(self, record: Answer) -> None:
        """Send an answer behind the snapshot that belongs to it."""
        self._answers.append(record)
        self._letters += len(record.error)
        self.wake.set()
        if len(self._answers) > _MOST_ANSWERS or (self._bounded and self._letters > _MOST_LETTERS):
            self._line.abort()
            self._answers.clear()

    async def send(self, data: bytes) -> None:
        """Send a record; who takes too long to read a large one is shut out."""
        if not self._bounded or len(data) <= _LARGE:
            await self._line.send(data)
            return
        async with self._broadcast.large:
            try:
                async with asyncio.timeout(_READ_S):
                    await self._line.send(data)
            except TimeoutError:
                self._line.abort()
                raise EOFError from None

    async def reply(self, record: Recalled | Located) -> None:
        """Send what was asked for."""
        with suppress(EOFError, ConnectionError):
            await self.send(self._codec.encode(record))

    async def feed(self, newest: Callable[[], Snapshot]) -> None:
        """Send what is new, for ever: the newest snapshot, and behind it the answers that belong to it."""
        encode = self._codec.encode
        with suppress(EOFError, ConnectionError):  # who receives from it learns that, too
            while True:
                await self.wake.wait()
                self.wake.clear()
                answers, self._answers, self._letters = self._answers, deque(), 0
                snapshot = newest()
                if snapshot is not self._seen:
                    self._seen = snapshot
                    await self._send_changes(snapshot)
                    await self.send(self._broadcast.snapshot(self._codec, snapshot))
                for one in answers:
                    await self.send(encode(one))

    async def _send_changes(self, snapshot: Snapshot) -> None:
        events = new_events(snapshot.events, self._told)
        if events:
            self._told = events[-1]
            await self.send(self._codec.encode(Logged(events)))
        progress, told = snapshot.program, self._running
        if progress is not None and (told is None or not _same(told, progress.running, progress.coming)):
            self._running = Running(progress.running, progress.coming)
            await self.send(self._broadcast.programs(self._codec, self._running))


def _same(told: Running, running: Program, coming: Program) -> bool:
    return told.running is running and told.coming is coming
