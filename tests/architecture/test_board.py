"""A board of somebody else's package is used end to end, and nobody compares kinds of boards."""

from __future__ import annotations

import ast
import json
import logging
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo
from tests.architecture.toy_board import forget, install, toy_board

import armctl
from armctl.cli.main import DONE, run
from armctl.errors import RobotFileError
from armctl.hardware.board_type import ByteModel, Setup
from armctl.hardware.boards import SHIPPED, board_type, board_types, kinds
from armctl.hardware.ports import list_ports
from armctl.hardware.simulation import BoardServer
from armctl.process.host import Host
from armctl.program import MoveStep, Program, save_program
from armctl.protocol import Connect, MonotonicClock

SRC = Path(__file__).parents[2] / "src" / "armctl"


@pytest.fixture
def toy_arm(tmp_path: Path) -> Iterator[Path]:
    with toy_board(tmp_path) as robot_file:
        yield robot_file


@pytest.fixture
def plugged_in(toy_arm: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[BoardServer[ByteModel]]:
    """The toy on a serial port that the system lists, with its USB numbers."""
    with BoardServer(board_type("toy").simulated(Setup(), {}), MonotonicClock().now) as server:
        port = ListPortInfo(server.port)
        port.vid, port.pid, port.hwid, port.serial_number = 0x1209, 0x0001, "USB VID:PID=1209:0001", "42"
        monkeypatch.setattr("armctl.cli.boards.list_ports", lambda: list_ports(lambda: [port]))
        yield server


def test_a_robot_file_may_name_it(toy_arm: Path) -> None:
    robot = armctl.load_robot(toy_arm)
    assert robot.board == "toy"
    assert robot.output_map is not None
    assert robot.output_map.unit == "steps"


def test_its_entries_are_checked_in_its_own_words(toy_arm: Path) -> None:
    toy_arm.write_text(toy_arm.read_text().replace("zero_steps", "zero_us", 1))
    with pytest.raises(RobotFileError, match=r"joints\[0\].servo: unknown key 'zero_us'"):
        armctl.load_robot(toy_arm)


def test_it_runs_a_program(toy_arm: Path, tmp_path: Path) -> None:
    there, back = (MoveStep(joints_deg=(angle, 90, -80, -40, 0)) for angle in (20, 0))
    save_program(Program(robot="toy_arm", steps=(there, back)), tmp_path / "swing.toml")
    with armctl.Arm.open(toy_arm) as arm:  # in the arm process, too, its package is found
        arm.enable()
        assert arm.snapshot.board is not None and arm.snapshot.board.kind.startswith("Toy")
    host = Host(armctl.load_robot(toy_arm))
    with armctl.Arm(host) as arm:
        host.submit(Connect("sim")).result(5)
        arm.enable()
        arm.run(tmp_path / "swing.toml")
        with host.boards.simulated().inspect() as toy:
            last, most = dict(vars(toy)["outputs"]), dict(vars(toy)["most"])
    outputs = arm.robot.output_map
    assert outputs is not None
    base = outputs.channels[0]
    assert last[base] == round(outputs.zero[0])
    assert most[base] == round(outputs.zero[0] + outputs.per_rad[0] * 0.349065850)  # 20° on the way


def test_ports_and_doctor_know_it(
    plugged_in: BoardServer[ByteModel], toy_arm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["ports", "--probe", "--json"]) == DONE
    [port] = json.loads(capsys.readouterr().out)
    assert (port["device"], port["kind"], port["serial_number"]) == (plugged_in.port, "Toy board", "42")
    assert port["answer"] == "probed: Toy 1.0"
    assert run(["doctor", "--port", "auto", "--json"]) == DONE
    seen = {finding["check"]: finding["seen"] for finding in json.loads(capsys.readouterr().out)["findings"]}
    assert seen["who answers"] == "Toy 1.0"
    assert run(["doctor", "--port", "auto", "--robot", str(toy_arm), "--json"]) == DONE
    assert "toys need none; 6 outputs are asked for" in capsys.readouterr().out


def test_a_defect_of_its_own_is_told_in_words(
    plugged_in: BoardServer[ByteModel], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ValueError("the toy is broken")

    monkeypatch.setattr(type(board_type("toy")), "examine", broken)
    run(["doctor", "--port", plugged_in.port])
    assert "broke off: the check-up: ValueError: the toy is broken" in capsys.readouterr().out
    monkeypatch.setattr(type(board_type("toy")), "ask", broken)
    run(["doctor", "--port", plugged_in.port])
    assert "asking for a Toy board: ValueError: the toy is broken" in capsys.readouterr().out


def test_it_is_simulated_and_its_robot_checked_by_name(
    toy_arm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["simulate", "toy", "--help"]) == DONE
    assert "Serve a simulated Toy board until interrupted" in capsys.readouterr().out
    assert run(["check", str(toy_arm)]) == DONE


@pytest.fixture
def fresh_registry() -> Iterator[None]:
    forget()
    yield
    forget()


@pytest.mark.usefixtures("fresh_registry")
@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("broken = no_such_module:Board", "broken of no_such_module:Board cannot be loaded: No module named"),
        ("number = math:pi", "math:pi is no BoardType"),
        ("nameless = tests.architecture.nameless:Board", "it does not say its kind, title"),
        ("second = armctl.hardware.maestro.board:MaestroBoard", "of the kind 'maestro' already"),
    ],
)
def test_an_entry_point_that_is_no_board_is_left_out_with_a_word_in_the_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, entry: str, said: str
) -> None:
    install(tmp_path, "other", entry)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with caplog.at_level(logging.WARNING, "armctl.hardware"):
        assert board_types() == SHIPPED
    assert said in caplog.text


def test_no_kind_of_board_is_compared_outside_hardware() -> None:
    shipped = {board.kind for board in SHIPPED}
    assert shipped <= set(kinds())
    compared: list[str] = []
    for path in SRC.rglob("*.py"):
        if {"hardware", "look"} & set(path.relative_to(SRC).parts):  # a look has motors of a make
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Compare | ast.match_case | ast.Subscript | ast.Dict):
                parts = node.pattern if isinstance(node, ast.match_case) else node
                words = [one.value for one in ast.walk(parts) if isinstance(one, ast.Constant)]
                compared += [f"{path}: {word}" for word in words if word in shipped]
    assert compared == []


@pytest.mark.parametrize("folder", ["dynamixel", "feetech"])
def test_a_make_of_bus_servos_is_known_to_one_file_outside_its_folder(folder: str) -> None:
    """Its packets, its tables and its simulated servos are: the registry names its board."""
    outside = [path for path in SRC.rglob("*.py") if folder not in path.relative_to(SRC).parts]
    knowing = [path for path in outside if f"armctl.hardware.{folder}" in path.read_text(encoding="utf-8")]
    assert [path.relative_to(SRC).as_posix() for path in knowing] == ["hardware/boards.py"]
