"""`armctl serve` in a process of its own, as a user starts it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def serving(
    folder: Path, *words: str, python: str | Path = sys.executable, end: signal.Signals = signal.SIGINT
) -> Iterator[str]:
    """``armctl serve`` in a process of its own; gives the address that it prints. A signal ends it."""
    with (folder / "stderr").open("w") as errors:
        process = subprocess.Popen(
            [python, "-m", "armctl", "serve", "--no-browser", "--http-port", "0", *words],
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
