from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.program.kit import program

from armctl.errors import ProgramError
from armctl.motion import stopping_s
from armctl.program import (
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    Step,
)
from armctl.program.feed import PlannedStep, ProgramSource, begin_program, plan_next
from armctl.program.frames import Placing, UserFrame
from armctl.program.program import Blocks
from armctl.robot import CarriedPart, Robot, load_robot

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home") + np.radians([0, 0, 20, 0, 0])  # away from every limit


def to(*away: float, blend_mm: float = 0.0) -> MoveStep:
    """A move to some radians away from where the arm stands."""
    goal = HOME + np.resize(np.array(away), ROBOT.n)
    return MoveStep(joints_deg=tuple(np.degrees(goal).tolist()), blend_mm=blend_mm)


def all_steps(robot: Robot, what: Program, loops: int = 1, first: int = 0) -> list[PlannedStep]:
    source, state = ProgramSource(what), begin_program(robot, what, HOME, loops=loops, first=first)
    found: list[PlannedStep] = []
    while True:
        steps, state = plan_next(robot, source, state)
        found += steps
        if not steps or steps[-1].error is not None:
            return found


def test_the_motions_after_a_gripper_step_carry_its_part() -> None:
    """Where the part would be in the floor the program ends; without the part it goes on."""
    down = {"x_mm": 200, "y_mm": 0, "pitch_deg": -90}
    high, low = PointStep(z_mm=100, **down), PointStep(z_mm=12, **down)
    part = {"part_x_mm": 30, "part_y_mm": 30, "part_z_mm": 30}
    whole = [high, GripperStep(open_percent=30, **part), high, GripperStep(open_percent=80), low]
    assert not any(step.error for step in all_steps(ROBOT, program(*whole)))
    *steps, last = all_steps(ROBOT, program(high, GripperStep(open_percent=30, **part), low))
    assert [step.after.part for step in steps] == [None, CarriedPart((30.0, 30.0, 30.0))]
    assert "the carried part: at 0.66 s, 3.0 mm below the floor" in str(last.error)
    # from the step at which it begins, it carries what the arm does
    arm = ROBOT.gripping(0.3).carrying(CarriedPart((30.0, 30.0, 30.0)))
    (high_done,) = all_steps(ROBOT, program(high))
    state = begin_program(arm, program(low), high_done.after.q, opening=0.3)
    (refused,), _ = plan_next(ROBOT, ProgramSource(program(low)), state)
    assert "the carried part" in str(refused.error)


def test_a_pass_that_begins_behind_everything_goes_on_with_the_next() -> None:
    what = program(to(0.1), to(-0.1), CommentStep(note="done"))
    steps = all_steps(ROBOT, what, loops=2, first=2)
    assert [(step.passes, step.index) for step in steps] == [(1, 0), (1, 1)]
    assert all_steps(ROBOT, what, loops=1, first=2) == []


def test_a_program_with_nothing_to_do_ends_however_often_it_runs() -> None:
    assert all_steps(ROBOT, program(CommentStep(note="later")), loops=1000) == []


def test_a_pass_is_drawn_from_one_version_however_fast_it_is_edited() -> None:
    long, short = program(to(0.1), to(-0.1), to(0.2)), program(to(0.3))

    class Edited(ProgramSource):
        """Another version whenever it is looked at."""

        def __init__(self) -> None:
            self.versions = [long, short] * 50

        @property
        def program(self) -> Program:
            return self.versions.pop(0)

        @program.setter
        def program(self, _: Program) -> None:
            raise AssertionError

    source, state = Edited(), begin_program(ROBOT, long, HOME, loops=3)
    while True:
        steps, state = plan_next(ROBOT, source, state)
        if not steps:
            break
        for step in steps:
            assert step.step == step.program.steps[step.index]


