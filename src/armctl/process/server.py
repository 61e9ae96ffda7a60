"""The arm process: one arm, served to clients on a local socket and on websockets that are handed over."""

from __future__ import annotations

import asyncio
import gc
import hmac
import itertools
import logging
import os
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path

import msgspec

from armctl.errors import ArmctlError, InputError, StateError
from armctl.hardware.boards import board_type
from armctl.process.connections import Connection, Hands, attend_stream
from armctl.process.host import Host
from armctl.process.records import (
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
    in_short,
    light,
    new_events,
    robot_record,
)
from armctl.process.registry import Note, likeness, remove, write_note
from armctl.robot import Robot
from armctl.runtime import ArmLink, Arrive, Command, Event, Leave, Origin, Snapshot, Ticket
from armctl.runtime.black_box import packed
from armctl.runtime.commands import MovingCommand
from armctl.runtime.snapshot import printable, stands_as_before
from armctl.system import on_end
from armctl.version import __version__

_LOGGER = logging.getLogger("armctl.process")
_WATCH_S = 0.1
_OWNER_S = 60.0
"""how long who started it may take to come"""
_HOLD_S = 600.0
"""how long the arm is held for somebody to take it over, where it would drop"""
_MOST_OPEN = 256
"""commands of one client that wait for their end"""
_MOST_UNREAD = 4096
"""answers that a client does not read; then it is shut out"""
_MOST_CLIENTS = 64
_MOST_A_SECOND = 1000
"""records of one client; more are a flood"""
_BIG = 4 * 1024
"""A record of more bytes is decoded beside the others: 64 KiB of curves take 0.1 s, STOP came so late."""
_MOST_WAITING = 16 * 1024 * 1024
"""bytes of one client that wait for that"""
_HELLO_S = 10.0
"""how long a connection may take to say hello"""
_GONE_S = 30.0
"""A client that gives no sign of life for so long is shut out: there is room for a number of them only."""
_AT_REST_S, _SETTLED_S = 0.2, 1.0
"""how often clients are told of an arm that stands as before, so long after it moved; else every tick"""


