"""A text field of the page, as all fields use it that read more than text from it."""

from __future__ import annotations

import viser


class TextEntry:
    """Whatever the field shows arrives at the server, character by character."""

    def __init__(self, handle: viser.GuiInputHandle[str]) -> None:
        self.handle = handle

    @property
    def text(self) -> str:
        """What the field shows."""
        return self.handle.value

    @property
    def is_empty(self) -> bool:
        """Nothing is in it."""
        return not self.text.strip()

    def send_again(self) -> None:
        """Make the page show what the server has."""
        text = self.handle.value
        self.handle.value = f"{text} "  # viser sends nothing when the value is the same
        self.handle.value = text

    @property
    def visible(self) -> bool:
        """Whether the field is shown."""
        return self.handle.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if self.handle.visible != visible:
            self.handle.visible = visible
