"""Messages on a page: each once, few at a time, gone by themselves."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from armctl.errors import InputError, UnreachableError
from armctl.ui.docs import page_of_error
from armctl.ui.events import Color, Notifications, reading_seconds
from armctl.ui.guard.parts import Parts


class Board:
    """Keeps what is shown, oldest first, and for how long; it never closes anything by itself."""

    def __init__(self) -> None:
        self.shown: list[str] = []
        self.seconds: list[float] = []

    def add_notification(
        self, title: str, body: str, *, auto_close_seconds: float, color: Color
    ) -> SimpleNamespace:
        text = f"{color} {title}: {body}"
        self.shown.append(text)
        self.seconds.append(auto_close_seconds)
        impl = SimpleNamespace(uuid=f"n{len(self.seconds)}")
        return SimpleNamespace(remove=lambda: self.shown.remove(text), _impl=impl)


def test_a_message_takes_the_place_of_its_like_or_of_the_oldest_and_closes_by_itself() -> None:
    board = Board()
    notices = Notifications(board, Parts())
    for text in ("enable first", "home first", "enable first"):
        notices.show("Refused", text, "red")
    assert board.shown == ["red Refused: home first", "red Refused: enable first"]
    assert len(board.seconds) == 3  # shown anew, so that its time begins anew
    for text in ("three", "four"):
        notices.show("Saved", text, "blue")
    assert board.shown == ["red Refused: enable first", "blue Saved: three", "blue Saved: four"]
    board = Board()
    Notifications(board, Parts()).show("Refused", "enable first", "red")
    assert board.seconds == [reading_seconds("enable first", "red")]
    assert 0 < reading_seconds("a.toml", "blue") < reading_seconds("a.toml", "yellow") < 60
    long = "it cannot go there. " * 20
    assert reading_seconds("short", "red") < reading_seconds(long, "red") < 60


def test_a_refusal_with_a_page_in_the_docs_links_there_as_long_as_it_is_shown() -> None:
    parts = Parts()
    notices = Notifications(Board(), parts)
    for error in (UnreachableError("too far"), InputError("not finite")):
        notices.show("Refused", str(error), "red", page_of_error(error))
    link = parts["notification n1"]
    assert 'href="/docs/troubleshooting/#the-target-is-out-of-reach"' in link
    assert 'target="_blank" rel="noopener"' in link
    with pytest.raises(KeyError):
        parts["notification n2"]  # no page is about it
    for text in ("two", "three"):
        notices.show("Saved", text, "blue", '/docs/"<&')
    assert "&quot;&lt;&amp;" in parts["notification n3"]
    with pytest.raises(KeyError):
        parts["notification n1"]  # gone with the oldest notification
