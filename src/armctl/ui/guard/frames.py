"""Which frames of one page are let through to viser."""

from __future__ import annotations

from collections.abc import Callable

from viser import GuiButtonHandle, GuiUploadButtonHandle

from armctl.ui.guard.flood import FloodGauge
from armctl.ui.guard.handles import Addressees
from armctl.ui.guard.messages import (
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
)
from armctl.ui.guard.tally import Tally
from armctl.ui.guard.uploads import UploadLedger
from armctl.ui.guard.values import accepts, is_usable


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
