"""Which frames of one page are let through to viser."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeGuard

import viser
from viser import (
    GuiApi,
    GuiButtonGroupHandle,
    GuiButtonHandle,
    GuiCheckboxHandle,
    GuiDropdownHandle,
    GuiFormHandle,
    GuiMultiSliderHandle,
    GuiNumberHandle,
    GuiRgbaHandle,
    GuiRgbHandle,
    GuiSliderHandle,
    GuiTextHandle,
    GuiUploadButtonHandle,
    GuiVector2Handle,
    GuiVector3Handle,
)
from viser._messages import FileTransferPartAck
from websockets.asyncio.server import ServerConnection

from armctl.ui.guard.messages import (
    MAX_UPLOAD_BYTES,
    UPLOAD_PART_BYTES,
    Admissible,
    ButtonHold,
    Camera,
    CommandTrigger,
    FormDirty,
    FormSubmit,
    GuiUpdate,
    MessageDecoder,
    UploadPart,
    UploadStart,
    Value,
)

# How much one page may send: a bucket that fills with time and empties with frames.

_CAPACITY = 2000.0
_REFILL_PER_S = 500.0
_BYTES_PER_UNIT = 16 << 10
_PRICE_OF_A_REFUSAL = 10.0


class FloodGauge:
    """Counts frames against an allowance.

    A busy page sends some 100 frames a second (50 ms throttle a panel, camera, held buttons); an upload of
    8 MiB costs 512 units. Refused frames are dear, since the page of armctl itself hardly ever sends one.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._level = _CAPACITY
        self._at_s = now_s()

    def charge(self, size_bytes: int, *, refused: bool) -> bool:
        """Charge one frame; False when the allowance is used up and the connection is to be closed."""
        now_s = self._now_s()
        self._level = min(_CAPACITY, self._level + _REFILL_PER_S * (now_s - self._at_s))
        self._at_s = now_s
        self._level -= 1.0 + size_bytes / _BYTES_PER_UNIT + (_PRICE_OF_A_REFUSAL if refused else 0.0)
        return self._level >= 0.0


# What one page is uploading, so that it cannot send more than it announced.
#
# viser keeps every part that arrives in memory, adds up no sizes before the end, and looks up a transfer
# by its id alone: without this ledger a page could fill the memory, or add parts to another page's file.
#
# A page sends the parts of a file that is too large in one go, whatever it is told: the ledger knows them, so
# that somebody who took the wrong file is told so, and not taken for one who floods.

_MOST_AT_ONCE = 2


@dataclass
class _Transfer:
    start: UploadStart
    received: dict[int, int] = field(default_factory=dict[int, int])


