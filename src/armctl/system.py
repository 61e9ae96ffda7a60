"""What differs between operating systems: terminals, groups, rights of files, processes, signals.

armctl is developed and tested on Linux. Where a system lacks something, the function here says what happens
instead. No other module imports ``fcntl``, ``grp``, ``pty``, ``pwd``, ``termios`` or ``tty``.
"""

from __future__ import annotations

import asyncio
import math
import os
import re
import select
import signal
import stat
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal

import platformdirs

_PSEUDO_TERMINAL = re.compile(r"/dev/(pts/|ttys)\d+")
"""names on Linux and on macOS"""


# Terminals and serial lines


def line_errors() -> tuple[type[Exception], ...]:
    """What the system raises for a serial line that is gone; ``termios.error`` is no ``OSError``."""
    try:
        import termios
    except ImportError:  # Windows
        return (OSError,)
    return OSError, termios.error


def keep_others_out(descriptor: int) -> None:
    """Let no other program open this serial device (TIOCEXCL). Windows does so by itself."""
    with suppress(ImportError):
        import fcntl
        import termios

        fcntl.ioctl(descriptor, termios.TIOCEXCL)


def open_pseudo_terminal() -> tuple[int, int, str] | None:
    """A raw pseudo-terminal: its server's end, which never blocks, its clients' end, and the name of that.

    None where the system has none (Windows). ``OSError``: none is left.
    """
    try:
        import tty
    except ImportError:
        return None
    server, clients = os.openpty()
    tty.setraw(clients)  # or the line discipline echoes the host's bytes and rewrites 0x0D and 0x03
    os.set_blocking(server, False)
    return server, clients, os.ttyname(clients)


def typed_enter(descriptor: int) -> bool:
    """Whether somebody has pressed Enter at a terminal since the last question; never waits."""
    if os.name == "nt":
        import msvcrt

        return any(msvcrt.getwch() in "\r\n" for _ in iter(msvcrt.kbhit, False))  # type: ignore[attr-defined]
    typed = b""
    while select.select([descriptor], [], [], 0.0)[0] and (more := os.read(descriptor, 4096)):
        typed += more
    return b"\n" in typed


def forget_typed(descriptor: int) -> None:
    """Drop what was typed at a terminal and not read."""
    typed_enter(descriptor)


def is_pseudo_terminal(device: str) -> bool:
    """Whether a program, not a device, is at the other end of ``device``."""
    return _PSEUDO_TERMINAL.fullmatch(os.path.realpath(device)) is not None


# Users, and who may open a device


def user_number() -> int | None:
    """The number of this user; None where users have none, and sockets no names (Windows)."""
    return os.getuid() if hasattr(os, "getuid") and hasattr(asyncio, "start_unix_server") else None


def may_open(device: str) -> bool:
    """Whether this process may read and write ``device``; Windows tells only when it is opened."""
    return os.name == "nt" or os.access(device, os.R_OK | os.W_OK)


