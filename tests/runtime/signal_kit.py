"""The Uzuner arm with inputs and outputs on its Maestro, and a bench with the true bytes of that board."""

from __future__ import annotations

from pathlib import Path

from tests.runtime.board_bench import BoardBench

from armctl.facts import State
from armctl.hardware.boards import channel_settings
from armctl.hardware.faults import Trouble
from armctl.hardware.input_script import InputPlayer, InputScript
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import SimulatedMaestro, simulated_maestro
from armctl.hardware.transport import Connection
from armctl.protocol import Connect, Enable
from armctl.robot import Robot, load_robot, robots_folder

BUTTON, DOOR, KNOB, LAMP, PUMP, BELL = 6, 7, 8, 9, 10, 11
"""channels"""
SIGNALS = """
[[inputs]]
name = "button"
channel = 6
active_low = true

[[inputs]]
name = "door"
channel = 7
debounce_ms = 40

[[inputs]]
name = "knob"
channel = 8
kind = "analog"

[[outputs]]
name = "lamp"
channel = 9
at_stop = "on"
at_release = "off"
at_end = "off"

[[outputs]]
name = "pump"
title = "Vacuum pump"
channel = 10
active_low = true
at_fault = "off"

[[outputs]]
name = "bell"
channel = 11
"""
VACUUM = """
[gripper]
title = "Cup"
speed_percent_s = 200
output = "pump"
part_input = "door"
"""


def robot_with(folder: Path, more: str = SIGNALS, gripper: str | None = None) -> Robot:
    """The arm with more in its file; ``gripper`` in place of its own."""
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    if gripper is not None:
        begin = text.index("[gripper]")
        text = text[:begin] + gripper + text[text.index("\n[", begin) :]
    path = folder / "uzuner.toml"
    path.write_text(f"{text}\n{more}", encoding="utf-8")
    return load_robot(path)


class BenchInputs:
    """What is connected to the board's inputs; time passes for the board as a script says."""

    def __init__(self, robot: Robot, board: SimulatedMaestro) -> None:
        self._robot, self._board = robot, board
        self._player: InputPlayer | None = None

    def simulate(self, channel: int, level: float) -> None:
        self._board.levels[channel] = level

    def play(self, script: InputScript | None) -> None:
        signals, levels = self._robot.signals, self._board.levels
        self._player = None if script is None else InputPlayer(script, signals, levels)

    def feed(self, data: bytes) -> bytes:
        return self._board.feed(data)

    def advance(self, now: float) -> bytes:
        return self._board.advance(now) if self._player is None else self._player.advance(self._board, now)

    def reset(self) -> None:
        self._board.reset()


def bench_of(robot: Robot, *troubles: Trouble, enabled: bool = True) -> BoardBench[SimulatedMaestro]:
    """The arm on its board, connected; holding where it is enabled. Its button is not pressed."""
    model = MaestroModel.MINI_12
    board = simulated_maestro(channel_settings(robot), model, None, robot.signals)
    board.levels[BUTTON] = 1.0
    bench = BoardBench.of(
        robot,
        board,
        lambda line, now: MaestroDriver(Connection(line, now, simulated=True), model=model),
        troubles=troubles,
    )
    world = BenchInputs(robot, board)
    bench.line.inner = world
    bench.controller._core.signals.let_simulate(world)
    bench.do(Connect("sim"))
    if enabled:
        bench.do(Enable())
        bench.until(State.HOLDING)
    return bench


def high(bench: BoardBench[SimulatedMaestro], *channels: int) -> list[bool]:
    """Which pins the board drives high."""
    return [bench.board.channel(one).position >= 6000 for one in channels]