class UploadLedger:
    """The transfers of one connection."""

    def __init__(self) -> None:
        self._open: dict[str, _Transfer] = {}
        self._too_large: dict[str, int] = {}  # how many parts are still to come

    def starts(self, message: UploadStart) -> bool:
        """Note a new transfer; False when it contradicts itself or too many are under way."""
        parts = -(-message.size_bytes // UPLOAD_PART_BYTES)
        if message.part_count != parts or message.transfer_uuid in self._open:
            return False
        if parts == 0:  # an empty file: viser finishes it at once, no part will come
            return True
        if len(self._open) >= _MOST_AT_ONCE:
            return False
        self._open[message.transfer_uuid] = _Transfer(message)
        return True

    def is_too_large(self, message: UploadStart) -> bool:
        """Tell whether the file is too large, and note which parts of it will come."""
        if message.size_bytes <= MAX_UPLOAD_BYTES:
            return False
        if len(self._too_large) < _MOST_AT_ONCE:
            self._too_large[message.transfer_uuid] = -(-message.size_bytes // UPLOAD_PART_BYTES)
        return True

    def is_leftover(self, message: UploadPart) -> bool:
        """Tell whether a part belongs to a file that was too large; each of them counts once."""
        left = self._too_large.pop(message.transfer_uuid, 0)
        if left > 1:
            self._too_large[message.transfer_uuid] = left - 1
        return left > 0

    def continues(self, message: UploadPart) -> bool:
        """Note a part; False unless it belongs to an open transfer and is exactly the part announced."""
        transfer = self._open.get(message.transfer_uuid)
        if transfer is None or transfer.start.source_component_uuid != message.source_component_uuid:
            return False
        start, index = transfer.start, message.part_index
        if index >= start.part_count or index in transfer.received:
            return False
        if len(message.content) != min(UPLOAD_PART_BYTES, start.size_bytes - index * UPLOAD_PART_BYTES):
            return False
        transfer.received[index] = len(message.content)
        if len(transfer.received) == start.part_count:
            del self._open[message.transfer_uuid]
        return True


# Whether a control of the page can take the value that a page sends for it.
#
# viser casts a value to the type of the present one and hands it to the callbacks: a string becomes
# ``True`` in a checkbox, a slider leaves its range, a disabled button is pressed. A *number field* is let
# through outside its range on purpose: the page itself sends such values while the user types, and the
# screen must be able to say "150 is outside" instead of going on with the digits that were inside.

_CLASSES = (
    GuiButtonHandle,
    GuiUploadButtonHandle,
    GuiCheckboxHandle,
    GuiTextHandle,
    GuiButtonGroupHandle,
    GuiDropdownHandle,
    GuiSliderHandle,
    GuiNumberHandle,
    GuiMultiSliderHandle,
    GuiVector2Handle,
    GuiVector3Handle,
    GuiRgbHandle,
    GuiRgbaHandle,
)
Operable = (
    GuiButtonHandle
    | GuiUploadButtonHandle
    | GuiCheckboxHandle
    | GuiTextHandle
    | GuiButtonGroupHandle
    | GuiDropdownHandle[Any]
    | GuiSliderHandle[Any]
    | GuiNumberHandle[Any]
    | GuiMultiSliderHandle[Any]
    | GuiVector2Handle
    | GuiVector3Handle
    | GuiRgbHandle
    | GuiRgbaHandle
)
"""The controls that a page can operate; a progress bar, for one, is not among them."""


def is_operable(handle: object) -> TypeGuard[Operable]:
    """Tell whether a handle of viser is a control that a page can operate."""
    return isinstance(handle, _CLASSES)


def is_usable(control: Operable) -> bool:
    """Tell whether the user could operate the control: the page greys it out, but sends all the same."""
    return control.visible and not control.disabled


def accepts(control: Operable, value: Value) -> bool:
    """Tell whether the control can hold this value.

    Args:
        control: the addressed control.
        value: what the page sent.
    """
    match control:
        case GuiButtonHandle():
            return value is True
        case GuiCheckboxHandle():
            return isinstance(value, bool)
        case GuiTextHandle():
            return isinstance(value, str)
        case GuiButtonGroupHandle() | GuiDropdownHandle():
            return isinstance(value, str) and value in control.options
        case GuiNumberHandle():
            return _is_number_like(control.value, value)
        case GuiSliderHandle():
            return _is_number_like(control.value, value) and _is_within(value, control.min, control.max)
        case GuiMultiSliderHandle():
            return _are_numbers_like(control.value, value) and all(
                _is_within(part, control.min, control.max) for part in _parts(value)
            )
        case GuiVector2Handle() | GuiVector3Handle():
            return _are_numbers_like(control.value, value)
        case GuiRgbHandle() | GuiRgbaHandle():
            return _are_numbers_like(control.value, value) and all(0 <= part <= 255 for part in _parts(value))
        case GuiUploadButtonHandle():
            return False


def _is_number_like(present: object, value: object) -> bool:
    """Tell whether ``value`` is a number that needs no rounding to take the place of ``present``."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return not isinstance(present, int) or float(value).is_integer()


def _are_numbers_like(present: tuple[float, ...], value: Value) -> bool:
    """Tell whether ``value`` has the components of ``present``, each a number of the same kind."""
    return (
        isinstance(value, tuple)
        and len(value) == len(present)
        and all(_is_number_like(old, new) for old, new in zip(present, value, strict=True))
    )


def _is_within(value: Value, low: float, high: float) -> bool:
    """Tell whether a slider can show the value; the page's rounding to its digits is let pass."""
    slack = 1e-6 * abs(high - low)
    return isinstance(value, int | float) and low - slack <= value <= high + slack


def _parts(value: Value) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else ()


# Where the guard looks into viser's own tables: what does a message address?
#
# The only file, apart from ``serving``, that touches viser's private parts (1.1.1).

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


# How often the guard refused what.

LOG = logging.getLogger("armctl.ui.guard")


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
        """Count one refusal.

        Args:
            reason: a few fixed words; nothing that the client sent, since it ends up in the log.
        """
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


class FrameFilter:
    """Judges the frames of one connection, in their order."""

    def __init__(self, addressees: Addressees, tally: Tally, now_s: Callable[[], float]) -> None:
        self._addressees = addressees
        self._tally = tally
        self._decoder = MessageDecoder()
        self._gauge = FloodGauge(now_s)
        self._uploads = UploadLedger()
        self._introduced = False
        self.flooded = False
        """Whether the page has sent more than it may; nothing more is admitted then."""

    def admits(self, raw: str | bytes) -> bool:
        """Tell whether viser may see this frame; refusals are counted.

        Args:
            raw: what the websocket delivered.
        """
        if self.flooded:
            return False
        message = self._decoder.decode(raw)
        if isinstance(message, UploadPart) and self._uploads.is_leftover(message):
            self.flooded = not self._gauge.charge(0, refused=False)
            return False
        reason = "not an admissible message" if message is None else self._reason_against(message)
        if reason is not None:
            self._tally.refuse(reason)
        if not self._gauge.charge(len(raw), refused=reason is not None):
            self.flooded = True
            self._tally.refuse("too many messages")
        return reason is None and not self.flooded

    def _reason_against(self, message: Admissible) -> str | None:
        if isinstance(message, Camera):
            self._introduced = True
            return None
        if not self._introduced:
            # viser would apply the value without calling the callbacks: it has no client to name yet.
            return "a message before the page introduced itself"
        match message:
            case GuiUpdate():
                return self._reason_against_update(message)
            case ButtonHold():
                control = self._addressees.control(message.uuid)
                held = isinstance(control, GuiButtonHandle) and is_usable(control)
                return None if held else "holding what is no usable button"
            case FormSubmit() | FormDirty():
                return None if self._addressees.has_form(message.uuid) else "a form that does not exist"
            case CommandTrigger():
                return None if self._addressees.has_command(message.uuid) else "a command that does not exist"
            case UploadStart():
                control = self._addressees.control(message.source_component_uuid)
                if not (isinstance(control, GuiUploadButtonHandle) and is_usable(control)):
                    return "an upload to what is no usable upload button"
                if self._uploads.is_too_large(message):
                    self._addressees.refuse_upload(message)
                    return "an upload that is too large"
                return None if self._uploads.starts(message) else "an upload that contradicts itself"
            case UploadPart():
                return None if self._uploads.continues(message) else "a part of no upload under way"
            case _:
                return None

    def _reason_against_update(self, message: GuiUpdate) -> str | None:
        control = self._addressees.control(message.uuid)
        if control is None:
            return "a control that does not exist"
        if not is_usable(control):
            return "a control that is disabled or hidden"
        if not accepts(control, message.updates.value):
            return "a value that the control cannot take"
        return None
