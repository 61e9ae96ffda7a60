"""Who is let in: names, origins, tokens, paths."""

from __future__ import annotations

import http.client
import socket
from collections.abc import Iterator

import pytest
import viser
from tests.ui.guard_kit import PATIENCE_S, Bell, RawPage
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from armctl.ui.guard import GuardedServer, SocketDoor, guarded_server
from armctl.ui.guard.door import Guesses

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


def ask(
    server: GuardedServer, path: str = "/", method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[http.client.HTTPResponse, str]:
    """An answer of the server and its text."""
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=PATIENCE_S)
    try:
        connection.request(method, path, body, headers)
        response = connection.getresponse()
        return response, response.read().decode(errors="replace")
    finally:
        connection.close()


def get(server: GuardedServer, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    return ask(server, path, **headers)[0]


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
    assert sorted(attributes) == ["HttpOnly", "Path=/", "SameSite=Lax"]
    assert get(locked, Cookie=f"other=1; {cookie}").status == 200
    bell = Bell(locked)
    with RawPage(locked.get_port(), cookie=cookie) as page:
        page.introduce()
        bell.press(page)
        assert bell.wait() >= 0


@pytest.mark.parametrize("accept", ["text/html,*/*", "*/*"])
def test_a_bare_visit_shows_how_to_get_in(locked: GuardedServer, accept: str) -> None:
    response, text = ask(locked, Accept=accept)
    assert response.status == 401
    assert "link that armctl printed" in text and "?token=" in text and TOKEN not in text
    assert response.headers["Content-Type"].startswith("text/html" if "html" in accept else "text/plain")


@pytest.mark.parametrize(
    ("host", "says"),
    [
        ("raspberrypi.local:{}", "--allow-host raspberrypi.local"),
        ("raspberrypi.local:1", "the address has to name that port"),
        ("<b>:{}", "Open the link"),
    ],
)
def test_a_foreign_name_is_answered_with_how_to_allow_it(server: GuardedServer, host: str, says: str) -> None:
    response, text = ask(server, Host=host.format(server.get_port()), Accept="text/html")
    assert response.status == 421
    assert says in text and "<b>" not in text


def test_a_browser_that_armctl_opens_gets_a_link_for_one_use(
    locked: GuardedServer, server: GuardedServer
) -> None:
    assert server.link_for_one_browser() == server.links[0]
    link = locked.link_for_one_browser()
    assert TOKEN not in link and link != locked.link_for_one_browser()
    path = link[link.index("/?") :]
    assert ask(locked, path, "HEAD")[0].status == 401  # looking does not use it up
    assert TOKEN in get(locked, path).headers["Set-Cookie"]
    assert get(locked, path).status == 401


def test_only_wrong_tokens_wait_and_nobody_locks_the_owner_out(
    locked: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []

    async def note(delay_s: float) -> None:
        waits.append(delay_s)

    monkeypatch.setattr("armctl.ui.guard.server.asyncio.sleep", note)
    for _ in range(12):
        assert get(locked).status == 401
    assert max(waits) == 0.0
    waits.clear()
    for _ in range(12):
        assert get(locked, "/?token=guess").status == 401
    assert waits == [0.0] * 10 + [Guesses.DELAY_S] * 2
    assert get(locked, f"/?token={TOKEN}").status == 302
    assert len([delay for delay in waits if delay]) == 2


def test_free_guesses_come_back_and_few_addresses_are_remembered() -> None:
    guesses = Guesses()
    assert [guesses.delay_s("a", 0.0) for _ in range(11)] == [0.0] * 10 + [Guesses.DELAY_S]
    assert guesses.delay_s("b", 0.0) == 0.0
    assert guesses.delay_s("a", 60.0) == 0.0
    for number in range(Guesses.MOST_ADDRESSES):
        guesses.delay_s(str(number), 60.0)
    assert [guesses.delay_s("a", 60.0) for _ in range(10)] == [0.0] * 10


def test_head_is_get_without_its_body(locked: GuardedServer, server: GuardedServer) -> None:
    response, text = ask(server, method="HEAD")
    assert (response.status, text) == (200, "")
    assert response.headers["Content-Length"] == get(server).headers["Content-Length"]
    response, text = ask(locked, method="HEAD")
    assert (response.status, text) == (401, "")
    assert ask(server, "/nothing", "HEAD")[0].status == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_another_method_is_not_allowed(server: GuardedServer, method: str) -> None:
    response, _ = ask(server, method=method, body=None if method == "TRACE" else b"x" * 100_000)
    assert (response.status, response.headers["Allow"]) == (405, "GET, HEAD")
    assert server.refusals == {"another method than GET and HEAD": 1}


def test_a_head_may_come_in_parts_and_opens_no_websocket(server: GuardedServer) -> None:
    for lines, status in (((HERE,), 200), (SOCKET, 400)):
        text = "\r\n".join(("AD / HTTP/1.1", *lines, "", "")).replace("{}", str(server.get_port()))
        with socket.create_connection(("127.0.0.1", server.get_port()), timeout=PATIENCE_S) as wire:
            wire.sendall(b"HE")
            assert get(server).status == 200  # so that the server has read the first part
            wire.sendall(text.encode())
            with wire.makefile("rb") as answer:
                said = answer.read()
        assert said.startswith(f"HTTP/1.1 {status} ".encode())
        assert said.endswith(b"\r\n\r\n") and said.count(b"\r\n\r\n") == 1  # no body


class Echo:
    """A server with a socket for programs at /api, one for pages at /stop; both say back what they hear."""

    def __init__(self, token: str | None) -> None:
        async def echo(connection: ServerConnection) -> None:
            async for said in connection:
                await connection.send(said)

        doors = {"/api": SocketDoor(echo, for_programs=True, schema=b'{"a": 1}'), "/stop": SocketDoor(echo)}
        self.server = guarded_server(port=0, token=token, sockets=doors)
        self.here = f"127.0.0.1:{self.server.get_port()}"
        self.cookie = f"armctl-{self.server.get_port()}={TOKEN}"

    def status(self, path: str, origin: str | None = None, **headers: str) -> int:
        """Open a websocket; 101 when it says back what it hears."""
        try:
            with connect(
                f"ws://{self.here}{path}",
                origin=None if origin is None else Origin(origin),
                additional_headers=headers,
                ping_interval=None,
            ) as socket:
                for said in ("\0 anything", b"\xff" * 300_000):  # no page may send that
                    socket.send(said)
                    assert socket.recv(timeout=PATIENCE_S) == said
                return 101
        except InvalidStatus as refusal:
            return refusal.response.status_code


@pytest.fixture(params=[TOKEN, None])
def echo(request: pytest.FixtureRequest) -> Iterator[Echo]:
    echo = Echo(request.param)
    yield echo
    echo.server.stop()


@pytest.mark.parametrize("echo", [TOKEN], indirect=True)
def test_a_program_needs_the_token_and_a_page_its_origin_too(echo: Echo) -> None:
    own, bearer = f"http://{echo.here}", {"Authorization": f"Bearer {TOKEN}"}
    for headers in (bearer, {"Cookie": echo.cookie}):
        assert echo.status("/api", own, **headers) == 101
        assert echo.status("/api", "http://evil.example", **headers) == 403
    for origin in (None, own):
        assert echo.status("/api", origin, **bearer) == 101
        assert echo.status(f"/api?token={TOKEN}", origin) == 101
        assert echo.status("/api", origin) == 401
        assert echo.status("/api?token=guess", origin, Authorization="Bearer guess") == 401
        assert echo.status("/api", origin, Authorization=f"Basic {TOKEN}") == 401
    assert echo.status("/api", Cookie=echo.cookie) == 401  # a cookie is a browser's, which has an origin
    assert status_of_raw(echo.server, "Host: evil.example:{}", *WEBSOCKET, path=f"/api?token={TOKEN}") == 421
    assert echo.status("/stop", own, Cookie=echo.cookie) == 101
    assert echo.status("/stop", **bearer) == 403
    assert echo.status("/stop", own, **bearer) == 401
    assert echo.status(f"/stop?token={TOKEN}", own) == 401
    assert get(echo.server, "/api/schema").status == 401
    assert get(echo.server, "/api/schema", Cookie=echo.cookie).status == 200
    assert ask(echo.server, "/api/schema", Authorization=f"Bearer {TOKEN}")[1] == '{"a": 1}'


@pytest.mark.parametrize("echo", [None], indirect=True)
def test_without_token_all_programs_of_this_computer_come_in_but_no_foreign_page(echo: Echo) -> None:
    assert echo.status("/api") == echo.status("/api", f"http://{echo.here}") == 101
    assert echo.status("/api", "http://evil.example") == 403
    assert echo.status("/stop") == 403
    assert echo.status("/stop", f"http://{echo.here}") == 101


def test_what_a_socket_does_not_serve_is_said(echo: Echo) -> None:
    bearer = {"Authorization": f"Bearer {TOKEN}", "Cookie": echo.cookie}
    assert get(echo.server, "/api", **bearer).status == 426
    assert get(echo.server, "/stop/schema", **bearer).status == 404
    assert echo.status("/api/schema", f"http://{echo.here}", **bearer) == 404
    assert echo.status("/api/", f"http://{echo.here}", **bearer) == 404


@pytest.mark.parametrize("garbage", [b"\x00" * 64, b"GET / HTTP/1.1\r\nbroken\r\n\r\n", b"GE", b""])
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
