"""Starts an arm process and connects to it."""

from __future__ import annotations

import logging
import os
import secrets
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import IO, Any, Self, cast

import msgspec

from armctl.boards import ANY_BOARD
from armctl.errors import ArmProcessError, BoardError, InputError
from armctl.hardware import BoardType
from armctl.hardware.boards import board_type
from armctl.process.lines import LocalLine
from armctl.process.link import Link
from armctl.process.registry import likeness, orphans, runtime_folder, sweep
from armctl.robot import Robot
from armctl.robot.record import plain, robot_of, robot_record
from armctl.system import start_apart

_LOGGER = logging.getLogger("armctl.process")


class Start(msgspec.Struct, frozen=True):
    """What an arm process is told by the process that starts it, over a pipe that nobody else has."""

    robot: dict[str, Any]
    """see ``robot_record``"""
    board_settings: Any
    """of this robot, as plain values"""
    settings_class: str
    """of these, ``module:name``, where the board does not say it; empty: it does, or there are none"""
    board: str
    rate_hz: float
    folder: str | None
    """of its Unix socket; None: a port of the loopback address"""
    secret: str
    pin: str
    logs: bool
    """to standard error, as ``armctl serve`` does"""

    @classmethod
    def of(
        cls, robot: Robot, board: str, rate_hz: float, folder: Path | None, pin: str, *, logs: bool
    ) -> Self:
        """For a robot with its body. ``InputError``: its board's settings cannot be told."""
        given, kind = robot.board_settings, board_type(robot.board)
        given = dict(cast("Mapping[Any, Any]", given)) if isinstance(given, Mapping) else given
        named = "" if given is None or kind.settings_type() else _class_name(kind, type(given))
        try:
            settings = msgspec.to_builtins(given, enc_hook=plain)
        except (TypeError, NotImplementedError) as cause:
            raise InputError(
                f"{kind.title}: a {type(given).__name__} of settings cannot be told to the arm process; "
                "let its BoardType say a settings_type, a msgspec.Struct or a dataclass"
            ) from cause
        where, secret = None if folder is None else str(folder), secrets.token_urlsafe(24)
        return cls(robot_record(robot), settings, named, board, rate_hz, where, secret, pin, logs)

    def whole_robot(self) -> Robot:
        """The robot, with what its board's driver reads."""
        robot = robot_of(self.robot)
        board = board_type(robot.board)
        kind = board.settings_type() or _class_of(board, self.settings_class)
        settings = None if kind is None else msgspec.convert(self.board_settings, kind | None)
        return replace(robot.flange or robot, board_settings=settings).with_tool(robot.tool)


# A board of an older package does not say of which class its settings are: it is its own, or a plain one.


def _class_name(board: BoardType, kind: type) -> str:
    if kind.__module__.partition(".")[0] not in (type(board).__module__.partition(".")[0], "builtins"):
        raise InputError(
            f"{board.title}: settings of a foreign class {kind.__qualname__}; say a settings_type"
        )
    return f"{kind.__module__}:{kind.__qualname__}"


def _class_of(board: BoardType, name: str) -> type | None:
    if not name:
        return None
    module, _, path = name.partition(":")
    found = cast("type", reduce(getattr, path.split("."), import_module(module)))
    return found if _class_name(board, found) == name else None


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
    start = Start.of(robot, board, rate_hz, folder, pin, logs=logs)
    places = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
    process = start_apart(
        [sys.executable, "-P", "-m", "armctl.process", robot.name],  # the name is for who reads `ps`
        os.environ | {"PYTHONPATH": places},  # boards of other packages are found where we find them
    )
    told, says = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
    try:
        with told:
            told.write(msgspec.msgpack.encode(start))
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
