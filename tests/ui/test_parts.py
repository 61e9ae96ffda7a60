"""Parts of the page that armctl draws itself: their line, what is sent on it, what is done there."""

from __future__ import annotations

import asyncio
import json
import queue
import threading
from collections.abc import Iterator
from functools import partial
from typing import Any, cast

import pytest
from tests.ui.guard_kit import PATIENCE_S
from websockets import Origin
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from armctl.ui.guard import GuardedServer, guarded_server
from armctl.ui.guard.parts import MOST_TYPED, PartLines, Parts, page_load

PAGE = "0123456789abcdef"


class WaitingLine:
    """A line of a page that nobody knows, which stays open."""

    async def recv(self) -> str:
        return json.dumps({"page": PAGE, "load": "1"})

    async def wait_closed(self) -> None:
        await asyncio.Event().wait()


def test_a_line_that_waits_leaves_nothing_behind_when_its_server_ends() -> None:
    async def main() -> set[asyncio.Task[Any]]:
        handling = asyncio.create_task(PartLines().handle(cast(Any, WaitingLine())))
        for _ in range(3):  # it waits for its parts, and for its end
            await asyncio.sleep(0)
        handling.cancel()
        await asyncio.wait({handling})
        await asyncio.sleep(0)
        return asyncio.all_tasks() - {cast(asyncio.Task[Any], asyncio.current_task())}

    assert asyncio.run(main()) == set()


def test_what_changes_is_sent_once_however_often_it_has_changed() -> None:
    sent: list[dict[str, str]] = []

    async def main() -> None:
        parts = Parts()
        first, second = asyncio.Event(), asyncio.Event()

        async def send(text: str) -> None:
            sent.append(json.loads(text)["parts"])
            (first if len(sent) == 1 else second).set()

        parts.show("ways", "<b>1</b>")
        parts.show("steps", "none")
        telling = asyncio.create_task(parts.tell(send))
        await first.wait()
        for number in range(5):
            parts.show("ways", f"<b>{number}</b>")
        parts.show("steps", "none")  # it is no other
        await second.wait()
        telling.cancel()

    asyncio.run(main())
    assert sent == [{"ways": "<b>1</b>", "steps": "none"}, {"ways": "<b>4</b>"}]


def test_of_a_long_list_only_rows_that_have_changed_are_sent_and_the_order_where_it_is_another() -> None:
    sent: list[dict[str, dict[str, object]]] = []

    async def main() -> None:
        parts = Parts()
        news = asyncio.Queue[None]()

        async def send(text: str) -> None:
            sent.append(json.loads(text).get("rows", {}))
            news.put_nowait(None)

        parts.rows("steps", [("1", "a"), ("2", "b"), ("3", "c")])
        telling = asyncio.create_task(parts.tell(send))
        await news.get()
        parts.rows("steps", [("1", "a"), ("2", "B"), ("3", "c")])
        await news.get()
        parts.row("steps", "3", "C")
        parts.row("steps", "1", "a")  # it is no other
        await news.get()
        parts.rows("steps", [("3", "C"), ("1", "a"), ("4", "d")])
        parts.row("steps", "4", "D")
        await news.get()
        parts.rows("steps", [("3", "C"), ("1", "a"), ("4", "D")])
        parts.show("head", "so that there is something")
        await news.get()
        telling.cancel()
        assert parts.shown_rows("steps") == {"3": "C", "1": "a", "4": "D"}

    asyncio.run(main())
    assert sent == [
        {"steps": {"order": ["1", "2", "3"], "html": {"1": "a", "2": "b", "3": "c"}}},
        {"steps": {"html": {"2": "B"}}},
        {"steps": {"html": {"3": "C"}}},
        {"steps": {"order": ["3", "1", "4"], "html": {"4": "D"}}},
        {},
    ]


@pytest.fixture
def server() -> Iterator[GuardedServer]:
    server = guarded_server(port=0)
    yield server
    server.stop()


def line(server: GuardedServer) -> ClientConnection:
    here = f"127.0.0.1:{server.get_port()}"
    return connect(f"ws://{here}/page", origin=Origin(f"http://{here}"), ping_interval=None)


def test_each_line_of_a_page_hears_everything() -> None:
    heard: dict[str, list[str]] = {"a": [], "b": []}

    async def main() -> None:
        parts = Parts()
        parts.show("ways", "0")

        async def send(line: str, text: str) -> None:
            heard[line].append(json.loads(text)["parts"]["ways"])

        lines = [asyncio.create_task(parts.tell(partial(send, line))) for line in heard]
        for number in range(1, 4):
            while any(len(one) < number for one in heard.values()):
                await asyncio.sleep(0)
            parts.show("ways", str(number))
        while any(len(one) < 4 for one in heard.values()):
            await asyncio.sleep(0)
        for line in lines:
            line.cancel()

    asyncio.run(main())
    assert heard == {"a": ["0", "1", "2", "3"], "b": ["0", "1", "2", "3"]}


