"""Where the server listens: its socket, the addresses that lead to it, and the encryption of its line."""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
import ssl
from collections.abc import Sequence
from pathlib import Path

import ifaddr

from armctl.documents import DocumentKind
from armctl.errors import ServerError

_PEM = DocumentKind(ServerError, most_bytes=256 << 10)
# viser itself takes the next port when one is busy, and waits for ever when it cannot bind at all: so the
# socket is bound before viser starts.

_BACKLOG = 100


def listening_socket(host: str, port: int, *, beyond_loopback: bool) -> socket.socket:
    """Bind and listen; the caller closes the socket. Port 0 lets the system choose a free one.

    Raises:
        ServerError: the address is unknown, or reachable from outside without ``beyond_loopback``, or the
            port is not to be had.
    """
    if not 0 <= port <= 65535:
        raise ServerError(f"port {port} does not exist; choose 1 … 65535 with --http-port (0: any free one)")
    try:
        infos = socket.getaddrinfo(host or "?", port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as cause:
        raise ServerError(f"cannot listen on {host!r}: no such address; use --host 127.0.0.1") from cause
    family, kind, protocol, _, address = infos[0]
    ip = ipaddress.ip_address(str(address[0]))
    if not ip.is_loopback and not beyond_loopback:
        raise ServerError(
            f"{host} can be reached from other computers, so a token is needed: "
            f"leave out --no-token, or listen on 127.0.0.1 only"
        )
    listener = socket.socket(family, kind, protocol)
    try:
        if os.name == "posix":  # elsewhere it would let two servers share one port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if ip == ipaddress.IPv6Address("::"):  # every address of the older kind, too
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        listener.bind(address)
        listener.listen(_BACKLOG)
    except OSError as cause:
        listener.close()
        other = port + 1 if port < 65535 else 8080
        why = {
            errno.EADDRINUSE: f"port {port} on {host} is in use by another program (another armctl?): "
            f"close it, or choose another port with --http-port {other}",
            errno.EACCES: f"port {port} is reserved for the system: choose one above 1023 with --http-port",
            errno.EADDRNOTAVAIL: f"{host} is no address of this computer: use --host 127.0.0.1",
        }.get(cause.errno or 0, f"cannot listen on {host}, port {port}: {cause.strerror or cause}")
        raise ServerError(why) from cause
    return listener


def url_host(ip: ipaddress.IPv4Address | ipaddress.IPv6Address) -> str:
    """An address as it is written in a URL; one of IPv4 as such, also where it came by an IPv6 socket."""
    if isinstance(ip, ipaddress.IPv6Address):
        return f"[{ip}]" if ip.ipv4_mapped is None else str(ip.ipv4_mapped)
    return str(ip)


def is_name(host: str) -> bool:
    """Tell whether a host is a name of this computer's own, neither an address nor ``localhost``."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return host.lower() != "localhost"
    return False


def names_of(listener: socket.socket, host: str, extra_hosts: Sequence[str]) -> list[str]:
    """By what the server can be called in a URL, the names that serve other computers first.

    ``host`` is what the user asked to listen on: an address, or a name, which is one of ``extra_hosts`` then.
    """
    ip = ipaddress.ip_address(listener.getsockname()[0])
    if ip.is_loopback and not is_name(host):
        return ["localhost" if host in ("127.0.0.1", "::1", "localhost") else url_host(ip), *extra_hosts]
    if not ip.is_unspecified:
        return [*extra_hosts, url_host(ip)]
    found = [
        ipaddress.ip_address(one.ip if isinstance(one.ip, str) else one.ip[0])
        for adapter in ifaddr.get_adapters()
        for one in adapter.ips
    ]
    addresses = [
        one
        for one in found
        if not one.is_loopback and not one.is_link_local and (one.version == 4 or ip.version == 6)
    ]
    return [*extra_hosts, *map(url_host, sorted(addresses, key=lambda one: one.version)), "localhost"]


def encryption(certificate: Path, key: Path) -> ssl.SSLContext:
    """What encrypts the line (https), from PEM files: a certificate with those that sign it, and its key.

    Raises:
        ServerError: a file cannot be read, is of another kind, encrypted, or they do not belong together.
    """
    for path, kind, option in ((certificate, b"CERTIFICATE", "cert"), (key, b"PRIVATE KEY", "key")):
        if kind + b"-----" not in _PEM.load(path, bytes):
            raise ServerError(
                f"{path}: holds no {kind.decode().lower()} in PEM form (-----BEGIN … {kind.decode()}-----); "
                f"give one as --tls-{option}"
            )

    def password() -> str:
        raise ServerError(
            f"{key}: is encrypted with a password; give a key that is not: "
            f"openssl pkey -in {key} -out plain.pem"
        )

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    # A session ticket comes after the handshake, while a client that reads and writes in two threads already
    # asks: one in 500 connections then waits for ever in OpenSSL. Resuming a session would save nothing here.
    context.num_tickets = 0
    try:
        context.load_cert_chain(certificate, key, password)
    except ssl.SSLError as cause:
        if cause.reason == "KEY_VALUES_MISMATCH":
            raise ServerError(f"{key} is not the key of the certificate {certificate}") from cause
        raise ServerError(
            f"{certificate} and {key} cannot be used for encryption: {cause.reason or cause}"
        ) from cause
    return context