@pytest.mark.parametrize(("acceleration", "seconds"), [(10.0, 0.25), (0.5, 5.0)])
def test_how_long_the_slowest_joint_needs_to_stand(acceleration: float, seconds: float) -> None:
    joints = tuple(
        replace(joint, speed=speed, acceleration=acceleration)
        for joint, speed in zip(ROBOT.joints, (1.0, 2.0, 2.5, 0.5, 1.0), strict=True)
    )
    assert stopping_s(replace(ROBOT, joints=joints)) == pytest.approx(seconds)


def test_a_program_made_in_python_is_checked_like_a_file() -> None:
    with pytest.raises(ProgramError, match=r"pick: step 2: key blend_mm: must be 0 … 1000, not -1\.0"):
        begin_program(ROBOT, program(to(0.05), to(0.1, blend_mm=-1.0)), HOME)


@pytest.mark.parametrize("blend_mm", [0.0, 10.0])
def test_a_singularity_on_a_line_is_refused_whether_the_line_is_blended_or_not(blend_mm: float) -> None:
    robot = load_robot("scorbot")
    start = np.radians([117.42, -74.11, -38.69, -8.52, 24.53])
    past_the_axis = LineStep(x_mm=42.89, y_mm=-72.31, z_mm=813.36, blend_mm=blend_mm)
    home = MoveStep(joints_deg=tuple(np.degrees(robot.pose("home")).tolist()))
    what = Program(robot="scorbot", name="past the axis", steps=(past_the_axis, home))
    (step,), _ = plan_next(robot, ProgramSource(what), begin_program(robot, what, start))
    assert step.index == 0 and "near a singularity" in str(step.error)


@pytest.mark.parametrize("step", [to(0.2), LineStep(x_mm=200, y_mm=30, z_mm=100, pitch="free")])
def test_a_step_alone_is_solved_once(step: Step, monkeypatch: pytest.MonkeyPatch) -> None:
    start = PointStep(x_mm=200, y_mm=0, z_mm=100).plan(ROBOT, HOME).end
    solved: list[str] = []
    path = type(step).path

    def counted(*args: object) -> object:
        solved.append("path")
        return path(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(type(step), "path", counted)
    what = program(step)
    (planned,), _ = plan_next(ROBOT, ProgramSource(what), begin_program(ROBOT, what, start))
    assert planned.trajectory is not None and solved == ["path"]


def test_no_more_legs_are_solved_than_the_first_one_needs_behind_it() -> None:
    long = program(*(to(turn, 0, 0, 0, 0, blend_mm=5) for turn in (1.2, -1.2, 1.2, -1.2)))
    steps, after = plan_next(ROBOT, ProgramSource(long), begin_program(ROBOT, long, HOME))
    assert [(step.index, step.goes_on) for step in steps] == [(0, True)]
    assert [step.index for step in after.known] == [1]


def test_frames_and_blocks_are_found_once_for_all_passes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: list[str] = []
    placed, blocked = Placing.__init__, Blocks.of

    def placing(self: Placing, steps: Sequence[Step], frames: Mapping[str, UserFrame]) -> None:
        found.append("frames")
        placed(self, steps, frames)

    def blocks(steps: Sequence[Step]) -> Blocks:
        found.append("blocks")
        return blocked(steps)

    monkeypatch.setattr(Placing, "__init__", placing)
    monkeypatch.setattr(Blocks, "of", blocks)
    what = program(RepeatStep(times=2), to(0.1), to(-0.1), EndStep())
    source = ProgramSource(what)
    state = begin_program(ROBOT, what, HOME, loops=3, whole=source.whole())
    moves = 0
    while (planned := plan_next(ROBOT, source, state))[0]:
        steps, state = planned
        moves += sum(step.moves for step in steps)
    assert moves == 12
    assert sorted(found) == ["blocks", "frames"]
    source.edit(program(to(0.2), EndStep()))  # a version that nobody has checked
    with pytest.raises(ProgramError, match="step 2"):
        plan_next(ROBOT, source, begin_program(ROBOT, what, HOME))
