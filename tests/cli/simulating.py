"""``armctl simulate`` in a process of its own, for the tests that talk to it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def simulated(board: str, *words: str, lines: int = 1) -> Iterator[str]:
    """The first lines that it prints, once its port is there; it must end in peace when it is interrupted."""
    process = subprocess.Popen(
        [sys.executable, "-m", "armctl", "simulate", board, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None and process.stderr is not None
    try:
        yield "".join(process.stdout.readline() for _ in range(lines))
    finally:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
        assert process.returncode == 0, errors
        assert "Traceback" not in errors
