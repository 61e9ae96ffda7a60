"""Inputs and outputs of a board: seen within a tick, debounced, counted; switched, and left as is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.runtime.board_bench import BoardBench
from tests.runtime.kit import TEST, TICK, make_rig
from tests.runtime.signal_kit import (
    BELL,
    BUTTON,
    DOOR,
    KNOB,
    LAMP,
    PUMP,
    SIGNALS,
    VACUUM,
    bench_of,
    high,
    robot_with,
)

from armctl.errors import BoardError, InputError, ProgramError, StateError
from armctl.facts import State
from armctl.hardware.maestro.simulated import SimulatedMaestro
from armctl.program import GripperStep, MoveStep, Program, SetStep, Step, WaitForStep, WaitStep
from armctl.protocol import (
    Cancel,
    ClearFault,
    Command,
    Connect,
    Disconnect,
    MoveGripper,
    MoveJoints,
    PlayInputs,
    Release,
    RunProgram,
    SetOutput,
    SimulateInput,
)

Bench = BoardBench[SimulatedMaestro]


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return bench_of(robot_with(tmp_path))


def refused(bench: Bench, command: Command, error: type[Exception], match: str) -> None:
    ticket = bench.controller.submit(command, TEST)
    bench.run(TICK)
    with pytest.raises(error, match=match):
        ticket.finished.result(0)


def runs(bench: Bench, *steps: Step):
    return bench.do(RunProgram(Program(robot="uzuner", name="p", steps=steps)))


def texts(bench: Bench) -> list[str]:
    return [event.text for event in bench.now.events]


def test_inputs_are_seen_at_the_next_tick_and_as_people_mean_them(bench: Bench) -> None:
    assert bench.now.inputs == {"button": 0.0, "door": 0.0, "knob": 0.0}
    bench.board.levels |= {BUTTON: 0.0, KNOB: 0.25}
    seen = bench.run(TICK).inputs
    assert seen["button"] == 1.0 and seen["knob"] == pytest.approx(256 / 1023)


def test_a_change_counts_once_it_has_lasted(bench: Bench) -> None:
    for level in (1.0, 0.0, 1.0, 0.0):  # it bounces
        bench.board.levels[DOOR] = level
        assert bench.run(TICK).inputs["door"] == 0.0
    bench.board.levels[DOOR] = 1.0
    assert bench.run(2 * TICK).inputs["door"] == 0.0
    assert bench.run(TICK).inputs["door"] == 1.0 and bench.now.edges == {"button": 0, "door": 1}
    bench.board.levels[DOOR] = 0.0
    assert bench.run(5 * TICK).edges["door"] == 2


def test_inputs_are_looked_at_while_the_arm_is_off(tmp_path: Path) -> None:
    bench = bench_of(robot_with(tmp_path), enabled=False)
    assert bench.now.state is State.OFF and not bench.controller._core.resting
    bench.board.levels[BUTTON] = 0.0
    assert bench.run(TICK).inputs["button"] == 1.0
    bench.do(SetOutput("lamp", 1.0))
    assert bench.run(TICK).outputs == {"lamp": 1.0, "pump": 1.0, "bell": 0.0}  # the pump is on where low
    assert high(bench, LAMP, PUMP) == [True, False]


def test_outputs_are_switched_in_every_state_but_a_fault(bench: Bench) -> None:
    bench.do(SetOutput("pump", 0.0))
    assert high(bench, PUMP) == [True]
    bench.controller.submit(MoveJoints(bench.now.q_command + np.radians(20)), TEST)
    assert bench.run(0.1).state is State.MOVING
    bench.do(SetOutput("bell", 1.0))
    assert bench.run(TICK).state is State.MOVING and high(bench, BELL) == [True]
    refused(bench, SetOutput("bell", 0.5), InputError, "output bell is digital: 0 or 1, not 0.5")
    refused(bench, SetOutput("siren", 1.0), InputError, "there is no output 'siren'; there are lamp")
    bench.until(State.HOLDING)
    bench.board.reset()
    assert bench.run(0.2).state is State.FAULT
    refused(bench, SetOutput("bell", 1.0), StateError, "bell needs the arm connected and without a fault")
    bench.do(ClearFault())
    bench.do(SetOutput("bell", 1.0))
    bench.do(Disconnect())
    refused(bench, SetOutput("bell", 1.0), StateError, "it is disconnected; connect first")
    assert bench.now.inputs == {} and bench.now.outputs == {}


def test_stop_leaves_outputs_as_the_file_says(bench: Bench) -> None:
    bench.do(SetOutput("bell", 1.0))
    bench.controller.submit(MoveJoints(bench.now.q_command + np.radians(30)), TEST)
    bench.run(0.1)
    stopped = bench.controller.stop(TEST)
    bench.run(TICK)
    assert high(bench, LAMP, PUMP, BELL) == [True, False, True]
    bench.run(1.0)
    stopped.finished.result(0)
    assert "output Lamp on at STOP" in texts(bench)


def test_release_leaves_outputs_as_the_file_says(bench: Bench) -> None:
    for name in ("lamp", "bell"):
        bench.do(SetOutput(name, 1.0))
    bench.do(Release())
    assert bench.now.state is State.OFF
    assert high(bench, LAMP, PUMP, BELL) == [False, False, True]


def test_a_fault_leaves_outputs_as_the_file_says(bench: Bench) -> None:
    bench.do(SetOutput("lamp", 1.0))
    for joint in range(3):
        bench.board.channel(joint).set_target(0)
    assert bench.run(0.2).state is State.FAULT
    assert high(bench, LAMP, PUMP) == [True, True]  # the pump is off where high


def test_a_board_that_is_gone_keeps_its_outputs_and_the_log_says_so(bench: Bench) -> None:
    bench.line.troubles = ()
    bench.controller._core.board.set_output = _gone  # type: ignore[union-attr,method-assign]
    for joint in range(3):
        bench.board.channel(joint).set_target(0)
    assert bench.run(0.2).state is State.FAULT and high(bench, PUMP) == [False]
    assert "outputs could not be switched at the fault: gone" in texts(bench)


def _gone(name: str, value: float) -> None:
    raise StateError("gone")


def test_the_end_of_a_program_and_of_the_line(bench: Bench) -> None:
    ticket = runs(bench, SetStep(output="lamp"), SetStep(output="bell"), WaitStep(seconds=0.1))
    bench.run(2 * TICK)
    assert high(bench, LAMP, BELL) == [True, True]
    bench.until(State.HOLDING)
    ticket.result(0)
    assert high(bench, LAMP, BELL) == [False, True]
    bench.controller.close()
    assert high(bench, BELL) == [True]


def test_a_program_that_is_stopped_ends_as_at_stop(bench: Bench) -> None:
    runs(bench, WaitForStep(watch="button", timeout_s=60))
    bench.controller.stop(TEST)
    bench.run(4 * TICK)
    assert bench.now.state is State.HOLDING and high(bench, LAMP) == [True]


def test_a_program_that_is_cancelled_ends_as_at_stop(bench: Bench) -> None:
    steps = (WaitStep(seconds=60.0),)
    bench.do(RunProgram(Program(robot="uzuner", name="p", steps=steps), motion="mine"))
    bench.do(Cancel("mine"))
    assert bench.run(4 * TICK).state is State.HOLDING and high(bench, LAMP) == [True]


def test_an_output_that_fails_keeps_no_other_from_its_own(tmp_path: Path) -> None:
    bench = bench_of(robot_with(tmp_path, SIGNALS.replace('name = "bell"', 'name = "bell"\nat_stop = "on"')))
    board = bench.controller._core.board
    assert board is not None
    switch = board.set_output

    def all_but_the_lamp(name: str, value: float) -> None:
        if name == "lamp":
            raise BoardError("the lamp does not answer")
        switch(name, value)

    board.set_output = all_but_the_lamp  # type: ignore[method-assign]
    bench.controller.stop(TEST)
    assert bench.run(4 * TICK).state is State.FAULT and "the lamp does not answer" in bench.now.cause
    assert high(bench, BELL) == [True]


def test_a_wait_is_over_within_a_tick(bench: Bench) -> None:
    runs(bench, WaitForStep(watch="button", timeout_s=60), SetStep(output="bell"), WaitStep(seconds=1))
    bench.run(1.0)
    assert bench.now.warnings == ("waiting for button = 1",) and bench.now.awaited == (0,)
    assert "warning" not in {line.level for line in bench.now.events[-3:]}, "it is as it should be"
    bench.board.levels[BUTTON] = 0.0
    bench.run(TICK)
    assert high(bench, BELL) == [False]
    bench.run(TICK)
    assert high(bench, BELL) == [True]


def test_a_wait_that_takes_too_long_ends_the_program_or_goes_on(bench: Bench) -> None:
    ticket = runs(bench, WaitForStep(watch="door", timeout_s=0.5), SetStep(output="bell"))
    bench.until(State.HOLDING)
    with pytest.raises(ProgramError, match=r"p: step 1: waited 0.5 s for door = 1, which did not come"):
        ticket.finished.result(0)
    assert high(bench, BELL) == [False]
    ticket = runs(bench, WaitForStep(watch="door", timeout_s=0.5, otherwise="go on"), SetStep(output="bell"))
    bench.until(State.HOLDING)
    ticket.result(0)
    assert high(bench, BELL) == [True]
    assert any("waited 0.5 s for door = 1, which did not come; it goes on" in text for text in texts(bench))


def test_an_edge_that_comes_while_the_arm_moves_counts(bench: Bench) -> None:
    there = tuple(np.degrees(bench.now.q_command + np.radians(20)).tolist())
    wait = WaitForStep(watch="button", timeout_s=1, trigger="edge")
    ticket = runs(bench, MoveStep(joints_deg=there), wait, wait)
    bench.run(0.2)
    bench.board.levels[BUTTON] = 0.0
    bench.run(2 * TICK)
    bench.board.levels[BUTTON] = 1.0
    while bench.run(TICK).state is State.MOVING and bench.now.program.step < 2:  # type: ignore[union-attr]
        pass
    assert bench.now.program.step == 2  # type: ignore[union-attr]  # the first wait was over at once
    bench.until(State.HOLDING)
    with pytest.raises(ProgramError, match="step 3: waited 1 s for button = edge to 1"):  # the second was not
        ticket.finished.result(0)


def test_an_analog_input_is_waited_for(bench: Bench) -> None:
    ticket = runs(bench, WaitForStep(watch="knob", compare="above", value=0.5, timeout_s=5))
    bench.board.levels[KNOB] = 0.49
    assert bench.run(0.2).state is State.MOVING
    bench.board.levels[KNOB] = 0.51
    bench.run(3 * TICK)
    ticket.result(0)


def test_a_motion_before_a_set_stops_where_it_ends(bench: Bench) -> None:
    start = bench.now.q_command.copy()
    first, second = (tuple(np.degrees(start + np.radians(angle)).tolist()) for angle in (10, 20))
    runs(
        bench,
        MoveStep(joints_deg=first, blend_mm=50),
        SetStep(output="bell"),
        MoveStep(joints_deg=second),
    )
    while not high(bench, BELL)[0]:
        assert bench.run(TICK).state is State.MOVING
    assert np.abs(bench.now.q_command - start - np.radians(10)).max() < 1e-6


def test_a_gripper_that_is_an_output(tmp_path: Path) -> None:
    robot = robot_with(tmp_path, gripper=VACUUM)
    bench = bench_of(robot)
    assert bench.now.gripper == 0.0 and high(bench, PUMP) == [False]  # it was on: nothing is switched
    bench.do(MoveGripper(1.0))
    bench.run(1.0)
    assert bench.now.gripper == 1.0 and high(bench, PUMP) == [True]
    bench.do(MoveGripper(0.0))
    bench.run(TICK)
    assert high(bench, PUMP) == [False]  # at once, and then it has its time
    refused(bench, SetOutput("pump", 0.0), StateError, "output pump is the gripper's")
    bench.run(1.0)
    bench.do(Release())
    bench.do(SetOutput("pump", 0.0))
    assert high(bench, PUMP) == [True]


def test_a_part_that_is_not_gripped_ends_the_program(tmp_path: Path) -> None:
    bench = bench_of(robot_with(tmp_path, gripper=VACUUM))
    bench.do(MoveGripper(1.0))
    bench.run(1.0)
    grip = GripperStep(open_percent=0, part_x_mm=20, part_y_mm=20, part_z_mm=20)
    ticket = runs(bench, grip, WaitStep(seconds=0.1))
    bench.run(0.5)
    bench.board.levels[DOOR] = 1.0
    bench.until(State.HOLDING, seconds=1.0)
    ticket.result(0)
    assert bench.now.part_mm == (20, 20, 20)
    bench.board.levels[DOOR] = 0.0
    bench.run(0.2)
    ticket = runs(bench, GripperStep(open_percent=100), grip)
    bench.until(State.HOLDING)
    with pytest.raises(ProgramError, match=r"waited 2.5 s for the gripper to hold a part \(door = 1\)"):
        ticket.finished.result(0)


def test_a_gripper_that_stop_opens_has_lost_its_part(tmp_path: Path) -> None:
    more = SIGNALS.replace('at_fault = "off"', 'at_stop = "off"')
    bench = bench_of(robot_with(tmp_path, more, VACUUM))
    bench.do(MoveGripper(0.0, (20.0, 20.0, 20.0)))
    bench.run(0.5)
    assert bench.now.part_mm is not None
    bench.controller.stop(TEST)
    bench.run(4 * TICK)
    assert bench.now.gripper == 1.0 and bench.now.part_mm is None
    bench.do(MoveGripper(0.0))
    bench.run(0.8)
    assert bench.now.gripper == 0.0 and high(bench, PUMP) == [False]


def test_inputs_of_a_simulated_board_are_set_by_hand(bench: Bench) -> None:
    bench.do(SimulateInput("button", 1.0))
    assert bench.board.levels[BUTTON] == 0.0 and bench.run(TICK).inputs["button"] == 1.0
    refused(bench, SimulateInput("horn", 1.0), InputError, "there is no input 'horn'; .* button, door, knob")
    refused(bench, SimulateInput("button", 2.0), InputError, "input button: 2 .* outside 0")
    plain = make_rig().enable()
    plain.refuses(SimulateInput("button", 1.0), "only those of a connected simulated board")


def test_inputs_of_a_simulated_board_follow_a_script_on_the_boards_clock(bench: Bench) -> None:
    bench.do(PlayInputs("at 1 s button on; every 2 s door on for 300 ms"))
    began, seen = bench.clock.now(), dict[float, tuple[float, float]]()
    assert bench.now.scripted == ("button", "door")
    while (since := bench.clock.now() - began) < 5.0:
        now = bench.run(TICK)
        seen[round(since + TICK, 2)] = now.inputs["button"], now.inputs["door"]
    button = [time for time, (on, _) in seen.items() if on]
    door = [time for time, (_, on) in seen.items() if on]
    assert min(button) == pytest.approx(1.0, abs=2 * TICK) and len(button) > 190
    assert [t for t in door if t < 3] == pytest.approx([2.06 + 0.02 * k for k in range(15)], abs=2 * TICK)
    assert bench.now.edges["door"] == 4 and bench.now.edges["button"] == 1
    bench.do(SimulateInput("door", 1.0))
    assert bench.run(0.5).inputs["door"] == 1.0  # pressed by hand, until the script says otherwise
    assert bench.run(0.9).inputs["door"] == 0.0
    bench.do(PlayInputs(" "))
    assert bench.now.scripted == () and bench.run(4.0).inputs["door"] == 0.0


def test_a_program_waits_for_what_a_script_does(bench: Bench) -> None:
    bench.do(PlayInputs("time_s,button,knob\n1,on,\n1.5,off,0.25\n"))
    began = bench.clock.now()
    wait = WaitForStep(watch="knob", compare="above", value=0.2, timeout_s=5)
    ticket = runs(bench, WaitForStep(watch="button", timeout_s=5), wait)
    bench.until(State.HOLDING)
    ticket.finished.result(0)
    assert bench.clock.now() - began == pytest.approx(1.5, abs=4 * TICK)


@pytest.mark.parametrize("text", ["at 1 s horn on", "nonsense"])
def test_a_script_that_cannot_be_is_refused_and_the_last_one_goes_on(bench: Bench, text: str) -> None:
    bench.do(PlayInputs("at 1 s door on"))
    refused(bench, PlayInputs(text), InputError, "line 1: ")
    assert bench.now.scripted == ("door",) and bench.run(1.2).inputs["door"] == 1.0
    make_rig().enable().refuses(PlayInputs(text), "only those of a connected simulated board")


def test_a_board_without_pins_is_not_connected_to_an_arm_that_needs_them(tmp_path: Path) -> None:
    rig = make_rig(robot=robot_with(tmp_path))
    rig.refuses(Connect("sim"), "this board has no inputs or outputs beside those of the joints")
