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
from armctl.boards import setup_of
from armctl.facts import State
from armctl.hardware import ByteModel, Driver
from armctl.hardware.boards import board_type
from armctl.hardware.transport import Connection, Transport
from armctl.program import open_program
from armctl.protocol import Connect, Disconnect, Enable, HomeAxes, Release, RunProgram
from armctl.robot import Robot

ROBOTS = ("uzuner", "abaas", "scorbot")
"""one for each kind of board"""
WIRE = Path(__file__).parent / "wire"
SESSION_S = 300.0


class RecordedLine:
    """A line that keeps a line of text for each write: the time [ms], and the bytes in hex."""

    def __init__(self, line: Transport, now: Callable[[], float], record: list[str]) -> None:
        self._line, self._now, self._record = line, now, record
        self._begun = now()

    def __getattr__(self, name: str) -> object:
        return getattr(self._line, name)

    def write(self, data: bytes) -> None:
        self._record.append(f"{round(1000 * (self._now() - self._begun))} {data.hex()}")
        self._line.write(data)


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
        if not bench.do(Enable()).finished.done():
            bench.until(State.HOLDING)
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


def _bench(robot: Robot, record: list[str]) -> BoardBench[ByteModel]:
    """As ``sim`` wires them up, with the recorded line in between."""
    setup, kind = setup_of(robot), board_type(robot.board)

    def driver(opened: Callable[[], Transport], now: Callable[[], float]) -> Driver:
        line = Connection(lambda: RecordedLine(opened(), now, record), now, simulated=True)
        return kind.driver(setup, line)

    return BoardBench.of(robot, kind.simulated(setup, {}), driver)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_session_sends_the_bytes_that_were_recorded(robot: str) -> None:
    now = recorded(robot)
    then = lzma.decompress((WIRE / f"{robot}.txt.xz").read_bytes()).decode().splitlines()
    for line, (new, old) in enumerate(zip(now, then, strict=False)):
        assert new == old, f"write {line}, after {[one for one in then[:line] if one.startswith('#')][-1]}"
    assert len(now) == len(then)


if __name__ == "__main__":
    for name in ROBOTS:
        text = "\n".join(recorded(name)).encode()
        (WIRE / f"{name}.txt.xz").write_bytes(lzma.compress(text, preset=9))
