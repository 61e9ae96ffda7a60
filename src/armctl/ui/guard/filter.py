"""What a connected page may say: by which HTTP method, and which messages, how large, how many."""

from __future__ import annotations

import logging
import math
import socket
import threading
from collections import Counter
from collections.abc import Callable
from itertools import chain
from typing import Any

import viser
from websockets.asyncio.server import Server, ServerConnection
from websockets.frames import CloseCode
from websockets.http11 import Request
from websockets.server import ServerProtocol

from armctl.ui.viser_seam import UPLOAD_PART_BYTES, MessageReader, acknowledge_all, control_of
from armctl.ui.viser_seam import messages as wire

LOG = logging.getLogger("armctl.ui.guard")

MAX_FRAME_BYTES = 16 << 20
"""Pictures of the scene are the largest frames; viser itself would take 50 MiB."""
MAX_UPLOAD_BYTES = 1 << 20
"""The largest file that a page may upload: a program, whose files have this limit, too."""
MAX_ARM_BYTES = 24 << 20
"""… and where an arm with its meshes is expected"""
_MAX_PLAIN_BYTES = 20 << 10
"""of every frame that is neither a picture nor a part of a file"""

ALLOWED = (
    wire.ViewerCameraMessage,
    wire.GuiUpdateMessage,
    wire.GuiButtonHoldMessage,
    wire.GuiFormDirtyMessage,
    wire.GuiFormSubmitMessage,
    wire.CommandTriggerMessage,
    wire.TransformControlsUpdateMessage,
    wire.TransformControlsDragStartMessage,
    wire.TransformControlsDragEndMessage,
    wire.SceneNodeClickMessage,
    wire.GetRenderResponseMessage,
    wire.LocalStorageGetItemResponseMessage,
    wire.FileTransferStartUpload,
    wire.FileTransferPart,
)
"""Left out above all: ``ShareUrlRequest``, which opens a public tunnel."""
_READER = MessageReader(ALLOWED)


class Tally:
    """Counts refusals by reason, and logs the 1st, 10th, 100th … of each: a flood must not fill the log."""

    def __init__(self) -> None:
        self._is_open = False
        self._counts: Counter[str] = Counter()
        self._lock = threading.Lock()

    def open(self) -> None:
        """Start counting: what is refused before are the guard's own probes."""
        self._is_open = True

    def refuse(self, reason: str) -> None:
        """Count one refusal; ``reason`` is a few fixed words, nothing that the client sent."""
        if not self._is_open:
            return
        with self._lock:
            self._counts[reason] += 1
            count = self._counts[reason]
        if str(count).strip("0") == "1":
            LOG.warning("refused: %s (%d so far)", reason, count)

    @property
    def counts(self) -> dict[str, int]:
        """How often each reason was given, as a copy."""
        with self._lock:
            return dict(self._counts)


class FloodGauge:
    """Counts frames against an allowance: a bucket that fills with time and empties with frames.

    A busy page sends some 100 frames a second (50 ms throttle a panel, camera, held buttons); the largest
    upload costs 64 units. Refused frames cost more, since the page of armctl itself hardly ever sends one.
    """

    CAPACITY = 2000.0
    REFILL_PER_S = 500.0
    BYTES_PER_UNIT = 16 << 10
    PRICE_OF_A_REFUSAL = 10.0

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._level = self.CAPACITY
        self._at_s = now_s()

    def charge(self, size_bytes: int, *, refused: bool) -> bool:
        """Charge one frame; False when the allowance is used up and the connection is to be closed."""
        now_s = self._now_s()
        self._level = min(self.CAPACITY, self._level + self.REFILL_PER_S * (now_s - self._at_s))
        self._at_s = now_s
        self._level -= 1.0 + size_bytes / self.BYTES_PER_UNIT + (self.PRICE_OF_A_REFUSAL if refused else 0.0)
        return self._level >= 0.0


