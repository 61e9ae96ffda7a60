"""A simulated CPU as what armctl calls a board, so that its own lines and drivers reach it."""

from __future__ import annotations

from collections.abc import Callable

from tests.avr.avr import Avr, AvrError
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardError

_LONGEST_STEP_S = 0.05


class AvrBoard:
    """A real firmware image behind the ``ByteModel`` protocol.

    The CPU's time follows the time it is told. Where it cannot keep up, the time it is behind by is
    lost (``lost_s``), as if the CPU had stood still meanwhile.
    """

    def __init__(self, avr: Avr) -> None:
        self.avr = avr
        self.crash: AvrError | None = None
        """why the CPU crashed"""
        self.lost_s = 0.0
        self._told: float | None = None

    def feed(self, data: bytes) -> bytes:
        """Put bytes on the serial line, and return what the firmware has sent by now."""
        self._check()
        self.avr.write(data)
        return self.avr.read()

    def advance(self, now: float) -> bytes:
        """Run up to ``now`` [s], at most 50 ms, and return what the firmware has sent.

        Raises:
            BoardError: the CPU has crashed; the board has left the line.
        """
        self._check()
        if self._told is None:
            self._told = now
        behind = now - self._told
        self._told = now
        self.lost_s += max(0.0, behind - _LONGEST_STEP_S)
        try:
            self.avr.run_for(min(behind, _LONGEST_STEP_S))
        except AvrError as error:
            self.crash = error
            self._check()
        return self.avr.read()

    def reset(self) -> None:
        """Press the reset button."""
        self.avr.reset()

    def _check(self) -> None:
        if self.crash is not None:
            raise BoardError(str(self.crash)) from self.crash


class _OwnTime:
    """The same board where the CPU itself is the clock: time goes on only while somebody waits."""

    def __init__(self, avr: Avr) -> None:
        self._avr = avr

    def feed(self, data: bytes) -> bytes:
        self._avr.write(data)
        return self._avr.read()

    def advance(self, now: float) -> bytes:
        return self._avr.read()

    def reset(self) -> None:
        self._avr.reset()


def stepped_line(avr: Avr) -> Callable[[], LoopTransport]:
    """What opens a line to the simulated CPU for a driver whose clock is ``avr.now``.

    Everything is then in simulated time, and the same every time: a read that waits lets the CPU run.
    Its serial line has the firmware's baud rate. A crash raises ``AvrError``.
    """
    return lambda: LoopTransport(_OwnTime(avr), lambda: avr.now, avr.run_for, name=avr.image.name)