def parts_of(
    server: GuardedServer, html: str, page: str = PAGE, load: str = ""
) -> tuple[Parts, queue.Queue[str]]:
    """Parts that are linked to a page, and the keys of what is chosen there."""
    chosen: queue.Queue[str] = queue.Queue()

    async def make() -> Parts:
        parts = Parts()
        parts.show("ways", html)
        parts.on("way", chosen.put)
        parts.on("end", lambda _: server.part_lines.unlink(parts))
        server.part_lines.link(page, load, parts)
        return parts

    return asyncio.run_coroutine_threadsafe(make(), server.get_event_loop()).result(PATIENCE_S), chosen


def hear(page: ClientConnection) -> dict[str, str]:
    return json.loads(page.recv(timeout=PATIENCE_S))["parts"]


def test_a_line_that_comes_before_its_page_waits_for_it(server: GuardedServer) -> None:
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        _, others = parts_of(server, "of another page", "fedcba9876543210")
        _, chosen = parts_of(server, "mine")
        assert hear(page) == {"ways": "mine"}
        page.send(json.dumps({"do": "nothing", "key": "1"}))  # of a part that has gone
        page.send(json.dumps({"do": "way", "key": "2"}))
        assert chosen.get(timeout=PATIENCE_S) == "2"
        assert others.empty()


def test_a_value_arrives_with_its_key_and_one_that_is_too_long_ends_the_line(server: GuardedServer) -> None:
    parts, _ = parts_of(server, "mine")
    given: queue.Queue[tuple[str, str]] = queue.Queue()
    parts.on_value("set", lambda key, value: given.put((key, value)))
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        hear(page)
        for value in ("12,5", "−3", "", "ü" * MOST_TYPED):
            page.send(json.dumps({"do": "set", "key": "7.1", "value": value}))
            assert given.get(timeout=PATIENCE_S) == ("7.1", value)
        page.send(json.dumps({"do": "set", "key": "7.1", "value": "x" * (MOST_TYPED + 1)}))
        with pytest.raises(ConnectionClosed):
            hear(page)
    assert given.empty()


def test_what_is_shown_says_how_much_of_what_was_done_is_in_it(server: GuardedServer) -> None:
    parts, _ = parts_of(server, "mine")
    after = {1: "1", 2: "2", 3: "2", 4: "4"}
    parts.on("act", lambda key: parts.show("ways", after[int(key)]))
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        assert json.loads(page.recv(timeout=PATIENCE_S))["done"] == 0
        done = 0
        for key in "1234":
            page.send(json.dumps({"do": "act", "key": key}))
        while done < 4:
            said = json.loads(page.recv(timeout=PATIENCE_S))
            done += said["done"]
            assert said["parts"] == {"ways": after[done]}


def test_a_page_with_another_arm_gets_its_parts_on_a_new_line(server: GuardedServer) -> None:
    _, before = parts_of(server, "of one arm")
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        assert hear(page) == {"ways": "of one arm"}
        parts_of(server, "of another arm")
        with pytest.raises(ConnectionClosed):
            hear(page)
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        assert hear(page) == {"ways": "of another arm"}
        page.send(json.dumps({"do": "way", "key": "2"}))
        page.send(json.dumps({"do": "end"}))
        with pytest.raises(ConnectionClosed):  # once all before it is done
            hear(page)
    assert before.empty()


def test_the_same_parts_linked_again_keep_their_line(server: GuardedServer) -> None:
    """First by what the page says where it opens viser's line, then by what it answers there."""
    parts, chosen = parts_of(server, "mine", load="1")
    with line(server) as page:
        page.send(json.dumps({"page": PAGE, "load": "1"}))
        hear(page)
        server.get_event_loop().call_soon_threadsafe(server.part_lines.link, PAGE, "1", parts)
        page.send(json.dumps({"do": "way", "key": "1"}))
        assert chosen.get(timeout=PATIENCE_S) == "1"


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/?page=0f&load=1.2", ("0f", "1.2")),
        ("/?load=1&page=0f&token=x", ("0f", "1")),
        ("/", None),
        ("/?page=0f", None),
        ("/?page=&load=1", None),
        (f"/?page={'0' * 129}&load=1", None),
        (f"/?page=0f&load=1&{'x' * 10_000}", None),
    ],
)
def test_what_a_path_says_of_its_page(path: str, said: tuple[str, str] | None) -> None:
    assert page_load(path) == said