class UploadLedger:
    """What one page is uploading, so that it cannot fill the memory: viser keeps every part that arrives.

    A page sends the parts of a file that is too large in one go, even after the refusal. The ledger counts
    them, so that a user who picked the wrong file reads so, and is not taken for one who floods.
    """

    MOST_AT_ONCE = 2
    MOST_LEFTOVER_PARTS = (1 << 30) // UPLOAD_PART_BYTES

    def __init__(self) -> None:
        self._missing: dict[str, set[int]] = {}
        """parts still to come, by transfer"""
        self._too_large: dict[str, int] = {}
        """number of parts still to come, by transfer"""

    def reason_against(self, start: wire.FileTransferStartUpload, most: int = MAX_UPLOAD_BYTES) -> str | None:
        """Note a new file of at most so many bytes; why it is refused, if so."""
        size, transfer = start.size_bytes, start.transfer_uuid
        parts = -(-size // UPLOAD_PART_BYTES)
        if size > most:
            if len(self._too_large) < self.MOST_AT_ONCE:
                self._too_large[transfer] = min(parts, self.MOST_LEFTOVER_PARTS)
            return "an upload that is too large"
        too_many = len(self._missing) >= self.MOST_AT_ONCE and parts > 0
        if start.part_count != parts or size < 0 or transfer in self._missing or too_many:
            return "an upload that contradicts itself"
        if parts:
            self._missing[transfer] = set(range(parts))
        return None

    def is_leftover(self, part: wire.FileTransferPart) -> bool:
        """Tell whether a part belongs to a file that was too large; each of them counts once."""
        left = self._too_large.pop(part.transfer_uuid, 0)
        if left > 1:
            self._too_large[part.transfer_uuid] = left - 1
        return left > 0 and len(part.content) <= UPLOAD_PART_BYTES

    def continues(self, part: wire.FileTransferPart) -> bool:
        """Note a part; False unless it is one that is still to come."""
        missing = self._missing.get(part.transfer_uuid, set())
        if part.part_index not in missing or len(part.content) > UPLOAD_PART_BYTES:
            return False
        missing.remove(part.part_index)
        if not missing:
            del self._missing[part.transfer_uuid]
        return True


class FrameFilter:
    """Judges the frames of one connection, in their order."""

    def __init__(
        self, tally: Tally, now_s: Callable[[], float], client: Callable[[], viser.ClientHandle | None]
    ) -> None:
        """``client`` gives the page as viser knows it, once the page has introduced itself."""
        self._tally, self._client = tally, client
        self._gauge = FloodGauge(now_s)
        self._uploads = UploadLedger()
        self._told: viser.NotificationHandle | None = None
        """the newest refusal of a value"""
        self.flooded = False
        """Whether the page has sent more than it may; nothing more is admitted then."""

    def admits(self, raw: str | bytes) -> bool:
        """Tell whether viser may see this frame; refusals are counted."""
        if self.flooded:
            return False
        dropped, size, cost = False, len(raw), len(raw)
        try:
            message = _READER.read(raw)
            if isinstance(message, wire.FileTransferPart) and self._uploads.is_leftover(message):
                dropped, cost = True, 0
            elif isinstance(message, wire.GuiFormDirtyMessage):
                dropped = True  # viser would keep it for ever, for all pages; nobody here asks for it
            reason = None if dropped else self._reason_against(message, size)
        except Exception:  # the fields of a message may be of any type
            reason = "no message of a page"
        if reason is not None:
            self._tally.refuse(reason)
        if not self._gauge.charge(cost, refused=reason is not None):
            self.flooded = True
            self._tally.refuse("too many messages")
        return reason is None and not dropped and not self.flooded

    def _reason_against(self, message: wire.Message | None, size: int) -> str | None:
        if message is None:
            return "a message of another type"
        if isinstance(message, wire.FileTransferPart):
            return None if self._uploads.continues(message) else "a part of no upload under way"
        if isinstance(message, wire.GetRenderResponseMessage):
            return None
        if size > _MAX_PLAIN_BYTES:
            return "a message that is too large"
        if isinstance(message, wire.GuiUpdateMessage) and message.updates.keys() != {"value"}:
            return "setting something else than a value"
        if isinstance(message, wire.ViewerCameraMessage) and not _is_finite(message):
            return "a camera that is nowhere"  # the page could not be built
        client = self._client()
        control = None if client is None else control_of(client, message)
        if control is not None and (control.disabled or not control.visible):
            return "a control that is disabled or hidden"  # the page greys it out, but sends all the same
        if isinstance(message, wire.GuiUpdateMessage) and not _fits(control, message.updates["value"]):
            if client is not None and isinstance(control, viser.GuiSliderHandle):
                self._refuse_value(client, control, message.updates["value"])
            return "a value that the control cannot take"
        if not isinstance(message, wire.FileTransferStartUpload):
            return None
        if client is None or not isinstance(control, viser.GuiUploadButtonHandle):
            return "an upload to what is no upload button"
        most = MAX_ARM_BYTES if ".zip" in control.mime_type else MAX_UPLOAD_BYTES
        if message.size_bytes > most:
            _refuse_upload(client, message, most)
        return self._uploads.reason_against(message, most)

    def _refuse_value(self, client: viser.ClientHandle, slider: Any, value: object) -> None:
        """Say that a number typed beside a slider is not taken, and show the one in force again."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return
        if min(0.0, slider.min) <= value <= max(0.0, slider.max):
            return  # "2" on the way to "20": another digit may make it fit
        if self._told is not None:
            self._told.remove()
        kept = slider.value
        self._told = client.add_notification(
            "Refused",
            f"{slider.label}: {value:g} is outside {slider.min:g} … {slider.max:g}; it stays {kept:g}.",
            color="red",
            auto_close_seconds=8.0,
        )
        slider.value = slider.min if kept != slider.min else slider.max  # what is the same is not sent
        slider.value = kept


def _refuse_upload(client: viser.ClientHandle, start: wire.FileTransferStartUpload, most: int) -> None:
    """Tell the page that the file is too large; it takes the file for sent, and can send another one."""
    acknowledge_all(client, start)
    client.add_notification(
        "Upload refused",
        f"{start.filename[:100]} was not taken: it has {start.size_bytes / 2**20:.1f} MiB, "
        f"the largest that is taken has {most / 2**20:.0f} MiB.",
        color="red",
        auto_close_seconds=12.0,
    )


def _fits(control: Any, value: object) -> bool:
    """Tell whether a list offers a value, and a slider has it; viser casts all others to their type.

    Callbacks look up what a list gives, and viser's page sends each digit that is typed beside a slider.
    """
    if (options := getattr(control, "options", None)) is not None:
        return value in options
    if not isinstance(control, viser.GuiSliderHandle):
        return True  # a number field may leave its range: its screen says so
    slack = 1e-6 * (control.max - control.min)  # the page rounds to its digits
    return isinstance(value, int | float) and control.min - slack <= value <= control.max + slack


def _is_finite(camera: wire.ViewerCameraMessage) -> bool:
    numbers = (camera.fov, camera.near, camera.far)
    places = (camera.position, camera.look_at, camera.up_direction, camera.wxyz)
    return all(map(math.isfinite, (*numbers, *chain(*places))))


# One connection: the HTTP method of its request, and the frames that it lets through.


_REFUSED_METHODS = frozenset((b"POST", b"PUT", b"DELETE", b"PATCH", b"OPTIONS", b"TRACE", b"CONNECT"))
_LONGEST_METHOD = 7
_METHOD_NOT_ALLOWED = (
    b"HTTP/1.1 405 Method Not Allowed\r\nAllow: GET, HEAD\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
)


class GuardedConnection(ServerConnection):
    """Drops bad frames and keeps the connection; a page that floods is disconnected (1008)."""

    def __init__(
        self,
        protocol: ServerProtocol,
        server: Server,
        *,
        client_of: Callable[[ServerConnection], viser.ClientHandle | None],
        tally: Tally,
        **options: Any,
    ) -> None:
        super().__init__(protocol, server, **options)
        self._tally = tally
        self._filter = FrameFilter(tally, self.loop.time, lambda: client_of(self))
        self._begin: bytes | None = b""
        """what has come of a request whose method is not known yet"""
        self._refused = False
        self.head_only = False
        """whether the request is HEAD: the answer is that to GET, without its body"""
        self.handed_over = False
        self.docs_path: str | None = None
        """path of the documentation that the door let it in to"""
        self.socket_path: str | None = None
        """path of the armctl socket that the door let it in to; None for viser's page"""

    def hand_over(self, give: Callable[[socket.socket, bytes], bool], request: Request) -> bool:
        """Have another process go on with this connection; whether it does."""
        if self.transport.get_extra_info("sslcontext") is not None:
            return False  # what it is encrypted with cannot be handed over
        line = self.transport.get_extra_info("socket")
        with socket.fromfd(line.fileno(), line.family, line.type) as copy:
            if not give(copy, request.serialize()):
                return False
        self.handed_over = True
        self.transport.abort()  # our own copy; nothing is sent on it
        return True

    def data_received(self, data: bytes) -> None:
        """Read the method first: ``websockets`` knows GET alone and hangs up on everything else."""
        if self._begin is not None:
            data = self._begin + data
            method, space, rest = data.partition(b" ")
            if not space and len(data) <= _LONGEST_METHOD:
                self._begin = data
                return
            self._begin = None
            if method == b"HEAD" and space:
                self.head_only, data = True, b"GET " + rest
            elif method in _REFUSED_METHODS:
                self._refused = True
                self._tally.refuse("another method than GET and HEAD")
                self.transport.write(_METHOD_NOT_ALLOWED)
        if not self._refused:  # else it is the rest of the request; the client hangs up, or is timed out
            super().data_received(data)

    async def recv(self, decode: bool | None = None) -> Any:
        """Receive the next frame, for viser the next admissible one; see ``websockets``."""
        while True:
            raw = await super().recv(decode)
            if self.socket_path is not None or self._filter.admits(raw):
                return raw
            if self._filter.flooded:
                await self.close(CloseCode.POLICY_VIOLATION, "too many messages")
