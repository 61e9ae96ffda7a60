"""run and simulate: the command line on real serial devices."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest
import serial
from tests.cli.simulating import simulated
from tests.robot.test_tools import arm_with_tools
from tests.runtime.signal_kit import BUTTON, KNOB, robot_with

from armctl import Arm
from armctl.cli.main import DONE, REFUSED, WRONG_USAGE, run
from armctl.facts import State
from armctl.hardware.boards import channel_settings
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.maestro.codec import crc7
from armctl.hardware.transport import Connection
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

EXAMPLE = Path(__file__).parents[2] / "examples" / "pick_and_place.toml"


@pytest.mark.parametrize(
    ("board", "sent", "answer"),
    [
        # 1500 µs on channel 2, and read it; the error register
        ("maestro", b"\x84\x02\x70\x2e\x90\x02\xa1", b"\x70\x17\0\0"),
        ("encoder", b"2 EN 1*5689\n", b"2 ok*055E\n"),
        (
            "firmata",
            bytes.fromhex("f0 70 16 20 04 60 12 f7 f0 6f 16 5c 0b f7 f0 6d 16 f7"),
            bytes.fromhex("f0 6e 16 04 5c 0b f7"),
        ),
    ],
)
def test_any_client_can_talk_to_a_simulated_board(
    tmp_path: Path, board: str, sent: bytes, answer: bytes
) -> None:
    link = tmp_path / board
    with simulated(board, "--link", str(link)) as said:
        assert str(link) in said
        with serial.Serial(str(link), 57600, timeout=10) as port:
            port.write(sent)
            assert port.read_until(answer).endswith(answer)
    assert not link.is_symlink()


def test_factory_board_clamps_to_992_2000(tmp_path: Path) -> None:
    link = tmp_path / "maestro"
    with simulated("maestro", "--link", str(link), "--factory"), serial.Serial(str(link), timeout=2) as port:
        for target, held in ((2400, 2000), (700, 992)):
            port.write(bytes([0x84, 0, (4 * target) & 0x7F, (4 * target) >> 7, 0x90, 0]))
            assert int.from_bytes(port.read(2), "little") == 4 * held


def test_a_boards_own_options_and_the_fault(tmp_path: Path) -> None:
    """The Pololu form to device 3, with its CRC; half an answer; the timeout strikes in the silence."""
    link = tmp_path / "maestro"
    words = ("--crc", "--device", "3", "--timeout", "0.01", "--fault", "half-reply@0")
    with simulated("maestro", "--link", str(link), *words), serial.Serial(str(link), timeout=10) as port:
        errors = bytes.fromhex("aa 03 21")
        port.write(errors + bytes([crc7(errors)]))
        assert len(port.read(1)) == 1
        port.timeout = 0.1
        assert port.read(1) == b""
        port.write(errors + bytes([crc7(errors)]))
        port.timeout = 10
        assert port.read(1) == b"\x20"


def test_a_board_that_is_unplugged_says_so_and_comes_back(tmp_path: Path) -> None:
    words = ("--boot", "1.5", "--fault", "unplug@0.5+0.4")
    with simulated("firmata", "--link", str(tmp_path / "mega"), *words, lines=3) as said:
        assert [line.split(" (")[0] for line in said.splitlines()] == [
            f"simulated board on {tmp_path / 'mega'}",
            "simulated board unplugged",
            f"simulated board on {tmp_path / 'mega'}",
        ]


def test_its_inputs_follow_a_script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot_with(tmp_path)
    link, script = tmp_path / "maestro", tmp_path / "inputs.txt"
    words = ("--robot", str(tmp_path / "uzuner.toml"), "--inputs", str(script))
    script.write_text("at 0 s knob = 60 %; at 50 ms button on")
    with simulated("maestro", "--link", str(link), *words), serial.Serial(str(link), timeout=10) as port:
        button = 1023  # to ground where it is pressed
        while button:
            port.write(bytes([0x90, KNOB, 0x90, BUTTON]))
            knob, button = (int.from_bytes(port.read(2), "little") for _ in range(2))
            assert knob == round(0.6 * 1023)
    script.write_text("at 0 s horn on")
    assert run(["simulate", "maestro", *words]) == REFUSED
    assert "inputs.txt: line 1: there is no input 'horn'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("maestro", "--fault", "explode"), "there is no fault 'explode'; there are drop"),
        (("maestro", "--timeout", "0"), "must be within 0.01"),
        (("maestro", "--device", "128"), "0<=x<=127"),
        (("firmata", "--boot", "inf"), "not a finite number"),
        (("encoder", "--crc"), "No such option"),
    ],
)
def test_what_no_board_can_be_told(capsys: pytest.CaptureFixture[str], words, says: str) -> None:
    assert run(["simulate", *words]) == WRONG_USAGE
    assert says in capsys.readouterr().err


def test_run_drives_a_program_on_a_device(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    link = tmp_path / "maestro"
    program = tmp_path / "short.toml"
    program.write_text(
        'format = 1\nrobot = "uzuner"\nname = "short"\n'
        '[[steps]]\ndo = "move"\njoints_deg = [15, 100, -80, -60, 10]\n'  # long enough to be told each time
        '[[steps]]\ndo = "move"\njoints_deg = [5, 100, -80, -60, 10]\n'
        '[[steps]]\ndo = "gripper"\nopen_percent = 25\n'
    )
    with simulated("maestro", "--link", str(link)):
        asked = ["run", str(program), "--port", str(link), "--loops", "2"]
        assert run(asked) == REFUSED  # its pulses are off, and nobody has said where the arm stands
        said = capsys.readouterr().err
        assert "nobody knows where the arm is: pulses are off" in said and "--pose last" in said
        assert said.count("\n") == 1
        assert run([*asked, "--pose", "last"]) == REFUSED
        assert "no last pose of uzuner on this board is kept" in capsys.readouterr().err
        assert run([*asked, "--pose", "rest"]) == DONE
        with serial.Serial(str(link), timeout=2) as port:
            held = []
            for channel in range(6):
                port.write(bytes([0x90, channel]))
                held.append(int.from_bytes(port.read(2), "little") / 4)
    pulses = [1479.93 + 9 * 5, 781.795 + 1000, 1446.45 - 800, 1482.95 - 600, 1501.6 + 100, 1250]
    assert held == pytest.approx(pulses, abs=0.126)
    said = capsys.readouterr()
    assert "short, 3 steps" in said.out
    for number in (1, 2):
        assert said.err.count(f"pass {number}, step 1 of 3: pose 15, 100, ") == 1  # once, as it begins


@pytest.mark.parametrize(
    ("pose", "status", "says"),
    [
        ("0,90,x", WRONG_USAGE, "0,90,x: joint angles are numbers with commas between them"),
        ("nowhere", REFUSED, "no pose 'nowhere'"),
    ],
)
def test_a_pose_that_is_none(capsys: pytest.CaptureFixture[str], pose: str, status: int, says: str) -> None:
    assert run(["run", str(EXAMPLE), "--pose", pose]) == status
    assert says in capsys.readouterr().err


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


def test_run_refuses_another_tool_than_the_program_was_checked_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arm that runs already has the tool on that somebody said."""
    robot = arm_with_tools(tmp_path)
    program = tmp_path / "wait.toml"
    program.write_text(f'format = 1\nrobot = "{robot.name}"\n[[steps]]\ndo = "wait"\nseconds = 0\n')
    with Arm.open(robot, "sim") as arm:
        arm.set_tool("pen")
        monkeypatch.setattr(Arm, "open", lambda *_, **__: nullcontext(arm))
        words = ["run", str(program), "--robot", str(tmp_path / "uzuner.toml"), "--port", "sim"]
        assert run(words) == REFUSED
        assert "the tool 'pen' is on, and the program was checked with 'jaws'" in capsys.readouterr().err
        assert arm.snapshot.state is State.OFF
        assert run([*words, "--tool", "pen"]) == DONE


