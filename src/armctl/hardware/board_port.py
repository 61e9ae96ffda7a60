"""The port of a driver: what the system says of it, how it is opened, and which board is behind it then."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from armctl.errors import PortError
from armctl.hardware.ports import PortInfo, describe_port
from armctl.hardware.serial_transport import SerialTransport
from armctl.hardware.transport import Transport

AcceptBoard = Callable[[str | None], None]
"""Is told the serial number of the board behind an open port; raises ``PortError`` for the wrong one."""
_BAUD = 115_200
_PTY_FOLDER = "/dev/pts/"


def any_board(_serial_number: str | None) -> None:
    """Whatever board is there."""


class BoardPort:
    """A port by its name, or what opens a transport.

    Which board is behind a name is certain only while the port is open: until then another one may be
    plugged in there. So it is looked up before opening, and once more after.

    Args:
        line: port name (device, pty, ``socket://host:port``), or what opens the transport.
        ports: the listing of serial ports; a simulated board, a pty or a socket is not among them.
        accept: judges the board that is there.
        simulated: whether a simulated board is at the other end.
    """

    def __init__(
        self,
        line: str | Callable[[], Transport],
        ports: Callable[[], Sequence[PortInfo]],
        accept: AcceptBoard,
        *,
        simulated: bool,
    ) -> None:
        self._line, self._ports, self._accept, self._simulated = line, ports, accept, simulated

    @property
    def restarts_board(self) -> bool:
        """Whether opening the line starts an Arduino anew, as a device's control lines do."""
        if not isinstance(self._line, str) or "://" in self._line:
            return False
        return not str(Path(self._line).resolve()).startswith(_PTY_FOLDER)

    def look_up(self) -> PortInfo | None:
        """What is listed under the name now; None where nothing is.

        Opening the line of an Arduino starts it anew and lets its servos or motors go, so a board that is
        listed as another one is left alone.

        Raises:
            PortError: it is listed as one that cannot be used, or that is not the one that is wanted.
        """
        info = self._listed()
        if info is not None and not info.usable:
            raise PortError(f"{self._line}: {info.why_not}")
        if info is not None:
            self._accept(info.serial_number)
        return info

    def open(self, baud: int = _BAUD) -> tuple[Transport, PortInfo | None]:
        """Open the line, and see which board is behind it; None where the system does not tell.

        Raises:
            PortError: it cannot be opened, or the board is not the one that is wanted.
        """
        transport = SerialTransport(self._line, baud=baud) if isinstance(self._line, str) else self._line()
        try:
            info = self._listed()
            if not self._simulated:
                self._accept(None if info is None else info.serial_number)
        except BaseException:
            transport.close()
            raise
        return transport, info

    def _listed(self) -> PortInfo | None:
        if not isinstance(self._line, str) or self._simulated:
            return None
        return describe_port(self._line, self._ports())
