"""The real driver and the simulated encoder board on the controller's own clock: true bytes, no threads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.runtime.board_bench import BoardBench
from tests.runtime.kit import TEST, TICK, fails

from armctl.errors import BoardError, StateError
from armctl.facts import State
from armctl.hardware import Source
from armctl.hardware.boards import channel_settings
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.messages import Mode
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard, simulated_encoder_board
from armctl.hardware.faults import Fault
from armctl.hardware.transport import Connection
from armctl.program import Program, WaitForStep, WaitStep
from armctl.protocol import (
    ClearFault,
    Connect,
    Enable,
    HomeAxes,
    MoveGripper,
    MoveJoints,
    Release,
    RunProgram,
    SetOutput,
)
from armctl.robot import load_robot, robots_folder

SCORBOT = load_robot("scorbot")
HOMING_S = 180.0


Bench = BoardBench[SimulatedEncoderBoard]


def home(bench: Bench) -> None:
    ticket = bench.do(HomeAxes())
    bench.until(State.HOLDING, State.OFF, State.FAULT, seconds=HOMING_S)
    ticket.finished.result(0)


@pytest.fixture
def bench() -> Bench:
    board = simulated_encoder_board(channel_settings(SCORBOT), SCORBOT.board_settings.axes)
    bench = BoardBench.of(
        SCORBOT,
        board,
        lambda line, now: EncoderDriver(Connection(line, now, simulated=True), SCORBOT.board_settings),
    )
    bench.do(Connect("sim"))
    return bench


@pytest.fixture
def homed(bench: Bench) -> Bench:
    home(bench)
    return bench


def test_home_move_grip_and_release(homed: Bench) -> None:
    assert homed.now.source is Source.MEASURED
    assert homed.now.commanded
    goal = SCORBOT.pose("home") + np.radians([10, 5, -5, 5, 20])
    moved = homed.do(MoveJoints(goal))
    gripped = homed.do(MoveGripper(1.0))
    homed.until(State.HOLDING)
    homed.run(5.0)
    moved.finished.result(0)
    gripped.finished.result(0)
    assert np.abs(homed.now.q - goal).max() <= np.radians(0.5)
    homed.do(Release())
    homed.run(0.1)
    assert homed.board.mode is Mode.OFF
    assert not homed.now.powered and not homed.now.commanded
    assert np.isfinite(homed.now.q).all()  # the encoders go on counting
    homed.do(Enable())
    homed.run(0.2)
    assert homed.board.mode is Mode.ON
    assert homed.now.state is State.HOLDING


PINS = """
[[inputs]]
name = "door"
channel = 43

[[inputs]]
name = "bouncy"
channel = 44
debounce_ms = 40

[[outputs]]
name = "lamp"
channel = 45
at_stop = "off"