def test_run_says_what_is_wrong_with_the_port(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["run", str(EXAMPLE), "--port", "/dev/there_is_none"]) == REFUSED
    error = capsys.readouterr().err
    assert "/dev/there_is_none" in error and error.count("\n") == 1


def test_the_driver_opens_a_simulated_encoder_board(tmp_path: Path) -> None:
    link = tmp_path / "encoder"
    robot = load_robot("scorbot")
    with simulated("encoder", "--link", str(link)):
        driver = EncoderDriver(
            Connection(str(link), MonotonicClock().now, ports=list), robot.board_settings, timeout_s=10.0
        )
        assert driver.open().kind == "armctl encoder board, firmware 1.3.0"
        driver.configure(channel_settings(robot))
        driver.home()
        readback = driver.read()
        assert readback.homing is not None and readback.homing.running == 5, "the gripper is the first"
        driver.release()
        driver.close()


@pytest.mark.parametrize(
    ("kind", "robot", "says"),
    [
        ("encoder", "uzuner", "uzuner is set up for Pololu Maestro, whose outputs are in µs"),
        ("maestro", "scorbot", "outputs are in counts; use `armctl simulate encoder`"),
    ],
)
def test_a_robot_of_another_board_is_refused(
    capsys: pytest.CaptureFixture[str], kind: str, robot: str, says: str
) -> None:
    """Counts are no pulse widths."""
    assert run(["simulate", kind, "--robot", robot]) == REFUSED
    assert says in capsys.readouterr().err
