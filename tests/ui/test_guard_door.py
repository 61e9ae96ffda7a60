"""Who is let in: names, origins, tokens, paths."""

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
WEBSOCKET = (
    "Upgrade: websocket",
    "Connection: Upgrade",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
)


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


def status_of_raw(server: GuardedServer, *lines: str, path: str = "/") -> int:
    """Send a request whose headers http.client would not let us send; ``{}`` in a line is the port."""
    text = "\r\n".join((f"GET {path} HTTP/1.1", *lines)).replace("{}", str(server.get_port()))
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=PATIENCE_S) as wire:
        wire.sendall(f"{text}\r\n\r\n".encode())
        with wire.makefile("rb") as answer:
            return int(answer.readline().split()[1])


def status_of_page(server: GuardedServer, **options: str | None) -> int:
    """Try to open a websocket that is refused."""
    with pytest.raises(InvalidStatus) as refusal:
        RawPage(server.get_port(), **options)  # type: ignore[arg-type]
    return refusal.value.response.status_code


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


HERE = "Host: 127.0.0.1:{}"
SOCKET = (HERE, "Origin: http://127.0.0.1:{}", *WEBSOCKET)


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        ((HERE,), 200),
        ((), 421),
        ((HERE, "Host: evil.example"), 400),
        ((HERE, HERE), 400),
        ((HERE, *2 * ("Upgrade: websocket",)), 400),
        ((HERE, *2 * ("Accept-Encoding: gzip",)), 400),
        ((HERE, *2 * ("Cookie: a=b",)), 400),
        (SOCKET, 101),
        ((*SOCKET, "Origin: http://evil.example"), 400),
    ],
)
def test_a_header_is_given_once(server: GuardedServer, lines: tuple[str, ...], status: int) -> None:
    assert status_of_raw(server, *lines) == status


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
    origin = origin.format(server.get_port())
    assert status_of_page(server, origin=origin) == 403
    assert get(server, Origin=origin).status == 403
    assert server.refusals == {"a foreign origin": 2}


def test_a_websocket_without_origin_or_from_a_rebound_name_is_refused(server: GuardedServer) -> None:
    assert status_of_page(server, origin=None) == 403
    # DNS rebinding: host and origin agree with each other, but not with us
    assert status_of_page(server, host=f"evil.example:{server.get_port()}") == 421


@pytest.mark.parametrize("path", ["/?websocket=ws://127.0.0.1:9", "/index.html?x", "/?token=guess"])
def test_a_query_is_dropped(server: GuardedServer, path: str) -> None:
    response = get(server, path)
    assert (response.status, response.headers["Location"]) == (302, "/")


@pytest.mark.parametrize(
    "path", ["/nothing", "//evil.example/", "/" + "a" * 4000, "/%00", "/../pyproject.toml", "/%2e%2e/x"]
)
def test_there_is_nothing_but_the_page(server: GuardedServer, path: str) -> None:
    assert get(server, path).status == 404


def test_a_page_without_token_is_refused(locked: GuardedServer) -> None:
    for path in ("/", "/?token=", f"/?token={TOKEN[:-1]}", "/?token=%C3%A4%00"):
        assert get(locked, path).status == 401
    for cookie in ("wrong", "\xe4"):
        assert get(locked, Cookie=f"armctl-{locked.get_port()}={cookie}").status == 401
    assert locked.refusals == {"no valid token": 6}
    assert status_of_page(locked) == 401
    # only the cookie opens a websocket: what stands in an address is seen by others
    assert status_of_raw(locked, *SOCKET, path=f"/?token={TOKEN}") == 401


def test_the_token_becomes_a_cookie(locked: GuardedServer) -> None:
    response = get(locked, f"/?token={TOKEN}")
    assert (response.status, response.headers["Location"]) == (302, "/")
    cookie, *attributes = response.headers["Set-Cookie"].split("; ")
    assert sorted(attributes) == ["HttpOnly", "Path=/", "SameSite=Strict"]
    assert get(locked, Cookie=f"other=1; {cookie}").status == 200
    bell = Bell(locked)
    with RawPage(locked.get_port(), cookie=cookie) as page:
        page.introduce()
        bell.press(page)
        assert bell.wait() >= 0


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
