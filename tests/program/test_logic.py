"""Alternatives, loops with a condition, counters: which steps run, and in which order."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.program.kit import program
from tests.runtime.signal_kit import robot_with

from armctl.errors import ProgramError
from armctl.motion.analysis import TICK_S
from armctl.program import (
    Blocks,
    CountStep,
    Cursor,
    ElseStep,
    EndStep,
    IfStep,
    MoveStep,
    RepeatStep,
    Step,
    WaitStep,
    WhileStep,
    check_program,
    load_program,
    read_csv,
    save_program,
    write_csv,
    write_script,
)
from armctl.program.edit import delete, duplicate, surround
from armctl.program.rehearsal import rehearse
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
A, B, C = (WaitStep(seconds=k) for k in (1, 2, 3))
END, ELSE = EndStep(), ElseStep()
PRESSED = IfStep(watch="button")
HELD = WhileStep(watch="button")
FEW = WhileStep(watch="counter", counter="parts", compare="below", value=3)
ONE_MORE = CountStep(counter="parts", add=1)


def order(steps: Sequence[Step], *answers: bool, first: int = 0) -> list[int]:
    """The steps as they run; the answers in the order in which they are asked."""
    cursor, left = Cursor(program(*steps), first), list(answers)
    found: list[int] = []
    while (following := cursor.next()) is not None:
        found.append(following[0])
        if cursor.asked is not None:
            cursor.decide(left.pop(0))
    assert not left
    return found


def test_one_of_two_alternatives_runs() -> None:
    steps = (PRESSED, A, ELSE, B, END, C)
    assert order(steps, True) == [0, 1, 5]
    assert order(steps, False) == [0, 3, 5]
    assert order((PRESSED, A, END, C), False) == [0, 3]
    assert order((PRESSED, ELSE, B, END), True) == [0]
    # begun inside, its question counts as answered
    assert order(steps, first=1) == [1, 5]
    assert order(steps, first=3) == [3, 5]
    assert order(steps, first=2) == [5]


def test_a_loop_asks_ahead_of_each_pass() -> None:
    assert order((HELD, A, END, C), True, True, False) == [0, 1, 0, 1, 0, 3]
    bounded = WhileStep(watch="button", most=2)
    assert order((bounded, A, END, C), True, True) == [0, 1, 0, 1, 3]  # it is not asked a third time
    assert order((bounded, A, END, C), False) == [0, 3]


def test_blocks_nest() -> None:
    steps = (RepeatStep(times=2), HELD, PRESSED, A, ELSE, B, END, END, END, C)
    answers = (True, True, True, False, False, False)
    assert order(steps, *answers) == [1, 2, 3, 1, 2, 5, 1, 1, 9]
    assert Blocks.of(steps).depths == [0, 1, 2, 3, 2, 3, 2, 1, 0, 0]


def test_a_step_behind_a_question_needs_its_answer() -> None:
    cursor = Cursor(program(A, PRESSED, B, END))
    assert [cursor.next(), cursor.next()] == [(0, A), (1, PRESSED)]
    twin = cursor.copy()
    with pytest.raises(ProgramError, match="step 2: which step comes next is not decided"):
        cursor.next()
    twin.decide(True)
    assert twin.next() == (2, B)
    with pytest.raises(ProgramError, match="no step asks anything"):
        twin.decide(True)


@pytest.mark.parametrize(
    ("steps", "index", "message"),
    [
        ((A, ELSE, B), 1, "'else' without an 'if'"),
        ((RepeatStep(times=2), A, ELSE, B, END), 2, "'else' without an 'if'"),
        ((PRESSED, A, ELSE, ELSE, END), 3, "'else' without an 'if'"),
        ((PRESSED, RepeatStep(times=2), A, ELSE, END, END), 3, "'else' without an 'if'"),
        ((A, PRESSED, B), 1, "this 'if' has no 'end'"),
        ((HELD, B, PRESSED, END), 0, "this 'while' has no 'end'"),
        ((PRESSED, END, END), 2, "'end' without a 'repeat', 'if' or 'while'"),
    ],
)
def test_a_wrong_nesting_is_named_with_its_step(steps: tuple[Step, ...], index: int, message: str) -> None:
    ((at, why),) = Blocks.of(steps).findings
    assert at == index
    with pytest.raises(ProgramError, match=f"step {index + 1}: {message}"):
        Cursor(program(*steps))
    assert any(one.step == index and one.reason == why for one in check_program(program(*steps), ROBOT))


def test_they_go_through_files_and_tables(tmp_path: Path) -> None:
    steps = (ONE_MORE, FEW, PRESSED, A, ELSE, CountStep(counter="parts", to=0), END, END)
    what = program(*steps)
    save_program(what, tmp_path / "pick.toml")
    assert load_program(tmp_path / "pick.toml") == what
    assert read_csv(write_csv(what, ROBOT), ROBOT, "pick") == what
    assert [step.describe() for step in steps] == [
        "parts + 1", "counter parts < 3", "button = 1", "1 s", "", "parts = 0", "of the block", "of the block"
    ]  # fmt: skip


class _ScriptArm:
    """Runs a script's calls: says when it waits, and has a button."""

    def __init__(self, pressed: list[float]) -> None:
        self.waited: list[float] = []
        self._pressed = pressed

    @property
    def inputs(self) -> dict[str, float]:
        return {"button": self._pressed.pop(0)}

    def wait(self, seconds: float) -> None:
        self.waited.append(seconds)


