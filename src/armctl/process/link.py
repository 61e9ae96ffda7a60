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

import numpy as np

from armctl.errors import ArmctlError, ArmProcessError, BoardError, InputError, StateError
from armctl.facts import State
from armctl.hardware.boards import board_type
from armctl.process.lines import LocalLine, ProcessLine, hand_over
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
    Locate,
    Located,
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
)
from armctl.protocol import (
    Command,
    Event,
    MonotonicClock,
    MovingCommand,
    Origin,
    ProgramProgress,
    Recording,
    Snapshot,
    Ticket,
)
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
_ENDED_S = 0.2
_BUSY_S = 0.1
"""a caller whose signs of life are further apart was busy: what it asks for then may be older than a STOP"""
_CLOSE_S = 15.0
"""how long an arm process may take to bring the arm to rest and end"""


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
        self._locating: dict[int, Future[str]] = {}
        self._answering = threading.RLock()
        """held while tickets are answered: the reader does, and whoever ends the link"""
        self._stops = 0
        """how often STOP was asked for"""
        self._beat_at = self._woke_at = self._stopped_at = -math.inf
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
            self._arm = robot_of(welcome.robot) if robot is None else robot
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
    def robot(self) -> Robot:
        """The arm, as it is calibrated, with the tool that is on."""
        return self._arm.with_tool(self._snapshot.tool)

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
        unknown = np.full(self._arm.n, np.nan)
        still = np.zeros(self._arm.n)
        return replace(
            self._snapshot, state=State.FAULT, cause=lost, unreachable=True, powered=powered,
            q=unknown, commanded=False, program=None,
            velocity_command=still, acceleration_command=still, homing=(), warnings=(), told_by_cause=(),
            awaited=(), stopped=None,
            quantities={}, levels=(), inputs={}, outputs={}, edges={}, limp=(),
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

    def simulated_port(self) -> str:
        """Where its simulated board is served; ``BoardError``: it does not say."""
        located: Future[str] = Future()
        with self._lock:
            if self._lost is not None or self._closing:
                raise ArmProcessError(self._lost or "the arm is being closed")
            number = next(self._numbers)
            self._locating[number] = located
            self._put(self._codec.encode(Locate(number)))
        try:
            return located.result(_RECALL_S)
        except TimeoutError:
            raise ArmProcessError(f"no simulated board is served within {_RECALL_S:g} s") from None

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
        still_s = now - self._alive_at
        if still_s > (_BUSY_S if self._stopped_at > self._alive_at else SILENCE_S):
            self._woke_at, self._still_s = now, still_s
        self._alive_at = now

    def _just_woke(self) -> bool:
        """Whether what is asked for now may have waited while the caller of ``beat`` stood still."""
        now = self._now()
        if not self._beats and self._alive_at < math.inf:
            self._caller_lives(now)
        return now - self._woke_at < AFTER_GAP_S

    def _stop_waiting(self) -> list[int]:
        """Take back the motions that are not sent yet: STOP waits for none; the lock is held."""
        self._stops, self._stopped_at = self._stops + 1, self._now()
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
                return _whole(snapshot, self._events, self._running)
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
            case Located(number, port):
                with self._lock:
                    located = self._locating.pop(number, None)
                if located is not None:
                    located.set_result(port)
            case Refused(error):
                raise ArmProcessError(f"the arm process refused: {error}")
            case _:
                pass
        return None

    def _answer(self, number: int, record: Answer) -> None:
        with self._lock:
            waiting = self._tickets.get(number)
            asked = self._recalls.pop(number, None) or self._locating.pop(number, None)
            if record.finished:
                self._tickets.pop(number, None)
        if asked is not None:
            asked.set_exception(ArmProcessError(record.error))
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
            asked = [*self._recalls.values(), *self._locating.values()]
            self._recalls, self._locating = {}, {}
            self._out.clear()
            self._lock.notify_all()
        for one in asked:
            one.set_exception(ArmProcessError(why))
        with self._answering:
            for ticket, answers in waiting:
                ticket.end(StateError(why))
                give(answers)
        self._line.close()  # last: a network that is gone may keep it waiting

    def _epitaph(self, cause: Exception) -> str:
        """What has become of the arm process, and what its board does now."""
        if self._closing:
            return "closed"
        board = board_type(self._arm.board)
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


def _whole(snapshot: Snapshot, events: tuple[Event, ...], programs: Running | None) -> Snapshot:
    """With log and programs as they were told last."""
    progress: ProgramProgress | None = snapshot.program
    if progress is not None and programs is not None:
        progress = replace(progress, running=programs.running, coming=programs.coming)
    return replace(snapshot, events=events, program=progress)
