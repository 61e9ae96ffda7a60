"""Who may open a device and which program has it open (``/proc``); opening it would reset an Arduino."""

from __future__ import annotations

import os
from contextlib import suppress
from importlib import resources
from pathlib import Path

from armctl.system import group_of, is_pseudo_terminal, joined_since_login

UDEV_RULES_NAME = "70-armctl.rules"
UDEV_COMMAND = f"armctl ports --udev | sudo tee /etc/udev/rules.d/{UDEV_RULES_NAME}"
_USUAL_GROUP = "dialout"


def permission_hint(device: str) -> str:
    """What gives this user access to ``device``: the line with the group that owns it, or the udev rule."""
    # Distributions differ (dialout, uucp). What belongs to root's own group udev has not set up.
    group = group_of(device) or _USUAL_GROUP
    group = _USUAL_GROUP if group == "root" else group
    if joined_since_login(group):
        return (
            f"you are in the group {group} already, but this login began before that: log out and in again "
            "(a new terminal is not enough)"
        )
    return (
        f"run `sudo usermod -aG {group} $USER`, then log out and in again "
        f"(a new terminal is not enough); or install the udev rule: `{UDEV_COMMAND}`, then plug it in again"
    )


def udev_rules() -> str:
    """The rules file that gives whoever sits at the computer access to the boards' ports."""
    return resources.files("armctl.hardware").joinpath(UDEV_RULES_NAME).read_text(encoding="utf-8")


PROC = Path("/proc")
UDEV_DATABASE = Path("/run/udev/data")

_MODEM_MANAGER = "ModemManager"
_IGNORED = ("E:ID_MM_DEVICE_IGNORE=1", "E:ID_MM_PORT_IGNORE=1")

MODEM_MANAGER_NOTE = (
    "ModemManager is running and may talk to this port in the first seconds after plugging in; if the board "
    "misbehaves then, install the udev rule (`armctl ports --udev`)"
)


def program_using(device: str, proc: Path = PROC) -> str | None:
    """The other program of this user that has ``device`` open; None for a pseudo-terminal: its server has."""
    if is_pseudo_terminal(device):
        return None
    resolved = os.path.realpath(device)
    for process in sorted(proc.glob("[0-9]*")):
        if process.name != str(os.getpid()) and resolved in _open_files(process):
            return f"{_name(process)} (process {process.name})"
    return None


def modem_manager_note(device: str, proc: Path = PROC, database: Path = UDEV_DATABASE) -> str | None:
    """What to know where ModemManager runs and udev's record of ``device`` does not keep it away."""
    with suppress(OSError):
        number = os.stat(device).st_rdev
        record = (database / f"c{os.major(number)}:{os.minor(number)}").read_text()
        if any(line in _IGNORED for line in record.splitlines()):
            return None
    running = any(_name(process) == _MODEM_MANAGER for process in proc.glob("[0-9]*"))
    return MODEM_MANAGER_NOTE if running else None


def _open_files(process: Path) -> set[str]:
    """What a process's descriptors point to, by name: to ask a dead network mount for more may hang."""
    files: set[str] = set()
    with suppress(OSError):  # another user's process, or one that has just ended
        for link in (process / "fd").iterdir():
            with suppress(OSError):  # closed meanwhile
                files.add(os.readlink(link))
    return files


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:
        return "a program"
