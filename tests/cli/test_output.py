"""What a command does where nobody reads its output, or the output cannot be written."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from armctl.cli.main import REFUSED

FULL = Path("/dev/full")
"""takes no byte, as a full disk"""


def armctl(*words: str, stdout: int) -> tuple[int, str]:
    """Exit status and stderr of a process of its own: what Python does at its end counts too."""
    done = subprocess.run(
        [sys.executable, "-m", "armctl", *words], stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=60
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("words", [("fk", "uzuner", "0", "0", "0", "0", "0"), ("--help",)])
def test_a_full_disk_is_one_line(words: tuple[str, ...]) -> None:
    with FULL.open("w") as full:
        status, said = armctl(*words, stdout=full.fileno())
    assert status == REFUSED
    assert said == f"armctl: the output cannot be written: {os.strerror(errno.ENOSPC)}\n"


def test_a_pipe_that_nobody_reads_on_ends_in_silence() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        status, said = armctl("robots", stdout=writing)
    finally:
        os.close(writing)
    assert (status, said) == (REFUSED, "")
