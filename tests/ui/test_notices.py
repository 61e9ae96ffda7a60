"""Messages on a page: each once, few at a time, gone by themselves."""

from __future__ import annotations

from dataclasses import dataclass, field

from armctl.ui.session import Color, Notices, reading_seconds


@dataclass(frozen=True)
class Shown:
    board: Board
    text: str

    def remove(self) -> None:
        self.board.shown.remove(self.text)


@dataclass
class Board:
    """Keeps what is shown, oldest first; it never closes anything by itself."""

    shown: list[str] = field(default_factory=list[str])
    seconds: list[float] = field(default_factory=list[float])

    def add_notification(self, title: str, body: str, *, auto_close_seconds: float, color: Color) -> Shown:
        self.shown.append(f"{color} {title}: {body}")
        self.seconds.append(auto_close_seconds)
        return Shown(self, self.shown[-1])


def test_the_same_message_again_takes_the_place_of_the_first() -> None:
    board = Board()
    notices = Notices(board)
    notices.show("Refused", "enable first", "red")
    notices.show("Saved", "a.toml", "blue")
    notices.show("Refused", "enable first", "red")
    assert board.shown == ["blue Saved: a.toml", "red Refused: enable first"]
    assert len(board.seconds) == 3  # shown anew, so that its time begins anew


def test_the_oldest_gives_way_to_a_fourth() -> None:
    board = Board()
    notices = Notices(board)
    for text in ("one", "two", "three", "four"):
        notices.show("Refused", text, "red")
    assert board.shown == ["red Refused: two", "red Refused: three", "red Refused: four"]


def test_every_message_closes_by_itself_and_what_must_be_read_stays_longer() -> None:
    board = Board()
    Notices(board).show("Refused", "enable first", "red")
    assert board.seconds == [reading_seconds("enable first", "red")]
    assert 0 < reading_seconds("a.toml", "blue") < reading_seconds("a.toml", "yellow") < 60
    long = "it cannot go there. " * 20
    assert reading_seconds("short", "red") < reading_seconds(long, "red") < 60
