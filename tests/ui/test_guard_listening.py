"""By which addresses the page is reached, and the encryption of the line to it."""

from __future__ import annotations

import ipaddress
import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPSConnection
from pathlib import Path
from types import SimpleNamespace

import ifaddr
import pytest
from tests.ui.guard_kit import PATIENCE_S, RawPage
from tests.ui.tls_files import CERTIFICATE, KEY, LOCKED_KEY, OTHER_KEY

from armctl.errors import ServerError
from armctl.ui.guard import GuardedServer, encryption, guarded_server

TOKEN = "a-secret-of-some-length_0123456789"


@contextmanager
def listening(host: str, *names: str) -> Iterator[tuple[GuardedServer, list[str]]]:
    """A server, and the names in its links."""
    server = guarded_server(host, 0, extra_hosts=names, token=TOKEN)
    try:
        tail = f":{server.get_port()}/?token={TOKEN}"
        assert all(link.startswith("http://") and link.endswith(tail) for link in server.links)
        yield server, [link.removeprefix("http://").removesuffix(tail) for link in server.links]
    finally:
        server.stop()


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer with two networks."""
    addresses = (
        ["127.0.0.1", ("::1", 0, 0)],
        [("2001:db8::5", 0, 0), ("fe80::1", 0, 2), "192.0.2.5"],
        ["10.0.0.3"],
    )
    adapters = [SimpleNamespace(ips=[SimpleNamespace(ip=ip) for ip in ips]) for ips in addresses]
    monkeypatch.setattr(ifaddr, "get_adapters", lambda: adapters)


@pytest.mark.usefixtures("network")
@pytest.mark.parametrize(
    ("host", "names", "expected", "beyond"),
    [
        ("127.0.0.1", (), ["localhost"], False),
        ("127.0.0.2", (), ["127.0.0.2"], False),
        ("::1", (), ["localhost"], False),
        ("127.0.0.1", ("arm.lab",), ["localhost", "arm.lab"], False),
        ("0.0.0.0", (), ["192.0.2.5", "10.0.0.3", "localhost"], True),
        ("0.0.0.0", ("pi.local", "pi"), ["pi.local", "pi", "192.0.2.5", "10.0.0.3", "localhost"], True),
        ("::", (), ["192.0.2.5", "10.0.0.3", "[2001:db8::5]", "localhost"], True),
    ],
)
def test_links_name_what_other_computers_can_open_first(
    host: str, names: tuple[str, ...], expected: list[str], beyond: bool
) -> None:
    with listening(host, *names) as (server, named):
        assert named == expected
        assert (server.beyond_loopback, server.encrypted) == (beyond, False)


def test_a_name_to_listen_on_is_a_name_that_pages_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    resolve = socket.getaddrinfo
    monkeypatch.setattr(
        socket, "getaddrinfo", lambda host, *rest, **more: resolve("127.0.0.1", *rest, **more)
    )
    with listening("arm.lab", "arm.lab", "pi.local") as (server, named):
        assert named == ["arm.lab", "pi.local", "127.0.0.1"]
        RawPage(server.get_port(), host=f"arm.lab:{server.get_port()}", cookie=cookie(server)).socket.close()


def test_every_own_address_is_answered_on_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    own = [
        ipaddress.ip_address(ip.ip if isinstance(ip.ip, str) else ip.ip[0])
        for adapter in ifaddr.get_adapters()
        for ip in adapter.ips
    ]
    for host in ("0.0.0.0", "::"):
        with listening(host) as (server, named):
            for ip in (ip for ip in own if str(ip) in named or f"[{ip}]" in named):
                here = f"[{ip}]" if ip.version == 6 else str(ip)
                with socket.create_connection((str(ip), server.get_port()), timeout=PATIENCE_S) as wire:
                    request = f"GET /?token={TOKEN} HTTP/1.1\r\nHost: {here}:{server.get_port()}\r\n\r\n"
                    wire.sendall(request.encode())
                    assert wire.recv(4096).startswith(b"HTTP/1.1 302")


def cookie(server: GuardedServer) -> str:
    return f"armctl-{server.get_port()}={TOKEN}"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    for name, text in {
        "cert": CERTIFICATE,
        "key": KEY,
        "locked": LOCKED_KEY,
        "other": OTHER_KEY,
        "both": CERTIFICATE + KEY,
        "broken": "-----BEGIN CERTIFICATE-----\nabc\n-----END CERTIFICATE-----\n",
        "text": "a certificate",
        "large": "x" * (300 << 10),
    }.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("certificate", "key", "words"),
    [
        ("cert", "other", "other is not the key of the certificate .*cert$"),
        (
            "cert",
            "locked",
            r"locked: is encrypted with a password; .*openssl pkey -in .*locked -out plain\.pem",
        ),
        ("cert", "cert", "cert: holds no private key in PEM form .*--tls-key"),
        ("key", "cert", "key: holds no certificate in PEM form .*--tls-cert"),
        ("broken", "key", "broken and .*key cannot be used for encryption: "),
        ("text", "key", "text: holds no certificate"),
        ("nothing", "key", "nothing: cannot be read: No such file"),
        ("cert", ".", ": cannot be read: "),
        ("large", "key", "large: is larger than 256 KiB"),
    ],
)
def test_files_that_cannot_encrypt_are_refused_in_words(
    files: Path, certificate: str, key: str, words: str
) -> None:
    with pytest.raises(ServerError, match=words):
        encryption(files / certificate, files / key)


def test_nothing_follows_the_handshake_but_what_is_asked_for(files: Path) -> None:
    """A session ticket would: a client that reads it while it writes its request may hang."""
    server = guarded_server(port=0, tls=encryption(files / "both", files / "both"))
    try:
        port = server.get_port()
        trust = ssl.create_default_context(cadata=CERTIFICATE)
        with (
            socket.create_connection(("localhost", port), timeout=PATIENCE_S) as line,
            trust.wrap_socket(line, server_hostname="localhost") as wire,
        ):
            wire.sendall(f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
            assert wire.recv(12) == b"HTTP/1.1 200"
            assert wire.session is not None
            assert not wire.session.has_ticket
    finally:
        server.stop()


def test_an_encrypted_line_has_an_origin_and_a_cookie_of_its_own(
    files: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    server = guarded_server(port=0, token=TOKEN, tls=encryption(files / "both", files / "both"))
    try:
        port = server.get_port()
        assert server.links == (f"https://localhost:{port}/?token={TOKEN}",)
        assert server.encrypted
        trust = ssl.create_default_context(cadata=CERTIFICATE)
        connection = HTTPSConnection("localhost", port, timeout=PATIENCE_S, context=trust)
        connection.request("GET", f"/?token={TOKEN}")
        set_cookie = connection.getresponse().headers["Set-Cookie"]
        assert set_cookie == f"{cookie(server)}; HttpOnly; SameSite=Lax; Path=/; Secure"
        connection.close()
        for scheme, status in (("https", 200), ("http", 403)):
            headers = {"Cookie": cookie(server), "Origin": f"{scheme}://localhost:{port}"}
            connection.request("GET", "/", headers=headers)
            assert connection.getresponse().status == status
            connection.close()
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as plain:
            plain.sendall(b"GET / HTTP/1.1\r\n\r\n")
            assert plain.recv(1) == b""
    finally:
        server.stop()
    assert capfd.readouterr() == ("", "")
    assert [record for record in caplog.records if record.name != "armctl.ui.guard"] == []
