"""The real driver and the simulated Maestro on the controller's own clock: true bytes, no threads."""

from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.board_bench import BoardBench
from tests.runtime.kit import ROBOT, TEST, TICK

from armctl.hardware import Source
from armctl.hardware.faults import Fault
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.codec import Opcode
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import ChannelConfig, MaestroSettings, SimulatedMaestro
from armctl.hardware.transport import Connection
from armctl.runtime import ClearFault, Connect, Enable, MoveJoints, State

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")
WIDE = {channel: ChannelConfig(minimum_us=500, maximum_us=2500) for channel in range(6)}
QUARTER = 0.25 / 516  # ¼ µs at the base's 9 µs a degree [rad]


Bench = BoardBench[SimulatedMaestro]


@pytest.fixture
def bench() -> Bench:
    board = SimulatedMaestro(MaestroModel.MICRO_6, MaestroSettings(channels=WIDE))
    bench = BoardBench.of(
        ROBOT,
        board,
        lambda line, _now: MaestroDriver(
            Connection(line, lambda: 0.0, simulated=True), model=MaestroModel.MICRO_6
        ),
    )
    bench.do(Connect("sim"))
    bench.do(Enable())
    bench.until(State.HOLDING)
    return bench


def test_the_board_follows_to_a_quarter_microsecond(bench: Bench) -> None:
    bench.do(MoveJoints(HOME))
    worst = 0.0
    while bench.run(TICK).state is State.MOVING:
        worst = max(worst, float(np.abs(bench.now.q - bench.now.q_command).max()))
    # the transmitted position runs one servo frame behind
    assert worst <= np.radians(120) * 2 * TICK
    bench.run(0.1)
    assert np.abs(bench.now.q - HOME).max() <= QUARTER
    assert bench.now.source is Source.TRANSMITTED
    bench.run(1)
    assert bench.now.warnings == ()


@pytest.mark.parametrize("dark_s", [0.025, 0.06, 0.1, 0.13, 0.2, 0.5])
def test_a_brown_out_that_switched_the_pulses_off_is_a_fault_and_nothing_jumps(
    bench: Bench, dark_s: float
) -> None:
    bench.controller.submit(MoveJoints(HOME, duration_s=10), TEST)
    bench.run(0.5)
    before = len(bench.board.log)
    bench.line.brown_out(dark_s)
    bench.run(1.0)
    assert bench.now.state is State.FAULT
    assert "switched the pulses off by itself" in bench.now.cause
    assert not [command for command in bench.board.log[before:] if command.opcode is Opcode.SET_TARGET]


def test_a_lost_reply_halts_the_arm_and_it_goes_on_from_rest(bench: Bench) -> None:
    bench.do(MoveJoints(HOME, duration_s=3))
    bench.run(1.0)
    bench.line.inject(Fault.DROP_REPLY)
    bench.run(TICK)
    assert bench.now.velocity_command.any()
    bench.run(TICK)
    assert not bench.now.velocity_command.any()
    bench.run(TICK)
    slow = np.abs(bench.now.velocity_command)
    assert (slow <= ROBOT.acceleration_limits * 2 * TICK * (1 + 1e-6)).all()
    bench.until(State.HOLDING)
    assert bench.now.cause == "move finished"


def test_pulses_off_while_holding_are_a_fault_and_enable_sets_the_board_up_anew(bench: Bench) -> None:
    bench.board.reset()
    bench.run(0.2)
    assert bench.now.state is State.FAULT
    assert "switched the pulses off by itself" in bench.now.cause
    bench.do(ClearFault())
    assert bench.now.state is State.OFF
    before = len(bench.board.log)
    bench.do(Enable())
    bench.until(State.HOLDING)
    assert any(command.raw[0] == 0x87 for command in bench.board.log[before:])  # Set Speed again
