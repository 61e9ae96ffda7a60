"""The check walks every path: branches, passes, waits that cannot end. Seeded faults are all found."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.program.kit import program
from tests.runtime.signal_kit import robot_with

from armctl.facts import NeverComes, NeverEnds, OnPath, PathsLeftOut, PathTurn, Unbounded
from armctl.motion import Finding
from armctl.program import (
    CountStep,
    ElseStep,
    EndStep,
    IfStep,
    MoveStep,
    PointStep,
    RepeatStep,
    Step,
    WaitForStep,
    WaitStep,
    WhileStep,
    check_program,
)
from armctl.robot import Robot

END, ELSE, PRESSED = EndStep(), ElseStep(), IfStep(watch="button")
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
SUNK = PointStep(x_mm=200, y_mm=0, z_mm=-40)
FAR = PointStep(x_mm=900, y_mm=0, z_mm=0)
TURNED = MoveStep(joints_deg=(100, 90, -80, -40, 0))
NEAR = MoveStep(joints_deg=(10, 90, -80, -40, 0), duration_s=1.0)
"""in time from home, but not from TURNED"""
ADD = CountStep(counter="n", add=1)


def counted(compare: str, value: float, kind: type[IfStep] | type[WhileStep] = IfStep) -> IfStep | WhileStep:
    return kind(watch="counter", counter="n", compare=compare, value=value)  # type: ignore[arg-type]


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return robot_with(tmp_path)


def found(robot: Robot, *steps: Step) -> list[Finding]:
    return check_program(program(*steps), robot, start=robot.pose("home"))


def errors(robot: Robot, *steps: Step) -> list[Finding]:
    return [one for one in found(robot, *steps) if one.severity == "error"]


@pytest.mark.parametrize("bad", [SUNK, FAR])
def test_a_fault_on_one_branch_is_found_with_its_path(robot: Robot, bad: Step) -> None:
    (one, *_) = errors(robot, HOME, PRESSED, HOME, ELSE, bad, HOME, END)
    assert one.step == 4 and isinstance(one.reason, OnPath) and one.reason.turns == (PathTurn(1, "else"),)
    assert "(path: step 2: no)" in str(one)
    (one, *_) = errors(robot, HOME, PRESSED, bad, HOME, ELSE, HOME, END)
    assert one.step == 2 and isinstance(one.reason, OnPath) and one.reason.turns == (PathTurn(1, "then"),)


def test_what_a_branch_leaves_behind_is_followed(robot: Robot) -> None:
    """A motion behind the block that is too fast from where one of its branches ends."""
    assert errors(robot, HOME, PRESSED, HOME, END, NEAR) == []
    (one,) = errors(robot, HOME, PRESSED, TURNED, END, NEAR)
    assert one.step == 4 and isinstance(one.reason, OnPath) and one.reason.turns == (PathTurn(1, "then"),)
    (one,) = errors(robot, HOME, PRESSED, TURNED, END, WaitStep(seconds=1), PRESSED, HOME, ELSE, NEAR, END)
    assert isinstance(one.reason, OnPath)
    assert one.reason.turns == (PathTurn(1, "then"), PathTurn(5, "else"))


def test_a_limit_in_the_nth_pass_is_found(robot: Robot) -> None:
    steps = (HOME, RepeatStep(times=1_000_000), ADD, counted("equals", 7), SUNK, END, HOME, END)
    (one, *_) = errors(robot, *steps)
    assert one.step == 4 and isinstance(one.reason, OnPath)
    assert one.reason.turns == (PathTurn(1, "pass", 7), PathTurn(3, "then"))
    assert errors(robot, HOME, RepeatStep(times=6), *steps[2:]) == []
    assert errors(robot, HOME, RepeatStep(times=7), *steps[2:]) != []
    loop = counted("below", 7, WhileStep)
    assert errors(robot, HOME, loop, *steps[2:]) != []
    assert errors(robot, HOME, counted("below", 6, WhileStep), *steps[2:]) == []


def test_passes_that_take_turns_are_counted(robot: Robot) -> None:
    """A block that goes to and fro ends on the side that its number of passes says."""
    there = (counted("equals", 0), TURNED, CountStep(counter="n", to=1), ELSE, HOME)
    steps = (*there, CountStep(counter="n", to=0), END)
    assert errors(robot, HOME, RepeatStep(times=1_000_000), *steps, END, NEAR) == []
    (one,) = errors(robot, HOME, RepeatStep(times=999_999), *steps, END, NEAR)
    assert one.step == 10


def test_counters_decide_which_branch_there_is(robot: Robot) -> None:
    assert errors(robot, HOME, ADD, counted("equals", 1), HOME, ELSE, SUNK, END) == []
    assert errors(robot, HOME, ADD, counted("equals", 2), HOME, ELSE, SUNK, END) != []


def test_a_wait_for_what_nothing_can_bring_is_found(robot: Robot) -> None:
    wait = WaitForStep(watch="counter", counter="n", value=2, timeout_s=5)
    (one,) = errors(robot, ADD, wait, ADD, HOME)
    assert one.step == 1 and isinstance(one.reason, NeverComes)
    assert errors(robot, ADD, ADD, wait, HOME) == []
    (one,) = errors(robot, ADD, PRESSED, ADD, END, wait)
    assert one.step == 4 and isinstance(one.reason, OnPath) and one.reason.turns == (PathTurn(1, "else"),)
    (one,) = found(robot, WaitForStep(watch="counter", counter="n", timeout_s=5, otherwise="go on"), HOME)
    assert one.severity == "warning"


def test_a_loop_that_never_ends_is_found_and_one_without_bound_is_said(robot: Robot) -> None:
    (one,) = errors(robot, counted("below", 3, WhileStep), HOME, END)
    assert one.step == 0 and isinstance(one.reason, NeverEnds)
    assert errors(robot, counted("below", 3, WhileStep), ADD, HOME, END) == []
    (one,) = found(robot, WhileStep(watch="button"), HOME, END)
    assert (one.step, one.severity) == (0, "warning") and isinstance(one.reason, Unbounded)
    assert found(robot, WhileStep(watch="button", most=5), HOME, END) == []


def test_what_stands_behind_what_is_never_passed_is_not_walked(robot: Robot) -> None:
    again = (RepeatStep(times=2), HOME, END)
    (one,) = found(robot, counted("below", 3, WhileStep), HOME, END, *again)
    assert isinstance(one.reason, NeverEnds)
    never = WaitForStep(watch="counter", counter="n", value=1.0, timeout_s=5.0)
    (one,) = found(robot, never, *again)
    assert isinstance(one.reason, NeverComes)


def test_many_branches_cost_no_more_than_their_steps(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """2 ** 200 paths that meet again after each block."""
    assert errors(robot, HOME, *200 * (PRESSED, TURNED, ELSE, HOME, END, HOME)) == []
    monkeypatch.setattr("armctl.program.paths.MOST_VISITS", 1000)
    down = (counted("equals", -1e6), HOME, END, ADD, CountStep(counter="n", add=-2), HOME)
    left = [
        one
        for one in found(robot, WhileStep(watch="button"), *down, END)
        if isinstance(one.reason, PathsLeftOut)
    ]
    assert [one.severity for one in left] == ["warning"]


class _EnoughError(Exception):
    pass


def test_it_tells_its_progress_and_can_be_ended(robot: Robot) -> None:
    told: list[tuple[int, int]] = []

    def progress(done: int, steps: int) -> None:
        told.append((done, steps))
        if len(told) == 5:
            raise _EnoughError

    with pytest.raises(_EnoughError):
        check_program(
            program(HOME, RepeatStep(times=9), PRESSED, TURNED, ELSE, HOME, END, END), robot,
            start=robot.pose("home"), progress=progress,
        )  # fmt: skip
    assert told == [(1, 8), (4, 8), (6, 8), (6, 8), (6, 8)]
