"""What one page is uploading, so that it cannot send more than it announced.

viser keeps every part that arrives in memory, adds up no sizes before the end, and looks up a transfer
by its id alone: without this ledger a page could fill the memory, or add parts to another page's file.

A page sends the parts of a file that is too large in one go, whatever it is told: the ledger knows them, so
that somebody who took the wrong file is told so, and not taken for one who floods.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from armctl.ui.guard.messages import MAX_UPLOAD_BYTES, UPLOAD_PART_BYTES, UploadPart, UploadStart

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