def test_a_page_that_is_loaded_anew_presses_nothing_of_the_one_before(server: GuardedServer) -> None:
    """The server has not heard yet that the old one has gone; its end would stop what was begun there."""
    _, before = parts_of(server, "of the old page", load="1")
    with line(server) as old:
        old.send(json.dumps({"page": PAGE, "load": "1"}))
        assert hear(old) == {"ways": "of the old page"}
    with line(server) as again:  # the same page, whose line was lost
        again.send(json.dumps({"page": PAGE, "load": "1"}))
        assert hear(again) == {"ways": "of the old page"}
    with line(server) as new:
        new.send(json.dumps({"page": PAGE, "load": "2"}))
        new.send(json.dumps({"do": "way", "key": "1"}))
        _, chosen = parts_of(server, "of the new page", load="2")
        assert hear(new) == {"ways": "of the new page"}
        assert chosen.get(timeout=PATIENCE_S) == "1" and before.empty()


def test_a_line_of_a_page_that_has_gone_keeps_no_other_from_its_parts(server: GuardedServer) -> None:
    """After a restart of the server an old page knocks, too, before it is loaded anew."""
    with line(server) as old, line(server) as new:
        old.send(json.dumps({"page": PAGE, "load": "1"}))  # it never says that it goes
        new.send(json.dumps({"page": PAGE, "load": "2"}))
        parts_of(server, "of the new page", load="2")
        assert hear(new) == {"ways": "of the new page"}
        parts_of(server, "of another arm", load="2")
        with pytest.raises(ConnectionClosed):
            hear(new)
    with line(server) as new:
        new.send(json.dumps({"page": PAGE, "load": "2"}))
        assert hear(new) == {"ways": "of another arm"}


def test_a_line_that_waits_keeps_no_server_from_ending(server: GuardedServer) -> None:
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        page.ping().wait(PATIENCE_S)
        ended = threading.Thread(target=server.stop)
        ended.start()
        with pytest.raises(ConnectionClosed):
            hear(page)
        ended.join()
    assert server.get_event_loop().is_closed()


def test_what_is_still_being_done_keeps_no_server_from_ending(server: GuardedServer) -> None:
    parts, _ = parts_of(server, "mine")
    begun = threading.Event()

    async def wait_for_the_arm(_: str) -> None:
        begun.set()
        await asyncio.Event().wait()

    parts.on("go", wait_for_the_arm)
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        hear(page)
        page.send(json.dumps({"do": "go"}))
        assert begun.wait(PATIENCE_S)
        server.stop()
        assert server.get_event_loop().is_closed()
        with pytest.raises(ConnectionClosed):
            hear(page)


def test_the_newer_of_two_lines_with_one_name_is_the_page_s(server: GuardedServer) -> None:
    _, chosen = parts_of(server, "mine")
    with line(server) as old, line(server) as new:
        for page in (old, new):
            page.send(json.dumps({"page": PAGE}))
            assert hear(page) == {"ways": "mine"}
        with pytest.raises(ConnectionClosed):
            hear(old)
        new.send(json.dumps({"do": "way", "key": "1"}))
        assert chosen.get(timeout=PATIENCE_S) == "1"


def test_who_does_too_much_is_disconnected(server: GuardedServer) -> None:
    _, chosen = parts_of(server, "mine")
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        hear(page)
        with pytest.raises(ConnectionClosed):
            for number in range(5000):
                page.send(json.dumps({"do": "way", "key": str(number)}))
            hear(page)
    assert chosen.qsize() < 1000


@pytest.mark.logs_a_defect
def test_parts_that_cannot_be_sent_end_the_line_and_are_logged(
    server: GuardedServer, caplog: pytest.LogCaptureFixture
) -> None:
    parts_of(server, "\ud800")
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        with pytest.raises(ConnectionClosed):
            hear(page)
    assert "the parts of a page could not be sent" in caplog.text


@pytest.mark.parametrize(
    "said", [b'{"do":"\xff"}', '{"go": 1}', "[]", "nothing", '{"do": 5}', json.dumps({"do": "x" * 300})]
)
def test_what_is_no_message_of_a_page_ends_the_line(server: GuardedServer, said: str | bytes) -> None:
    _, chosen = parts_of(server, "mine")
    with line(server) as page:
        page.send(json.dumps({"page": PAGE}))
        hear(page)
        page.send(said)
        with pytest.raises(ConnectionClosed):
            hear(page)
    assert chosen.empty()


def test_a_part_that_is_dropped_before_it_was_sent_is_not_sent() -> None:
    parts, sent = Parts(), []

    async def told() -> None:
        async def send(text: str) -> None:
            sent.append(text)

        parts.show("kept", "<b>one</b>")
        telling = asyncio.create_task(parts.tell(send))
        await asyncio.sleep(0)
        parts.show("gone", "<b>two</b>")
        parts.drop("gone")
        parts.drop("gone")  # it is gone already
        parts.show("kept", "<b>three</b>")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        telling.cancel()

    asyncio.run(told())
    assert "three" in sent[-1] and not any("two" in text for text in sent)
