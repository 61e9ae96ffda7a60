"""A report for whoever has to find out what happened: one zip file, without names of persons or computers."""

from __future__ import annotations

import getpass
import platform
import re
import socket
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import numpy as np

from armctl import log_files
from armctl.calibration import Calibration, encode_calibration
from armctl.documents import DocumentKind
from armctl.errors import ArmctlError, RobotFileError
from armctl.hardware.doctor import without_personal_data
from armctl.protocol import Recording, read_recording, saved_recordings
from armctl.protocol.recording import Story, members, packed, zipped
from armctl.robot import robot_path
from armctl.version import __version__

_PACKAGES = ("numpy", "scipy", "viser", "pyserial", "msgspec", "websockets")
_FAULTS = 3
_ROBOTS = DocumentKind(RobotFileError, most_bytes=4 << 20)
_TOKEN = re.compile(r"(token|pin|secret)=[^\s&\"']+", re.IGNORECASE)
_WHAT = {
    "versions.json": "versions of armctl, Python, its packages and the operating system",
    "black_box.json": (
        "the last 60 s: commands, answers, log, warnings (format: armctl/protocol/recording.py)"
    ),
    "ticks.npy": "the last 60 s: a row a tick, setpoints and readings; numpy.load reads it",
    "calibration.toml": "the calibration in force",
    "programs.txt": "names of the saved programs",
    "doctor.txt": "the check-up of the port and its board",
    "not_had.txt": "what could not be had for this report, and why",
}


def environment() -> dict[str, str]:
    """Versions of everything that has a part in it."""
    versions = {"Python": platform.python_version()}
    versions["system"] = f"{platform.system()} {platform.release()} {platform.machine()}"
    versions["armctl"] = __version__
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:  # put on the path by hand
            versions[package] = "not installed"
    return versions


def scrubbed(text: str) -> str:
    """A text without tokens, home folder, names of computer and user."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a user without an entry, as in some containers
        user = ""
    text = _TOKEN.sub(r"\1=<removed>", text)
    return without_personal_data(text, str(Path.home()), socket.gethostname(), user)


def report(
    robot: str | None = None,
    calibration: Calibration | None = None,
    recording: Recording | ArmctlError | None = None,
    programs: Iterable[str] = (),
    checkup: str = "",
) -> bytes:
    """The report as a zip file. May block: it reads log files and saved black boxes.

    ``robot``: what opened it, a shipped name or a file. ``recording``: the last minute, or why it cannot be
    had; None: that of the newest fault that was saved. ``checkup``: what doctor found.
    """
    found: dict[str, bytes] = {}
    not_had: list[str] = []

    def put(name: str, text: str) -> None:
        if text:
            found[name] = scrubbed(text).encode(errors="replace")

    put("versions.json", msgspec.json.format(msgspec.json.encode(environment()), indent=1).decode())
    if robot is not None:
        path = robot_path(robot)
        try:
            put(f"robot/{path.name}", _ROBOTS.load(path, bytes.decode))
        except (ArmctlError, UnicodeError) as cause:
            not_had.append(f"robot file: {cause}")
    put("calibration.toml", "" if calibration is None else encode_calibration(calibration))
    put("programs.txt", "\n".join(programs))
    put("doctor.txt", checkup)
    for name, text in log_files.tails().items():
        put(f"log/{name}", text)
    faults: list[Recording] = []
    for path in saved_recordings()[:_FAULTS]:
        try:
            faults.append(_scrubbed_recording(read_recording(path)))
            found[f"faults/{path.name}"] = packed(faults[-1])
        except ArmctlError as cause:
            not_had.append(str(cause))
    if isinstance(recording, ArmctlError):
        not_had.append(f"the last minute: {recording}")
        recording = None
    if recording is not None:
        found |= members(_scrubbed_recording(recording))
    elif faults:
        found |= members(faults[0])
    put("not_had.txt", "\n".join(not_had))
    lines = [f"{name}: {_about(name)}" for name in sorted(found)]
    put(
        "README.txt",
        "A report of armctl. `armctl replay` shows its last minute.\n\n" + "\n".join(lines) + "\n",
    )
    return zipped(found)


def _about(name: str) -> str:
    folder = name.partition("/")[0]
    about = {
        "robot": "the robot file",
        "log": "the end of a process's log",
        "faults": "the last minute before a fault; `armctl replay` shows it, too",
    }
    return about[folder] if folder in about else _WHAT[name]


def _scrubbed_recording(recording: Recording) -> Recording:
    story = Story(**{name: getattr(recording, name) for name in Story.__struct_fields__})
    clean = msgspec.json.decode(scrubbed(msgspec.json.encode(story).decode()), type=Story)
    fields = {name: getattr(clean, name) for name in Story.__struct_fields__}
    same = ("joints", "columns", "states")  # a user may be called as a joint is
    return Recording(
        **(fields | {name: getattr(recording, name) for name in same}), ticks=np.array(recording.ticks)
    )
