"""A board that was lost is said to be plugged in again once it is."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from tests.ui.page_kit import snapshot_of

from armctl.facts import State
from armctl.hardware import BoardIdentity
from armctl.robot import load_robot
from armctl.ui import console as port_watch
from armctl.ui.console import Console, PortChoice, PortWatch

CONNECTED = replace(snapshot_of(load_robot("uzuner")), state=State.HOLDING)
LOST = replace(CONNECTED, state=State.FAULT, board=None)
MAESTRO = PortChoice("/dev/ttyACM1", "Maestro on /dev/ttyACM1", serial_number="00123", listed=True)
OTHER = PortChoice("/dev/ttyACM0", "Maestro on /dev/ttyACM0", serial_number="00999", listed=True)


class Bench:
    def __init__(self, monkeypatch: pytest.MonkeyPatch, board: BoardIdentity) -> None:
        monkeypatch.setattr(port_watch, "_FRAMES", 1)
        self.plugged_in: list[PortChoice] = [OTHER, MAESTRO]
        self.looks = 0
        console = SimpleNamespace(list_ports=self._list, frame_listeners=[])
        self.watch = PortWatch.of(cast(Console, console), None)
        assert console.frame_listeners == [self.watch.note]
        self.connected = replace(CONNECTED, board=board)

    def _list(self) -> list[PortChoice]:
        self.looks += 1
        return self.plugged_in

    def see(self, *plugged_in: PortChoice, lost: bool = True) -> str | None:
        self.plugged_in = list(plugged_in)

        async def frame() -> None:
            self.watch.note(LOST if lost else self.connected)
            for task in asyncio.all_tasks() - {asyncio.current_task()}:
                await task

        asyncio.run(frame())
        return self.watch.back_on


def test_it_is_found_by_its_serial_number_on_whatever_port(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, BoardIdentity("Maestro", "/dev/ttyACM0", "00123"))
    assert bench.see(OTHER, MAESTRO, lost=False) is None and bench.looks == 0
    assert bench.see(OTHER, MAESTRO) is None  # it has not been away: its power may be gone
    assert bench.see(OTHER) is None
    assert bench.see(OTHER, MAESTRO) == "/dev/ttyACM1"
    assert bench.see(OTHER) is None
    assert bench.see(OTHER, MAESTRO) == "/dev/ttyACM1"
    assert bench.see(OTHER, MAESTRO, lost=False) is None


def test_without_a_serial_number_its_port_counts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    port = tmp_path / "arm"
    bench = Bench(monkeypatch, BoardIdentity("Firmata board", str(port)))
    assert bench.see(lost=False) is None
    assert bench.see(OTHER) is None
    port.touch()
    assert bench.see(OTHER) == str(port)


def test_a_simulated_board_is_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, BoardIdentity("Maestro", "/dev/pts/3", simulated=True))
    bench.see(lost=False)
    assert bench.see() is None and bench.looks == 0
