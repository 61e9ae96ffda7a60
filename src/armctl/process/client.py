"""One client of the arm process: what it asks for is judged, then decoded, then carried out, in order."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Coroutine
from concurrent.futures import Future
from typing import Any, Protocol

from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts import say
from armctl.process.connections import Broadcast, Outbox, RecordConnection, nobody, nothing_large
from armctl.process.limits import MOST_CONTROL_A_SECOND, Meter, most_bytes
from armctl.process.records import (
    CONTROL,
    MOST_ELSE,
    Answer,
    Ask,
    Beat,
    Codec,
    End,
    Hello,
    Locate,
    Located,
    Recall,
    Recalled,
    Refused,
    Stop,
    Trust,
    answer,
)
from armctl.protocol import ArmLink, Arrive, Command, ControlCommand, Leave, MovingCommand, Origin, Ticket
from armctl.protocol.snapshot import printable

_LOGGER = logging.getLogger("armctl.process")
_MOST_OPEN = 256
"""commands of one client that wait for their end"""
_BIG = 4 * 1024
"""A command of more bytes is decoded beside the others: 64 KiB of curves take 0.1 s, STOP came so late."""
_MOST_WAITING, _MOST_WAITING_IN_ALL = 8 * 1024 * 1024, 16 * 1024 * 1024
"""bytes of one client, and of all that are no owners, that wait for that"""
_GOODBYE_S = 0.2
_RECALL_EVERY_S = 2.0
"""how often a client gets the last minute: packing it costs a quarter of a second"""


class SharedByClients(Protocol):
    """What the clients of an arm share."""

    arm: ArmLink
    ended: asyncio.Event
    broadcast: Broadcast
    stops: int
    """how often STOP was pressed"""
    mover: Client | None
    """whose command moves the arm"""
    waiting: int
    """bytes of clients that are no owners, which wait to be decoded"""

    def count(self, client: Client, records: int, size: int) -> None:
        """Count what a client sends; ``InputError``: it is too much."""
        ...

    def hold_large(self, client: Client) -> None:
        """A large record of a client comes in, who may command; that of another one has to go."""
        ...

    def release_large(self, client: Client) -> None:
        """It is decoded, or its client is gone."""
        ...

    async def decoded(self, codec: Codec, record: Ask, *, rests: bool) -> Command | ArmctlError:
        """The command of a large record, decoded beside the event loop, one at a time."""
        ...

    async def last_minute(self) -> bytes:
        """The last minute of the arm, packed."""
        ...

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """Run something beside the connections."""
        ...


_SETTLING_S = 0.2
"""so long a large record waits until it is known who operates; a controller takes a tick for that"""


class Client:
    """One connection."""

    def __init__(
        self,
        server: SharedByClients,
        codec: Codec,
        line: RecordConnection,
        hello: Hello,
        number: int,
        *,
        owns: bool,
        source: str,
    ) -> None:
        self.name = " ".join(printable(hello.name).split())[:40] or "program"
        self.id, self.number = f"{self.name}, program {number}", number
        self.owns, self.line, self.source = owns, line, source
        self.outbox = Outbox(line, codec, server.broadcast, bounded=not owns)
        self._server, self._codec, self._hello = server, codec, hello
        self._loop = asyncio.get_running_loop()
        self.heard_at = self._loop.time()
        self.meter = Meter()
        self._open = 0
        self._settling = 0
        """what it has said about who operates, and is not answered yet"""
        self._settled = asyncio.Event()
        self._waiting: deque[tuple[Ask, str, int, int]] = deque()
        """commands that wait for their turn to be decoded: kind, bytes, how often STOP was pressed before"""
        self._waiting_bytes = 0
        self._recalled_at = -_RECALL_EVERY_S
        self._recalling = self._gone = self._shut = False
        self._goodbye = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        line.alive, line.admit = self._alive, self._admit

    def begin(self) -> None:
        """It is let in: say so to the arm, and send it what happens."""
        if not self.owns:  # who owns the arm speaks for its pages
            party = Origin(self.id, source=f"programs at {self.source}" if self.source else "")
            ticket = self._server.arm.submit(Arrive(self.name, self._hello.watch), party)
            self._settle(ticket)
            ticket.finished.add_done_callback(self._arrived)
        self._begin(self.outbox.feed(lambda: self._server.arm.snapshot))
        self.outbox.wake.set()

    def leave(self) -> None:
        """Its connection is gone: what moves at its command is stopped."""
        if self._gone:
            return
        self._gone = True
        for task in self._tasks:
            task.cancel()
        self._forget_waiting()
        self._server.release_large(self)
        self.line.alive, self.line.admit = nobody, nothing_large  # a circle less
        if not self.owns:
            self._server.arm.submit(Leave("its connection is gone"), Origin(self.id))
        if self._server.mover is self:
            self.stop("its connection is gone")

    def stop(self, why: str) -> None:
        """Stop what moves at its command."""
        self._server.mover = None
        if self._server.arm.snapshot.busy:
            self._server.arm.stop(Origin(self.name, why))

    def shut_out(self, why: str) -> None:
        """End its connection, and say why; nothing that it sends counts any more."""
        if self._shut:
            return
        self._shut = True
        self._forget_waiting()
        _LOGGER.warning("%s: %s", self.name, why)

        self._server.spawn(self._say_goodbye(why))

    async def _say_goodbye(self, why: str) -> None:
        try:
            async with asyncio.timeout(_GOODBYE_S):
                await self.line.send(self._codec.encode(Refused(why)))
                await asyncio.sleep(_GOODBYE_S)
        except (EOFError, OSError, RuntimeError, TimeoutError):  # its connection ends already
            _LOGGER.debug("%s: nobody reads why it is shut out", self.name)
        finally:
            self.line.abort()
            self._goodbye.set()

    @property
    def ended(self) -> bool:
        """It is shut out: nothing more is read from it."""
        return self._shut

    async def said_goodbye(self) -> None:
        """Wait until it had the time to read why it is shut out."""
        await self._goodbye.wait()

    def _arrived(self, finished: Future[None]) -> None:
        refusal = finished.exception()
        if refusal is not None:  # one that is not known would be asked nothing when it commands
            self._loop.call_soon_threadsafe(self.shut_out, str(refusal))

    def _alive(self, frames: int) -> None:
        """A sign of life that its line gives by itself."""
        self._server.count(self, frames, 0)
        if not self._hello.beats:
            self.heard_at = self._loop.time()

    async def _admit(self, size: int) -> None:
        """``size`` bytes of a record are there, more than most have: only who may command sends it."""
        if self.owns:
            return
        try:
            async with asyncio.timeout(_SETTLING_S):  # a STOP may come behind it
                await self._until_settled()
        except TimeoutError as cause:
            words = f"a record of {size} bytes or more while a PIN of yours waits; wait for its answer first"
            raise InputError(words) from cause
        if (why := self._server.arm.snapshot.control.refusal(self.id)) is not None:
            raise InputError(f"a record of {size} bytes or more; {MOST_ELSE} at most, as {say(why)}")
        self._server.hold_large(self)

    def take(self, data: bytes) -> None:
        """Carry out one record, or let it wait behind a big one; STOP never waits."""
        if self._shut:
            return
        self._server.count(self, 1, len(data))
        self.heard_at = self._loop.time()
        record = self._codec.from_client(data)
        arm = self._server.arm
        match record:
            case Ask():
                self._asked(record, len(data))
            case Stop(number, who, note):
                self._server.stops += 1
                self._follow(number, arm.stop(self._origin(who, note)))
            case End():
                if not self.owns:
                    raise InputError("only who started the arm may end it")
                self._server.ended.set()
            case Recall(number):
                self._recall(number)
            case Locate(number):
                if not self.owns:
                    raise InputError("only who started the arm may use its simulated board")
                self._begin(self._locate(number))
            case Beat():
                pass
            case Trust() | Hello():
                raise InputError("a hello comes once, at the beginning")

    def _asked(self, ask: Ask, size: int) -> None:
        """Carry out a command, let it wait, or refuse it by its kind, before it is decoded."""
        try:
            kind = self._codec.kind(ask)
            self._require_admissible(kind, size)
            control = kind in CONTROL
            if not self._waiting and (control or not self._settling):
                self._require_may_command(kind, ask.who)
                if size <= _BIG:
                    self._carry_out(ask, command_of(self._codec, ask))
                    return
        except ArmctlError as refusal:
            self.outbox.put(answer(ask.id, refusal))
            return
        self._waiting.append((ask, kind, size, self._server.stops))
        self._waiting_bytes += size
        if not self.owns:
            self._server.waiting += size
        if len(self._waiting) == 1:
            self._begin(self._take_waiting())

    def _require_admissible(self, kind: str, size: int) -> None:
        """Refuse (``ArmctlError``) what is too large for its kind, or too much."""
        if self._open + len(self._waiting) >= _MOST_OPEN:
            raise StateError(f"{_MOST_OPEN} commands wait for their end already; wait for them")
        if self.owns:
            return
        if size > most_bytes(kind):
            raise InputError(f"a {kind} of {size} bytes is too large; {most_bytes(kind)} at most")
        if self._waiting_bytes + size > _MOST_WAITING or self._server.waiting + size > _MOST_WAITING_IN_ALL:
            raise StateError("too many bytes wait to be read already; wait for the answers")
        if kind in CONTROL:
            self.meter.control += 1
            if self.meter.control > MOST_CONTROL_A_SECOND:
                raise StateError(
                    f"more than {MOST_CONTROL_A_SECOND} a second about who operates; wait a moment"
                )

    def _require_may_command(self, kind: str, who: str) -> None:
        """Refuse (``StateError``) the commands of who may not command, as the controller would.

        Who owns the arm speaks for many pages. Its commands are not judged ahead: the controller does it, in
        their order.
        """
        if kind in CONTROL or self.owns:
            return
        party = self._origin(who, "").who
        if (why := self._server.arm.snapshot.control.refusal(party)) is not None:
            raise StateError(why)

    async def _take_waiting(self) -> None:
        """Judge and decode what waits, one after the other, the large ones beside the event loop."""
        while self._waiting:
            ask, kind, size, stops = self._waiting[0]
            if kind not in CONTROL:
                await self._until_settled()
            command: Command | ArmctlError
            try:
                self._require_may_command(kind, ask.who)
                if size <= _BIG:
                    command = command_of(self._codec, ask)
                else:
                    command = await self._server.decoded(self._codec, ask, rests=not self.owns)
            except ArmctlError as refusal:
                command = refusal
            if not self._waiting:  # it was shut out meanwhile
                return
            if isinstance(command, MovingCommand) and stops != self._server.stops:
                command = StateError("stopped before it began")
            self._carry_out(ask, command)
            self._waiting.popleft()
            self._waiting_bytes -= size
            if not self.owns:
                self._server.waiting -= size
            if size > MOST_ELSE:
                self._server.release_large(self)

    def _forget_waiting(self) -> None:
        if not self.owns:
            self._server.waiting -= self._waiting_bytes
        self._waiting.clear()
        self._waiting_bytes = 0

    def _origin(self, who: str, note: str, source: str = "") -> Origin:
        return Origin(who or self.name, note, source) if self.owns else Origin(self.id)

    def _carry_out(self, ask: Ask, command: Command | ArmctlError) -> None:
        if not isinstance(command, Command):
            self.outbox.put(answer(ask.id, command))
            return
        ticket = self._server.arm.submit(command, self._origin(ask.who, ask.note, ask.source))
        if isinstance(command, MovingCommand):
            ticket.accepted.add_done_callback(self._began)
        elif isinstance(command, ControlCommand) and not self.owns:
            self._settle(ticket)  # pages do not wait for each other: the controller judges them
        self._follow(ask.id, ticket)

    def _settle(self, ticket: Ticket) -> None:
        """What comes behind it waits until it is known who operates then."""
        self._settling += 1
        self._settled.clear()

        def settled() -> None:
            self._settling -= 1
            if not self._settling:
                self._settled.set()

        ticket.finished.add_done_callback(lambda _: self._loop.call_soon_threadsafe(settled))

    async def _until_settled(self) -> None:
        while self._settling:
            await self._settled.wait()

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
                self._loop.call_soon_threadsafe(self.outbox.put, answer(number, None, accepted=True))

        def finished(future: Future[None]) -> None:
            self._loop.call_soon_threadsafe(self._close, answer(number, future.exception()))

        ticket.accepted.add_done_callback(accepted)
        ticket.finished.add_done_callback(finished)

    def _close(self, last: Answer) -> None:
        self._open -= 1
        self.outbox.put(last)

    def _recall(self, number: int) -> None:
        """Send the last minute, not too often."""
        again_s = self._recalled_at + _RECALL_EVERY_S - self._loop.time()
        if self._recalling:
            self.outbox.put(answer(number, StateError("the last minute is on its way already")))
        elif not self.owns and again_s > 0:
            words = f"the last minute was given a moment ago; ask again in {again_s:.1f} s"
            self.outbox.put(answer(number, StateError(words)))
        else:
            self._recalling = True
            self._begin(self._send_last_minute(number))

    async def _send_last_minute(self, number: int) -> None:
        try:
            content = await self._server.last_minute()
        except ArmctlError as cause:
            self.outbox.put(answer(number, cause))
        else:
            self._recalled_at = self._loop.time()
            await self.outbox.reply(Recalled(number, content))
        finally:
            self._recalling = False

    async def _locate(self, number: int) -> None:
        try:
            port = await asyncio.to_thread(self._server.arm.simulated_port)
        except ArmctlError as cause:
            self.outbox.put(answer(number, cause))
        else:
            await self.outbox.reply(Located(number, port))

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


def command_of(codec: Codec, ask: Ask) -> Command | ArmctlError:
    """The command of an ``Ask``, or what is wrong with it."""
    try:
        return codec.command(ask)
    except ArmctlError as refusal:
        return refusal