def group_of(device: str) -> str | None:
    """The name of the group that owns a device file; None where groups or the file are unknown."""
    try:
        import grp

        return grp.getgrgid(Path(device).stat().st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return None


def joined_since_login(group: str) -> bool:
    """Whether this user is listed in the group, and this process does not know it yet."""
    try:
        import grp
        import pwd

        entry, user = grp.getgrnam(group), pwd.getpwuid(os.getuid()).pw_name
    except (ImportError, KeyError):
        return False
    return user in entry.gr_mem and entry.gr_gid not in os.getgroups()


# What armctl keeps of its user (logs, last poses, black boxes, reports) is for this user alone: names of
# people and computers, links and tokens may be in it. Robots, programs and calibrations are shared.

_OTHERS, WRITTEN_BY_OTHERS = 0o077, 0o022
"""the rights of group and others: all, and to write"""


def open_private(path: str, flags: int) -> int:
    """An ``opener`` for ``open``: the file is this user's alone, also where it was there and others' too."""
    descriptor = os.open(path, flags, 0o600)
    found = os.fstat(descriptor)
    if hasattr(os, "fchmod") and _is_open_to_others(found):  # Windows has other rights
        os.fchmod(descriptor, found.st_mode & ~_OTHERS)
    return descriptor


def private_folder(folder: Path) -> None:
    """Have a folder of armctl's state that only this user may enter; ``OSError``: it cannot be made.

    One that is there already is closed to others, with the files in it, and armctl's folder above it.
    """
    state = platformdirs.user_state_path("armctl")
    for missing in reversed([one for one in folder.parents if not one.exists()]):
        missing.mkdir(mode=0o700, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    ours = [folder, state] if folder.is_relative_to(state) else [folder]
    for path in (*ours, *(Path(one) for one in os.scandir(folder) if one.is_file(follow_symlinks=False))):
        with suppress(OSError):  # swept meanwhile, or a disk without rights
            found = path.stat()
            if _is_open_to_others(found):
                path.chmod(found.st_mode & 0o777 & ~_OTHERS)


def is_private(path: Path) -> bool:
    """Whether a file is this user's, and only this user may read it; ``OSError``: there is none."""
    return is_own_file(path.stat(follow_symlinks=False), _OTHERS)


def is_own_file(found: os.stat_result, forbidden: int = WRITTEN_BY_OTHERS) -> bool:
    """Whether a file is a regular one of this user's, and others have none of the rights ``forbidden``."""
    ours = user_number() is None or (found.st_uid == user_number() and not found.st_mode & forbidden)
    return stat.S_ISREG(found.st_mode) and ours


def _is_open_to_others(found: os.stat_result) -> bool:
    return bool(found.st_mode & _OTHERS) and found.st_uid == user_number()


# Processes and signals


def whose(pid: int) -> Literal["ours", "another user's", "nobody's", "unknown"]:
    """Who has a process of this number; unknown where to ask would end it (Windows)."""
    if os.name != "posix":
        return "unknown"
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return "nobody's"
    except PermissionError:
        return "another user's"
    return "ours"


def kill(pid: int) -> None:
    """End a process at once, without asking it."""
    os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))


def start_apart(arguments: Sequence[str], environment: dict[str, str]) -> subprocess.Popen[bytes]:
    """Start a program with pipes; Ctrl-C at our terminal is for us alone, who bring the arm to rest first.

    It gets a process group of its own, not a session: Linux may share the processors out session by session,
    and a tick of the arm process then waits up to 0.1 s for the page server, its own program.
    """
    return subprocess.Popen(
        arguments, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        process_group=0,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same for Windows
    )  # fmt: skip


def priority_below() -> None:
    """Let other processes go first (nice 10)."""
    if hasattr(os, "nice"):
        os.nice(10)


def bound_this_process(seconds: float, most_bytes: int) -> None:
    """End this process when it takes more processor time, and give it no more memory; Windows: neither."""
    with suppress(ImportError):
        import resource

        for what, most in ((resource.RLIMIT_CPU, math.ceil(seconds)), (resource.RLIMIT_AS, most_bytes)):
            _, hard = resource.getrlimit(what)
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(what, (most, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def ended_by_time(code: int) -> bool:
    """Whether a process has this exit code because its processor time was over."""
    return hasattr(signal, "SIGXCPU") and code == -signal.SIGXCPU


def ending_signals() -> tuple[signal.Signals, ...]:
    """SIGTERM and SIGHUP, by which others end a program; Windows has no SIGHUP."""
    return tuple(one for one in signal.Signals if one.name in ("SIGTERM", "SIGHUP"))


def on_end(loop: asyncio.AbstractEventLoop, act: Callable[[str], None]) -> None:
    """Call ``act`` with the name of a signal that is to end this program."""
    for one in (signal.SIGINT, *ending_signals()):
        with suppress(NotImplementedError, RuntimeError, ValueError):  # Windows; not on the main thread
            loop.add_signal_handler(one, act, one.name)


def outlive_readers() -> None:
    """Go on when the terminal that reads our output is closed."""
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
