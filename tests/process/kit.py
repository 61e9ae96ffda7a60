"""An arm served inside the test's own process, on a socket, and clients of it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

from armctl.boards import ANY_BOARD
from armctl.process.link import Link, LocalLine
from armctl.process.server import serve_arm
from armctl.robot import Robot, load_robot

ROBOT = load_robot("uzuner")
SECRET = "secret"


@contextmanager
def served(folder: Path | None, robot: Robot = ROBOT) -> Iterator[Path | tuple[str, int]]:
    """The address of an arm that is served until its last client has gone."""
    address: Future[str] = Future()
    path = None if folder is None else folder / "arm.sock"

    def run() -> None:
        asyncio.run(serve_arm(robot, ANY_BOARD, 50.0, path, SECRET, address.set_result))

    thread = threading.Thread(target=run)
    thread.start()
    said = address.result(20)
    keeper = Link(LocalLine(_address(said, folder), SECRET), "keeper", robot)
    try:
        yield _address(said, folder)
    finally:
        keeper.close()  # the last one that owns it
        thread.join()


def _address(said: str, folder: Path | None) -> Path | tuple[str, int]:
    return ("127.0.0.1", int(said)) if folder is None else Path(said)
