"""ports: the listing, the probing and the udev rules."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armctl.cli.main import DONE, run
from armctl.hardware.maestro.simulated import SimulatedMaestro, simulated_maestro
from armctl.hardware.simulation import BoardServer
from armctl.hardware.transport import PortInfo
from armctl.protocol import ManualClock

MAESTRO = "Pololu Micro Maestro 6-channel"


@pytest.fixture
def listing(monkeypatch: pytest.MonkeyPatch) -> list[PortInfo]:
    """What the system lists, to be filled."""
    found: list[PortInfo] = []
    monkeypatch.setattr("armctl.cli.boards.list_ports", lambda: found)
    return found


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert run(["ports", *words]) == DONE
    out, err = capsys.readouterr()
    assert err == ""
    return out


def test_no_port_at_all(listing, capsys: pytest.CaptureFixture[str]):
    assert printed(capsys) == "no serial port found; the simulated board needs none (--port sim)\n"
    assert json.loads(printed(capsys, "--json")) == []


def test_kind_serial_number_reason_name_and_notes(listing, capsys: pytest.CaptureFixture[str]):
    listing += [
        PortInfo("/dev/ttyACM0", MAESTRO, "", "0007", True, None, "/dev/serial/by-id/maestro", ("a note",)),
        PortInfo("/dev/ttyACM1", MAESTRO, "", None, False, "this is the TTL port"),
    ]
    assert printed(capsys).splitlines() == [
        f"/dev/ttyACM0        {MAESTRO}, serial number 0007",
        "                    ready to use",
        "                    /dev/serial/by-id/maestro",
        "                    a note",
        f"/dev/ttyACM1        {MAESTRO}",
        "                    this is the TTL port",
    ]
    first, second = json.loads(printed(capsys, "--json"))
    assert (first["serial_number"], first["notes"]) == ("0007", ["a note"])
    assert second["why_not"] == "this is the TTL port"
    assert "answer" not in first


def test_probing_opens_usable_ports_only(listing, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    with BoardServer(simulated_maestro(), ManualClock().now, link=tmp_path / "arm") as server:
        listing += [
            PortInfo(server.port, MAESTRO, "", None, True, None),
            PortInfo("/dev/ttyACM1", MAESTRO, "", None, False, "this is the TTL port"),
            PortInfo(str(tmp_path / "gone"), MAESTRO, "", None, True, None),
        ]
        out = printed(capsys, "--probe")
        records = json.loads(printed(capsys, "--probe", "--json"))
    assert "probed: Pololu Maestro\n" in out
    assert [record["answer"] for record in records[:2]] == ["probed: Pololu Maestro", None]
    assert "no such port" in records[2]["answer"]


def test_listing_alone_opens_nothing(listing, capsys: pytest.CaptureFixture[str]):
    board = SimulatedMaestro()
    with BoardServer(board, ManualClock().now) as server:
        listing.append(PortInfo(server.port, MAESTRO, "", None, True, None))
        printed(capsys)
        with server.inspect() as seen:
            assert seen.log == ()


def test_the_udev_rules_and_nothing_else(listing, capsys: pytest.CaptureFixture[str]):
    out = printed(capsys, "--udev")
    assert out.startswith("# armctl")
    assert 'ATTRS{idVendor}=="1ffb"' in out
    assert out.endswith('LABEL="armctl_end"\n')
