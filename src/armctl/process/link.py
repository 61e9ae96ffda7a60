"""A client of an arm process: the same face as the controller's, over a local socket."""

from __future__ import annotations

import asyncio
import itertools
import math
import socket
import subprocess
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Protocol
from urllib.parse import parse_qs, urlsplit

import numpy as np
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import connect

from armctl.errors import ArmctlError, ArmProcessError, BoardError, InputError, StateError
from armctl.facts import State
from armctl.hardware.boards import board_type
from armctl.process.records import (
    BEAT_S,
    MOST_BYTES,
    SILENCE_S,
    Answer,
    Ask,
    Beat,
    Codec,
    End,
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
    error_of,
    whole,
)
from armctl.protocol import Command, Event, MonotonicClock, MovingCommand, Origin, Recording, Snapshot, Ticket
from armctl.protocol.clock import AFTER_GAP_S
from armctl.protocol.commands import Answer as TicketAnswer
from armctl.protocol.commands import give
from armctl.protocol.recording import unpacked
from armctl.robot import Robot
from armctl.robot.record import robot_of
from armctl.system import kill

_BEAT = Codec().encode(Beat())
_LOG_LINES = 200
_STOPPED = "stopped before it began"
_RECALL_S = 10.0
_CONNECT_S = 10.0
_PING_S, _GONE_S, _GOODBYE_S = 5.0, 30.0, 2.0
"""A network that is pulled out says nothing: a console that leaves a ping unanswered for so long is gone."""
_ENDED_S = 0.2
_CLOSE_S = 15.0
"""how long an arm process may take to bring the arm to rest and end"""


class ProcessLine(Protocol):
    """Carries records to an arm process and back. One thread sends, another receives.

    ``OSError``: it is broken; after ``close``, also for a thread that waits in ``receive``.
    """

    def send(self, data: bytes) -> None:
        """Send a record."""
        ...

    def receive(self) -> bytes:
        """The next record."""
        ...

    def close(self) -> None:
        """End it, from any thread. May be called more than once."""
        ...


class LocalLine:
    """The local socket of an arm process; each record has its length in front."""

    def __init__(self, address: Path | tuple[str, int], secret: str, *, adopts: bool = False) -> None:
        """Connect; ``adopts``: to an arm process that nobody owns. ``BoardError``: nobody answers there."""
        self.address, self.secret = address, secret
        self._socket = _connected(address)
        try:
            self.send(Codec().encode(Trust(secret, adopts=adopts)))
        except OSError as cause:
            raise ArmProcessError(f"no arm process answers at {address}: {cause.strerror}") from cause

    def send(self, data: bytes) -> None:
        """Send a record."""
        self._socket.sendall(len(data).to_bytes(4) + data)

    def receive(self) -> bytes:
        """The next record."""
        size = int.from_bytes(self._exactly(4))
        if size > MOST_BYTES:
            raise ConnectionError(f"a record of {size} bytes")
        return self._exactly(size)

    def close(self) -> None:
        """End it."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes who waits in receive
        self._socket.close()

    def _exactly(self, count: int) -> bytes:
        data = bytearray()
        while len(data) < count:
            part = self._socket.recv(count - len(data))
            if not part:
                raise ConnectionError("the connection was closed")
            data += part
        return bytes(data)


class RemoteLine:
    """The WebSocket of a console, ``http://host:8080`` or ``https://…``."""

    def __init__(self, url: str, token: str | None) -> None:
        """Connect. ``BoardError``: nobody answers, or the token is not the one that it wants."""
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InputError(f"{url!r} is no address of a console; it looks like http://192.168.1.20:8080")
        given = parse_qs(parts.query).get("token", [""])[0]
        headers = {"Authorization": f"Bearer {token or given}"} if token or given else {}
        address = f"{'wss' if parts.scheme == 'https' else 'ws'}://{parts.netloc}/api"
        try:
            self._socket = connect(
                address, additional_headers=headers, max_size=MOST_BYTES, compression=None,
                open_timeout=_CONNECT_S, ping_interval=_PING_S, ping_timeout=_GONE_S,
                close_timeout=_GOODBYE_S, proxy=None,
            )  # fmt: skip
        except InvalidStatus as cause:
            text = (cause.response.body or b"").decode(errors="replace").strip().splitlines()
            why = " ".join(text) or f"status {cause.response.status_code}"
            raise BoardError(f"{parts.netloc}: {why}") from cause
        except (OSError, WebSocketException) as cause:
            raise BoardError(f"no console answers at {parts.netloc}: {cause}") from cause

    def send(self, data: bytes) -> None:
        """Send a record."""
        try:
            self._socket.send(data)
        except WebSocketException as cause:
            raise ConnectionError(str(cause)) from cause

    def receive(self) -> bytes:
        """The next record."""
        try:
            data = self._socket.recv()
        except (EOFError, WebSocketException) as cause:
            raise ConnectionError(str(cause)) from cause
        return data if isinstance(data, bytes) else data.encode()

    def close(self) -> None:
        """End it."""
        self._socket.close()


