"""armctl simulate firmata, as a program of its own."""

from __future__ import annotations

from pathlib import Path

import serial
from tests.cli.simulating import simulated


def test_any_client_can_talk_to_the_simulated_sketch(tmp_path: Path) -> None:
    link = tmp_path / "firmata"
    with simulated("firmata", "--link", str(link)) as said:
        assert str(link) in said
        with serial.Serial(str(link), 57600, timeout=5) as port:
            port.write(bytes.fromhex("f0 70 16 20 04 60 12 f7 f0 6f 16 5c 0b f7 f0 6d 16 f7"))
            assert port.read_until(b"\x0b\xf7")[-7:].hex(" ") == "f0 6e 16 04 5c 0b f7"
    assert not link.is_symlink()
