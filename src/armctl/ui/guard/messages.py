"""The messages that a page may send, each with the exact shape that viser 1.1.1 expects.

Whatever is not listed here never reaches viser: ``ShareUrlRequest`` (opens a public tunnel), every
message that is meant for the other direction, and the drag and pointer messages that armctl does not
use (``SceneNodeDragMessage``, ``ScenePointerMessage``). viser decodes messages without looking at their
types, so a field of the wrong type would surface as a traceback somewhere inside it, or in a callback.
Bounds also keep out NaN and infinity: no comparison with NaN is true.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

MAX_UPLOAD_BYTES = 8 << 20
"""The largest file that a page may upload; programs and robot files are a few kilobytes."""
_LARGEST_FILE = 1 << 40
"""of a larger one not even the announcement is looked at"""

UPLOAD_PART_BYTES = 512 << 10
"""The page cuts a file in parts of this size (``chunkSize`` in viser's UploadButton.tsx)."""
_MOST_PARTS = _LARGEST_FILE // UPLOAD_PART_BYTES

_LARGEST = 1e9

Identifier = Annotated[str, Meta(min_length=1, max_length=64)]
NodeName = Annotated[str, Meta(min_length=1, max_length=256)]
Number = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST)]
Integer = Annotated[int, Meta(ge=-1_000_000_000, le=1_000_000_000)]
Text = Annotated[str, Meta(max_length=4096)]
Pixels = Annotated[int, Meta(ge=0, le=32_768)]
UnitPart = Annotated[float, Meta(ge=-1.001, le=1.001)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[UnitPart, UnitPart, UnitPart, UnitPart]
Components = Annotated[tuple[Integer | Number, ...], Meta(min_length=1, max_length=16)]
Value = bool | Integer | Number | Text | Components
"""What a control of the page may be set to; tuples are vectors, colours and multi-sliders."""


class Message(msgspec.Struct, frozen=True, tag_field="type", forbid_unknown_fields=True):
    """A message from a page; an unknown field is refused because viser would raise ``KeyError``."""


class Camera(Message, frozen=True, tag="ViewerCameraMessage"):
    """Where the page looks from; the first one makes viser call the connect callbacks."""

    wxyz: Quaternion
    position: Vector
    fov: Annotated[float, Meta(gt=0.0, lt=3.1416)]
    near: Annotated[float, Meta(ge=0.0, le=_LARGEST)]
    far: Annotated[float, Meta(ge=0.0, le=_LARGEST)]
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector


class ValueUpdate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The one property that a page may set; viser would set *any*, ``update_cb`` included."""

    value: Value


class GuiUpdate(Message, frozen=True, tag="GuiUpdateMessage"):
    """A control was edited, or a button clicked."""

    uuid: Identifier
    updates: ValueUpdate


class ButtonHold(Message, frozen=True, tag="GuiButtonHoldMessage"):
    """A button is being held; repeated ``frequency`` times a second."""

    uuid: Identifier
    frequency: Annotated[float, Meta(gt=0.0, le=1000.0)]


class FormSubmit(Message, frozen=True, tag="GuiFormSubmitMessage"):
    """Ctrl+Enter inside a form."""

    uuid: Identifier


class FormDirty(Message, frozen=True, tag="GuiFormDirtyMessage"):
    """The first edit inside a form; viser passes it on to every other page."""

    uuid: Identifier


class CommandTrigger(Message, frozen=True, tag="CommandTriggerMessage"):
    """A command of the palette, or its hot key. viser itself refuses the disabled ones."""

    uuid: Identifier


class TransformUpdate(Message, frozen=True, tag="TransformControlsUpdateMessage"):
    """A gizmo in the scene was moved."""

    name: NodeName
    wxyz: Quaternion
    position: Vector
    owner: Annotated[str, Meta(max_length=64)] = ""


class TransformDragStart(Message, frozen=True, tag="TransformControlsDragStartMessage"):
    """A gizmo in the scene was taken hold of."""

    name: NodeName
    owner: Annotated[str, Meta(max_length=64)] = ""


class TransformDragEnd(Message, frozen=True, tag="TransformControlsDragEndMessage"):
    """A gizmo in the scene was let go."""

    name: NodeName
    owner: Annotated[str, Meta(max_length=64)] = ""


class NodeClick(Message, frozen=True, tag="SceneNodeClickMessage"):
    """Something in the scene was clicked. Whether ``instance_index`` exists is for the callback to check."""

    name: NodeName
    instance_index: Annotated[int, Meta(ge=0, le=10_000_000)] | None
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: tuple[Number, Number]
    modifier: Annotated[str, Meta(max_length=32)] | None
    owner: Annotated[str, Meta(max_length=64)] = ""


class RenderResponse(Message, frozen=True, tag="GetRenderResponseMessage"):
    """A picture that the server asked for."""

    payload: bytes
    render_uuid: Identifier


class LocalStorageResponse(Message, frozen=True, tag="LocalStorageGetItemResponseMessage"):
    """A value of the browser's storage that the server asked for; also the heartbeat's answer."""

    value: Annotated[str, Meta(max_length=65_536)] | None
    error: Text | None
    request_uuid: Identifier


class UploadStart(Message, frozen=True, tag="FileTransferStartUpload"):
    """A file is about to come; its name is a bare one: no folder, no control characters."""

    source_component_uuid: Identifier
    transfer_uuid: Identifier
    filename: Annotated[str, Meta(min_length=1, max_length=255, pattern=r"^[^/\\\x00-\x1f\x7f]+\Z")]
    mime_type: Annotated[str, Meta(max_length=255)]
    part_count: Annotated[int, Meta(ge=0, le=_MOST_PARTS)]
    size_bytes: Annotated[int, Meta(ge=0, le=_LARGEST_FILE)]


class UploadPart(Message, frozen=True, tag="FileTransferPart"):
    """One part of a file."""

    source_component_uuid: Identifier
    transfer_uuid: Identifier
    part_index: Annotated[int, Meta(ge=0, le=_MOST_PARTS)]
    content: Annotated[bytes, Meta(max_length=UPLOAD_PART_BYTES)]


Admissible = (
    Camera
    | GuiUpdate
    | ButtonHold
    | FormSubmit
    | FormDirty
    | CommandTrigger
    | TransformUpdate
    | TransformDragStart
    | TransformDragEnd
    | NodeClick
    | RenderResponse
    | LocalStorageResponse
    | UploadStart
    | UploadPart
)


class MessageDecoder:
    """Decodes a frame into one of the admissible messages, or into nothing."""

    def __init__(self) -> None:
        self._decoder: msgspec.msgpack.Decoder[Admissible] = msgspec.msgpack.Decoder(Admissible)

    def decode(self, raw: str | bytes) -> Admissible | None:
        """Decode one frame.

        Args:
            raw: what the websocket delivered; text frames are refused, viser sends only binary ones.

        Returns:
            The message, or None when it is not admissible.
        """
        if isinstance(raw, str):
            return None
        try:
            return self._decoder.decode(raw)
        except (msgspec.MsgspecError, ValueError, RecursionError):
            return None
