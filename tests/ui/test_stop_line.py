"""The line for STOP: who may speak on it, what it says, and when a page counts as silent."""

from __future__ import annotations

import json
import queue
import ssl
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.ui.guard_kit import PATIENCE_S
from tests.ui.tls_files import CERTIFICATE, KEY
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from armctl.ui.guard import GuardedServer, encryption, guarded_server
from armctl.ui.guard.stop_line import Heartbeats

LIMIT_S = 0.9
PAGE, OTHER = "page", "other"


def heard_until(heartbeats: Heartbeats, begin_s: float, end_s: float) -> list[float]:
    """When a page is reported, with a check every 25 ms."""
    times = [begin_s + 0.025 * n for n in range(round((end_s - begin_s) / 0.025) + 1)]
    return [time for time in times if heartbeats.overdue(time) is not None]


@pytest.fixture
def watching() -> Heartbeats:
    heartbeats = Heartbeats(LIMIT_S)
    heartbeats.watch(PAGE, 0.0)
    assert heard_until(heartbeats, 0.0, 0.0) == []
    return heartbeats


def test_silence_is_reported_within_a_second_and_again_while_it_lasts(watching: Heartbeats) -> None:
    watching.beat(PAGE, 0.2)
    watching.watch(PAGE, 0.6)  # told again and again: no sign of life
    assert heard_until(watching, 0.025, 2.0) == pytest.approx([1.125, 1.625], abs=0.03)
    watching.beat(PAGE, 2.0)
    assert heard_until(watching, 2.0, 2.9) == []
    assert len(heard_until(watching, 2.925, 3.0)) == 1


def test_another_page_is_no_sign_of_life_and_a_new_operator_has_its_own_time(watching: Heartbeats) -> None:
    watching.beat(OTHER, 0.8)
    assert heard_until(watching, 0.025, 0.95)[:1] == pytest.approx([0.925])
    watching.watch(OTHER, 1.0)
    assert heard_until(watching, 0.975, 1.9) == []
    assert watching.overdue(1.925) == OTHER
    watching.watch(None, 2.0)
    assert heard_until(watching, 1.95, 9.0) == []


def test_a_check_that_comes_late_itself_proves_nothing(watching: Heartbeats) -> None:
    assert watching.overdue(5.0) is None  # the page's beats wait to be read
    watching.beat(PAGE, 5.01)
    assert heard_until(watching, 5.025, 5.9) == []
    assert watching.overdue(6.0) == PAGE


@pytest.fixture
def server() -> Iterator[GuardedServer]:
    server = guarded_server(port=0)
    yield server
    server.stop()


@pytest.fixture
def stops(server: GuardedServer) -> queue.Queue[str]:
    stops: queue.Queue[str] = queue.Queue()
    server.stop_lines.attend(stops.put, lambda who: None)
    return stops


def line(server: GuardedServer, **options: Any) -> ClientConnection:
    here = f"127.0.0.1:{server.get_port()}"
    return connect(f"ws://{here}/stop", origin=Origin(f"http://{here}"), ping_interval=None, **options)


def say(page: ClientConnection, /, **message: object) -> dict[str, object]:
    page.send(json.dumps(message))
    return hear(page)


def hear(page: ClientConnection) -> dict[str, object]:
    return json.loads(page.recv(timeout=PATIENCE_S))


def test_a_press_is_called_out_under_the_pages_name_and_confirmed(
    server: GuardedServer, stops: queue.Queue[str]
) -> None:
    with line(server) as page:
        assert hear(page) == {"line": "open"}
        assert say(page, stop=1) == {"stopped": 1}  # before anybody knows whose line it is
        server.stop_lines.link(PAGE, "browser page 7")
        assert say(page, page=PAGE, stop=2) == {"stopped": 2}
        assert say(page, beat=3, tabs=["Control", "Inverse"]) == {"beat": 3}
        assert server.stop_lines.tabs("browser page 7") == ("Control", "Inverse")
        server.stop_lines.unlink("browser page 7")
        assert server.stop_lines.tabs("browser page 7") == ()
    assert [stops.get_nowait(), stops.get_nowait()] == ["a browser page", "browser page 7"]
    assert stops.empty()


