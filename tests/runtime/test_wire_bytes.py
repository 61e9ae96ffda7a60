"""The bytes on the wire stay what they were: every part of a session, on every kind of board.

``python -m tests.runtime.test_wire_bytes`` records them anew: only where they are meant to change.
"""

from __future__ import annotations

import lzma
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.runtime.board_bench import BoardBench

from armctl import load_robot
from armctl.hardware import ByteModel, Driver
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.simulated import simulated_encoder_board
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import ChannelConfig, MaestroSettings, SimulatedMaestro
from armctl.hardware.transport import Connection, Transport
from armctl.program import open_program
from armctl.robot import Robot
from armctl.runtime import (
    Connect,
    Disconnect,
    Enable,
    HomeAxes,
    Release,
    RunProgram,
    State,
    channel_settings,
)

ROBOTS = ("uzuner", "abaas", "scorbot")
"""one for each kind of board"""
WIRE = Path(__file__).parent / "wire"
SESSION_S = 300.0


class RecordedLine:
    """A line that keeps a line of text for each write: the time [ms], and the bytes in hex."""

    def __init__(self, line: Transport, now: Callable[[], float], record: list[str]) -> None:
        self._line, self._now, self._record = line, now, record
        self._begun = now()

    @property
    def name(self) -> str:
        return self._line.name

    def write(self, data: bytes) -> None:
        self._record.append(f"{round(1000 * (self._now() - self._begun))} {data.hex()}")
        self._line.write(data)

    def read(self, count: int, timeout_s: float) -> bytes:
        return self._line.read(count, timeout_s)

    def discard_input(self) -> None:
        self._line.discard_input()

    def close(self) -> None:
        self._line.close()


def recorded(name: str) -> list[str]:
    """The writes of one session with a robot on its simulated board, under the names of its parts."""
    robot, record = load_robot(name), list[str]()
    bench = _bench(robot, record)

    @contextmanager
    def part(title: str) -> Iterator[None]:
        record.append(f"# {title}")
        yield
        bench.run(0.2)

    with part("connect"):
        bench.do(Connect("sim")).finished.result(0)
    if robot.board == "encoder":
        with part("home"):
            homed = bench.do(HomeAxes())
            bench.until(State.HOLDING, State.OFF, State.FAULT, seconds=SESSION_S)
            homed.finished.result(0)
    with part("enable"):
        bench.do(Enable())
        bench.run(2.0)
    with part("program"):
        ran = bench.do(RunProgram(open_program(WIRE / f"{name}.toml", robot)))
        bench.until(State.HOLDING, State.OFF, State.FAULT, seconds=SESSION_S)
        ran.finished.result(0)
    with part("release"):
        bench.do(Release()).finished.result(0)
    with part("disconnect"):
        bench.do(Disconnect()).finished.result(0)
    return record


def _golden(name: str) -> list[str]:
    """What was recorded."""
    return lzma.decompress((WIRE / f"{name}.txt.xz").read_bytes()).decode().splitlines()


def _bench(robot: Robot, record: list[str]) -> BoardBench[ByteModel]:
    """As ``sim`` wires them up, with the recorded line in between."""
    channels = channel_settings(robot)
    board: ByteModel
    match robot.board:
        case "maestro":
            ranges = {one.channel: ChannelConfig(one.minimum, one.maximum) for one in channels}
            model = MaestroModel.with_channels(len(channels))
            board = SimulatedMaestro(model, MaestroSettings(channels=ranges))
        case "firmata":
            board = SimulatedFirmata(0.0)
        case "encoder":
            board = simulated_encoder_board(channels, robot.board_settings.axes)

    def driver(opened: Callable[[], Transport], now: Callable[[], float]) -> Driver:
        def line() -> RecordedLine:
            return RecordedLine(opened(), now, record)

        match robot.board:
            case "maestro":
                return MaestroDriver(Connection(line, lambda: 0.0, simulated=True), model=model)
            case "firmata":
                return FirmataDriver(Connection(line, now, simulated=True))
            case "encoder":
                return EncoderDriver(Connection(line, now, simulated=True), robot.board_settings)

    return BoardBench.of(robot, board, driver)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_session_sends_the_bytes_that_were_recorded(robot: str) -> None:
    now, then = recorded(robot), _golden(robot)
    for line, (new, old) in enumerate(zip(now, then, strict=False)):
        assert new == old, f"write {line}, after {[one for one in then[:line] if one.startswith('#')][-1]}"
    assert len(now) == len(then)


if __name__ == "__main__":
    for name in ROBOTS:
        text = "\n".join(recorded(name)).encode()
        (WIRE / f"{name}.txt.xz").write_bytes(lzma.compress(text, preset=9))
