"""The WebSocket API beside the pages: connections of other programs go straight to the arm process.

An arm process that is gone is started again by whoever says hello: else a console without a screen would have
to be started again by hand.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, get_args

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from armctl.errors import ArmctlError, ArmProcessError, InputError, StateError
from armctl.kinematics import Target
from armctl.motion import Trajectory
from armctl.process import Link
from armctl.process.limits import source_of
from armctl.process.records import Codec, FromArm, FromClient, Hello, Refused, asked_of_clients, in_short
from armctl.process.trajectories import Motion
from armctl.protocol import ArmLink
from armctl.protocol.snapshot import printable
from armctl.ui.guard import SocketDoor
from armctl.version import __version__

PATH = "/api"
_LOG = logging.getLogger("armctl.ui")
_TRY_AGAIN = 1013
_LONGEST_REASON = 120
"""bytes of the reason for which a websocket is closed"""
_PING_S = 0.25
_HELLO_S = 10.0
_ENDED_S, _LOOKS = 1.0, 20
"""how long it may take until the end of the arm process is known, and how often that is looked at"""


def api_door(
    arm: Callable[[], ArmLink | None], revive: Callable[[str], Awaitable[None]] | None = None
) -> SocketDoor:
    """What answers at ``/api``; ``arm`` gives the present arm, None while there is none yet.

    ``revive`` starts the process of an arm again that is gone, for somebody of that name; None: nobody does.
    """

    def hand_over(line: socket.socket, request: bytes) -> bool:
        link = arm()
        try:
            return isinstance(link, Link) and not link.ended and link.hand_over(line, request)
        except OSError as cause:
            _LOG.warning("a connection could not be handed to the arm process: %s", cause)
            return False

    def present() -> Link | None:
        """The present arm; None where its process is gone, and can be started again."""
        link = arm()
        if link is None:
            raise StateError("armctl is starting; try again in a moment")
        if not isinstance(link, Link):
            raise StateError("this arm has no process of its own")
        if not link.ended or revive is None:
            return link
        return None

    async def relay(connection: ServerConnection) -> None:
        """Serve what cannot be handed over: it is encrypted, there are no such sockets, the arm is gone."""
        first: str | bytes | None = None
        source = source_of(connection.remote_address)
        with suppress(ConnectionClosed, TimeoutError):
            try:
                link = present()
                line = None if link is None else await _line(link, source)
                if line is None:
                    first = await asyncio.wait_for(connection.recv(), _HELLO_S)
                    await _revive_for(first, revive)
                    link = present()
                    line = None if link is None else await _line(link, source)
                if line is None:
                    raise ArmProcessError(
                        "the arm process is gone; press Connect in a page, or restart armctl"
                    )
            except ArmctlError as refusal:
                if first is None:  # it tells in which form an answer is understood
                    first = await asyncio.wait_for(connection.recv(), _HELLO_S)
                await _refuse(connection, Codec.of(_bytes(first)), in_short(refusal))
            else:
                await _relayed(connection, *line, first)

    return SocketDoor(relay, for_programs=True, schema=schema(), hand_over=hand_over)


async def _revive_for(first: str | bytes, revive: Callable[[str], Awaitable[None]] | None) -> None:
    """Start the arm process again for who says hello; ``ArmctlError``: it is no hello, or that fails."""
    data = _bytes(first)
    hello = Codec.of(data).from_client(data)
    if not isinstance(hello, Hello):
        raise InputError("the first record must be a hello")
    if revive is not None:
        await revive(" ".join(printable(hello.name).split())[:40] or "program")


async def _refuse(connection: ServerConnection, codec: Codec, why: str) -> None:
    _LOG.warning("a program is not served: %s", why)
    await connection.send(codec.encode(Refused(why)), text=codec.json)
    await connection.close(_TRY_AGAIN, why.encode()[:_LONGEST_REASON].decode(errors="ignore"))


async def _line(link: Link, source: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter] | None:
    """A connection to the arm process; None: it is gone. Errors as ``Link.relay``."""
    try:
        return await link.relay(source)
    except OSError as cause:
        for _ in range(_LOOKS):  # its link learns that a moment later
            if link.ended:
                return None
            await asyncio.sleep(_ENDED_S / _LOOKS)
        raise ArmProcessError(
            f"the arm process does not answer ({cause.strerror or cause}): it may be frozen. Use the switch "
            "in the arm's supply, end it, and connect again"
        ) from cause


def _bytes(message: str | bytes) -> bytes:
    return message.encode() if isinstance(message, str) else message


async def _relayed(
    connection: ServerConnection,
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    first: str | bytes | None,
) -> None:
    """Carry records both ways; ``first`` has come already."""

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

    async def inward(message: str | bytes) -> None:
        data = _bytes(message)
        writer.write(len(data).to_bytes(4) + data)
        await writer.drain()

    chores = [asyncio.create_task(outward()), asyncio.create_task(signs_of_life())]
    try:
        if first is not None:
            await inward(first)
        async for message in connection:
            await inward(message)
    except (OSError, ConnectionClosed):
        _LOG.debug("a relayed connection broke", exc_info=True)
    finally:
        for chore in chores:
            chore.cancel()
        writer.close()


def schema() -> bytes:
    """JSON schema of every record and command, made from the types themselves."""

    def array(kind: type) -> dict[str, Any]:
        if kind is Trajectory:
            return {"type": "object"}  # filled in below
        return {"type": "array", "description": "numbers, or arrays of them; null: not known"}

    kinds = [*get_args(FromClient), *get_args(FromArm), *asked_of_clients(), *get_args(Motion)]
    _, parts = msgspec.json.schema_components(kinds, schema_hook=array, ref_template="#/$defs/{name}")
    parts["Ask"]["properties"]["command"] = {"$ref": "#/command"}
    positional = parts["Target"]
    named = dict(zip(Target._fields, positional["prefixItems"], strict=True))
    parts["Target"] = {
        "description": positional["description"],
        "anyOf": [
            {"type": "object", "properties": named, "required": ["point"], "additionalProperties": False},
            {key: value for key, value in positional.items() if key not in ("title", "description")},
        ],
    }
    words = {
        "type": "object",
        "additionalProperties": {"type": "string"},
        "description": "quantities in words",
    }
    parts["Snapshot"]["properties"]["measured"] = words
    parts["Follow"]["properties"]["trajectory"] = {
        "anyOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in get_args(Motion)]
    }
    rows = {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
    parts["Curve"]["properties"]["coefficients"]["items"] = rows
    said = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"armctl {__version__}: records of the WebSocket API",
        "from_client": {"anyOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in get_args(FromClient)]},
        "from_arm": {"anyOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in get_args(FromArm)]},
        "command": {"anyOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in asked_of_clients()]},
        "$defs": parts,
    }
    return msgspec.json.encode(said)
