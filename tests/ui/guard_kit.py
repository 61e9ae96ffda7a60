"""A page without a browser: says exactly the bytes that a test gives it."""

from __future__ import annotations

import queue
import socket
from types import TracebackType
from typing import Any, Self, cast

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

PATIENCE_S = 10.0
CAMERA = {
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1, 2.5, 3),
    "fov": 1.3,
    "near": 0.01,
    "far": 1000,
    "image_height": 800,
    "image_width": 1280,
    "look_at": (0, 0, 0),
    "up_direction": (0, 0, 1),
}


class RawPage:
    """A websocket client that can say anything."""

    def __init__(
        self,
        port: int,
        *,
        origin: str | None = "",
        host: str = "",
        cookie: str = "",
        version: str = viser.__version__,
        query: str = "",
    ) -> None:
        here = f"127.0.0.1:{port}"
        headers = {"Cookie": cookie} if cookie else {}
        self.socket: ClientConnection = connect(
            f"ws://{host or here}/{query}",
            sock=socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S),
            origin=None if origin is None else Origin(origin or f"http://{host or here}"),
            subprotocols=[Subprotocol(f"viser-v{version}")],
            additional_headers=headers,
            compression=None,
            max_size=None,
            close_timeout=1.0,  # the server's answer stands behind all that a test has not read
            ping_interval=None,  # without a keepalive thread, which would outlive the connection for a moment
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.socket.close()

    def say(self, kind: str, **fields: Any) -> None:
        self.socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def read_to_the_end(self) -> ConnectionClosed:
        """Read until the server closes the connection; how it did so is the result."""
        try:
            while True:
                self.socket.recv(timeout=PATIENCE_S)
        except ConnectionClosed as end:
            return end

    def read_until(self, words: bytes) -> None:
        """Read until the server has sent ``words`` in one of the next thousand frames."""
        for _ in range(1000):
            frame = cast(bytes, self.socket.recv(timeout=PATIENCE_S))
            end = 16 + int.from_bytes(frame[8:16], "little")
            if words in zstandard.ZstdDecompressor().decompress(frame[16:end]):
                return
        raise AssertionError(words)

    def introduce(self) -> None:
        self.say("ViewerCameraMessage", **CAMERA)

    def operate(self) -> None:
        """Open the console's page on an enabled arm, and wait until its log says so: that is built last."""
        self.introduce()
        self.read_until(b"operates the arm")

    def set(self, uuid: object, value: object) -> None:
        self.say("GuiUpdateMessage", uuid=uuid, updates={"value": value})


class Bell:
    """A button whose ``async def`` callback rings: when it does, all that was said before has been judged."""

    def __init__(self, server: viser.ViserServer, label: str = "STOP") -> None:
        self._server = server
        self.handle = server.gui.add_button(label)
        self._rings: queue.Queue[int] = queue.Queue()

        @self.handle.on_click
        async def _(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            self.ring(event.client_id)

    @property
    def uuid(self) -> str:
        return uuid_of(self.handle)

    def press(self, page: RawPage) -> None:
        page.set(self.uuid, True)

    def ring(self, client_id: int | None) -> None:
        assert client_id is not None
        self._rings.put(client_id)

    def wait(self) -> int:
        """Wait for the callback; the result is the id of the page that pressed."""
        return self._rings.get(timeout=PATIENCE_S)

    def ring_from(self, page: RawPage) -> int:
        self.press(page)
        return self.wait()

    def gui_of(self, page: RawPage) -> viser.GuiApi:
        """The page's own GUI."""
        client_id = self.ring_from(page)
        return self._server.get_clients()[client_id].gui

    @property
    def silent(self) -> bool:
        return self._rings.empty()


def uuid_of(handle: Any) -> str:
    return handle._impl.uuid
