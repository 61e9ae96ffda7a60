"""What one page is told in passing: the newest few messages, each once."""

from __future__ import annotations

import math
from typing import Literal, Protocol

Color = Literal["blue", "yellow", "red"]
_MOST = 3
"""so many at a time: they lie over the scene, and what is older answers an older click"""
_READ_S = {"blue": 5.0, "yellow": 10.0, "red": 10.0}
"""the least that one stays: information may be missed, a refusal has to be read"""
_LETTERS_A_SECOND = 12


class Removable(Protocol):
    """One message on the page."""

    def remove(self) -> None:
        """Take it away, if the page has not done so by itself."""
        ...


class NoticeBoard(Protocol):
    """Where they are shown: viser's client."""

    def add_notification(
        self, title: str, body: str, *, auto_close_seconds: float, color: Color
    ) -> Removable:
        """Show one for so many seconds, or until it is clicked away."""
        ...


class Notices:
    """Shows messages that go away by themselves.

    The same message again takes the place of the first, and its time begins anew; one too many takes the
    place of the oldest. What has to be known for longer is in the log and in the Control panel.
    """

    def __init__(self, board: NoticeBoard) -> None:
        self._board = board
        self._shown: dict[tuple[str, str, Color], Removable] = {}

    def show(self, title: str, text: str, color: Color) -> None:
        """Show a message for as long as it takes to read it."""
        key = (title, text, color)
        if (same := self._shown.pop(key, None)) is not None:
            same.remove()
        while len(self._shown) >= _MOST:
            self._shown.pop(next(iter(self._shown))).remove()
        self._shown[key] = self._board.add_notification(
            title, text, auto_close_seconds=reading_seconds(text, color), color=color
        )


def reading_seconds(text: str, color: Color) -> float:
    """How long a message stays [s]."""
    return max(_READ_S[color], math.ceil(len(text) / _LETTERS_A_SECOND))
