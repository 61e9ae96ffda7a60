"""A websocket connection that delivers only what the filter admits."""

from __future__ import annotations

from typing import Any

from typing_extensions import override
from websockets.asyncio.server import Server, ServerConnection
from websockets.frames import CloseCode
from websockets.server import ServerProtocol

from armctl.ui.guard.frames import FrameFilter
from armctl.ui.guard.handles import ConnectionHandles, ServerSlot
from armctl.ui.guard.tally import Tally


class GuardedConnection(ServerConnection):
    """Drops bad frames and keeps the connection; a page that floods is disconnected (1008)."""

    def __init__(
        self, protocol: ServerProtocol, server: Server, *, slot: ServerSlot, tally: Tally, **options: Any
    ) -> None:
        super().__init__(protocol, server, **options)
        self._filter = FrameFilter(ConnectionHandles(slot, self), tally, self.loop.time)

    @override
    async def recv(self, decode: bool | None = None) -> Any:
        """Receive the next admissible frame; see ``websockets``."""
        while True:
            raw = await super().recv(decode)
            if self._filter.admits(raw):
                return raw
            if self._filter.flooded:
                await self.close(CloseCode.POLICY_VIOLATION, "too many messages")
