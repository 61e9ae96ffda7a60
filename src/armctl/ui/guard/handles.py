"""Where the guard looks into viser's own tables: what does a message address?

The only file, apart from ``serving``, that touches viser's private parts (1.1.1).
"""

from __future__ import annotations

from typing import Protocol

import viser
from viser import GuiApi, GuiFormHandle
from viser._messages import FileTransferPartAck
from websockets.asyncio.server import ServerConnection

from armctl.ui.guard.messages import MAX_UPLOAD_BYTES, UploadStart
from armctl.ui.guard.values import Operable, is_operable

_MIB = 1 << 20
_READ_S = 12.0
"""a refusal has to be read"""


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

    def refuse_upload(self, upload: UploadStart) -> None:
        """Tell the page that a file is too large."""
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

    def refuse_upload(self, upload: UploadStart) -> None:
        """See ``Addressees``. The page takes the file for sent, and can send another one."""
        client = self._client()
        if client is None:
            return
        size = upload.size_bytes
        done = FileTransferPartAck(upload.source_component_uuid, upload.transfer_uuid, size, size)
        client.gui._websock_interface.queue_message(done)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        client.add_notification(
            "Upload refused",
            f"{upload.filename} was not taken: it has {size / _MIB:.1f} MiB, "
            f"the largest that is taken has {MAX_UPLOAD_BYTES / _MIB:.0f} MiB.",
            color="red",
            auto_close_seconds=_READ_S,
        )

    def _client(self) -> viser.ClientHandle | None:
        server = self._slot.server
        if server is None:
            return None
        if self._client_id is None:
            live = server._websock_server._live_connections  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
            self._client_id = next((i for i, c in tuple(live.items()) if c is self._connection), None)
        return None if self._client_id is None else server.get_clients().get(self._client_id)

    def _guis(self) -> list[GuiApi]:
        server, client = self._slot.server, self._client()
        if server is None:
            return []
        return [server.gui] if client is None else [server.gui, client.gui]
