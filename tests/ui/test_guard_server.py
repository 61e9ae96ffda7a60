from __future__ import annotations

import asyncio
import socket
import threading
from typing import Any

import pytest
import viser
import websockets.asyncio.server
from tests.ui.guard_kit import Bell, RawPage
from websockets.http11 import Request, Response

from armctl.errors import ServerError
from armctl.ui import viser_seam as viser_serving
from armctl.ui.guard import SocketDoor, guarded_server
from armctl.ui.guard import server as serving
from armctl.ui.guard.door import Door
from armctl.ui.guard.filter import Tally

TOKEN = "a-secret-of-some-length_0123456789"


def test_a_busy_port_is_refused_in_words_and_free_again_afterwards() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        said = rf"port {port} on 127\.0\.0\.1 is in use by another program .* --http-port {port + 1}"
        with pytest.raises(ServerError, match=said):
            guarded_server(port=port)
    for _ in range(2):
        server = guarded_server(port=port)
        assert server.get_port() == port
        server.stop()


@pytest.mark.parametrize(
    ("host", "port", "words"),
    [
        ("127.0.0.1", -1, "port -1 does not exist"),
        ("127.0.0.1", 65536, "port 65536 does not exist"),
        ("203.0.113.7", 0, "is no address of this computer"),
        ("no-such-name.invalid", 0, "no such address"),
        ("", 0, "no such address"),
        ("a" * 300, 0, "no such address"),
    ],
)
def test_an_address_that_cannot_be_had_is_refused(host: str, port: int, words: str) -> None:
    with pytest.raises(ServerError, match=words):
        guarded_server(host, port, token=TOKEN)


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_other_computers_need_a_token(host: str) -> None:
    with pytest.raises(ServerError, match="can be reached from other computers, so a token is needed"):
        guarded_server(host, 0)
    guarded_server(host, 0, token=TOKEN).stop()


@pytest.mark.parametrize(
    "token", ["", "short", "x" * 257, "semicolon; Domain=evil", "line\nbreak-line-break", "ä" * 20]
)
def test_a_weak_or_unsafe_token_is_refused(token: str) -> None:
    with pytest.raises(ServerError, match="the token must be"):
        guarded_server(port=0, token=token)


@pytest.mark.parametrize("name", ["http://arm.lab", "arm.lab:8080", "arm lab", "", "*"])
def test_extra_hosts_are_bare_names(name: str) -> None:
    with pytest.raises(ServerError, match=r"is no host name"):
        guarded_server(port=0, extra_hosts=(name,))


