"""Starts an arm process and connects to it."""

from __future__ import annotations

import asyncio
import ctypes
import logging
import os
import pickle
import platform
import secrets
import struct
import sys
import traceback
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import IO, cast

from armctl.boards import ANY_BOARD
from armctl.errors import ArmProcessError, BoardError
from armctl.log_files import begin as begin_log
from armctl.process.link import Link, LocalLine
from armctl.process.registry import likeness, orphans, runtime_folder, sweep
from armctl.process.server import serve_arm
from armctl.robot import Robot
from armctl.system import outlive_readers, start_apart

_LOGGER = logging.getLogger("armctl.process")


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
    port: str | None = None,
) -> Link:
    """Start a process that runs an arm, not connected to a board yet, and connect to it.

    One that holds the same arm on ``port`` because who started it is gone is taken over instead.
    ``board``: as ``Host``. ``name``: how its log calls this client. ``beats``: as ``Link``. ``logs``: its log
    goes to standard error. ``pin``: the teacher's, who can always take control.
    ``BoardError``: it cannot be started.
    """
    folder, robot = runtime_folder(), robot.with_body()
    if folder is not None:
        sweep(folder)
        if port is not None and (link := _taken_over(folder, robot, board, rate_hz, pin, port, name, beats)):
            return link
    start = _Start(robot, board, rate_hz, folder, secrets.token_urlsafe(24), pin, logs)
    places = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
    process = start_apart(
        [sys.executable, "-P", "-m", "armctl.process", robot.name],  # the name is for who reads `ps`
        os.environ | {"PYTHONPATH": places},  # boards of other packages are found where we find them
    )
    told, says = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
    try:
        with told:
            pickle.dump(start, told)
        with says:
            kind, _, said = says.readline().decode().rstrip("\n").partition(" ")
        if kind != "ready":
            raise ArmProcessError(f"the arm process did not start: {said or f'exit status {process.wait()}'}")
        address = ("127.0.0.1", int(said)) if folder is None else Path(said)
        return Link(LocalLine(address, start.secret), name, robot, process, beats=beats)
    except BaseException:
        process.kill()
        process.wait()
        raise


def _taken_over(
    folder: Path, robot: Robot, board: str, rate_hz: float, pin: str, port: str, name: str, beats: bool
) -> Link | None:
    """An arm process that was left alone and holds this arm on this port; None: there is none."""
    for address, note in orphans(folder, likeness(robot, board, rate_hz, pin), port):
        try:
            link = Link(LocalLine(address, note.secret, adopts=True), name, robot, note.pid, beats=beats)
        except BoardError as refusal:  # it has just ended, or somebody else was faster
            _LOGGER.warning("the arm process %d was not taken over: %s", note.pid, refusal)
            continue
        _LOGGER.warning(
            "the program that drove %s on %s was gone without a word; its arm process %d has held the arm "
            "since, and is taken over", robot.title, note.port, note.pid,
        )  # fmt: skip
        return link
    return None


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
    outlive_readers()
    _ask_for_short_slices()
    if start.logs:
        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    # What takes a while: here, before a motion waits for it, or a tick.
    _ = start.robot.inverse_kinematics
    import_module("scipy.optimize")  # and scipy.linalg with it

    def ready(address: str) -> None:
        with suppress(BrokenPipeError):  # who started it is gone: nobody will come
            sys.stdout.write(f"ready {address}\n")
            sys.stdout.close()

    address = None if start.folder is None else start.folder / f"arm-{os.getpid()}.sock"
    arm = serve_arm(start.robot, start.board, start.rate_hz, address, start.secret, ready, start.pin)
    status = 1
    try:
        with begin_log("arm"):
            asyncio.Runner().run(arm)
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        # The arm stands and its line is closed. Python would wait for threads that plan or decode.
        with suppress(OSError, ValueError):
            sys.stderr.flush()
        os._exit(status)
