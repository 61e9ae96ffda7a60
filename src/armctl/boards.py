"""From a port as the user names it to a driver: the simulated board, the one that is found, or a device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from armctl.errors import PortError
from armctl.hardware import ChannelSettings, Driver
from armctl.hardware.maestro import MaestroDriver, MaestroModel, SimulatedMaestro, serve_simulated_maestro
from armctl.hardware.ports import find_maestro, list_ports
from armctl.hardware.pty_server import PtyServer

SIMULATED, AUTOMATIC = "sim", "auto"
_SIMULATED_TIMEOUT_S = 0.5
"""The simulated board lives in this process: on a busy computer it is late, never gone."""


class Boards:
    """Opens drivers, and owns the simulated board behind ``sim`` for as long as the program runs."""

    def __init__(
        self,
        channels: Sequence[ChannelSettings],
        now: Callable[[], float],
        only_simulated: str | None = None,
    ) -> None:
        """Prepare; ``only_simulated`` says why no real board may be driven, None where one may."""
        self._channels, self._now, self._only_simulated = tuple(channels), now, only_simulated
        self._lock = threading.Lock()
        self._simulated: PtyServer[SimulatedMaestro] | None = None

    def driver(self, port: str) -> Driver:
        """A driver for a port, not opened yet.

        Args:
            port: ``sim``, ``auto``, a device or ``socket://host:port``.

        Raises:
            PortError: ``auto`` found no board, or more than one; or the arm may only be simulated.
        """
        if port == SIMULATED:
            server = self.simulated()
            return MaestroDriver(
                server.port,
                now=self._now,
                model=_model(self._channels),
                simulated=True,
                timeout_s=_SIMULATED_TIMEOUT_S,
            )
        if self._only_simulated is not None:
            raise PortError(f"{port} is not opened: {self._only_simulated}")
        if port == AUTOMATIC:
            port = find_maestro(list_ports()).device
        return MaestroDriver(port, now=self._now)

    def simulated(self) -> PtyServer[SimulatedMaestro]:
        """The simulated board's server, started when it is first asked for."""
        with self._lock:
            if self._simulated is None:
                server = serve_simulated_maestro(
                    self._now, channels=self._channels, model=_model(self._channels)
                )
                server.__enter__()
                self._simulated = server
            return self._simulated

    def close(self) -> None:
        """Take the simulated board off its line. May be called more than once."""
        with self._lock:
            server, self._simulated = self._simulated, None
        if server is not None:
            server.__exit__(None, None, None)


def _model(channels: Sequence[ChannelSettings]) -> MaestroModel:
    """The smallest Maestro with enough channels."""
    return MaestroModel.with_channels(max((one.channel for one in channels), default=0) + 1)
