"""What viser's pages say: the messages of its protocol, and the controls that they are for."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, cast

import msgspec
import viser
from viser._messages import (
    CommandTriggerMessage,
    FileTransferPart,
    FileTransferPartAck,
    FileTransferStartUpload,
    GetRenderResponseMessage,
    GuiButtonHoldMessage,
    GuiFormDirtyMessage,
    GuiFormSubmitMessage,
    GuiUpdateMessage,
    LocalStorageGetItemResponseMessage,
    Message,
    SceneNodeClickMessage,
    TransformControlsDragEndMessage,
    TransformControlsDragStartMessage,
    TransformControlsUpdateMessage,
    ViewerCameraMessage,
)

__all__ = [
    "UPLOAD_PART_BYTES",
    "CommandTriggerMessage",
    "FileTransferPart",
    "FileTransferStartUpload",
    "GetRenderResponseMessage",
    "GuiButtonHoldMessage",
    "GuiFormDirtyMessage",
    "GuiFormSubmitMessage",
    "GuiUpdateMessage",
    "LocalStorageGetItemResponseMessage",
    "Message",
    "MessageReader",
    "SceneNodeClickMessage",
    "TransformControlsDragEndMessage",
    "TransformControlsDragStartMessage",
    "TransformControlsUpdateMessage",
    "ViewerCameraMessage",
    "acknowledge_all",
    "control_of",
]

UPLOAD_PART_BYTES = 512 << 10
"""The page cuts a file in parts of this size (``chunkSize`` in viser's UploadButton.tsx)."""


class _Envelope(msgspec.Struct):
    type: str


class MessageReader:
    """Decodes frames as viser does, each field checked against its type: viser lets most of them pass.

    Holds: the dataclasses of ``viser._messages``, which msgpack maps with their name as ``type``, and
    ``Message.deserialize``.
    """

    def __init__(self, kinds: Iterable[type[Message]]) -> None:
        """``kinds``: of messages that may come."""
        self._decoders = {kind.__name__: msgspec.msgpack.Decoder(kind) for kind in kinds}

    def read(self, raw: str | bytes) -> Message | None:
        """The message of a frame.

        None for one of another kind; an exception of any kind where a field is of a wrong type or viser could
        not read the frame.
        """
        if isinstance(raw, str):
            raise TypeError("viser's pages send binary frames only")
        decoder = self._decoders.get(msgspec.msgpack.decode(raw, type=_Envelope).type)
        if decoder is None:
            return None
        decoder.decode(raw)
        return cast(Message, Message.deserialize(raw))


def control_of(client: viser.ClientHandle, message: Message) -> Any:
    """The control of this page that a message is for, by its handle; None: there is none.

    Holds: ``GuiApi._gui_input_handle_from_uuid``, and the fields ``uuid`` and ``source_component_uuid``.
    """
    fields = vars(message)
    table = client.gui._gui_input_handle_from_uuid  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
    return table.get(fields.get("uuid", fields.get("source_component_uuid", "")))


def acknowledge_all(client: viser.ClientHandle, start: FileTransferStartUpload) -> None:
    """Have the page take a file for sent, so that it can send another one.

    Holds: ``GuiApi._websock_interface.queue_message`` and ``FileTransferPartAck``, the answer to a last part.
    """
    size = start.size_bytes
    done = FileTransferPartAck(start.source_component_uuid, start.transfer_uuid, size, size)
    client.gui._websock_interface.queue_message(done)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
