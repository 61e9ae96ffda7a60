"""A viser server that is safe to run next to a robot arm."""

from __future__ import annotations

import re
from collections.abc import Sequence

import viser
from typing_extensions import override

from armctl.errors import ServerError
from armctl.ui.guard.door import Door
from armctl.ui.guard.handles import ServerSlot
from armctl.ui.guard.listening import listening_socket
from armctl.ui.guard.probe import probe
from armctl.ui.guard.serving import GuardedServing
from armctl.ui.guard.tally import LOG, Tally

_VISER_VERSION = "1.1.1"
_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,256}")
_HOST_NAME = re.compile(r"[A-Za-z0-9._-]{1,253}|\[[0-9A-Fa-f:.]+\]")


class GuardedServer(viser.ViserServer):
    """A viser server without public tunnel, that can be stopped more than once.

    Only ``guarded_server`` makes one: the class alone does not guard anything.
    """

    def __init__(self, tally: Tally, *, host: str, port: int, label: str | None) -> None:
        self._tally = tally
        self._stopped = False
        super().__init__(  # pyright: ignore[reportUnknownMemberType]  # its deprecated options
            host=host, port=port, label=label, verbose=False
        )

    @property
    def refusals(self) -> dict[str, int]:
        """How often the guard refused what since the start."""
        return self._tally.counts

    @override
    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: a public tunnel would let anybody drive the arm."""
        del verbose
        self._tally.refuse("a public tunnel")
        return None

    @override
    def stop(self) -> None:
        """Stop serving and wait for the threads; a second call does nothing."""
        if self._stopped:
            return
        self._stopped = True
        super().stop()
        if self.refusals:
            LOG.info("refused in all: %s", ", ".join(f"{why}: {n}" for why, n in self.refusals.items()))


def guarded_server(
    host: str = "127.0.0.1",
    port: int = 8080,
    *,
    extra_hosts: Sequence[str] = (),
    token: str | None = None,
    label: str | None = None,
) -> GuardedServer:
    """Start a viser server behind the guard.

    Args:
        host: address to listen on; one that other computers can reach needs a token.
        port: TCP port; 0 takes any free one.
        extra_hosts: names by which other computers call this one (``arm.lab``), without port. Loopback
            names and the address connected to are always allowed.
        token: secret of at least 16 letters, digits, ``-`` or ``_``, which pages bring as ``/?token=…``
            once; a cookie keeps it.
        label: title of the main panel.

    Returns:
        The running server; it has already been tried from outside.

    Raises:
        ServerError: the address cannot be had, an option is unsafe, or the guard turns out not to hold.
    """
    if viser.__version__ != _VISER_VERSION:
        raise ServerError(
            f"the guard is made for viser {_VISER_VERSION}, but {viser.__version__} is installed; "
            f"install viser=={_VISER_VERSION}"
        )
    if token is not None and not _TOKEN.fullmatch(token):
        raise ServerError("the token must be 16 … 256 letters, digits, '-' or '_'")
    for name in extra_hosts:
        if not _HOST_NAME.fullmatch(name):
            raise ServerError(f"{name!r} is no host name; give it without scheme, port and path")
    tally = Tally()
    listener = listening_socket(host, port, beyond_loopback=token is not None)
    address, bound_port = listener.getsockname()[:2]
    serving = GuardedServing(listener, Door(tuple(extra_hosts), token, tally), ServerSlot())
    try:
        with serving.in_place():
            server = GuardedServer(tally, host=host, port=bound_port, label=label)
    except BaseException:
        listener.close()
        raise
    try:
        if serving.failure is not None:
            raise ServerError(
                f"the web server cannot be opened: {serving.failure}; "
                "is the installed version of websockets one that viser supports?"
            ) from serving.failure
        if serving.calls != 1 or server.get_port() != bound_port:
            raise ServerError(
                "the web server's guard is not effective: viser did not open its server through it; "
                "armctl does not run unguarded"
            )
        probe(address, bound_port, token_needed=token is not None)
    except BaseException:
        server.stop()
        listener.close()  # nobody else does when viser did not take it
        raise
    tally.open()
    serving.slot.server = server
    return server
