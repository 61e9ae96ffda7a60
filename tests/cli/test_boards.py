"""run and simulate: the command line on real serial devices."""

from __future__ import annotations

from pathlib import Path

import pytest
import serial
from tests.cli.simulating import simulated

from armctl.cli.main import DONE, REFUSED, run

EXAMPLE = Path(__file__).parents[2] / "examples" / "pick_and_place.toml"


def test_any_client_can_talk_to_the_simulated_maestro(tmp_path: Path) -> None:
    link = tmp_path / "maestro"
    with simulated("maestro", "--link", str(link)) as said:
        assert str(link) in said
        with serial.Serial(str(link), timeout=2) as port:
            port.write(bytes([0x84, 2, 0x70, 0x2E]))  # 1500 µs on channel 2
            port.write(bytes([0x90, 2]))
            assert port.read(2) == bytes([0x70, 0x17])
            port.write(bytes([0xA1]))
            assert port.read(2) == b"\0\0"
    assert not link.is_symlink()


def test_factory_board_clamps_to_992_2000(tmp_path: Path) -> None:
    link = tmp_path / "maestro"
    with simulated("maestro", "--link", str(link), "--factory"), serial.Serial(str(link), timeout=2) as port:
        for target, held in ((2400, 2000), (700, 992)):
            port.write(bytes([0x84, 0, (4 * target) & 0x7F, (4 * target) >> 7, 0x90, 0]))
            assert int.from_bytes(port.read(2), "little") == 4 * held


def test_run_drives_a_program_on_a_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link = tmp_path / "maestro"
    program = tmp_path / "short.toml"
    program.write_text(
        'format = 1\nrobot = "uzuner"\nname = "short"\n'
        '[[steps]]\ndo = "move"\njoints_deg = [5, 100, -80, -60, 10]\n'
        '[[steps]]\ndo = "gripper"\nopen_percent = 25\n'
    )
    with simulated("maestro", "--link", str(link)):
        assert run(["run", str(program), "--port", str(link), "--loops", "2"]) == DONE
        with serial.Serial(str(link), timeout=2) as port:
            held = []
            for channel in range(6):
                port.write(bytes([0x90, channel]))
                held.append(int.from_bytes(port.read(2), "little") / 4)
    pulses = [1479.93 + 9 * 5, 781.795 + 1000, 1446.45 - 800, 1482.95 - 600, 1501.6 + 100, 1250]
    assert held == pytest.approx(pulses, abs=0.126)
    assert "short, 2 steps" in capsys.readouterr().out


def test_run_refuses_a_program_with_an_unreachable_step_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "far.toml"
    program.write_text(
        'format = 1\nrobot = "uzuner"\n[[steps]]\ndo = "point"\nx_mm = 400\ny_mm = 0\nz_mm = 100\n'
    )
    assert run(["run", str(program)]) == REFUSED
    error = capsys.readouterr().err
    assert "step 1" in error and "too far" in error and error.count("\n") == 1


def test_run_says_what_is_wrong_with_the_port(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["run", str(EXAMPLE), "--port", "/dev/there_is_none"]) == REFUSED
    error = capsys.readouterr().err
    assert "/dev/there_is_none" in error and error.count("\n") == 1
