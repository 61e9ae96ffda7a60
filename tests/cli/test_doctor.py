"""doctor: what it prints for each simulated board, over each kind of line, and its exit status."""

from __future__ import annotations

import getpass
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from armctl.cli.main import DONE, REFUSED, WRONG_USAGE, run
from armctl.errors import PortError
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro.simulated import MaestroSettings, SimulatedMaestro, simulated_maestro
from armctl.hardware.simulation import BoardServer
from armctl.hardware.transport import PortInfo, SerialTransport
from armctl.protocol import ManualClock, MonotonicClock


@pytest.fixture(autouse=True)
def nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer without boards, whose names would show if they got into a report."""
    monkeypatch.setattr("armctl.cli.boards.list_ports", list)
    monkeypatch.setattr(socket, "gethostname", lambda: "babbage.lan")
    monkeypatch.setattr(getpass, "getuser", lambda: "lovelace")
    monkeypatch.setattr(Path, "home", lambda: Path("/home/lovelace"))


def record(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, str], dict[str, str]]:
    """Exit status, verdict by check (the last one counts) and what was seen by check."""
    status = run(["doctor", *words, "--json"])
    out, err = capsys.readouterr()
    assert err == ""
    findings = json.loads(out)["findings"]
    verdicts, seen = ({one["check"]: one[key] for one in findings} for key in ("verdict", "seen"))
    return status, verdicts, seen


@pytest.mark.parametrize(
    ("robot", "answers"),
    [("uzuner", "Pololu Maestro"), ("abaas", "StandardFirmata"), ("scorbot", "armctl-encoder")],
)
def test_the_simulated_board_of_each_kind_is_well(capsys: pytest.CaptureFixture[str], robot, answers):
    status, verdicts, seen = record(capsys, "--port", "sim", "--robot", robot)
    assert status == DONE
    assert "failed" not in verdicts.values()
    assert seen["who answers"].startswith(answers)
    assert (verdicts["channels"], verdicts["round trips"] in ("ok", "warning")) == ("ok", True)


def test_without_a_port_it_says_which_there_are(capsys: pytest.CaptureFixture[str]):
    assert run(["doctor"]) == WRONG_USAGE
    assert "auto looks for a board, sim examines the simulated one" in capsys.readouterr().err


def test_the_report_for_people(capsys: pytest.CaptureFixture[str]):
    assert run(["doctor", "--port", "sim", "--robot", "uzuner"]) == DONE
    out = capsys.readouterr().out
    first, second, *_ = out.splitlines()
    assert first.startswith("armctl doctor: Python 3.")
    assert "pyserial 3." in first
    assert second == "port sim, robot uzuner"
    assert "\nok          channels        channels 0, 1, 2, 3, 4, 5: the board has them\n" in out
    assert "\n                            -> set " in out
    assert out.splitlines()[-1].endswith("4 not checked")


def test_a_pty_by_its_link_without_a_robot(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    with BoardServer(simulated_maestro(), ManualClock().now, link=tmp_path / "arm"):
        status, verdicts, seen = record(capsys, "--port", str(tmp_path / "arm"))
    assert status == DONE
    assert seen["who answers"] == "Pololu Maestro"
    assert (verdicts["opens"], verdicts["channels"], verdicts["other programs"]) == (
        "ok",
        "not checked",
        "not checked",
    )


def test_a_port_in_use_is_not_called_free_first(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    port = str(tmp_path / "arm")
    with (
        BoardServer(simulated_maestro(), ManualClock().now, link=tmp_path / "arm"),
        closing(SerialTransport(port)),
    ):
        status, verdicts, seen = record(capsys, "--port", port)
    assert (status, verdicts["opens"]) == (REFUSED, "failed")
    assert "in use by another program" in seen["opens"]
    assert verdicts["other programs"] == "not checked"


def test_the_kind_may_stand_in_front_of_the_port(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    with BoardServer(simulated_maestro(), ManualClock().now, link=tmp_path / "arm"):
        status, _, seen = record(capsys, "--port", f"encoder:{tmp_path / 'arm'}")
    assert status == REFUSED
    assert "a Pololu Maestro answers, where an Arduino with armctl's" in seen["who answers"]
    assert seen["channels"] == "no robot was named"


@pytest.mark.parametrize("port", ["firmata:/dev/ttyACM0", "maestro:socket://127.0.0.1:1"])
def test_the_kind_in_front_of_the_port_must_be_the_robots(capsys: pytest.CaptureFixture[str], port: str):
    """Its counts are no pins: nothing is opened."""
    status, verdicts, seen = record(capsys, "--port", port, "--robot", "scorbot")
    assert (status, verdicts) == (REFUSED, {"port": "failed"})
    assert "Scorbot ER-4PC is set up for Arduino with armctl's encoder firmware, this is" in seen["port"]


@contextmanager
def maestro_on_tcp() -> Iterator[int]:
    """A simulated Maestro behind a TCP port, as a serial-to-network bridge would show it."""
    board = SimulatedMaestro()
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                while data := connection.recv(4096):
                    connection.sendall(board.feed(data))

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield listener.getsockname()[1]
        thread.join(timeout=20)
        assert not thread.is_alive()


def test_a_board_behind_a_socket(capsys: pytest.CaptureFixture[str]):
    with maestro_on_tcp() as port:
        status, _, seen = record(capsys, "--port", f"socket://127.0.0.1:{port}", "--robot", "uzuner")
    assert status == DONE
    assert seen["who answers"] == "Pololu Maestro"


def test_auto_without_a_robot_finds_an_arduino_too(capsys: pytest.CaptureFixture[str], tmp_path, monkeypatch):
    port = str(tmp_path / "mega")
    listing = [PortInfo(port, "Arduino Mega", "Mega", "75", True, None)]
    monkeypatch.setattr("armctl.cli.boards.list_ports", lambda: listing)
    with BoardServer(SimulatedFirmata(), MonotonicClock().now, link=tmp_path / "mega"):
        _, verdicts, seen = record(capsys, "--port", "auto")
    assert seen["port"] == "Arduino Mega, USB serial number 75"
    assert seen["who answers"] == "StandardFirmata 2.3; Firmata protocol 2.3"
    assert verdicts["who answers"] == "ok"


def test_a_board_in_the_factorys_serial_mode_fails_with_advice(capsys: pytest.CaptureFixture[str], tmp_path):
    settings = MaestroSettings(takes_usb=False)
    with BoardServer(simulated_maestro(settings=settings), ManualClock().now, link=tmp_path / "arm"):
        assert run(["doctor", "--port", str(tmp_path / "arm"), "--robot", "uzuner"]) == REFUSED
    out = capsys.readouterr().out
    assert "failed      who answers     nobody that armctl knows answers\n" in out
    assert "USB Dual Port" in out
    assert "not checked round trips" in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--port", "/dev/none"), "/dev/none does not exist"),
        (("--port", "auto", "--robot", "scorbot"), "no Arduino found; serial ports: none at all"),
    ],
)
def test_a_port_that_is_not_there(capsys: pytest.CaptureFixture[str], words: tuple[str, ...], says: str):
    status, verdicts, seen = record(capsys, *words)
    assert (status, verdicts["port"]) == (REFUSED, "failed")
    assert seen["port"].startswith(says)


def test_the_report_names_nobody(capsys: pytest.CaptureFixture[str]):
    for words in (
        ("--port", "/home/lovelace/arm"),
        ("--port", "socket://babbage.lan:1"),
        ("--port", "/media/lovelace/arm", "--json"),
    ):
        assert run(["doctor", *words]) == REFUSED
        out = capsys.readouterr().out
        assert "lovelace" not in out
        assert "babbage" not in out
        assert "arm" in out or "<host>" in out


def test_a_robot_that_does_not_exist_is_wrong_usage_not_a_report(capsys: pytest.CaptureFixture[str]):
    assert run(["doctor", "--port", "sim", "--robot", "r2d2"]) == REFUSED
    assert "r2d2" in capsys.readouterr().err
    assert run(["doctor"]) == WRONG_USAGE


def test_what_breaks_the_listing_is_a_report(capsys: pytest.CaptureFixture[str], monkeypatch):
    def broken() -> list[object]:
        raise PortError("the system lists no ports")

    monkeypatch.setattr("armctl.cli.boards.list_ports", broken)
    status, _, seen = record(capsys, "--port", "auto")
    assert (status, seen) == (REFUSED, {"port": "the system lists no ports"})