@pytest.mark.parametrize(
    ("target", "name", "value", "words"),
    [
        (viser, "__version__", "1.2.0", r"made for viser 1\.1\.1, but 1\.2\.0 is installed"),
        (viser_serving, "_OPENER", "viser.elsewhere", "viser did not open its server through it"),
    ],
)
def test_another_viser_is_refused(
    target: object, name: str, value: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(target, name, value)
    with pytest.raises(ServerError, match=words):
        guarded_server(port=0)


def test_a_door_that_lets_strangers_in_is_noticed_and_frees_the_port(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with monkeypatch.context() as patch:
        patch.setattr(Door, "answer", lambda *_: None)
        with pytest.raises(ServerError, match="a page of a foreign origin was answered with 101"):
            guarded_server(port=port)
    guarded_server(port=port).stop()


@pytest.mark.parametrize("header", ["Origin", "Host"])
def test_a_door_that_overlooks_one_header_is_noticed(monkeypatch: pytest.MonkeyPatch, header: str) -> None:
    answer = Door.answer

    def careless(door: Door, connection: object, request: Request) -> Response | None:
        here = f"127.0.0.1:{connection.local_address[1]}"  # type: ignore[attr-defined]
        for name, value in (("Host", here), ("Origin", f"http://{here}")):
            if header == "Host" or name == header:
                del request.headers[name]
                request.headers[name] = value
        return answer(door, connection, request)  # type: ignore[arg-type]

    monkeypatch.setattr(Door, "answer", careless)
    with pytest.raises(ServerError, match="guard is not effective"):
        guarded_server(port=0)


@pytest.mark.parametrize("token", [TOKEN, None])
def test_a_door_that_is_open_at_a_socket_of_its_own_is_noticed(
    monkeypatch: pytest.MonkeyPatch, token: str | None
) -> None:
    answer = Door.answer

    def careless(door: Door, connection: object, request: Request) -> Response | None:
        if request.path == "/api":
            connection.socket_path = "/api"  # type: ignore[attr-defined]
            return None
        return answer(door, connection, request)  # type: ignore[arg-type]

    async def unused(connection: object) -> None:
        del connection

    sockets = {"/api": SocketDoor(unused, for_programs=True)}
    with monkeypatch.context() as patch:
        patch.setattr(Door, "answer", careless)
        with pytest.raises(ServerError, match="a foreign origin was answered with 101 at /api"):
            guarded_server(port=0, token=token, sockets=sockets)
    guarded_server(port=0, token=token, sockets=sockets).stop()


def test_a_websockets_library_that_has_changed_is_no_reason_to_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    def changed(*args: object, **options: object) -> None:
        raise TypeError("unexpected keyword argument 'process_response'")

    monkeypatch.setattr(websockets.asyncio.server, "serve", changed)
    with pytest.raises(ServerError, match="cannot be opened: unexpected keyword argument"):
        guarded_server(port=0)


def test_servers_can_be_started_at_once() -> None:
    serve = websockets.asyncio.server.serve
    servers: list[viser.ViserServer] = []
    threads = [threading.Thread(target=lambda: servers.append(guarded_server(port=0))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({server.get_port() for server in servers}) == 4
    for server in servers:
        server.stop()
    assert websockets.asyncio.server.serve is serve


def test_start_and_stop_print_nothing_and_leave_no_thread(capfd: pytest.CaptureFixture[str]) -> None:
    before = set(threading.enumerate())
    server = guarded_server(port=0)
    with RawPage(server.get_port()) as page:
        bell = Bell(server)
        page.introduce()
        bell.press(page)
        bell.wait()
        server.stop()
        server.stop()
    assert set(threading.enumerate()) == before
    assert capfd.readouterr() == ("", "")


def test_a_tunnel_cannot_be_asked_for_and_the_port_of_the_environment_is_ignored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", "1")  # viser would take it
    server = guarded_server(port=0)
    try:
        assert server.get_port() > 1
        assert server.request_share_url() is None
        assert server.refusals == {"a public tunnel": 1}
    finally:
        server.stop()


@pytest.mark.parametrize(
    ("modules", "is_refusal"),
    [
        (("armctl.ui.guard.filter", "viser.infra._infra", "viser._gui_api"), True),
        (("viser._gui_api", "armctl.ui.page", "viser._gui_handles"), False),
        (("viser._gui_api", "armctl.ui.page"), False),
    ],
)
def test_a_callback_of_armctl_that_fails_inside_viser_is_no_refusal(
    modules: tuple[str, ...], is_refusal: bool
) -> None:
    def call(module: str, *deeper: str) -> None:
        names: dict[str, Any] = {"__name__": module, "go_on": lambda: call(*deeper) if deeper else int("x")}
        exec("def run(): go_on() if deeper else int('x')", names | {"deeper": deeper}, names)
        names["run"]()

    tally, loop, defects = Tally(), asyncio.new_event_loop(), []
    tally.open()
    loop.default_exception_handler = defects.append
    try:
        call(*modules)
    except ValueError as error:
        serving._on_loop_error(tally, loop, {"message": "", "exception": error})
    loop.close()
    assert (tally.counts, len(defects)) == (
        ({"a value that viser cannot take": 1}, 0) if is_refusal else ({}, 1)
    )
