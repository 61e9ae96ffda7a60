from __future__ import annotations

import http.client
import socket
from collections.abc import Iterator

import pytest
import viser
from tests.ui.guard_kit import PATIENCE_S, Bell, RawPage
from websockets.exceptions import InvalidStatus

from armctl.ui.guard import GuardedServer, guarded_server

TOKEN = "a-secret-of-some-length_0123456789"


@pytest.fixture
def server() -> Iterator[GuardedServer]:
    server = guarded_server(port=0, extra_hosts=("arm.lab",))
    yield server
    server.stop()


@pytest.fixture
def locked() -> Iterator[GuardedServer]:
    server = guarded_server(port=0, token=TOKEN)
    yield server
    server.stop()


def get(server: GuardedServer, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=PATIENCE_S)
    try:
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        response.read()
        return response
    finally:
        connection.close()


def status_of_raw(server: GuardedServer, *lines: str) -> int:
    """Send a request whose headers http.client would not let us send."""
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=PATIENCE_S) as wire:
        wire.sendall(("\r\n".join(("GET / HTTP/1.1", *lines)) + "\r\n\r\n").encode())
        with wire.makefile("rb") as answer:
            return int(answer.readline().split()[1])


def websocket_lines() -> list[str]:
    return [
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
    ]


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST", "[::1]", "arm.lab"])
def test_the_page_is_served_under_its_own_names(server: GuardedServer, host: str) -> None:
    response = get(server, Host=f"{host}:{server.get_port()}")
    assert response.status == 200
    assert response.headers["Content-Type"] == "text/html"


def test_every_response_carries_the_protective_headers(server: GuardedServer) -> None:
    for response in (get(server), get(server, "/nothing"), get(server, Host="evil.example")):
        policy = response.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "connect-src 'self' blob: data:" in policy
        assert "frame-ancestors 'none'" in policy
        assert response.headers["X-Content-Type-Options"] == "nosniff"
        assert response.headers["Referrer-Policy"] == "no-referrer"
        assert response.headers["Cache-Control"] == "no-store"
        assert response.headers["Server"] is None


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil.example:{}", ""]
)
def test_a_foreign_host_is_refused(server: GuardedServer, host: str) -> None:
    assert get(server, Host=host.format(server.get_port())).status == 421
    assert server.refusals == {"a foreign host name": 1}


def test_a_request_without_host_or_with_two_is_refused(server: GuardedServer) -> None:
    here = f"127.0.0.1:{server.get_port()}"
    assert status_of_raw(server) == 421
    assert status_of_raw(server, f"Host: {here}", "Host: evil.example") == 400
    assert status_of_raw(server, f"Host: {here}", f"Host: {here}") == 400
    assert status_of_raw(server, f"Host: {here}") == 200


@pytest.mark.parametrize("name", ["Upgrade: websocket", "Accept-Encoding: gzip", "Cookie: a=b"])
def test_a_header_given_twice_is_refused(server: GuardedServer, name: str) -> None:
    assert status_of_raw(server, f"Host: 127.0.0.1:{server.get_port()}", name, name) == 400


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "https://127.0.0.1:{}",
        "http://localhost:{}",
        "http://127.0.0.1",
        "file://",
    ],
)
def test_a_foreign_origin_is_refused(server: GuardedServer, origin: str) -> None:
    """Even ``localhost`` for a page at 127.0.0.1: the origin has to be the very address called."""
    with pytest.raises(InvalidStatus) as refusal:
        RawPage(server.get_port(), origin=origin.format(server.get_port()))
    assert refusal.value.response.status_code == 403
    assert get(server, Origin=origin.format(server.get_port())).status == 403
    assert server.refusals == {"a foreign origin": 2}


def test_two_origins_are_refused(server: GuardedServer) -> None:
    here = f"127.0.0.1:{server.get_port()}"
    lines = [f"Host: {here}", f"Origin: http://{here}", *websocket_lines()]
    assert status_of_raw(server, *lines) == 101
    assert status_of_raw(server, *lines, "Origin: http://evil.example") == 400


def test_a_websocket_needs_an_origin(server: GuardedServer) -> None:
    with pytest.raises(InvalidStatus) as refusal:
        RawPage(server.get_port(), origin=None)
    assert refusal.value.response.status_code == 403


def test_a_rebound_name_is_refused(server: GuardedServer) -> None:
    """DNS rebinding: host and origin agree with each other, but not with us."""
    with pytest.raises(InvalidStatus) as refusal:
        RawPage(server.get_port(), host=f"evil.example:{server.get_port()}")
    assert refusal.value.response.status_code == 421


@pytest.mark.parametrize(
    "path",
    [
        "/?websocket=ws://127.0.0.1:9",
        "/?playbackPath=http://evil.example/a",
        "/index.html?x",
        "/?token=guess",
    ],
)
def test_a_query_is_dropped(server: GuardedServer, path: str) -> None:
    response = get(server, path)
    assert response.status == 302
    assert response.headers["Location"] == "/"


@pytest.mark.parametrize(
    "path", ["/nothing", "//evil.example/", "/" + "a" * 4000, "/%00", "/../pyproject.toml", "/%2e%2e/x"]
)
def test_there_is_nothing_but_the_page(server: GuardedServer, path: str) -> None:
    assert get(server, path).status == 404


def test_a_page_without_token_is_refused(locked: GuardedServer) -> None:
    assert get(locked).status == 401
    assert get(locked, "/?token=").status == 401
    assert get(locked, f"/?token={TOKEN[:-1]}").status == 401
    assert get(locked, "/?token=%C3%A4%00").status == 401
    assert get(locked, Cookie=f"armctl-{locked.get_port()}=wrong").status == 401
    assert get(locked, Cookie=f"armctl-{locked.get_port()}=\xe4").status == 401
    assert locked.refusals == {"no valid token": 6}
    with pytest.raises(InvalidStatus) as refusal:
        RawPage(locked.get_port())
    assert refusal.value.response.status_code == 401


def test_the_token_becomes_a_cookie(locked: GuardedServer) -> None:
    response = get(locked, f"/?token={TOKEN}")
    assert response.status == 302
    assert response.headers["Location"] == "/"
    cookie, *attributes = response.headers["Set-Cookie"].split("; ")
    assert sorted(attributes) == ["HttpOnly", "Path=/", "SameSite=Strict"]
    assert get(locked, Cookie=f"other=1; {cookie}").status == 200
    bell = Bell(locked)
    with RawPage(locked.get_port(), cookie=cookie) as page:
        page.introduce()
        bell.press(page)
        assert bell.wait() >= 0


def test_the_token_alone_opens_no_websocket(locked: GuardedServer) -> None:
    """Only the cookie does: what stands in an address is seen by others."""
    here = f"127.0.0.1:{locked.get_port()}"
    lines = [f"Host: {here}", f"Origin: http://{here}", *websocket_lines()]
    with socket.create_connection(("127.0.0.1", locked.get_port()), timeout=PATIENCE_S) as wire:
        wire.sendall(("\r\n".join((f"GET /?token={TOKEN} HTTP/1.1", *lines)) + "\r\n\r\n").encode())
        assert b" 401 " in wire.recv(100)


@pytest.mark.parametrize(
    "garbage", [b"\x00" * 64, b"POST / HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\nbroken\r\n\r\n", b""]
)
def test_broken_requests_leave_no_trace_on_stderr(
    server: GuardedServer, garbage: bytes, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=PATIENCE_S) as wire:
        wire.sendall(garbage)
        wire.shutdown(socket.SHUT_WR)
        while wire.recv(4096):
            pass
    assert get(server).status == 200
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []
