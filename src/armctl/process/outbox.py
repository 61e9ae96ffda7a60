"""What is sent to the clients of an arm: the newest snapshot, what has changed beside it, and answers.

A record for all of them is encoded once. Memory stays bounded whatever they read: a client that does not read
its answers is shut out, and few clients at a time have a large record under way.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from armctl.process.connections import RecordConnection
from armctl.process.records import Answer, Codec, Logged, Recalled, Running, Seen, light, new_events
from armctl.program import Program
from armctl.protocol import Event, Snapshot

_MOST_UNREAD, _MOST_UNREAD_TEXT = 4096, 256 * 1024
"""answers that a client does not read, and letters of their errors; then it is shut out"""
_LARGE, _LARGE_AT_ONCE = 64 * 1024, 6
"""larger records are sent to so many clients at once: each has a copy in memory until it has read it"""
_READ_S = 5.0
"""how long a client may take to read such a one"""


class Broadcast:
    """Encodes what all clients get, once for all that speak alike."""

    def __init__(self) -> None:
        self.large = asyncio.Semaphore(_LARGE_AT_ONCE)
        self._snapshots: dict[bool, tuple[Snapshot, bytes]] = {}
        self._programs: dict[bool, tuple[Running, bytes]] = {}

    def snapshot(self, codec: Codec, snapshot: Snapshot) -> bytes:
        """A snapshot without what changes rarely."""
        known = self._snapshots.get(codec.json)
        if known is None or known[0] is not snapshot:
            known = self._snapshots[codec.json] = (snapshot, codec.encode(Seen(light(snapshot))))
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
        if len(self._answers) > _MOST_UNREAD or (self._bounded and self._letters > _MOST_UNREAD_TEXT):
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

    async def recalled(self, number: int, content: bytes) -> None:
        """Send the last minute."""
        with suppress(EOFError, ConnectionError):
            await self.send(self._codec.encode(Recalled(number, content)))

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