class Server:
    """Serves one arm to its clients; everything but ``tell`` happens on one event loop."""

    def __init__(self, secret: str, silence_s: float = SILENCE_S) -> None:
        self.arm: ArmLink
        self.silence_s = silence_s
        self.stops = 0
        """how often STOP was pressed"""
        self.mover: Client | None = None
        """whose command moves the arm"""
        self.ended = asyncio.Event()
        self._secret = secret
        self._clients: set[Client] = set()
        self._ids = itertools.count(1)
        self._loop = asyncio.get_running_loop()
        self._told: Snapshot | None = None
        self._moved_at = 0.0
        self._encoded: dict[bool, tuple[Snapshot, bytes]] = {}
        self._note: tuple[Path, Note] | None = None
        self._held_until: float | None = None
        """nobody owns the arm, and it is held until then"""
        self._wanted_until: float | None = self._loop.time() + _OWNER_S
        """nobody has owned it yet, and will not after that"""

    def tell(self, snapshot: Snapshot) -> None:
        """There is a new snapshot, at rest told less often; called by the controller's thread."""
        told, now = self._told, snapshot.stamp
        if snapshot.busy:
            self._moved_at = now
        if (
            told is not None
            and now - self._moved_at > _SETTLED_S
            and now - told.stamp < _AT_REST_S
            and stands_as_before(snapshot, told)
        ):
            return
        self._told = snapshot
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._wake_clients)

    def note(self, address: Path, note: Note) -> None:
        """Keep a note beside the socket, for other arm processes and for who takes this one over."""
        self._note = address, note
        write_note(address, note)

    def leave_socket(self) -> None:
        """Take away the socket and its note."""
        if self._note is not None:
            remove(self._note[0])
            self._note = None

    def _keep_note(self) -> None:
        if self._note is None:
            return
        address, note = self._note
        board = self.arm.snapshot.board
        port = "" if board is None or board.simulated else board.port
        orphaned = self._held_until is not None
        if (port, orphaned) != (note.port, note.orphaned):
            self.note(address, msgspec.structs.replace(note, port=port, orphaned=orphaned))

    def _wake_clients(self) -> None:
        self._keep_note()
        for client in self._clients:
            client.wake.set()

    def encoded(self, codec: Codec, snapshot: Snapshot) -> bytes:
        """A snapshot as bytes, once for all clients that speak alike."""
        known = self._encoded.get(codec.json)
        if known is None or known[0] is not snapshot:
            known = self._encoded[codec.json] = (snapshot, codec.encode(Seen(light(snapshot))))
        return known[1]

    async def attend(self, line: Connection, let_in: bool) -> None:
        """Serve one client until its connection ends.

        ``let_in``: it has shown its token at the door; else it has to know the secret of this process.
        """
        client: Client | None = None
        codec = Codec()
        try:
            async with asyncio.timeout(_HELLO_S):
                data, trust = await line.receive(), None
                if not let_in:
                    trust = self._trusted(codec.from_client(data))
                    data = await line.receive()
                codec = Codec.of(data)
                hello = codec.from_client(data)
            if not isinstance(hello, Hello):
                raise InputError("the first record must be a hello")
            if len(self._clients) >= _MOST_CLIENTS:
                raise StateError(f"{_MOST_CLIENTS} clients are connected already; close one")
            owns = trust is not None and not trust.relays
            if trust is not None and trust.adopts:
                self._adopt(hello)
            if owns:
                self._wanted_until = None
            client = Client(self, codec, line, hello, next(self._ids), owns=owns)
            robot = robot_record(self.arm.robot)
            self._clients.add(client)
            await line.send(codec.encode(Welcome(__version__, client.id, robot, self.silence_s)))
            client.begin()
            while True:
                client.take(await line.receive())
        except (EOFError, ConnectionError):
            pass
        except TimeoutError:
            line.abort()
        except ArmctlError as refusal:
            _LOGGER.warning("%s: %s", "a client" if client is None else client.name, refusal)
            with suppress(EOFError, ConnectionError):
                await line.send(codec.encode(Refused(in_short(refusal))))
        finally:
            if client in self._clients:
                self._clients.remove(client)
                client.leave()
                if client.owns and not any(one.owns for one in self._clients):
                    self._orphan(client.name)

    def _orphan(self, owner: str) -> None:
        """Nobody owns the arm any more: end, or hold it where it would drop."""
        if self.ended.is_set():
            return
        arm, snapshot = self.arm, self.arm.snapshot
        board, kind = snapshot.board, board_type(self.arm.robot.board)
        gone = f"{owner} is gone without a word"
        if board is None or board.simulated or not (kind.off_when_left and snapshot.powered):
            does = "" if board is None or board.simulated else f"; the {kind.power} stay as they are"
            _LOGGER.warning("%s: the arm is brought to rest, and its process ends%s", gone, does)
            self.ended.set()
            return
        self._held_until = self._loop.time() + _HOLD_S
        arm.stop(Origin("arm process", f"{gone}; the arm is held for {_HOLD_S / 60:.0f} min, then it drops"))
        for party in snapshot.control.parties:
            arm.submit(Leave(gone), Origin(party.id))
        for client in self._clients:
            client.line.abort()
        self._keep_note()

    def _adopt(self, hello: Hello) -> None:
        if self._held_until is None:
            raise StateError("who started this arm is there; only an arm that was left can be taken over")
        self._held_until = None
        self._keep_note()
        _LOGGER.warning("%s has taken the arm over", hello.name)

    def _trusted(self, trust: FromClient) -> Trust:
        """What somebody says first on the local socket, who must know the secret."""
        if not (
            isinstance(trust, Trust) and hmac.compare_digest(trust.secret.encode(), self._secret.encode())
        ):
            raise InputError("who connects here must know the secret of this arm process")
        return trust

    def end(self, signal_name: str) -> None:
        """A signal asks for the end."""
        _LOGGER.warning("%s: the arm is brought to rest, and its process ends", signal_name)
        self.ended.set()

    async def watch(self) -> None:
        """Stop what a client moves that has become silent, and shut out who is silent for long."""
        while True:
            await asyncio.sleep(min(_WATCH_S, self.silence_s / 4))
            now = self._loop.time()
            mover = self.mover
            if mover is not None and now - mover.heard_at > self.silence_s:
                mover.stop(f"no sign of life for {self.silence_s:g} s")
            if self._wanted_until is not None and now > self._wanted_until:
                self._orphan("who started it")
                self._wanted_until = None
            if self._held_until is not None and (now > self._held_until or not self.arm.snapshot.powered):
                _LOGGER.warning("nobody has taken the arm over: its process ends, and the arm drops")
                self.ended.set()
            for client in self._clients:
                if not client.owns and now - client.heard_at > _GONE_S:
                    client.line.abort()


