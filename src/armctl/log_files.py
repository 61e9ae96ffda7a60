"""The log on disk: each process writes a file of its own, and old files go by count.

A line is ``2026-11-22T14:03:09.512+01:00 WARNING armctl.runtime: STOP (browser page 1)``: local time with its
offset from UTC, level, logger, what happened. What the disk does never holds up who logs: a thread writes.
"""

from __future__ import annotations

import logging
import os
import queue
import re
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from datetime import datetime
from io import TextIOWrapper
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path
from typing import cast

import platformdirs

from armctl.system import open_private, private_folder

_FILE_BYTES, _ROTATED = 1 << 20, 1
"""a process's log is rotated at this size, into so many files beside it"""
_KEPT = 20
"""logs of so many processes are kept"""
_MOST_WAITING = 10_000
"""lines that wait for a slow disk; those beyond are lost, and that is said"""
_FILE = re.compile(r"\d{8}-\d{6}-[\w-]+-\d+\.log")
_LOG = logging.getLogger("armctl")


def folder() -> Path:
    """Where the logs of this user are."""
    return platformdirs.user_state_path("armctl") / "log"


@contextmanager
def begin(name: str, where: Path | None = None) -> Generator[Path | None]:
    """Inside, what ``armctl.*`` logs from INFO on goes to a file, too, named for ``name`` and this process.

    Gives the file. A disk that is full or may not be written is said once, and what was to be done goes on;
    None: there is no file at all. ``where``: the folder, None: the user's own.
    """
    where = folder() if where is None else where
    path = where / f"{datetime.now():%Y%m%d-%H%M%S}-{name}-{os.getpid()}.log"
    try:
        private_folder(where)
        file = _LogFile(path)
        _sweep(where)
    except OSError as cause:
        _warn(f"there is no log file: {path}: {cause.strerror}; everything else works")
        yield None
        return
    waiting: queue.Queue[logging.LogRecord | None] = queue.Queue(_MOST_WAITING)
    lines = _LogQueue(waiting, file)
    listener = _Writer(waiting, file)
    level = _LOG.level
    _LOG.setLevel(logging.INFO)
    _LOG.addHandler(lines)
    listener.start()
    try:
        yield path
    finally:
        _LOG.removeHandler(lines)
        _LOG.setLevel(level)
        listener.stop()
        file.close()


def tails(where: Path | None = None, processes: int = 4, most_bytes: int = 256 << 10) -> Mapping[str, str]:
    """The last lines of the newest logs, by file name, the newest first; ``most_bytes`` of each at most."""
    found: dict[str, str] = {}
    for path in _newest_first(folder() if where is None else where)[:processes]:
        try:
            with path.open("rb") as stream:
                size = stream.seek(0, os.SEEK_END)
                stream.seek(max(0, size - most_bytes))
                text = stream.read(most_bytes).decode(errors="replace")
        except OSError as cause:  # swept by another process meanwhile
            text = f"cannot be read: {cause.strerror}\n"
        else:
            if size > most_bytes:
                text = text.partition("\n")[2]
        found[path.name] = text
    return found


def _warn(text: str) -> None:
    """Log a warning that reaches the terminal, too, where nobody shows the log there."""
    _LOG.warning("%s", text)
    if not logging.getLogger().handlers:
        sys.stderr.write(f"armctl: {text}\n")


class _Format(logging.Formatter):
    """One line a record; what a message holds of line ends begins a line that is set in."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802
        """Local time with its offset from UTC."""
        del datefmt
        return datetime.fromtimestamp(record.created).astimezone().isoformat(timespec="milliseconds")

    def format(self, record: logging.LogRecord) -> str:
        """A record as text; nobody can forge a line by what he calls himself."""
        return "\n    ".join(super().format(record).splitlines())


class _LogQueue(QueueHandler):
    """Hands records over to the thread that writes; never waits."""

    def __init__(self, waiting: queue.Queue[logging.LogRecord | None], file: _LogFile) -> None:
        super().__init__(waiting)
        self._file = file

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """The disk is too slow: say so once."""
        del record
        self._file.complain("lines are lost, the disk is too slow")


class _Writer(QueueListener):
    def __init__(self, waiting: queue.Queue[logging.LogRecord | None], file: logging.Handler) -> None:
        super().__init__(waiting, file)
        self._waiting = waiting

    def enqueue_sentinel(self) -> None:
        """What it reads last; there may be no place for it yet."""
        self._waiting.put(None)


class _LogFile(RotatingFileHandler):
    """Writes a bounded file, anew if somebody has deleted it; says once that it cannot."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, maxBytes=_FILE_BYTES, backupCount=_ROTATED, encoding="utf-8")
        self.setFormatter(_Format())
        self._complained = False

    def _open(self) -> TextIOWrapper:
        opened = open(self.baseFilename, self.mode, encoding=self.encoding, opener=open_private)
        return cast("TextIOWrapper", opened)

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record."""
        if not os.path.exists(self.baseFilename):  # swept, or deleted by its user
            self.close()
        super().emit(record)  # opens it where it is closed

    def close(self) -> None:
        """Close the file; what a full disk did not take is lost."""
        try:
            super().close()
        except OSError as cause:
            self.complain(cause)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """A full disk, mostly."""
        del record
        self.complain(sys.exc_info()[1])

    def complain(self, cause: object) -> None:
        """Log once that there is no log."""
        if not self._complained:
            self._complained = True
            why = cause.strerror if isinstance(cause, OSError) else cause
            _warn(f"the log cannot be written: {self.baseFilename}: {why}; everything else works")


def _newest_first(where: Path) -> list[Path]:
    """The logs of processes, without what was rotated; by when they were last written."""
    dated: list[tuple[float, Path]] = []
    try:
        for entry in os.scandir(where):
            if _FILE.fullmatch(entry.name):
                dated.append((entry.stat().st_mtime, Path(entry.path)))
    except OSError:  # there is no folder yet, or another process sweeps
        _LOG.debug("logs could not be listed", exc_info=True)
    return [path for _, path in sorted(dated, reverse=True)]


def _sweep(where: Path) -> None:
    """Delete the logs of the oldest processes; one that still runs begins a new file."""
    for path in _newest_first(where)[_KEPT:]:
        for old in (path, path.with_name(f"{path.name}.{_ROTATED}")):
            old.unlink(missing_ok=True)
