"""Looks whether a board that was lost is plugged in again, so that the pages say so. It opens no port."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Self

from armctl.facts import State
from armctl.hardware import BoardIdentity
from armctl.protocol import Snapshot
from armctl.ui.console import Console, PortChoice

_FRAMES = 25
"""from one look to the next: a second"""


class PortWatch:
    """What all pages share of the ports. Used on the web server's event loop only."""

    def __init__(self, console: Console) -> None:
        self._list_ports = console.list_ports
        self._board: BoardIdentity | None = None
        """the one that was connected last"""
        self._frames = 0
        self._looking: asyncio.Task[None] | None = None
        self._was_away = False
        self.choices: Sequence[PortChoice] = ()
        """as they were listed last while the board was lost; empty: not yet"""
        self.back_on: str | None = None
        """the port where the board that was lost is plugged in again; None: it is not, or none is lost"""

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Look for this console."""
        watch = cls(console)
        console.frame_listeners.append(watch.note)
        return watch

    def note(self, snapshot: Snapshot) -> None:
        """Called with every frame."""
        if snapshot.board is not None or snapshot.unreachable or snapshot.state is not State.FAULT:
            self._board = snapshot.board if snapshot.board is not None else self._board
            self._was_away, self.back_on = False, None
            return
        self._frames += 1
        if self._frames % _FRAMES == 0 and (self._looking is None or self._looking.done()):
            self._looking = asyncio.create_task(self._look())

    async def _look(self) -> None:
        board = self._board
        if board is None or board.simulated:
            return
        self.choices = await asyncio.to_thread(self._list_ports)
        port = await asyncio.to_thread(_port_of, board, self.choices)
        self._was_away |= port is None
        self.back_on = port if self._was_away else None


def _port_of(board: BoardIdentity, choices: Sequence[PortChoice]) -> str | None:
    """Where a board is plugged in now: by its serial number, else by its port; None: nowhere."""
    listed = [choice for choice in choices if choice.listed]
    if board.serial_number:
        return next((one.port for one in listed if one.serial_number == board.serial_number), None)
    there = board.port in [choice.port for choice in listed] or Path(board.port).exists()
    return board.port if there else None
