"""Serves a firmware image on a pseudo-terminal in real time, for armctl and any other serial client.

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
from tests.avr.board import AvrBoard
from tests.avr.building import encoder_image, shim_library
from tests.avr.firmata_image import firmata_image

from armctl.hardware.simulation import PtyServer
from armctl.runtime.clock import MonotonicClock

_TICK_S = 0.002
_LOOK_S = 0.2
_IMAGES: dict[str, Callable[[], Path]] = {"firmata": firmata_image, "encoder": encoder_image}


@contextmanager
def served(avr: Avr, now: Callable[[], float], link: Path | None = None) -> Generator[PtyServer[AvrBoard]]:
    """Serve a simulated CPU on a pty while the context is open; its ``port`` is what a client opens.

    Raises (on leaving):
        AvrError: the CPU has crashed. Clients saw a line that broke.
    """
    board = AvrBoard(avr)
    with PtyServer(board, now, link=link, tick_s=_TICK_S) as server:
        yield server
    if board.crash is not None:
        raise board.crash


@click.command()
@click.argument("image")
@click.option("--link", type=click.Path(path_type=Path), help="Where to find the port, e.g. /tmp/mega.")
def main(image: str, link: Path | None) -> None:
    """Serve IMAGE (firmata, encoder, or a hex file) on a pseudo-terminal until interrupted."""
    path = _IMAGES[image]() if image in _IMAGES else Path(image)
    ended = threading.Event()

    def end(signum: int, frame: FrameType | None) -> None:
        ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    with (
        closing(Avr(shim_library(), path)) as avr,
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
