"""The listening socket, bound before viser starts.

viser itself takes the next port when one is busy, and waits for ever when it cannot bind at all.
"""

from __future__ import annotations

import errno
import ipaddress
import os
import socket

from armctl.errors import ServerError

_BACKLOG = 100


def listening_socket(host: str, port: int, *, beyond_loopback: bool) -> socket.socket:
    """Bind and listen.

    Args:
        host: address or name to listen on.
        port: TCP port; 0 lets the system choose a free one.
        beyond_loopback: whether an address that other computers can reach is allowed.

    Returns:
        The socket; the caller closes it.

    Raises:
        ServerError: the address is unknown or reachable from outside, or the port is not to be had.
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
            f"give one, or listen on 127.0.0.1 only"
        )
    listener = socket.socket(family, kind, protocol)
    try:
        if os.name == "posix":  # elsewhere it would let two servers share one port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(_BACKLOG)
    except OSError as cause:
        listener.close()
        raise ServerError(_why(cause, host, port)) from cause
    return listener


def _why(cause: OSError, host: str, port: int) -> str:
    match cause.errno:
        case errno.EADDRINUSE:
            return (
                f"port {port} on {host} is in use by another program (another armctl?): "
                f"close it, or choose another port with --http-port {port + 1 if port < 65535 else 8080}"
            )
        case errno.EACCES:
            return f"port {port} is reserved for the system: choose one above 1023 with --http-port"
        case errno.EADDRNOTAVAIL:
            return f"{host} is no address of this computer: use --host 127.0.0.1"
        case _:
            return f"cannot listen on {host}, port {port}: {cause.strerror or cause}"