[[outputs]]
name = "pump"
channel = 46
at_fault = "off"
"""


@pytest.fixture
def with_pins(tmp_path: Path) -> Bench:
    """Homed, both outputs on."""
    path = tmp_path / "scorbot.toml"
    text = (robots_folder() / "scorbot.toml").read_text(encoding="utf-8")
    path.write_text(f"{text}\n{PINS}", encoding="utf-8")
    robot = load_robot(path)
    bench = BoardBench.of(
        robot,
        simulated_encoder_board(channel_settings(robot), robot.board_settings.axes),
        lambda line, now: EncoderDriver(Connection(line, now, simulated=True), robot.board_settings),
    )
    bench.do(Connect("sim"))
    home(bench)
    for name in ("lamp", "pump"):
        bench.do(SetOutput(name, 1.0))
    assert bench.run(2 * TICK).outputs == {"lamp": 1.0, "pump": 1.0}
    return bench


def test_a_pulse_of_5_ms_between_two_ticks_is_an_edge_but_for_an_input_that_is_debounced(
    with_pins: Bench,
) -> None:
    bench = with_pins
    wait = WaitForStep(watch="door", trigger="edge", timeout_s=5)
    ticket = bench.do(RunProgram(Program(robot="scorbot", steps=(WaitStep(seconds=0.5), wait))))
    bench.run(0.1)
    for pin in (43, 44):
        bench.board.levels[pin] = 1.0
    bench.clock.advance(0.005)
    bench.line.advance(bench.clock.now())
    bench.board.levels.clear()
    assert bench.run(2 * TICK).edges == {"door": 2, "bouncy": 0} and bench.now.inputs["door"] == 0.0
    bench.until(State.HOLDING)
    ticket.finished.result(0)  # the edge came while the program did something else


def test_outputs_at_stop_and_at_a_fault_that_the_board_has_found(with_pins: Bench) -> None:
    bench = with_pins
    bench.controller.stop(TEST)
    assert bench.run(2 * TICK).outputs == {"lamp": 0.0, "pump": 1.0}
    bench.do(SetOutput("lamp", 1.0))
    bench.board.axes[1].lose_edges(6)
    bench.until(State.FAULT)
    assert bench.run(2 * TICK).outputs == {"lamp": 1.0, "pump": 0.0}


def test_stop_ends_homing_and_it_can_be_begun_again(bench: Bench) -> None:
    ticket = bench.do(HomeAxes())
    bench.run(1.0)
    assert bench.board.mode is Mode.HOMING
    assert bench.now.powered and not bench.now.commanded
    bench.controller.stop(TEST)
    bench.run(TICK)
    assert bench.board.mode is Mode.HELD
    bench.run(1.0)
    fails(ticket.finished, "homing was stopped by test")
    assert bench.now.state is State.OFF
    assert bench.now.powered, "they hold, and the page says so"
    home(bench)
    bench.do(MoveJoints(SCORBOT.pose("rest")))
    bench.until(State.HOLDING)
    assert bench.now.warnings == ()


def test_lost_edges_are_shown_and_the_fifth_is_a_fault(homed: Bench) -> None:
    homed.do(MoveJoints(SCORBOT.pose("rest")))
    homed.run(0.2)
    homed.board.axes[1].lose_edges(1)
    homed.run(0.1)
    title = SCORBOT.joints[1].title
    assert homed.now.state is State.MOVING, "it goes on"
    assert any(
        text.startswith(f"{title}: its encoder has lost 1 edge since homing") for text in homed.now.warnings
    )
    homed.board.axes[1].lose_edges(4)
    homed.until(State.FAULT, seconds=0.2)
    assert f"{title}: its encoder lost more than 4 edges since homing" in homed.now.cause
    assert homed.board.mode is Mode.TRIPPED
    homed.do(ClearFault())
    home(homed)
    homed.run(11.0)
    assert (homed.now.state, homed.now.warnings) == (State.HOLDING, ())


@pytest.mark.parametrize("moving", [False, True])
def test_a_brown_out_is_a_fault_until_it_is_cleared_and_the_arm_homed(homed: Bench, moving: bool) -> None:
    if moving:
        homed.do(MoveJoints(SCORBOT.pose("rest")))
        homed.run(0.2)
    homed.line.brown_out(0.5)
    homed.until(State.FAULT, seconds=2.0)
    assert homed.board.mode is Mode.OFF
    assert not homed.now.powered and not homed.now.commanded
    if homed.now.board is None:
        homed.do(Connect("sim"))
    else:
        assert homed.now.cause.count("started anew") == 1
        assert "(in the middle of work: " in homed.now.cause, "though the banner that says so was lost"
        assert homed.now.cause.endswith("then clear the fault and home the arm")
        assert "started anew" in " ".join(homed.now.warnings)
        assert "started anew" not in " ".join(homed.now.more_warnings), "once is enough"
        homed.do(ClearFault())
    homed.run(0.5)
    assert homed.now.state is State.OFF
    assert homed.board.mode is Mode.OFF
    with pytest.raises(StateError, match="press Homing"):
        homed.do(Enable())
    home(homed)


def test_a_brown_out_while_it_homes_is_told(bench: Bench) -> None:
    ticket = bench.do(HomeAxes())
    bench.run(1.0)
    bench.line.brown_out(0.3)
    bench.until(State.OFF, seconds=2.0)
    fails(ticket.finished, "started anew", BoardError)
    assert bench.board.mode is Mode.OFF
    assert "started anew" in " ".join(bench.now.warnings)
    bench.do(HomeAxes())
    assert "started anew" not in " ".join(bench.now.warnings)


@pytest.mark.parametrize(
    "fault", [Fault.DROP_COMMAND, Fault.GARBLE_COMMAND, Fault.DROP_REPLY, Fault.GARBLE_REPLY]
)
def test_stop_ends_homing_on_a_bad_line(bench: Bench, fault: Fault) -> None:
    bench.do(HomeAxes())
    bench.run(1.0)
    bench.line.inject(fault, count=2)
    bench.controller.stop(TEST)
    bench.run(0.2)
    assert bench.board.mode in (Mode.HELD, Mode.OFF)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("asleep_s", [0.45, 2.0])  # the board brakes, and is off 0.05 s later
def test_a_host_that_was_away_is_told_and_can_go_on(homed: Bench, moving: bool, asleep_s: float) -> None:
    if moving:
        homed.do(MoveJoints(SCORBOT.pose("rest")))
        homed.run(0.5)
    homed.clock.advance(asleep_s)
    homed.run(0.1)
    assert homed.now.state is State.FAULT
    assert "watchdog" in homed.now.cause
    assert homed.now.cause.endswith("then clear the fault and enable")
    homed.run(1.0)
    assert homed.board.mode is Mode.OFF
    assert "watchdog" in " ".join(homed.now.warnings)
    homed.do(ClearFault())
    assert homed.now.state is State.OFF
    assert "watchdog" not in " ".join(homed.now.warnings)
    homed.do(Enable())
    assert homed.now.state is State.HOLDING
    homed.do(MoveJoints(SCORBOT.pose("home")))
    homed.until(State.HOLDING)


def test_a_closed_controller_leaves_the_motors_to_the_watchdog(bench: Bench) -> None:
    bench.do(HomeAxes())
    bench.run(1.0)
    bench.controller.close()
    bench.board.advance(bench.clock.now() + 1.0)
    assert bench.board.mode is Mode.OFF
