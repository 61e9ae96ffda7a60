"""armctl simulate firmata, as a program of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import serial


def test_any_client_can_talk_to_the_simulated_sketch(tmp_path: Path) -> None:
    link = tmp_path / "firmata"
    process = subprocess.Popen(
        [sys.executable, "-m", "armctl", "simulate", "firmata", "--link", str(link)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None and process.stderr is not None
    try:
        assert str(link) in process.stdout.readline()
        with serial.Serial(str(link), 57600, timeout=5) as port:
            port.write(bytes.fromhex("f0 70 16 20 04 60 12 f7 f0 6f 16 5c 0b f7 f0 6d 16 f7"))
            assert port.read_until(b"\x0b\xf7")[-7:].hex(" ") == "f0 6e 16 04 5c 0b f7"
    finally:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert not link.is_symlink()
