"""To whom control goes back, and that it is never taken from anybody."""

from __future__ import annotations

import asyncio
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from armctl.protocol import Control, Party
from armctl.ui import control_return
from armctl.ui.control_return import ControlReturn
from armctl.ui.guard.stop_line import StopLines

ONE, TWO = "browser page 1", "browser page 2"


class FakeLines(StopLines):
    """What pages have said on their lines."""

    def __init__(self) -> None:
        self.linked: dict[str, str] = {}
        self.there: set[str] = set()

    def who_is(self, page: str) -> str | None:
        return self.linked.get(page)

    def page_of(self, who: str | None) -> str | None:
        return next((page for page, name in self.linked.items() if name == who), None)

    def is_there(self, page: str) -> bool:
        return page in self.there


class Server:
    """One server after the other, with one file."""

    def __init__(self, path: Path) -> None:
        self.path, self.now_s, self.lines = path, 0.0, FakeLines()
        self.start()

    def start(self) -> None:
        self.lines.linked.clear()
        self.returning = ControlReturn(self.lines, self.path, lambda: self.now_s)

    def due(self, *pages: str, operator: Party | None = None, locked: bool = False) -> str | None:
        async def ask() -> str | None:
            parties = () if operator is None else (operator,)
            back = self.returning.due(Control(parties=parties, locked=locked), pages)
            for task in asyncio.all_tasks() - {asyncio.current_task()}:
                await task
            return back

        return asyncio.run(ask())


@pytest.fixture
def server(tmp_path: Path) -> Server:
    server = Server(tmp_path / "state" / "operator-8080")
    server.lines.linked["b"] = TWO
    assert server.due(ONE, TWO, operator=Party(TWO, "Ada", True)) is None
    assert stat.S_IMODE(server.path.stat().st_mode) == 0o600
    server.start()
    return server


def test_it_waits_for_who_had_it_and_gives_it_back(server: Server) -> None:
    former = server.returning.former
    assert former is not None and former.words == "Ada"
    server.lines.there.add("b")  # it has knocked, and is being built
    for server.now_s in (0.0, 4.0, 30.0):
        assert server.due(ONE) is None
    server.lines.linked["b"] = TWO
    assert server.due(ONE, TWO) == TWO
    assert server.due(ONE, TWO) is None and server.returning.former is None


def test_who_is_silent_while_its_page_is_loaded_anew_is_waited_for(server: Server) -> None:
    server.lines.there.add("b")
    assert server.due(ONE) is None
    server.lines.there.clear()
    server.now_s = control_return._COMES_S + 0.1
    assert server.due(ONE) is None
    server.now_s = control_return._LOADED_S + 0.1
    assert server.due(ONE) == ONE


def test_who_does_not_come_is_not_waited_for(server: Server) -> None:
    assert server.due(ONE) is None
    server.now_s = control_return._COMES_S + 0.1
    assert server.due(ONE, TWO) == ONE
    assert server.due(ONE, TWO) is None


@pytest.mark.parametrize("others", [{"operator": Party(ONE, ONE, True)}, {"locked": True}])
def test_it_is_never_taken_from_anybody_nor_past_a_lock(server: Server, others: dict[str, object]) -> None:
    server.lines.linked["b"] = TWO
    for server.now_s in (0.0, 100.0):
        assert server.due(ONE, TWO, **others) is None  # pyright: ignore[reportArgumentType]


def test_nobody_is_waited_for_where_the_operator_had_left(server: Server) -> None:
    server.lines.linked["b"] = TWO
    assert server.due(TWO) == TWO
    assert server.due(TWO, operator=Party(TWO, TWO, True)) is None
    assert server.due() is None  # its page was closed
    server.start()
    assert server.returning.former is None and not server.path.exists()


@pytest.mark.parametrize("written", [b"", b"{}", b"\xff", b'{"page": 3}'])
def test_a_file_that_is_no_record_stops_no_start(tmp_path: Path, written: bytes) -> None:
    path = tmp_path / "operator"
    path.write_bytes(written)
    assert ControlReturn(FakeLines(), path).former is None


def silent(server: Server, then: Callable[[], object]) -> str | None:
    """``TWO`` operates, hangs while the arm moves, and answers again."""
    server.lines.linked.update(a=ONE, b=TWO)
    server.due(TWO, operator=Party(TWO, TWO, True))
    server.returning.fell_silent(TWO)
    server.due(TWO, operator=Party(TWO, TWO, True))  # the arm has not heard of it yet
    assert server.due(ONE, TWO) is None  # it hangs still
    then()
    server.lines.there.add("b")
    return server.due(ONE, TWO)


def test_a_page_that_hung_gets_back_what_nobody_operates(server: Server) -> None:
    assert silent(server, lambda: None) == TWO
    assert server.due(ONE, TWO) is None


def test_a_page_that_hung_gets_nothing_once_another_has_operated(server: Server) -> None:
    assert silent(server, lambda: server.due(ONE, TWO, operator=Party(ONE, ONE, True))) is None
