"""Who may open a device, which program has it open, and what of this computer may disturb a board.

All of it is read from ``/proc``, ``/sys`` and udev's files: opening the device would reset an Arduino.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib import resources
from pathlib import Path

from armctl.lazy_dataclass import dataclass
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
UDEV_FOLDERS = tuple(
    Path(folder) / "udev/rules.d" for folder in ("/etc", "/run", "/usr/local/lib", "/usr/lib", "/lib")
)
"""where rules are, the folder that counts most first"""
SYSFS = Path("/sys")

_MODEM_MANAGER = "ModemManager"
_IGNORED = ("E:ID_MM_DEVICE_IGNORE=1", "E:ID_MM_PORT_IGNORE=1")

MODEM_MANAGER_NOTE = (
    "ModemManager is running and may talk to this port in the first seconds after plugging in; if the board "
    "misbehaves then, install the udev rule (`armctl ports --udev`)"
)


def latency_timer_ms(port: str, sysfs: Path = SYSFS) -> int | None:
    """How long the USB adapter behind a port holds answers back [ms]; None: it has no such timer."""
    name = Path(os.path.realpath(port)).name
    try:
        return int((sysfs / "bus/usb-serial/devices" / name / "latency_timer").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


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


# brltty, the service for Braille displays, takes USB-to-serial chips that such displays are made with, too.


@dataclass(frozen=True, slots=True)
class TakenDevice:
    """A USB device that has no serial port, because brltty has taken it."""

    place: str
    """as the kernel calls it, e.g. 1-1.2"""
    vendor: int
    product: int
    serial_number: str | None
    why: str


def taken_devices(folders: Sequence[Path] = UDEV_FOLDERS, sysfs: Path = SYSFS) -> Iterator[TakenDevice]:
    """Those that one of brltty's udev rules names, and that have no serial port."""
    for device in sorted((sysfs / "bus/usb/devices").glob("*")):
        numbers = _numbers(device)
        if numbers is None or any(device.glob("*:*/tty*")):
            continue
        rule = braille_rule(*numbers, folders)
        if rule is not None:
            why = f"it has no serial port: brltty, the service for Braille displays, takes it ({rule})"
            serial = _text(device / "serial") or None
            yield TakenDevice(device.name, *numbers, serial, f"{why}; {_without_brltty(rule)}")


def braille_rule(vendor: int, product: int, folders: Sequence[Path] = UDEV_FOLDERS) -> Path | None:
    """The file of udev rules by which brltty starts for a device with these USB numbers; None: there is none.

    A file hides those of its name in the folders behind it.
    """
    rules: dict[str, Path] = {}
    for folder in folders:
        for path in sorted(folder.glob("*brltty*.rules")):
            rules.setdefault(path.name, path)
    wanted = f'"{vendor:x}/{product:x}/'
    for path in rules.values():
        lines = _text(path).lower().splitlines()
        if any(wanted in line and not line.lstrip().startswith("#") for line in lines):
            return path
    return None


def braille_note(device: str, folders: Sequence[Path] = UDEV_FOLDERS, sysfs: Path = SYSFS) -> str | None:
    """What to know where brltty may take the port of ``device`` away."""
    usb = _usb_device(device, sysfs)
    numbers = None if usb is None else _numbers(usb)
    rule = None if numbers is None else braille_rule(*numbers, folders)
    if rule is None:
        return None
    what = f"brltty, the service for Braille displays, may take this port away ({rule} names its chip)"
    return f"{what}; {_without_brltty(rule)}"


def _without_brltty(rule: Path) -> str:
    return (
        "if you use no Braille display, run `sudo apt remove brltty` (or, to keep it, "
        f"`sudo ln -sf /dev/null /etc/udev/rules.d/{rule.name} && sudo udevadm control --reload`), "
        "then plug the board in again"
    )


# USB devices that are idle may be suspended; some boards do not come back from it.

SUSPEND_NOTE = (
    "Linux may suspend this USB device while it is idle (TLP and powertop switch that on); if the board is "
    "lost or restarts by itself, install the udev rules (`armctl ports --udev`), which keep it awake"
)


def suspend_note(device: str, sysfs: Path = SYSFS) -> str | None:
    """What to know where the kernel may suspend the USB device behind ``device``."""
    usb = _usb_device(device, sysfs)
    if usb is None or _text(usb / "power/control") != "auto":
        return None
    never = _text(usb / "power/autosuspend_delay_ms").startswith("-")
    return None if never else SUSPEND_NOTE


def port_notes(device: str) -> tuple[str, ...]:
    """All that may disturb the board behind ``device``, and what to do."""
    notes = (modem_manager_note(device), braille_note(device), suspend_note(device))
    return tuple(note for note in notes if note is not None)


def _usb_device(device: str, sysfs: Path) -> Path | None:
    """The folder of the USB device that a serial port belongs to; None: it belongs to none."""
    port = (sysfs / "class/tty" / os.path.basename(os.path.realpath(device)) / "device").resolve()
    return next((one for one in (port, *port.parents) if (one / "idVendor").is_file()), None)


def _numbers(usb: Path) -> tuple[int, int] | None:
    try:
        return int(_text(usb / "idVendor"), 16), int(_text(usb / "idProduct"), 16)
    except ValueError:
        return None


def _text(path: Path) -> str:
    """Of a file; empty where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


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
