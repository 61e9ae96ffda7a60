"""The WebSocket API beside the pages: connections of other programs go straight to the arm process."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from contextlib import suppress

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from armctl.errors import ArmctlError
from armctl.process import Link
from armctl.process.records import schema
from armctl.runtime import ArmLink
from armctl.ui.guard import SocketDoor

PATH = "/api"
_LOG = logging.getLogger("armctl.ui")
_TRY_AGAIN = 1013
_PING_S = 0.25


def api_door(arm: Callable[[], ArmLink | None]) -> SocketDoor:
    """What answers at ``/api``; ``arm`` gives the present arm, None while there is none yet."""

    def hand_over(line: socket.socket, request: bytes) -> bool:
        link = arm()
        try:
            return isinstance(link, Link) and link.hand_over(line, request)
        except OSError as cause:
            _LOG.warning("a connection could not be handed to the arm process: %s", cause)
            return False

    async def relay(connection: ServerConnection) -> None:
        link = arm()
        if not isinstance(link, Link):
            await connection.close(_TRY_AGAIN, "this arm has no process of its own")
            return
        await _relayed(connection, link)

    return SocketDoor(relay, for_programs=True, schema=schema(), hand_over=hand_over)


async def _relayed(connection: ServerConnection, link: Link) -> None:
    """Carry records both ways, where the connection itself cannot be handed over (TLS, Windows)."""
    try:
        reader, writer = await link.relay()
    except (ArmctlError, OSError) as cause:
        await connection.close(_TRY_AGAIN, str(cause)[:100])
        return

    async def outward() -> None:
        with suppress(asyncio.IncompleteReadError, OSError, ConnectionClosed):
            while True:
                data = await reader.readexactly(int.from_bytes(await reader.readexactly(4)))
                await connection.send(data, text=data[:1] == b"{")
        await connection.close()

    async def signs_of_life() -> None:
        with suppress(OSError, ConnectionClosed):
            while True:
                await (await connection.ping())
                writer.write(bytes(4))  # a record of length 0: the line is alive
                await asyncio.sleep(_PING_S)

    chores = [asyncio.create_task(outward()), asyncio.create_task(signs_of_life())]
    try:
        async for message in connection:
            data = message.encode() if isinstance(message, str) else message
            writer.write(len(data).to_bytes(4) + data)
            await writer.drain()
    except (OSError, ConnectionClosed):
        _LOG.debug("a relayed connection broke", exc_info=True)
    finally:
        for chore in chores:
            chore.cancel()
        writer.close()
