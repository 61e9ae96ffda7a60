"""A page of the console without its browser: it opens, beats, answers and presses as the real one does."""

from __future__ import annotations

import asyncio
import json
import secrets
from contextlib import suppress
from typing import Any

import msgspec
import viser
import zstandard
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin, Subprotocol

_OPEN_TABS = "Manual", "Serial motion"
_BEAT_S, _RETRY_S, _LOOK_S = 0.2, 0.3, 0.005
_PART_BYTES = 512 << 10
_PATIENCE_S = 60.0
_CAMERA = {
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 2.5, 3.0),
    "fov": 1.3,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 800,
    "image_width": 1280,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
_LAST = "Download the suggestion"
"""the label of what is built last"""


class Page:
    """One page; ``open`` makes it."""

    def __init__(
        self, viser_line: ClientConnection, stop_line: ClientConnection, part_line: ClientConnection | None
    ) -> None:
        self._viser, self._line, self._parts = viser_line, stop_line, part_line
        self._name = secrets.token_hex(16)
        self._widgets: dict[tuple[str, str], list[str]] = {}
        self._texts: dict[str, str] = {}
        self._disabled: set[str] = set()
        self._built = asyncio.Event()
        self._notices: asyncio.Queue[tuple[str, str]] = asyncio.Queue()
        self._presses = 0
        self._zstd = zstandard.ZstdDecompressor()
        self._tasks = [asyncio.create_task(work) for work in (self._read(), self._beat())]

    @classmethod
    async def open(cls, port: int) -> Page:
        """Open one and wait until it is built."""
        here = f"127.0.0.1:{port}"
        origin, protocol = Origin(f"http://{here}"), Subprotocol(f"viser-v{viser.__version__}")
        viser_line = await connect(
            f"ws://{here}/", origin=origin, subprotocols=[protocol], max_size=None, compression=None
        )
        page = cls(viser_line, await _stop_line(here, origin), await _part_line(here, origin))
        await page._say("ViewerCameraMessage", **_CAMERA)
        async with asyncio.timeout(_PATIENCE_S):
            await page._built.wait()
        return page

    async def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        for line in (self._viser, self._line, self._parts):
            if line is not None:
                await line.close()

    async def enabled(self, label: str, value: object = True) -> None:
        """Wait until a button can be pressed."""
        async with asyncio.timeout(_PATIENCE_S):
            while not self.is_enabled(label, value):
                await asyncio.sleep(_LOOK_S)

    def is_enabled(self, label: str, value: object = True) -> bool:
        """Whether a button can be pressed."""
        return self._button(label, value) not in self._disabled

    def _button(self, label: str, value: object) -> str:
        return self._widgets["GuiButtonMessage" if value is True else "GuiButtonGroupMessage", label][0]

    async def press(self, label: str, value: object = True) -> None:
        """Press a button; of a group: the one with the label ``value``."""
        uuid = self._button(label, value)
        await self._say("GuiUpdateMessage", uuid=uuid, updates={"value": value})

    async def do(self, what: str) -> None:
        """Press a button of what armctl draws itself, as the bar."""
        if self._parts is None:
            raise RuntimeError("this console draws nothing itself")
        await self._parts.send(json.dumps({"do": what}))

    async def type_target(self, label: str, text: str) -> None:
        """Type into a field of Inverse; Forward has some of the same names before."""
        uuid = self._widgets["GuiTextMessage", label][-1]
        await self._say("GuiUpdateMessage", uuid=uuid, updates={"value": text})

    async def stop(self) -> None:
        """STOP as Escape and the large button send it."""
        self._presses += 1
        await self._line.send(json.dumps({"stop": self._presses}))

    async def upload(self, name: str, content: bytes) -> None:
        """Upload a file as a program."""
        uuid, transfer = self._widgets["GuiUploadButtonMessage", "Upload"][0], secrets.token_hex(8)
        parts = [content[at : at + _PART_BYTES] for at in range(0, len(content), _PART_BYTES)]
        await self._say(
            "FileTransferStartUpload", source_component_uuid=uuid, transfer_uuid=transfer, filename=name,
            mime_type="", part_count=len(parts), size_bytes=len(content),
        )  # fmt: skip
        for index, part in enumerate(parts):
            await self._say(
                "FileTransferPart", source_component_uuid=uuid, transfer_uuid=transfer, part_index=index,
                content=part,
            )  # fmt: skip

    async def wait_for_notice(self, title: str) -> None:
        """Wait for a notification with this title."""
        said: list[tuple[str, str]] = []
        try:
            async with asyncio.timeout(_PATIENCE_S):
                while not said or said[-1][0] != title:
                    said.append(await self._notices.get())
        except TimeoutError:
            raise RuntimeError(f"the page says {said}, where {title!r} was to come") from None

    def notices(self) -> list[tuple[str, str]]:
        """Titles and texts that have come since somebody last looked."""
        return [self._notices.get_nowait() for _ in range(self._notices.qsize())]

    def shows(self, words: str) -> bool:
        """Whether a text of the page has these words in it."""
        return any(words in text for text in self._texts.values())

    async def _say(self, kind: str, **fields: Any) -> None:
        await self._viser.send(msgspec.msgpack.encode({"type": kind, **fields}))

    async def _read(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                frame = await self._viser.recv(decode=False)
                end = 16 + int.from_bytes(frame[8:16], "little")
                for message in msgspec.msgpack.decode(self._zstd.decompress(bytes(frame[16:end])))[
                    "messages"
                ]:
                    await self._take(message)

    async def _take(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "LocalStorageGetItemRequestMessage":
            await self._say(
                "LocalStorageGetItemResponseMessage",
                value=self._name, error=None, request_uuid=message["request_uuid"],
            )  # fmt: skip
        elif kind == "NotificationShowMessage":
            self._notices.put_nowait((message["props"]["title"], message["props"]["body"]))
        elif kind.startswith("Gui") and "props" in message:
            label = message["props"].get("label") or ""
            self._widgets.setdefault((kind, label), []).append(message["uuid"])
            self._texts[message["uuid"]] = message["props"].get("content") or ""
            self._enable(message["uuid"], message["props"])
            if label == _LAST:
                self._built.set()
        elif kind == "GuiUpdateMessage":
            if "content" in message["updates"]:
                self._texts[message["uuid"]] = message["updates"]["content"]
            self._enable(message["uuid"], message["updates"])

    def _enable(self, uuid: str, told: dict[str, Any]) -> None:
        if told.get("disabled"):
            self._disabled.add(uuid)
        elif "disabled" in told:
            self._disabled.discard(uuid)

    async def _beat(self) -> None:
        beats = 0
        with suppress(ConnectionClosed):
            await self._line.send(json.dumps({"page": self._name}))
            self._tasks.append(asyncio.create_task(_listen(self._line)))
            if self._parts is not None:
                await self._parts.send(json.dumps({"page": self._name}))
                self._tasks.append(asyncio.create_task(_listen(self._parts)))
            while True:
                beats += 1
                await self._line.send(json.dumps({"beat": beats, "tabs": _OPEN_TABS}))
                await asyncio.sleep(_BEAT_S)


async def _listen(line: ClientConnection) -> None:
    with suppress(ConnectionClosed):
        async for _ in line:
            pass


async def _part_line(here: str, origin: Origin) -> ClientConnection | None:
    """A line for what armctl draws of the page itself; None: an earlier version, which has none."""
    try:
        return await connect(f"ws://{here}/page", origin=origin, max_size=None, compression=None)
    except InvalidStatus:
        return None


async def _stop_line(here: str, origin: Origin) -> ClientConnection:
    """A line that the server listens to; while it starts it closes them again."""
    while True:
        line = await connect(f"ws://{here}/stop", origin=origin, compression=None)
        with suppress(ConnectionClosed):
            await line.recv()  # a page says nothing before
            return line
        await asyncio.sleep(_RETRY_S)
