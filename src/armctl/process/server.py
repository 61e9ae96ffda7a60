"""The arm process: one arm, served to clients on a local socket and on websockets that are handed over.

Who asks is known before what is asked is decoded: a command of who may not command is refused by its tag.
"""

from __future__ import annotations

import asyncio
import hmac
import itertools
import logging
import os
from collections.abc import Callable, Coroutine, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec

from armctl.errors import ArmctlError, InputError, StateError
from armctl.hardware.boards import board_type
from armctl.process.client import Client, command_of
from armctl.process.connections import Broadcast, ConnectionHandover, RecordConnection, attend_stream
from armctl.process.host import Host, collect_at_rest
from armctl.process.limits import Arrivals, Traffic, who_gives_way
from armctl.process.records import SILENCE_S, Ask, Codec, FromClient, Hello, Refused, Trust, Welcome, in_short
from armctl.process.registry import Note, likeness, remove, write_note
from armctl.protocol import ArmLink, Command, Leave, Origin, Snapshot, stands_as_before
from armctl.protocol.recording import packed
from armctl.robot import Robot
from armctl.robot.record import robot_record
from armctl.system import on_end
from armctl.version import __version__

_LOGGER = logging.getLogger("armctl.process")
_WATCH_S = 0.1
_OWNER_S = 60.0
"""how long who started it may take to come"""
_HOLD_S = 600.0
"""how long the arm is held for somebody to take it over, where it would drop"""
_MOST_CLIENTS = 64
_MOST_UNNAMED = 64
"""connections that have not said hello yet"""
_MOST_A_SECOND = 1000
"""records of one client; more are a flood"""
_HELLO_S = 10.0
"""how long a connection may take to say hello"""
_GONE_S = 30.0
"""A client that gives no sign of life for so long is shut out: there is room for a number of them only."""
_CLOSING_S = 12.0
"""how long bringing the arm to rest and closing its line may take; a client waits for 15 s"""
_AT_REST_S, _SETTLED_S, _SEEN_S = 0.2, 1.0, 0.012
"""how often clients are told of an arm that stands as before, so long after it moved; and of one that moves,
where that alone is new: every tick of the usual 50 a second, and no more often than the board is read"""


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
        self.broadcast = Broadcast()
        self.waiting = 0
        """bytes of clients that are no owners, which wait to be decoded"""
        self._large: Client | None = None
        """the only one of them of whom a large record is in memory"""
        self._unnamed: dict[RecordConnection, str] = {}
        """connections that have not said hello, and where they come from; the oldest first"""
        self._arrivals = Arrivals(self._loop.time)
        self._traffic = Traffic(self._loop.time)
        self._decoder = ThreadPoolExecutor(1, thread_name_prefix="armctl-decoder")
        self._decodes = asyncio.Lock()
        self._packing: asyncio.Task[bytes] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._robot: dict[bool, bytes] = {}
        """the arm as a record, as msgpack and as JSON"""
        self._told: Snapshot | None = None
        self._moved_at = 0.0
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
        if told is not None:
            moves_on = snapshot.busy and snapshot.state is told.state and snapshot.events is told.events
            stands = now - self._moved_at > _SETTLED_S and stands_as_before(snapshot, told)
            if now - told.stamp < (_SEEN_S if moves_on else _AT_REST_S if stands else 0.0):
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
            client.outbox.wake.set()

    async def attend(self, line: RecordConnection, let_in: bool, source: str = "") -> None:
        """Serve one client until its connection ends.

        ``let_in``: it has shown its token at the door; else it has to know the secret of this process.
        ``source``: which computer it comes from, see ``source_of``.
        """
        client: Client | None = None
        codec = Codec.of(b"", house=True)
        self._await_hello(line, source)
        try:
            async with asyncio.timeout(_HELLO_S):
                data, trust = await line.receive(), None
                if not let_in:
                    trust = self._trusted(codec.from_client(data))
                    source = trust.source or source
                    data = await line.receive()
                owns = trust is not None and not trust.relays
                codec = Codec.of(data, house=owns)
                if not owns and not self._arrivals.take(source):
                    raise StateError("too many connections from this computer in a short time; wait a moment")
                hello = codec.from_client(data)
            if not isinstance(hello, Hello):
                raise InputError("the first record must be a hello")
            client = Client(self, codec, line, hello, next(self._ids), owns=owns, source=source)
            self.count(client, 1, len(data))
            if not owns:
                self._make_room(client)
            if trust is not None and trust.adopts:
                self._adopt(hello)
            if owns:
                self._wanted_until = None
            self._unnamed.pop(line, None)
            self._clients.add(client)
            robot = self._robot.get(codec.json)
            if robot is None:
                robot = self._robot[codec.json] = codec.encode(robot_record(self.arm.robot))
            welcome = Welcome(__version__, client.id, msgspec.Raw(robot), self.silence_s)
            await client.outbox.send(codec.encode(welcome))
            client.begin()
            while not client.ended:
                client.take(await line.receive())
            await client.said_goodbye()
        except (EOFError, ConnectionError):
            pass
        except TimeoutError:
            line.abort()
        except ArmctlError as refusal:
            _LOGGER.warning("%s: %s", "a client" if client is None else client.name, refusal)
            with suppress(EOFError, ConnectionError):
                await line.send(codec.encode(Refused(in_short(refusal))))
        finally:
            self._unnamed.pop(line, None)
            if client in self._clients:
                self._clients.remove(client)
                client.leave()
                if client.owns and not any(one.owns for one in self._clients):
                    self._orphan(client.name)

    def _await_hello(self, line: RecordConnection, source: str) -> None:
        """Somebody has connected, and says nothing yet; of many the one that has waited longest has to go."""
        if len(self._unnamed) >= _MOST_UNNAMED:
            sources = list(self._unnamed.values())
            crowd = max(sources, key=sources.count)
            longest = next(one for one, where in self._unnamed.items() if where == crowd)
            del self._unnamed[longest]
            longest.abort()
        self._unnamed[line] = source

    def _make_room(self, newcomer: Client) -> None:
        """Have somebody give its place to a newcomer, where all are taken (``StateError``: nobody does)."""
        if len(self._clients) < _MOST_CLIENTS:
            return
        guests = sorted((one for one in self._clients if not one.owns), key=lambda one: one.number)
        free = [one for one in guests if one is not self.mover and not self._operates(one)]
        leaver = who_gives_way(free, newcomer.source, newcomer.name)
        if leaver is None:
            same = sum(one.source == newcomer.source for one in guests)
            here = f", {same} of them from {newcomer.source}" if newcomer.source and same else ""
            raise StateError(f"{len(self._clients)} clients are connected already{here}; close one")
        self._clients.discard(leaver)
        leaver.leave()
        leaver.shut_out(f"all {_MOST_CLIENTS} places are taken, and others have fewer of them; close some")

    def _operates(self, client: Client) -> bool:
        return self.arm.snapshot.control.operates(client.id)

    def count(self, client: Client, records: int, size: int) -> None:
        """Count what a client sends; ``InputError``: it is too much."""
        operates = client.owns or self._operates(client)
        self._traffic.count(client.meter, records, size, _MOST_A_SECOND, operates=operates)

    def hold_large(self, client: Client) -> None:
        """A large record of a client comes in, who may command; that of another one has to go."""
        before, self._large = self._large, client
        if before is not None and before is not client:
            before.shut_out("another client operates the arm now, and sends a large record; send it again")

    def release_large(self, client: Client) -> None:
        """It is decoded, or its client is gone."""
        if self._large is client:
            self._large = None

    async def decoded(self, codec: Codec, record: Ask, *, rests: bool) -> Command | ArmctlError:
        """The command of a large record, decoded beside the event loop, one at a time.

        ``rests``: so long as that took nothing else is decoded, so that half of the time is the arm's.
        """
        async with self._decodes:
            began = self._loop.time()
            command = await self._loop.run_in_executor(self._decoder, command_of, codec, record)
            if rests:
                await asyncio.sleep(self._loop.time() - began)
        return command

    async def last_minute(self) -> bytes:
        """The last minute of the arm, packed beside the event loop, once for all who ask at the same time."""
        if self._packing is None or self._packing.done():
            self._packing = self._loop.create_task(asyncio.to_thread(lambda: packed(self.arm.black_box())))
        return await asyncio.shield(self._packing)

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
        for client in tuple(self._clients):
            client.shut_out(f"{gone}; connect again once somebody has taken the arm over")
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

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """Run something beside the connections."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def close(self) -> None:
        """Decode nothing more."""
        self._decoder.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _private_files() -> Generator[None]:
    """What is created meanwhile is this user's alone."""
    before = os.umask(0o177)
    try:
        yield
    finally:
        os.umask(before)


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
    hands: ConnectionHandover | None = None
    try:
        if address is None:
            listener = await asyncio.start_server(connected, "127.0.0.1", 0)
        else:
            with _private_files():
                listener = await asyncio.start_unix_server(connected, address)
                hands = ConnectionHandover(server.attend, address, secret)
            like = likeness(robot, board, rate_hz, pin)
            server.note(address, Note(os.getpid(), robot.title, like, secret))
        chores += loop.create_task(server.watch()), loop.create_task(collect_at_rest(arm))
        ready(str(listener.sockets[0].getsockname()[1] if address is None else address))
        await server.ended.wait()
        listener.close()
    finally:
        try:
            async with asyncio.timeout(_CLOSING_S):
                await asyncio.to_thread(arm.close)
        except TimeoutError:
            _LOGGER.error("the arm is not closed within %g s; its process ends", _CLOSING_S)
        server.leave_socket()
        if address is not None:
            remove(address)  # also where it was not noted yet
        server.close()
        # last: whose connection ends, knows that all of this is over
        for task in (*chores, *connections):
            task.cancel()
        if hands is not None:
            hands.close()