def test_a_script_runs_the_same_steps() -> None:
    few = WhileStep(watch="button", most=2)
    steps = (FEW, ONE_MORE, PRESSED, A, ELSE, B, END, END, few, C, END, HELD, END, PRESSED, ELSE, A, END)
    text = write_script(program(*steps))
    body = text[text.index("    arm.enable()") :].replace("    arm.enable()", "if True:")
    arm = _ScriptArm([1, 0, 1, 1, 1, 1, 0, 0])
    exec(body, {"arm": arm})
    assert arm.waited == [1, 2, 1, 3, 3, 1]
    with pytest.raises(ProgramError, match=r"step 1: a Python script can ask for the level .* load of elbow"):
        write_script(program(IfStep(watch="load", joint="elbow", compare="above", value=3), A, END))


def test_what_a_condition_may_not_say() -> None:
    for step, message in (
        (IfStep(watch="counter"), "go together"),
        (IfStep(watch="button", counter="parts"), "go together"),
        (IfStep(watch="counter", counter="parts", trigger="edge"), "has no joint and no edge"),
        (CountStep(counter="parts"), "say what to add"),
        (CountStep(counter="parts", add=1, to=2), "say what to add"),
    ):
        block = (step, END) if isinstance(step, IfStep) else (step,)
        (finding,) = check_program(program(*block), ROBOT)
        assert finding.step == 0 and message in finding.what


def test_a_marker_takes_the_others_with_it() -> None:
    what = program(A, PRESSED, B, ELSE, C, END)
    assert delete(what, 1)[0].steps == delete(what, 5)[0].steps == (A, B)
    assert delete(what, 3)[0].steps == (A, PRESSED, B, END)
    assert duplicate(what, 3)[0].steps == (A, *2 * what.steps[1:])
    with pytest.raises(ProgramError, match="cut the block of steps 2 … 6"):
        surround(what, RepeatStep(times=2), "4-5", 3)


def test_a_rehearsal_counts_and_takes_inputs_as_told(tmp_path: Path) -> None:
    robot = robot_with(tmp_path)
    what = program(FEW, ONE_MORE, A, END, PRESSED, B, ELSE, C, END)
    # what asks or counts takes a tick
    assert rehearse(robot, what, robot.pose("home")).duration == pytest.approx(3 * 1 + 3 + 8 * TICK_S)
    told = rehearse(
        robot, what, robot.pose("home"),
        answer=lambda question, senses: question.uses == "button" or question.holds(senses),
    )  # fmt: skip
    assert told.duration == pytest.approx(3 * 1 + 2 + 8 * TICK_S)
    assert [step.index for step in told.steps] == [*(0, 1, 2) * 3, 0, 4, 5]


def test_a_question_ends_a_blend(tmp_path: Path) -> None:
    robot = robot_with(tmp_path)
    home = robot.pose("home")
    first, second = (
        MoveStep(joints_deg=tuple(np.degrees(home + np.radians(angle)).tolist()), blend_mm=50)
        for angle in (5, 10)
    )
    step = rehearse(robot, program(first, PRESSED, END, second), home).steps[0]
    end = step.trajectory.sample(step.duration)
    np.testing.assert_allclose(end.q, robot.read(first.joints_deg), atol=1e-9)
    np.testing.assert_allclose(end.velocity, 0, atol=1e-9)