class Client:
    """One connection."""

    def __init__(
        self, server: Server, codec: Codec, line: Connection, hello: Hello, number: int, *, owns: bool
    ) -> None:
        self.name = " ".join(printable(hello.name).split())[:40] or "program"
        self.id, self.owns, self.line = f"{self.name}, program {number}", owns, line
        self.wake = asyncio.Event()
        """there is something to send"""
        self._server, self._codec, self._hello = server, codec, hello
        self._loop = asyncio.get_running_loop()
        self.heard_at = self._loop.time()
        self._answers: deque[Answer | Recalled] = deque()
        self._open = self._taken = 0
        self._waiting: deque[tuple[bytes, int]] = deque()
        """records that wait for their turn to be decoded, and how often STOP was pressed before each"""
        self._recalling = self._gone = False
        self._second = 0.0
        self._told: Event | None = None
        self._running: Running | None = None
        self._seen: Snapshot | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        line.alive = self._alive

    def begin(self) -> None:
        """It is let in: say so to the arm, and send it what happens."""
        if not self.owns:  # who owns the arm speaks for its pages
            self._server.arm.submit(Arrive(self.name, self._hello.watch), Origin(self.id))
        self._begin(self._feed())
        self.wake.set()

    def leave(self) -> None:
        """Its connection is gone: what moves at its command is stopped."""
        self._gone = True
        for task in self._tasks:
            task.cancel()
        if not self.owns:
            self._server.arm.submit(Leave("its connection is gone"), Origin(self.id))
        if self._server.mover is self:
            self.stop("its connection is gone")

    def stop(self, why: str) -> None:
        """Stop what moves at its command."""
        self._server.mover = None
        if self._server.arm.snapshot.busy:
            self._server.arm.stop(Origin(self.name, why))

    def _alive(self, frames: int) -> None:
        """A sign of life that its line gives by itself."""
        self._count(frames)
        if not self._hello.beats:
            self.heard_at = self._loop.time()

    def _count(self, frames: int) -> None:
        now = self._loop.time()
        if now - self._second > 1.0:
            self._second, self._taken = now, 0
        self._taken += frames
        if self._taken > _MOST_A_SECOND:
            raise InputError(f"more than {_MOST_A_SECOND} records in a second; send less")

    def take(self, data: bytes) -> None:
        """Carry out one record, or let it wait behind a big one; STOP never waits."""
        self._count(1)
        self.heard_at = self._loop.time()
        if len(data) <= _BIG:
            record = self._codec.from_client(data)
            if not self._waiting or isinstance(record, Stop | Beat):
                self._carry_out(record, self._command(record))
                return
        self._waiting.append((data, self._server.stops))
        if sum(len(one) for one, _ in self._waiting) > _MOST_WAITING:
            raise InputError(f"more than {_MOST_WAITING} bytes wait to be read; send less")
        if len(self._waiting) == 1:
            self._begin(self._take_waiting())

    async def _take_waiting(self) -> None:
        """Decode big records beside the event loop, one after the other."""

        def decoded(data: bytes) -> tuple[FromClient, Command | ArmctlError | None]:
            record = self._codec.from_client(data)
            return record, self._command(record)

        try:
            while self._waiting:
                data, stops = self._waiting[0]
                record, command = await asyncio.to_thread(decoded, data)
                if isinstance(command, MovingCommand) and stops != self._server.stops:
                    command = StateError("stopped before it began")
                self._carry_out(record, command)
                self._waiting.popleft()
        except ArmctlError as refusal:
            _LOGGER.warning("%s: %s", self.name, refusal)
            await self.line.send(self._codec.encode(Refused(in_short(refusal))))
            self.line.abort()

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
                self._server.stops += 1
                self._follow(number, arm.stop(self._origin(who, note)))
            case End():
                if not self.owns:
                    raise InputError("only who started the arm may end it")
                self._server.ended.set()
            case Recall(number):
                if self._recalling:
                    self._put(answer(number, StateError("the last minute is on its way already")))
                else:
                    self._recalling = True
                    self._begin(self._recall(number))
            case Beat():
                pass
            case Trust() | Hello():
                raise InputError("a hello comes once, at the beginning")

    def _began(self, accepted: Future[None]) -> None:
        if accepted.exception() is None:
            self._loop.call_soon_threadsafe(self._moves)

    def _moves(self) -> None:
        self._server.mover = self
        if self._gone:
            self.stop("its connection is gone")

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
        except ArmctlError as cause:
            self._put(answer(number, cause))
        else:
            self._put(Recalled(number, content))
        finally:
            self._recalling = False

    def _put(self, record: Answer | Recalled) -> None:
        self._answers.append(record)
        self.wake.set()
        if len(self._answers) > _MOST_UNREAD:
            self.line.abort()

    def _begin(self, work: Awaitable[None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._task_ended)

    def _task_ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        defect = None if task.cancelled() else task.exception()
        if defect is not None:  # else its client would wait for answers for ever
            _LOGGER.error("%s: serving it failed", self.name, exc_info=defect)
            self.line.abort()

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
                        await self.line.send(encode(record))
                    await self.line.send(self._server.encoded(self._codec, snapshot))
                for one in answers:
                    await self.line.send(encode(one))

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


# Garbage: what lives from the start is never looked at. What is young is looked at often, a little at a time:
# 200,000 objects take 40 to 130 ms, some ticks, 3,000 take 0.1. What lives on is looked at once a minute, and
# what has lived for long while the arm stands.

_LOOK_EVERY_S, _OLD_EVERY_S = 0.1, 60.0
_MOST_YOUNG = 3_000


async def collect_at_rest(arm: ArmLink) -> None:
    """Collect garbage in place of Python's own collector: while the arm moves, only what is young."""
    gc.collect()
    gc.freeze()
    gc.disable()
    now = asyncio.get_running_loop().time
    looked_at = now()
    try:
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            if gc.get_count()[0] > _MOST_YOUNG:
                gc.collect(0)
            if now() - looked_at > _OLD_EVERY_S:
                gc.collect(1 if arm.snapshot.busy else 2)
                looked_at = now()
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
    silence_s: float = SILENCE_S,
) -> None:
    """Serve an arm until a client ends it, the last one that owns it has gone, or a signal comes.

    Where the arm would drop then, it is held for ten minutes after its last owner has gone without a word.

    ``address`` is the path of a Unix socket; None: a port of the loopback address. ``ready`` is called with
    the address.
    """
    server = Server(secret, silence_s)
    loop = asyncio.get_running_loop()
    on_end(loop, server.end)
    arm = server.arm = Host(robot, board, rate_hz, server.tell, pin)
    connections: set[asyncio.Task[None]] = set()

    def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = loop.create_task(attend_stream(server.attend, reader, writer))
        connections.add(task)
        task.add_done_callback(connections.discard)

    chores: list[asyncio.Task[None]] = []
    hands: Hands | None = None
    try:
        if address is None:
            listener = await asyncio.start_server(connected, "127.0.0.1", 0)
        else:
            before = os.umask(0o177)
            try:
                listener = await asyncio.start_unix_server(connected, address)
                hands = Hands(server.attend, address, secret)
            finally:
                os.umask(before)
            like = likeness(robot, board, rate_hz, pin)
            server.note(address, Note(os.getpid(), robot.title, like, secret))
        chores += loop.create_task(server.watch()), loop.create_task(collect_at_rest(arm))
        ready(str(listener.sockets[0].getsockname()[1] if address is None else address))
        await server.ended.wait()
        listener.close()
    finally:
        await asyncio.to_thread(arm.close)
        server.leave_socket()
        if address is not None:
            remove(address)  # also where it was not noted yet
        # last: whose connection ends, knows that all of this is over
        for task in (*chores, *connections):
            task.cancel()
        if hands is not None:
            hands.close()