class Link:
    """Drives an arm that another process runs. Any thread may use it."""

    def __init__(
        self,
        line: ProcessLine,
        name: str = "library",
        robot: Robot | None = None,
        process: subprocess.Popen[bytes] | int | None = None,
        *,
        beats: bool = True,
        watch: bool = False,
    ) -> None:
        """Say hello on a line. ``robot``: the arm, where it is known.

        ``process`` was started for this link, or taken over (its number), and ends with it. Without
        ``beats``, the caller calls ``beat``. ``watch``: not to operate the arm. ``BoardError``: it does not
        answer, or refuses.
        """
        self._line, self._process, self._beats = line, process, beats
        self._codec = Codec()
        self._now = MonotonicClock.now
        self._lock = threading.Condition()
        self._out: deque[tuple[int, bytes]] = deque()
        """what waits to be sent, with the number of the motion that it asks for, or 0"""
        self._tickets: dict[int, tuple[Ticket, list[TicketAnswer]]] = {}
        self._recalls: dict[int, Future[bytes]] = {}
        self._answering = threading.RLock()
        """held while tickets are answered: the reader does, and whoever ends the link"""
        self._stops = 0
        """how often STOP was asked for"""
        self._beat_at = self._woke_at = -math.inf
        self._alive_at, self._still_s = math.inf, 0.0
        """when who calls ``beat`` was seen last, and how long it stood still before ``_woke_at``"""
        self._numbers = itertools.count(1)
        self._events: tuple[Event, ...] = ()
        self._running: Running | None = None
        self._lost: str | None = None
        self._closing = False
        try:
            line.send(self._codec.encode(Hello(name, watch, beats=True)))
            welcome = self._codec.from_arm(line.receive())
            if not isinstance(welcome, Welcome):
                raise ArmProcessError(f"the arm process refused: {getattr(welcome, 'error', welcome)}")
            self.id = welcome.you
            self.robot = robot_of(welcome.robot) if robot is None else robot
            first: Snapshot | None = None
            while first is None:
                first = self._take(self._codec.from_arm(line.receive()))
        except OSError as cause:
            line.close()
            raise ArmProcessError(f"the arm process does not answer: {cause}") from cause
        except ArmctlError:
            line.close()
            raise
        self._snapshot = first
        self._board = first.board
        """the last one that was connected"""
        self._heard_at = self._now()
        self._reader = threading.Thread(target=self._read, name="armctl-link", daemon=True)
        self._reader.start()
        threading.Thread(target=self._write, name="armctl-link-out", daemon=True).start()

    @property
    def snapshot(self) -> Snapshot:
        """The newest that is known; a fault where the arm process is gone, or is silent for a second."""
        lost, powered = self._lost, False
        if lost is None:
            powered = self._snapshot.powered
            silent = self._now() - self._heard_at
            if silent <= SILENCE_S:
                return self._snapshot
            lost = (
                f"the arm process has not answered for {silent:.0f} s: it may be frozen, and STOP does not "
                "reach the arm; use the switch in its supply"
            )
        unknown = np.full(self.robot.n, np.nan)
        still = np.zeros(self.robot.n)
        return replace(
            self._snapshot, state=State.FAULT, cause=lost, unreachable=True, powered=powered,
            q=unknown, commanded=False, program=None,
            velocity_command=still, acceleration_command=still, homing=(), warnings=(),
            measured={}, quantities={}, inputs={}, outputs={}, limp=(),
        )  # fmt: skip

    @property
    def ended(self) -> bool:
        """Whether the arm process is gone for good."""
        return self._lost is not None

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        """Ask for something; what cannot be sent is refused by the ticket."""
        return self._ask(lambda number, by: Ask(number, command, by.who, by.note, by.source), origin)

    def stop(self, origin: Origin | None = None) -> Ticket:
        """STOP: drops what was asked for before it; the ticket is ``finished`` when the arm is at rest."""
        return self._ask(lambda number, by: Stop(number, by.who, by.note), origin)

    def black_box(self) -> Recording:
        """The last minute of the arm; ``BoardError``: the arm process does not give it."""
        with self._lock:
            if self._lost is not None or self._closing:
                raise ArmProcessError(self._lost or "the arm is being closed")
            if not self._recalls:  # else what another thread has asked for
                number = next(self._numbers)
                self._recalls[number] = Future()
                self._put(self._codec.encode(Recall(number)))
            (recalled,) = self._recalls.values()
        try:
            return unpacked(recalled.result(_RECALL_S))
        except TimeoutError:
            raise ArmProcessError(f"the arm process gives no black box within {_RECALL_S:g} s") from None

    def beat(self) -> None:
        """Give a sign of life; more often than ``SILENCE_S`` while the arm moves. One too many is no harm."""
        with self._lock:
            now = self._now()
            self._caller_lives(now)
            if now - self._beat_at >= BEAT_S and not self._out and self._lost is None:
                self._beat_at = now
                self._put(_BEAT)

    def hand_over(self, line: socket.socket, request: bytes) -> bool:
        """Give the arm process a connection, with the request that came on it; whether it takes any.

        ``OSError``: it cannot be taken now.
        """
        local = self._line
        if not (isinstance(local, LocalLine) and isinstance(local.address, Path)):
            return False
        hand_over(local.address, local.secret, line, request)
        return True

    async def relay(self, source: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Another connection to the same arm process, for somebody else's records, see ``source_of``."""
        local = self._line
        if not isinstance(local, LocalLine):
            raise StateError("the arm is far away itself; connect to its own console")
        if isinstance(local.address, Path):
            reader, writer = await asyncio.open_unix_connection(local.address)
        else:
            reader, writer = await asyncio.open_connection(*local.address)
        data = self._codec.encode(Trust(local.secret, relays=True, source=source))
        writer.write(len(data).to_bytes(4) + data)
        return reader, writer

    def close(self) -> None:
        """Leave; an arm process that was started for this link brings the arm to rest and ends."""
        with self._lock:
            if not self._closing and self._lost is None:
                self._closing = True
                if self._process is not None:
                    self._put(self._codec.encode(End()))
        match self._process:
            case None:
                pass
            case int(number):
                self._reader.join(_CLOSE_S)  # its line ends when it does
                if self._reader.is_alive():
                    kill(number)
            case process:
                try:
                    process.wait(_CLOSE_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        self._end("closed")

    def _ask(self, record: Callable[[int, Origin], Record], origin: Origin | None) -> Ticket:
        origin = Origin() if origin is None else origin
        number = next(self._numbers)
        asked, stops = record(number, origin), self._stops
        try:
            data = self._codec.encode(asked)  # without the lock: STOP does not wait for a big program
        except ArmctlError as refusal:  # a trajectory that cannot be carried
            return Ticket.ended(refusal)
        if len(data) > MOST_BYTES:
            text = f"a command of {len(data)} bytes is too large; {MOST_BYTES} at most"
            return Ticket.ended(InputError(text))
        with self._lock:
            if self._lost is not None or self._closing:
                return Ticket.ended(StateError(self._lost or "the arm is being closed"))
            moves = isinstance(asked, Ask) and isinstance(asked.command, MovingCommand)
            if moves and stops != self._stops:
                return Ticket.ended(StateError(_STOPPED))
            if moves and self._just_woke():
                words = f"this console stood still for {self._still_s:.1f} s before it could send that"
                return Ticket.ended(StateError(f"{words}; ask for it again"))
            answers: list[TicketAnswer] = []
            ticket = Ticket(answers)
            self._tickets[number] = ticket, answers
            dropped = self._stop_waiting() if isinstance(asked, Stop) else []
            self._put(data, number if moves else 0)
        for one in dropped:
            self._answer(one, answer(one, StateError(_STOPPED)))
        return ticket

    def _caller_lives(self, now: float) -> None:
        if now - self._alive_at > SILENCE_S:
            self._woke_at, self._still_s = now, now - self._alive_at
        self._alive_at = now

    def _just_woke(self) -> bool:
        """Whether what is asked for now may have waited while the caller of ``beat`` stood still."""
        now = self._now()
        if not self._beats and self._alive_at < math.inf:
            self._caller_lives(now)
        return now - self._woke_at < AFTER_GAP_S

    def _stop_waiting(self) -> list[int]:
        """Take back the motions that are not sent yet: STOP waits for none; the lock is held."""
        self._stops += 1
        dropped = [number for number, _ in self._out if number]
        self._out = deque(waiting for waiting in self._out if not waiting[0])
        return dropped

    def _put(self, data: bytes, motion: int = 0) -> None:
        """Queue a record; the lock is held."""
        self._out.append((motion, data))
        self._lock.notify()

    def _read(self) -> None:
        try:
            while True:
                snapshot = self._take(self._codec.from_arm(self._line.receive()))
                if snapshot is not None:
                    self._snapshot = snapshot
                    self._board = snapshot.board or self._board
                self._heard_at = self._now()
        except (OSError, ArmctlError) as cause:
            self._end(self._epitaph(cause))

    def _write(self) -> None:
        while True:
            with self._lock:
                while not self._out:
                    if self._lost is not None:
                        return
                    if not self._lock.wait(BEAT_S) and self._beats and not self._out:
                        self._put(_BEAT)
                _, data = self._out.popleft()
            try:
                self._line.send(data)
            except OSError as cause:
                self._end(self._epitaph(cause))
                return

    def _take(self, record: Record) -> Snapshot | None:
        """Take what the arm process says; gives a new snapshot."""
        match record:
            case Seen(snapshot):
                return whole(snapshot, self._events, self._running)
            case Logged(events):
                self._events = (*self._events, *events)[-_LOG_LINES:]
            case Running():
                self._running = record
            case Answer(number):
                self._answer(number, record)
            case Recalled(number, content):
                with self._lock:
                    recalled = self._recalls.pop(number, None)
                if recalled is not None:
                    recalled.set_result(content)
            case Refused(error):
                raise ArmProcessError(f"the arm process refused: {error}")
            case _:
                pass
        return None

    def _answer(self, number: int, record: Answer) -> None:
        with self._lock:
            waiting = self._tickets.get(number)
            recalled = self._recalls.pop(number, None)
            if record.finished:
                self._tickets.pop(number, None)
        if recalled is not None:
            recalled.set_exception(ArmProcessError(record.error))
        if waiting is None:
            return
        ticket, answers = waiting
        with self._answering:
            if record.finished:
                ticket.end(error_of(record))
            else:
                ticket.accept()
            give(answers)

    def _end(self, why: str) -> None:
        """The connection is over: say so in every ticket that waits."""
        with self._lock:
            if self._lost is not None:
                return
            self._lost = why
            waiting, self._tickets = list(self._tickets.values()), {}
            recalls, self._recalls = list(self._recalls.values()), {}
            self._out.clear()
            self._lock.notify_all()
        for recalled in recalls:
            recalled.set_exception(ArmProcessError(why))
        with self._answering:
            for ticket, answers in waiting:
                ticket.end(StateError(why))
                give(answers)
        self._line.close()  # last: a network that is gone may keep it waiting

    def _epitaph(self, cause: Exception) -> str:
        """What has become of the arm process, and what its board does now."""
        if self._closing:
            return "closed"
        board = board_type(self.robot.board)
        if isinstance(cause, BoardError):
            what = str(cause)
        else:
            code = None
            if isinstance(self._process, subprocess.Popen):
                with suppress(subprocess.TimeoutExpired):  # its line ends a moment before it
                    code = self._process.wait(_ENDED_S)
            how = "" if not code else f" (killed by signal {-code})" if code < 0 else f" (exit status {code})"
            what = f"the arm process ended{how}"
        seen = self._board
        if seen is None:
            does = "no board was connected"
        elif seen.simulated:
            does = "the simulated board is gone with it"
        elif board.off_when_left:
            does = f"its board switches the {board.power} off by itself"
        else:
            does = f"the {board.power} stay as they were, unless the board has a timeout of its own"
        return f"{what}, and STOP does not reach the arm; {does}. Connect again"


def _connected(address: Path | tuple[str, int]) -> socket.socket:
    try:
        if isinstance(address, tuple):
            return socket.create_connection(address, _CONNECT_S)
        line = socket.socket(socket.AF_UNIX)
        line.connect(str(address))
    except OSError as cause:
        raise ArmProcessError(f"no arm process answers at {address}: {cause.strerror or cause}") from cause
    return line


# A connection that one process hands to another: its file descriptor, over a socket beside the local one.


def hands_of(address: Path) -> Path:
    """The socket that takes connections for the arm process at ``address``."""
    return address.with_suffix(".hand")


def hand_over(address: Path, secret: str, line: socket.socket, request: bytes) -> None:
    """Give a connection to the arm process at ``address``, with the request that came on it.

    Raises ``OSError`` where it cannot be taken.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as hands:
        hands.setblocking(False)
        hands.connect(str(hands_of(address)))
        socket.send_fds(hands, [secret.encode() + b"\n" + request], [line.fileno()])
