"""A simulated CPU as a board: for drivers in simulated time, and on a pseudo-terminal in real time.

``python -m tests.avr.serve IMAGE [--link PATH]`` runs until it is interrupted, or ends with exit
status 1 when the simulated CPU crashes.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType

import click
from tests.avr.avr import Avr, AvrError
from tests.avr.building import IMAGES
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardError
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock

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
        """Run up to ``now`` [s], at most 50 ms, and return what the firmware has sent."""
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


class OwnTime(AvrBoard):
    """The same board where the CPU itself is the clock: time goes on only while a read waits."""

    def advance(self, now: float) -> bytes:
        return self.avr.read()


def stepped_line(avr: Avr) -> Callable[[], LoopTransport]:
    """What opens a line to the simulated CPU for a driver whose clock is ``avr.now``.

    Everything is then in simulated time, and the same every time: a read that waits lets the CPU run.
    Its serial line has the firmware's baud rate. A crash raises ``AvrError``.
    """
    return lambda: LoopTransport(OwnTime(avr), lambda: avr.now, avr.run_for, name=avr.image.name)


_TICK_S = 0.002
_LOOK_S = 0.2


@contextmanager
def served(avr: Avr, now: Callable[[], float], link: Path | None = None) -> Generator[BoardServer[AvrBoard]]:
    """Serve a simulated CPU on a pty while the context is open; ``AvrError`` on leaving where it crashed."""
    board = AvrBoard(avr)
    with BoardServer(board, now, link=link, tick_s=_TICK_S) as server:
        yield server
    if board.crash is not None:
        raise board.crash


@click.command()
@click.argument("image")
@click.option("--link", type=click.Path(path_type=Path), help="Where to find the port, e.g. /tmp/mega.")
def main(image: str, link: Path | None) -> None:
    """Serve IMAGE (firmata, encoder, or a hex file) on a pseudo-terminal until interrupted."""
    path = IMAGES[image]() if image in IMAGES else Path(image)
    ended = threading.Event()

    def end(signum: int, frame: FrameType | None) -> None:
        ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    with (
        closing(Avr(path)) as avr,
        served(avr, MonotonicClock().now, link) as server,
    ):
        click.echo(f"{path.name} on {server.port} (ctrl-c ends it)")
        while not ended.wait(_LOOK_S):
            with server.inspect() as board:
                if board.crash is not None:
                    break
        with server.inspect() as board:
            click.echo(f"{avr.now:.1f} s simulated, {board.lost_s:.1f} s behind real time")


if __name__ == "__main__":
    try:
        main()
    except AvrError as error:
        sys.exit(str(error))
