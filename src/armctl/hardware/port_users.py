"""Which other program has a serial port open, or is about to: told without opening the port.

Opening a port just to see whether it is free would reset an Arduino. Linux tells through ``/proc``, of
one's own programs; elsewhere, and of other users' programs, it turns out when the port is opened.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

PROC = Path("/proc")
UDEV_DATABASE = Path("/run/udev/data")

_PTY_FOLDER = "/dev/pts/"
_MODEM_MANAGER = "ModemManager"
_IGNORED = ("E:ID_MM_DEVICE_IGNORE=1", "E:ID_MM_PORT_IGNORE=1")

MODEM_MANAGER_NOTE = (
    "ModemManager is running and may talk to this port in the first seconds after plugging in; if the board "
    "misbehaves then, install the udev rule (`armctl ports --udev`)"
)


def program_using(device: str, proc: Path = PROC) -> str | None:
    """The program of this user, other than this process, that has ``device`` open: "name (process 812)".

    None for a pseudo-terminal: whoever serves it has it open, and that is no rival.
    """
    if is_pseudo_terminal(device):
        return None
    resolved = os.path.realpath(device)
    for process in sorted(proc.glob("[0-9]*")):
        if process.name != str(os.getpid()) and resolved in _open_files(process):
            return f"{_name(process)} (process {process.name})"
    return None


def is_pseudo_terminal(device: str) -> bool:
    """Whether a program, not a device, is at the other end of ``device``."""
    return os.path.realpath(device).startswith(_PTY_FOLDER)


def modem_manager_note(device: str, proc: Path = PROC, database: Path = UDEV_DATABASE) -> str | None:
    """What to know where ModemManager runs and no udev rule keeps it away from ``device``."""
    if _is_ignored(device, database):
        return None
    running = any(_name(process) == _MODEM_MANAGER for process in proc.glob("[0-9]*"))
    return MODEM_MANAGER_NOTE if running else None


def _open_files(process: Path) -> set[str]:
    """What a process's descriptors point to, by name: to ask a dead network mount for more may hang."""
    try:
        links = list((process / "fd").iterdir())
    except OSError:  # another user's process, or one that has just ended
        return set()
    files: set[str] = set()
    for link in links:
        with suppress(OSError):  # closed meanwhile
            files.add(os.readlink(link))
    return files


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:
        return "a program"


def _is_ignored(device: str, database: Path) -> bool:
    """Whether udev's record of the device tells ModemManager to leave it alone."""
    try:
        number = os.stat(device).st_rdev
        record = (database / f"c{os.major(number)}:{os.minor(number)}").read_text()
    except OSError:
        return False
    return any(line in _IGNORED for line in record.splitlines())
