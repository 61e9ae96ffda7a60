"""The real driver and the simulated Maestro on the controller's own clock: true bytes, no threads."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from tests.runtime import signal_kit
from tests.runtime.board_bench import BoardBench
from tests.runtime.kit import ROBOT, TEST, TICK

from armctl.errors import StateError
from armctl.facts import State
from armctl.hardware import Source
from armctl.hardware.faults import Fault, Trouble, trouble
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.codec import Opcode, command
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import ChannelConfig, MaestroSettings, SimulatedMaestro
from armctl.hardware.transport import Connection
from armctl.protocol import ClearFault, Connect, Enable, MoveJoints, Release, SetOutput
from armctl.robot import load_robot, robots_folder

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")
WIDE = {channel: ChannelConfig(minimum_us=500, maximum_us=2500) for channel in range(6)}
_TARGETS = (Opcode.SET_TARGET, Opcode.SET_MULTIPLE_TARGETS)
QUARTER = 0.25 / 516  # ¼ µs at the base's 9 µs a degree [rad]


Bench = BoardBench[SimulatedMaestro]


@pytest.fixture
def bench() -> Bench:
    return bench_of()


def bench_of(*troubles: Trouble, channels: Mapping[int, ChannelConfig] = WIDE) -> Bench:
    board = SimulatedMaestro(MaestroModel.MICRO_6, MaestroSettings(channels=channels))
    bench = BoardBench.of(
        ROBOT,
        board,
        lambda line, _now: MaestroDriver(
            Connection(line, lambda: 0.0, simulated=True), model=MaestroModel.MICRO_6
        ),
        troubles=troubles,
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


def test_a_board_that_starts_anew_between_a_reading_and_a_setpoint_is_a_fault(bench: Bench) -> None:
    bench.controller.submit(MoveJoints(HOME, duration_s=10), TEST)
    bench.run(0.5)
    bench.board.reset()  # the next setpoint switches the joints on again; the board knows no speed limit now
    bench.run(0.2)
    assert bench.now.state is State.FAULT
    assert "the board switched the pulses off by itself (Gripper)" in bench.now.cause


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


def test_a_lost_reply_is_asked_for_again_and_two_halt_the_arm_which_goes_on_from_rest(bench: Bench) -> None:
    bench.do(MoveJoints(HOME, duration_s=3))
    bench.run(1.0)
    bench.line.inject(Fault.DROP_REPLY)
    bench.run(3 * TICK)
    assert bench.now.velocity_command.any()
    bench.line.inject(Fault.DROP_REPLY, count=2)
    bench.run(2 * TICK)
    assert not bench.now.velocity_command.any()
    bench.run(TICK)
    slow = np.abs(bench.now.velocity_command)
    assert (slow <= ROBOT.acceleration_limits * 2 * TICK * (1 + 1e-6)).all()
    bench.until(State.HOLDING)
    assert bench.now.cause == "move finished"


@pytest.mark.parametrize("share", [0.02, 0.3])
def test_answers_that_get_lost_are_told_with_their_rate_and_many_bring_the_arm_to_rest(share: float) -> None:
    bench = bench_of(trouble(f"drop-reply:{share}@3"))
    bench.run(3.0)
    motion = bench.do(MoveJoints(HOME, duration_s=8))
    began = bench.clock.now()
    bench.until(State.HOLDING)
    (words,) = (one for one in bench.now.warnings if "does not answer" in one)
    assert re.fullmatch(
        r"the board does not answer (\d+) % of the questions in time: check cable, USB hub, baud rate", words
    )
    if share < 0.1:
        assert bench.now.cause == "move finished"
        assert bench.clock.now() - began < 10.0, "it crawls"
    else:
        with pytest.raises(StateError, match=r"stopped by armctl: the board does not answer 1\d % of"):
            motion.result(0)


def test_a_program_that_moves_a_servo_behind_our_back_is_a_fault(bench: Bench) -> None:
    bench.run(0.5)
    position = bench.board.position_us(0)
    assert position is not None
    bench.board.feed(command(Opcode.SET_TARGET, 0, round(4 * (position + 520))))
    before = len(bench.board.log)
    bench.run(1.0)
    assert bench.now.state is State.FAULT
    assert re.match(r"something else moved the arm \(Base by \d+ µs so far\): another", bench.now.cause)
    assert not [one for one in bench.board.log[before:] if one.opcode is Opcode.SET_TARGET]
    bench.do(ClearFault())
    bench.do(Enable())
    assert bench.board.position_us(0) == pytest.approx(position + 520, abs=1)


def test_a_narrower_channel_range_is_a_warning_and_no_other_program() -> None:
    narrow = {**WIDE, 0: ChannelConfig(minimum_us=1450, maximum_us=1510)}
    bench = bench_of(channels=narrow)
    bench.do(MoveJoints(HOME + np.radians([20, 0, 0, 0, 0])))
    bench.until(State.HOLDING)
    bench.run(2.0)
    assert bench.now.state is State.HOLDING
    assert any("its channel range is narrower" in words for words in bench.now.warnings)


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


def test_one_joint_is_released_and_comes_on_where_somebody_says_it_stands() -> None:
    bench = bench_of()
    before = bench.now.q_command
    bench.do(Release(("elbow",)))
    bench.run(0.5)
    assert bench.now.limp == ("Elbow",) and bench.now.state is State.HOLDING
    assert np.isnan(bench.now.q).tolist() == [False, False, True, False, False]
    bench.do(Enable(before + np.radians([0, 0, 5, 0, 0])))
    assert bench.now.state is State.MOVING
    bench.until(State.HOLDING)
    assert bench.now.limp == () and bench.now.warnings == ()
    assert np.degrees(bench.now.q - before) == pytest.approx([0, 0, 5, 0, 0], abs=0.05)


def test_a_fault_while_a_joint_is_limp_ends_that_too() -> None:
    bench = bench_of()
    bench.do(Release(("elbow",)))
    bench.do(Release())
    assert bench.run(0.1).state is State.OFF and bench.now.limp == ()
    bench.do(Enable())
    bench.until(State.HOLDING)


def test_a_joint_with_two_servos_moves_both(tmp_path: Path) -> None:
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    shoulder = "channel = 1, zero_us = 781.795, us_per_deg = 10, pulse_us = [749, 2251]"
    other = "channel = 11, zero_us = 2218.205, us_per_deg = -10, pulse_us = [749, 2251]"
    assert shoulder in text
    path = tmp_path / "strong.toml"
    path.write_text(text.replace(shoulder, f"{shoulder}, also = [{{ {other} }}]"), encoding="utf-8")
    arm = load_robot(path)
    board = SimulatedMaestro(
        MaestroModel.MINI_12, MaestroSettings(channels=dict.fromkeys(range(12), WIDE[0]))
    )
    bench = BoardBench.of(
        arm,
        board,
        lambda line, _now: MaestroDriver(
            Connection(line, lambda: 0.0, simulated=True), model=MaestroModel.MINI_12
        ),
    )
    bench.do(Connect("sim"))
    bench.do(Enable())
    bench.until(State.HOLDING)
    bench.do(MoveJoints(arm.pose("home")))
    bench.until(State.HOLDING)
    bench.run(0.2)  # the servos' ramp follows
    first, second = (board.position_us(channel) or 0.0 for channel in (1, 11))
    assert first + second == pytest.approx(3000, abs=0.5)
    assert first == pytest.approx(arm.outputs.outputs(arm.pose("home"))[1], abs=0.25)


def test_an_output_whose_one_write_at_stop_is_lost_is_switched_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = signal_kit.SIGNALS.replace('at_stop = "on"', 'at_stop = "off"')
    bench = signal_kit.bench_of(signal_kit.robot_with(tmp_path, text))
    bench.do(SetOutput("lamp", 1.0))
    bench.run(0.2)
    assert signal_kit.high(bench, signal_kit.LAMP) == [True]
    feed = bench.line.feed
    monkeypatch.setattr(bench.line, "feed", lambda data: b"" if data[0] in _TARGETS else feed(data))
    bench.controller.stop(TEST)
    bench.run(TICK)
    monkeypatch.undo()
    assert signal_kit.high(bench, signal_kit.LAMP) == [True]
    bench.run(0.1)
    assert signal_kit.high(bench, signal_kit.LAMP) == [False] and bench.now.outputs["lamp"] == 0.0
