"""Whether the guard holds: knock at the server's own door as those who must not come in."""

from __future__ import annotations

import http.client
import ipaddress
from http import HTTPStatus

import viser

from armctl.errors import ServerError

_TIMEOUT_S = 3.0
_REFUSALS = {HTTPStatus.FORBIDDEN, HTTPStatus.MISDIRECTED_REQUEST, HTTPStatus.UNAUTHORIZED}
_FOREIGN = "armctl-probe.invalid"


def probe(address: str, port: int, *, token_needed: bool) -> None:
    """Try to get in from outside.

    Args:
        address: the address that the server is bound to.
        port: its port.
        token_needed: whether a stranger without token must be refused as well.

    Raises:
        ServerError: somebody was let in, or the server did not answer.
    """
    ip = ipaddress.ip_address(address)
    if ip.is_unspecified:
        ip = ipaddress.ip_address("127.0.0.1" if ip.version == 4 else "::1")
    here = f"[{ip}]:{port}" if ip.version == 6 else f"{ip}:{port}"
    strangers = {
        "a page of a foreign origin": {"Host": here, "Origin": f"http://{_FOREIGN}"},
        "a page under a foreign name": {"Host": f"{_FOREIGN}:{port}", "Origin": f"http://{_FOREIGN}:{port}"},
        "a websocket without origin": {"Host": here},
    }
    if token_needed:
        strangers["a page without token"] = {"Host": here, "Origin": f"http://{here}"}
    for who, headers in strangers.items():
        status = _knock(str(ip), port, headers)
        if status not in _REFUSALS:
            raise ServerError(
                f"the web server's guard is not effective: {who} was answered with {status}; "
                f"armctl does not run unguarded, report this with the version of viser ({viser.__version__})"
            )


def _knock(address: str, port: int, headers: dict[str, str]) -> int:
    connection = http.client.HTTPConnection(address, port, timeout=_TIMEOUT_S)
    try:
        connection.request(
            "GET",
            "/",
            headers={
                "Upgrade": "websocket",
                "Connection": "Upgrade",
                "Sec-WebSocket-Version": "13",
                "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
                "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
                **headers,
            },
        )
        return connection.getresponse().status
    except (OSError, http.client.HTTPException) as cause:
        raise ServerError(f"the web server does not answer on port {port}: {cause}") from cause
    finally:
        connection.close()
