"""A simulated Firmata board on a pty, ready to be opened."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.pty_server import PtyServer


def serve_simulated_firmata(
    now: Callable[[], float], *, link: Path | None = None, boot_s: float = 0.0
) -> PtyServer[SimulatedFirmata]:
    """A server to be entered as a context; its ``port`` is what a driver or any other client opens.

    Opening a pty does not restart the board, as opening a real Mega's port does.

    Args:
        now: the clock [s].
        link: where the pty is to be found; under its own name when None.
        boot_s: how long the board takes to start.
    """
    return PtyServer(SimulatedFirmata(boot_s), now, link=link)
