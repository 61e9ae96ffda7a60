"""`armctl serve` in a process of its own, as a user starts it, and where pages are served."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_kept: list[int] = []


def page_port() -> int:
    """A free TCP port for the next server of pages, time after time the same one where it can be.

    A browser goes on with the process that it has for an address: its next page takes 0.6 of the time.
    """
    for port in (*_kept, *range(20_000 + os.getpid() % 10_000, 32_768)):  # below those that systems hand out
        with socket.socket() as probe:
            if os.name == "posix":
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue  # taken
        if not _kept:
            _kept.append(port)
        return port
    raise AssertionError("no port is free")


@contextmanager
def serving(
    folder: Path, *words: str, python: str | Path = sys.executable, end: signal.Signals = signal.SIGINT
) -> Iterator[str]:
    """``armctl serve`` in a process of its own; gives the address that it prints. A signal ends it."""
    with (folder / "stderr").open("w") as errors:
        process = subprocess.Popen(
            [python, "-m", "armctl", "serve", "--no-browser", "--http-port", str(page_port()), *words],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env=os.environ
            | {"PYTHONUNBUFFERED": "1", "XDG_DATA_HOME": str(folder), "XDG_STATE_HOME": str(folder)},
        )
    assert process.stdout is not None
    try:
        said = process.stdout.readline()
        address = re.search(r"https?://\S+", said)
        assert address is not None, said + (folder / "stderr").read_text()
        yield address.group()
    finally:
        process.send_signal(end)
        process.wait(30)
        process.stdout.close()
        log = (folder / "stderr").read_text()
        assert process.returncode == 0, log
        assert "Traceback" not in log, log
