"""What an encoder board has been told of its axes."""

from __future__ import annotations

from armctl.errors import StateError
from armctl.hardware.encoder.axis_table import AxisTable
from armctl.hardware.encoder.session import EncoderSession

WATCHDOG_MS = 500
_OLDEST_STATUS_S = 0.05


class ToldSettings:
    """Sends settings where the board has not got them: it forgets all of them when it starts anew."""

    def __init__(self) -> None:
        self._lines: tuple[str, ...] | None = None
        """what the board has; None where that is not certain"""
        self._restarts = 0
        self._told = False

    def tell(self, session: EncoderSession, table: AxisTable) -> None:
        """Send what ``table`` says, unless the board has it.

        Raises:
            StateError: the motors are on with other settings.
            BoardError: the board refuses, or the line is gone.
        """
        session.drain()
        lines = table.configuration()
        if lines == self._lines and session.heard.restarts == self._restarts:
            return
        status = session.fresh_status(_OLDEST_STATUS_S)
        if status.mode.powered:
            raise StateError(
                f"{session.name}: the motors are on, and with other settings; release first, or wait half a "
                "second after another program has let go of the board"
            )
        if not self._told and status.latched:
            session.command("CLR")  # from before armctl connected; told in the identity
        restarts, self._lines, self._told = session.heard.restarts, None, True
        for line in (f"WD {WATCHDOG_MS}", *lines):
            session.command(line)
        self._lines, self._restarts = lines, restarts
