"""A scene that is kept, not served."""

from __future__ import annotations

import asyncio
import threading
from typing import Any, cast

import viser
from viser.infra import StateSerializer, WebsockMessageHandler
from viser.infra._async_message_buffer import AsyncMessageBuffer


class KeptScene(WebsockMessageHandler):
    """The ``SceneApi`` of viser writes to it as to a server; it gives viser's client with the scene in it.

    Holds: what ``SceneApi`` asks of its server (``client_id``, ``_websock_connection``, ``_viser_server``,
    ``_scene_lifecycle_lock``), ``AsyncMessageBuffer``, which keeps the newest message of each kind for each
    part, and ``StateSerializer._insert_message``.
    """

    client_id = ""
    """as viser's server calls itself"""

    def __init__(self) -> None:
        super().__init__()
        nobody = asyncio.new_event_loop()
        nobody.close()  # viser wakes it with each message, and takes a closed one for a server that has ended
        self._buffer = AsyncMessageBuffer(nobody, persistent_messages=True)
        self._websock_connection = self._viser_server = self
        self._scene_lifecycle_lock = threading.RLock()
        self.api = viser.SceneApi(cast(Any, self), cast(Any, None), nobody)
        self.camera = viser.InitialCameraConfig(self.queue_message)

    def get_message_buffer(self) -> AsyncMessageBuffer:
        """What ``queue_message`` writes to."""
        return self._buffer

    def html(self) -> str:
        """Client of viser with this scene in it."""
        serializer: StateSerializer = self.get_message_serializer(
            lambda message: message.include_in_scene_serialization
        )
        for message in self._buffer.message_from_id.values():
            serializer._insert_message(message)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        return serializer.as_html()
