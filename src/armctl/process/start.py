"""Starts an arm process and connects to it."""

from __future__ import annotations

import asyncio
import ctypes
import logging
import os
import pickle
import platform
import secrets
import signal
import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from armctl.boards import ANY_BOARD
from armctl.errors import BoardError
from armctl.log_files import begin as begin_log
from armctl.process.link import Link, LocalLine
from armctl.process.server import serve_arm
from armctl.robot import Robot

_PREPARE = "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
_MAIN = _PREPARE + "from armctl.process.start import main; main()"


@dataclass(frozen=True)
class _Start:
    """What an arm process is told by the process that starts it, over a pipe that nobody else has."""

    robot: Robot
    board: str
    rate_hz: float
    folder: Path | None
    """of its Unix socket; None: a port of the loopback address"""
    secret: str
    pin: str
    logs: bool
    """to standard error, as ``armctl serve`` does"""


def start_arm(
    robot: Robot,
    board: str = ANY_BOARD,
    rate_hz: float = 50.0,
    name: str = "library",
    *,
    beats: bool = True,
    logs: bool = False,
    pin: str = "",
) -> Link:
    """Start a process that runs an arm, not connected to a board yet, and connect to it.

    ``board``: as ``Host``. ``name``: how its log calls this client. ``beats``: as ``Link``. ``logs``: its log
    goes to standard error. ``pin``: the teacher's, who can always take control.
    ``BoardError``: it cannot be started.
    """
    folder = runtime_folder()
    start = _Start(robot, board, rate_hz, folder, secrets.token_urlsafe(24), pin, logs)
    # a session of its own: Ctrl-C is for us, who bring the arm to rest before we end it
    process = subprocess.Popen(
        [sys.executable, "-c", _MAIN], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )
    told, says = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
    try:
        with told:
            pickle.dump(sys.path, told)
            pickle.dump(start, told)
        with says:
            kind, _, said = says.readline().decode().rstrip("\n").partition(" ")
        if kind != "ready":
            raise BoardError(f"the arm process did not start: {said or f'exit status {process.wait()}'}")
        address = ("127.0.0.1", int(said)) if folder is None else Path(said)
        return Link(LocalLine(address, start.secret), name, robot, process, beats=beats)
    except BaseException:
        process.kill()
        process.wait()
        raise


def runtime_folder() -> Path | None:
    """The folder of the sockets, which only this user may enter; None where there are no Unix sockets."""
    if not hasattr(asyncio, "start_unix_server"):
        return None
    run = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(run) / "armctl" if run else Path(tempfile.gettempdir()) / f"armctl-{os.getuid()}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    seen = folder.stat()
    if seen.st_uid != os.getuid() or seen.st_mode & 0o077:
        raise BoardError(f"{folder} can be entered by other users; remove it, or make it private: chmod 700")
    return folder


_SLICE_NS = 100_000
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}
"""numbers of the system call, of 64-bit programs"""


def _ask_for_short_slices() -> None:
    """Run soon after waking up on a busy computer, for short times; every user may ask Linux for that.

    With four busy programs on two cores a tick comes 0.1 ms late instead of 3.5 (median), 2.7 instead of 8
    (p90). Linux before 6.12 takes no notice.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if sys.platform == "linux" and sys.maxsize > 2**32 and number is not None:
        size, ordinary, nothing = 48, 0, 0
        wish = struct.pack("=IIQiIQQQ", size, ordinary, 0, os.nice(0), nothing, _SLICE_NS, 0, 0)
        ctypes.CDLL(None).syscall(number, 0, wish, 0)


def main() -> None:
    """The arm process."""
    start: _Start = pickle.load(sys.stdin.buffer)
    for number in (signal.SIGINT, signal.SIGPIPE, getattr(signal, "SIGHUP", signal.SIGINT)):
        signal.signal(number, signal.SIG_IGN)
    _ask_for_short_slices()
    if start.logs:
        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    _ = start.robot.inverse_kinematics  # takes a while: here, before the first motion waits for it

    def ready(address: str) -> None:
        sys.stdout.write(f"ready {address}\n")
        sys.stdout.close()

    address = None if start.folder is None else start.folder / f"arm-{os.getpid()}.sock"
    with begin_log("arm"):
        asyncio.run(
            serve_arm(start.robot, start.board, start.rate_hz, address, start.secret, ready, start.pin)
        )
