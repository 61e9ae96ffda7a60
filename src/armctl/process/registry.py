"""The arm processes of this user: a note beside each one's socket says which arm and which port it holds."""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
from contextlib import suppress
from pathlib import Path

import msgspec

from armctl.boards import AUTOMATIC, split_kind
from armctl.errors import ArmProcessError
from armctl.robot import Robot
from armctl.robot.record import robot_record
from armctl.system import open_private, user_number, whose

_LOGGER = logging.getLogger("armctl.process")
_FILES = (".sock", ".hand", ".json", ".new")
_LONGEST = 85
"""bytes of a folder: the name of a socket may have 104 with what comes behind"""


class Note(msgspec.Struct, frozen=True):
    """What an arm process says of itself, readable by its user alone."""

    pid: int
    title: str
    """of its robot"""
    likeness: str
    """of what it was started with"""
    secret: str
    port: str = ""
    """the device of its board; empty: not connected, or simulated"""
    orphaned: bool = False
    """who started it is gone, and it holds the arm until somebody takes it over"""


def likeness(robot: Robot, board: str, rate_hz: float, pin: str) -> str:
    """The same for arm processes that are started alike, whichever tool is on: robot, board, rate, PIN."""
    told = (robot_record(robot.flange or robot), board, float(rate_hz), pin)
    return hashlib.sha256(msgspec.msgpack.encode(told, order="deterministic")).hexdigest()


def runtime_folder() -> Path | None:
    """The folder of the sockets, which only this user may enter; None where there are no Unix sockets."""
    user = user_number()
    if user is None:
        return None
    run = os.environ.get("XDG_RUNTIME_DIR", "")
    ours = os.path.isdir(run) and os.stat(run).st_uid == user  # `su` leaves that of somebody else
    folder = Path(run) / "armctl" if ours else Path(tempfile.gettempdir()) / f"armctl-{user}"
    if len(os.fsencode(folder)) > _LONGEST:
        raise ArmProcessError(f"{folder} is too long for a socket's name; set XDG_RUNTIME_DIR, or TMPDIR")
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        seen = folder.stat()
    except OSError as cause:
        raise ArmProcessError(f"no folder for the sockets: {folder}: {cause.strerror}") from cause
    if seen.st_uid != user or seen.st_mode & 0o077:
        raise ArmProcessError(f"{folder} is open to other users; remove it, or make it private: chmod 700")
    return folder


def write_note(address: Path, note: Note) -> None:
    """Put a note beside a socket, in one step."""
    new = address.with_suffix(".new")
    try:
        new.unlink(missing_ok=True)
        with open(new, "xb", opener=open_private) as file:
            file.write(msgspec.json.encode(note))
        new.replace(address.with_suffix(".json"))
    except OSError as cause:
        _LOGGER.warning("what this process holds is not noted: %s: %s", new, cause.strerror)


def remove(address: Path) -> None:
    """Take away a socket and what is beside it."""
    for suffix in _FILES:
        address.with_suffix(suffix).unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Take away what killed arm processes have left."""
    for pid, address in _addresses(folder):
        if not _runs(pid):
            remove(address)
            _LOGGER.warning("the arm process %d was killed; its socket is removed", pid)


def running(folder: Path) -> list[tuple[Path, Note]]:
    """The arm processes that run, with their sockets."""
    notes: list[tuple[Path, Note]] = []
    for pid, address in _addresses(folder):
        # a note that is just being taken away, or is not one
        with suppress(OSError, msgspec.MsgspecError):
            note = msgspec.json.decode(address.with_suffix(".json").read_bytes(), type=Note)
            if note.pid == pid and _runs(pid):
                notes.append((address, note))
    return notes


def orphans(folder: Path, like: str, port: str) -> list[tuple[Path, Note]]:
    """The arm processes that may be taken over by one who would start the like for a port."""
    return [
        (address, note)
        for address, note in running(folder)
        if note.orphaned and note.likeness == like and (port == AUTOMATIC or _same(note.port, port))
    ]


def holder(port: str) -> str | None:
    """Which other arm process holds a port, and what to do; None: none does."""
    folder = runtime_folder()
    for _, note in [] if folder is None else running(folder):
        if note.pid == os.getpid() or not _same(note.port, port):
            continue
        holds = f"the arm process {note.pid} holds it and drives {note.title}"
        if note.orphaned:
            return (
                f"{holds}, whose program is gone: it keeps the arm from dropping. Start armctl with the same "
                f"robot, calibration, PIN and port to take it over, or support the arm and end it: "
                f"kill {note.pid}"
            )
        return (
            f"{holds}. Join it: open the link that its `armctl serve` printed in a browser, or give it to "
            f"Arm.connect; or end its program, or the process itself: kill {note.pid}"
        )
    return None


def _addresses(folder: Path) -> list[tuple[int, Path]]:
    """Process ids and sockets, by the names of files."""
    names = {path.stem for path in folder.glob("arm-*") if path.suffix in _FILES}
    numbers = [(name.removeprefix("arm-"), folder / f"{name}.sock") for name in sorted(names)]
    return [(int(number), address) for number, address in numbers if number.isdecimal()]


def _runs(pid: int) -> bool:
    return whose(pid) == "ours"  # else it has ended, and somebody else's may have the number by now


def _same(held: str, port: str) -> bool:
    """Whether a port is the device that is held; one device can have several names."""
    device = split_kind(port)[1]
    if "://" in device or "://" in held:
        return held == device
    return bool(held) and os.path.realpath(held) == os.path.realpath(device)
