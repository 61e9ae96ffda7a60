"""Conditions of steps, and the steps that switch and wait: what they say, hold and refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.runtime.signal_kit import VACUUM, robot_with

from armctl.errors import ProgramError
from armctl.facts import Quantities
from armctl.program import (
    Condition,
    Program,
    Senses,
    SetStep,
    Step,
    WaitForStep,
    check_program,
    load_program,
    read_csv,
    save_program,
    write_csv,
    write_script,
)
from armctl.program.rehearsal import rehearse
from armctl.robot import Robot, load_robot

STEPS: tuple[Step, ...] = (
    SetStep(output="lamp"),
    WaitForStep(watch="button", timeout_s=5.0, trigger="edge"),
    WaitForStep(watch="load", joint="elbow", compare="above", value=40, timeout_s=2, otherwise="go on"),
    SetStep(output="lamp", value=0.0, note="done"),
)
PROGRAM = Program(robot="uzuner", name="press", steps=STEPS)


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return robot_with(tmp_path)


def test_they_go_through_files_tables_and_scripts(robot: Robot, tmp_path: Path) -> None:
    save_program(PROGRAM, tmp_path / "press.toml")
    assert load_program(tmp_path / "press.toml") == PROGRAM
    assert read_csv(write_csv(PROGRAM, robot), robot, "press") == PROGRAM
    script = write_script(PROGRAM)
    assert "set_output('lamp', 1.0)" in script
    assert "wait_for(watch='button', timeout_s=5.0, trigger='edge')" in script
    assert "joint='elbow', compare='above', otherwise='go on'" in script


def test_they_are_told_in_the_list() -> None:
    assert [step.describe() for step in STEPS] == [
        "lamp = 1",
        "button = edge to 1, at most 5 s, then stop",
        "load of elbow > 40 %, at most 2 s, then go on",
        "lamp = 0",
    ]


def senses(robot: Robot, load: float | None = None, edges: int = 0, **inputs: float) -> Senses:
    return Senses.of(robot, {"Elbow": Quantities(load=load, temperature_c=50)}, inputs, {"button": edges})


def test_when_they_hold(robot: Robot) -> None:
    pressed = Condition(watch="button")
    assert pressed.holds(senses(robot, button=1.0)) and not pressed.holds(senses(robot, button=0.0))
    assert not pressed.holds(senses(robot))  # not known
    heavy = Condition(watch="load", joint="elbow", compare="above", value=40)
    assert heavy.holds(senses(robot, load=-0.41)) and not heavy.holds(senses(robot, load=0.4))
    assert not heavy.holds(senses(robot))
    cool = Condition(watch="temperature", joint="elbow", compare="below", value=60)
    assert cool.holds(senses(robot)) and not Condition(watch="voltage", joint="elbow", compare="below").holds(
        senses(robot)
    )
    edge = Condition(watch="button", trigger="edge")
    for count, level, holds in ((0, 1.0, False), (1, 1.0, True), (1, 0.0, False), (2, 0.0, True)):
        assert edge.holds(senses(robot, edges=count, button=level)) is holds


@pytest.mark.parametrize(
    ("step", "said"),
    [
        (
            WaitForStep(watch="window", timeout_s=1),
            "no input 'window': watch must be one of 'button'",
        ),
        (WaitForStep(watch="load", timeout_s=1), "load of which joint"),
        (WaitForStep(watch="load", joint="elbow", timeout_s=1), "load wavers: compare it above or below"),
        (WaitForStep(watch="button", joint="elbow", timeout_s=1), "input button belongs to no joint"),
        (WaitForStep(watch="button", value=0.5, timeout_s=1), "input button is digital: it equals 0 or 1"),
        (WaitForStep(watch="button", compare="above", timeout_s=1), "input button is digital"),
        (WaitForStep(watch="knob", timeout_s=1), "input knob is analog: compare it above or below"),
        (WaitForStep(watch="knob", compare="above", value=3, timeout_s=1), "input knob is 0 ... 1, never 3"),
        (WaitForStep(watch="button", timeout_s=0.0), "key timeout_s: must be"),
        (SetStep(output="siren"), "uzuner has no output 'siren'; it has lamp, pump, bell"),
        (SetStep(output="bell", value=0.5), "output bell is digital: 0 or 1, not 0.5"),
        (SetStep(output="bell", value=2), "key value: must be 0 … 1, not 2"),
    ],
)
def test_what_cannot_be_is_found_by_the_check(robot: Robot, step: Step, said: str) -> None:
    (finding,) = check_program(Program(robot="uzuner", name="p", steps=(SetStep(output="lamp"), step)), robot)
    assert finding.step == 1 and said in finding.what


def test_an_arm_without_pins_and_the_grippers_own_output(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="uzuner has no output 'lamp'; it has none; the"):
        SetStep(output="lamp").check(load_robot("uzuner"))
    with pytest.raises(ProgramError, match="output pump is the gripper's: use a gripper step"):
        SetStep(output="pump").check(robot_with(tmp_path, gripper=VACUUM))


def test_in_a_rehearsal_they_take_a_tick_each(robot: Robot) -> None:
    done = rehearse(robot, PROGRAM, robot.pose("home"))
    assert [step.index for step in done.steps] == [0, 1, 2, 3] and done.duration == pytest.approx(0.06)
    assert np.array_equal(done.steps[-1].trajectory.end, robot.pose("home"))