def test_an_encrypted_line_works_too(tmp_path: Path) -> None:
    both = tmp_path / "both.pem"
    both.write_text(CERTIFICATE + KEY)
    trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    server, stops = guarded_server(port=0, tls=encryption(both, both)), queue.Queue[str]()
    server.stop_lines.attend(stops.put, lambda who: None)
    try:
        here = f"127.0.0.1:{server.get_port()}"
        with connect(
            f"wss://{here}/stop", origin=Origin(f"https://{here}"), ssl=trusting, ping_interval=None
        ) as page:
            assert hear(page) == {"line": "open"}
            assert say(page, page=PAGE, stop=1) == {"stopped": 1}
    finally:
        server.stop()
    assert stops.qsize() == 1


def test_it_does_not_wait_for_a_page_that_is_being_built(
    server: GuardedServer, stops: queue.Queue[str]
) -> None:
    built = threading.Event()
    with line(server) as page:
        hear(page)
        server.get_event_loop().call_soon_threadsafe(built.wait, PATIENCE_S)
        assert say(page, stop=1) == {"stopped": 1}
        built.set()
    assert stops.qsize() == 1


def test_a_linked_page_that_falls_silent_is_reported_by_name(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armctl.ui.guard.stop_line._AGAIN_S", 60.0)
    silent: queue.Queue[str] = queue.Queue()
    server.stop_lines.attend(lambda who: None, silent.put, silence_s=0.1)
    with line(server) as page:
        hear(page)
        say(page, page=PAGE, beat=1)
        server.stop_lines.watch("browser page 1")  # not linked: nothing is known of its beats
        server.stop_lines.link(PAGE, "browser page 1")
        server.stop_lines.watch("browser page 1")
        assert silent.get(timeout=PATIENCE_S) == "browser page 1"
        assert silent.empty()


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("garbage", 1007),
        ('{"stop": "1"}', 1007),
        ('{"halt": 1}', 1007),
        (b"\xff\x00", 1007),
        (b'{"page": "\xff"}', 1007),
        (json.dumps({"page": "x" * 300}), 1009),
    ],
)
def test_what_is_no_message_of_a_page_ends_the_line(
    server: GuardedServer, stops: queue.Queue[str], message: str | bytes, code: int
) -> None:
    with line(server) as page:
        hear(page)
        page.send(message)
        with pytest.raises(ConnectionClosed) as end:
            hear(page)
    assert end.value.rcvd is not None and end.value.rcvd.code == code
    assert stops.empty()


def test_a_flood_ends_the_line(server: GuardedServer, stops: queue.Queue[str]) -> None:
    with line(server) as page, pytest.raises(ConnectionClosed) as end:
        hear(page)
        for beat in range(20_000):
            say(page, beat=beat)
    assert end.value.rcvd is not None and end.value.rcvd.code == 1008


@pytest.mark.parametrize("close", [lambda server: None, lambda server: server.stop_lines.close()])
def test_nobody_confirms_a_stop_that_nobody_carries_out(
    server: GuardedServer, close: Callable[[GuardedServer], None]
) -> None:
    close(server)
    with line(server) as page, pytest.raises(ConnectionClosed):
        say(page, stop=1)


def test_strangers_do_not_come_in(server: GuardedServer, stops: queue.Queue[str]) -> None:
    with pytest.raises(InvalidStatus) as refusal:
        connect(f"ws://127.0.0.1:{server.get_port()}/stop", origin=Origin("http://evil.example"))
    assert refusal.value.response.status_code == 403
    assert stops.empty()


def test_a_page_learns_which_server_answers_and_whether_viser_has_it(
    server: GuardedServer, stops: queue.Queue[str]
) -> None:
    lines = server.stop_lines
    with line(server) as page:
        hear(page)
        told = say(page, page=PAGE, of="", ask=1)
        assert told["known"] is False and told["server"]
        lines.link(PAGE, "browser page 7")
        assert say(page, ask=2) == told | {"known": True}
        say(page, beat=1)
        assert lines.is_there(PAGE) and not lines.is_there(OTHER)
        assert (lines.page_of("browser page 7"), lines.who_is(PAGE)) == (PAGE, "browser page 7")
        say(page, page=PAGE, of="another server", ask=3)  # loads itself anew: it is no page of this one yet
        assert lines.who_is(PAGE) is None
        say(page, page=PAGE, of=told["server"], ask=4)
        assert lines.who_is(PAGE) == "browser page 7"
        lines.unlink("browser page 7")
        assert say(page, ask=5) == told
