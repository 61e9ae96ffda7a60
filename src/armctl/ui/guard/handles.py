"""Where the guard looks into viser's own tables: what does a message address?

The only file, apart from ``serving``, that touches viser's private parts (1.1.1).
"""

from __future__ import annotations

from typing import Protocol

import viser
from viser import GuiApi, GuiFormHandle
from websockets.asyncio.server import ServerConnection

from armctl.ui.guard.values import Operable, is_operable


class Addressees(Protocol):
    """What the messages of one page can address."""

    def control(self, uuid: str) -> Operable | None:
        """Find a control that this page can see; None when there is no such one."""
        ...

    def has_form(self, uuid: str) -> bool:
        """Tell whether this page can see a form with this id."""
        ...

    def has_command(self, uuid: str) -> bool:
        """Tell whether this page has been given a command, or a hot key, with this id."""
        ...


class ServerSlot:
    """Holds the server once it exists; a page may connect while viser is still constructing it."""

    def __init__(self) -> None:
        self.server: viser.ViserServer | None = None


class ConnectionHandles:
    """The handles that one connection can address: the shared ones and its own, never another page's."""

    def __init__(self, slot: ServerSlot, connection: ServerConnection) -> None:
        self._slot = slot
        self._connection = connection
        self._client_id: int | None = None

    def control(self, uuid: str) -> Operable | None:
        """See ``Addressees``."""
        for gui in self._guis():
            handle = gui._gui_input_handle_from_uuid.get(uuid)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
            if is_operable(handle):
                return handle
        return None

    def has_form(self, uuid: str) -> bool:
        """See ``Addressees``."""
        return any(
            isinstance(gui._container_handle_from_uuid.get(uuid), GuiFormHandle)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
            for gui in self._guis()
        )

    def has_command(self, uuid: str) -> bool:
        """See ``Addressees``."""
        return any(
            uuid in gui._command_handle_from_uuid  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
            for gui in self._guis()
        )

    def _guis(self) -> list[GuiApi]:
        server = self._slot.server
        if server is None:
            return []
        if self._client_id is None:
            live = server._websock_server._live_connections  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
            self._client_id = next((i for i, c in tuple(live.items()) if c is self._connection), None)
        client = None if self._client_id is None else server.get_clients().get(self._client_id)
        return [server.gui] if client is None else [server.gui, client.gui]
