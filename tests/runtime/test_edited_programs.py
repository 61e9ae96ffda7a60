"""A looping program that is edited while it runs: the edit takes effect at the next pass."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import groupby, pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.program.kit import program
from tests.runtime.kit import (
    MIDDLE,
    ROBOT,
    LateExecutor,
    Rig,
    assert_accelerations_keep_limits,
    assert_keeps_limits,
    make_rig,
    swings,
)

from armctl.errors import StateError
from armctl.facts import State
from armctl.program import (
    LineStep,
    MotionStep,
    MoveStep,
    PointStep,
    Program,
    SpeedStep,
    Step,
    WaitStep,
)
from armctl.protocol import Release, RunProgram, UpdateProgram

LONG = bool(os.environ.get("ARMCTL_LONG"))


def square(blend_mm: float, z_mm: float = 100.0) -> list[Step]:
    corners = [(180, -60), (180, 60), (220, 60), (220, -60)]
    return [LineStep(x_mm=x, y_mm=y, z_mm=z_mm, pitch="free", blend_mm=blend_mm) for x, y in corners]


def moves(blend_mm: float, *away: Sequence[float]) -> list[Step]:
    return swings(blend_mm, *(np.resize(one, ROBOT.n) * [1, 1, 0, 0, 0] for one in away))


THREE = ((0.0, 0.0), (0.1, 0.05), (0.0, 0.1))
RING = [(0.1 * np.cos(a), 0.1 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 8, endpoint=False)]
SHAPES: dict[str, tuple[list[Step], list[Step]]] = {
    "lines": (
        square(10),
        [*square(10)[:3], LineStep(x_mm=200, y_mm=0, z_mm=120, pitch="free", blend_mm=10)],
    ),
    "there and back within tenths of a second": (
        moves(200, (0.05, 0.05), (-0.05, -0.05)),
        moves(200, (0.05, 0.05), (-0.05, -0.05), (0.1, 0.1)),
    ),
    "three short moves": (moves(30, *THREE), moves(30, *THREE, (0.2, 0.0))),
    "a ring of short moves, turned round": (moves(30, *RING), moves(30, *RING[6::-1])),
    "a speed step at the seam": (
        [SpeedStep(percent=50), *moves(20, *THREE)],
        [SpeedStep(percent=80), *moves(20, (0.1, -0.05), *THREE)],
    ),
    "a wait within": ([*moves(20, *THREE), WaitStep(seconds=0.1), *moves(20, *THREE[:2])], moves(20, *THREE)),
    "at rest at the seam": ([*moves(20, *THREE[:2]), *moves(0, THREE[2])], moves(20, (0.1, -0.05), *THREE)),
}


def stands_at_the_end_of(steps: Sequence[Step]) -> Rig:
    rig = make_rig().enable()
    first = square(0)[-1] if isinstance(steps[-1], LineStep) else steps[-1]
    if isinstance(first, LineStep):
        first = PointStep(x_mm=first.x_mm, y_mm=first.y_mm, z_mm=first.z_mm)
    rig.finishes(RunProgram(program(first)))
    rig.history.clear()
    return rig


Seen = tuple[int, int, Program]


def motions_seen(rig: Rig) -> dict[Seen, list[np.ndarray]]:
    """Where the arm was commanded to while each moving step of each pass ran, in this order."""
    seen: dict[Seen, list[np.ndarray]] = {}
    shown = [(s.program, s.q_command) for s in rig.history if s.program is not None]
    for here, ticks in groupby(shown, lambda tick: (tick[0].loop, tick[0].step, tick[0].running)):
        if isinstance(here[2].steps[here[1]], MotionStep):
            assert here not in seen, "a step is repeated"
            seen[here] = [q for _, q in ticks]
    return seen


def moving_steps(what: Program) -> list[int]:
    return [k for k, step in enumerate(what.steps) if isinstance(step, MotionStep)]


def assert_no_step_is_skipped(seen: Sequence[Seen]) -> None:
    for passes, group in groupby(seen, lambda here: here[0]):
        steps = list(group)
        versions = {id(version) for _, _, version in steps}
        assert len(versions) == 1, "a pass is of one version"
        if passes != seen[-1][0]:
            assert [step for _, step, _ in steps] == moving_steps(steps[0][2])
    passes = [passes for passes, _ in groupby(seen, lambda here: here[0])]
    assert passes == list(range(passes[0], passes[0] + len(passes)))


def assert_every_end_is_met_within_its_blend(seen: dict[Seen, list[np.ndarray]]) -> None:
    order = list(seen)
    for here, ahead in pairwise(order[:-1]):
        step = here[2].steps[here[1]]
        assert isinstance(step, LineStep | MoveStep)
        if isinstance(step, LineStep):
            goal = np.array([step.x_mm, step.y_mm, step.z_mm]) / 1000
        else:
            goal = ROBOT.forward(np.radians(step.joints_deg))[:3, 3]
        tools = ROBOT.forward(np.array(seen[here] + seen[ahead]))[:, :3, 3]
        ways = np.diff(tools, axis=0)
        along = ((goal - tools[:-1]) * ways).sum(axis=1) / np.maximum((ways**2).sum(axis=1), 1e-30)
        nearest = tools[:-1] + np.clip(along, 0, 1)[:, None] * ways
        assert np.linalg.norm(nearest - goal, axis=1).min() <= step.blend_mm / 1000 + 5e-5


@given(shape=st.sampled_from(sorted(SHAPES)), at=st.floats(0.02, 3.0))
@example(shape="a wait within", at=1.2)  # steps of the next pass were handed out before the edit came
@settings(max_examples=9 if LONG else 3)
def test_the_edit_takes_effect_at_the_next_pass_whatever_the_shape(shape: str, at: float) -> None:
    old, new = (program(*steps) for steps in SHAPES[shape])
    rig = stands_at_the_end_of(old.steps)
    rig.do(RunProgram(old, None))
    rig.run(at)
    rig.do(UpdateProgram(new)).result(0)
    running = rig.tick().program
    rig.run(4)
    seen = motions_seen(rig)
    first = next(here for here in seen if here[2] is new)
    assert first[0] == running.loop + (running.running is not new)
    assert rig.now.state is State.MOVING
    assert_no_step_is_skipped(list(seen))
    assert_every_end_is_met_within_its_blend(seen)
    assert_keeps_limits(rig)


def test_an_edited_loop_that_is_blended_over_its_end_stops_there_once() -> None:
    rig = stands_at_the_end_of(square(10))
    rig.do(RunProgram(program(*square(10)), None))
    rig.run(3)
    rig.do(UpdateProgram(program(*square(10, 110.0))))
    rig.history.clear()
    rig.run(8)
    stands = [not s.velocity_command.any() for s in rig.history]
    assert sum(now and not before for before, now in pairwise(stands)) == 1
    assert_accelerations_keep_limits(rig)


def test_two_edits_one_after_the_other_and_one_back_again() -> None:
    old, first, second = (program(*moves(30, *THREE, (away, 0.0))) for away in (0.05, 0.15, 0.2))
    rig = stands_at_the_end_of(old.steps)
    rig.do(RunProgram(old, None))
    rig.run(2)
    for version in (first, second):
        rig.do(UpdateProgram(version))
    rig.run(4)
    rig.do(UpdateProgram(old))
    rig.run(4)
    seen = motions_seen(rig)
    versions = [next(iter(group)) for _, group in groupby([here[2] for here in seen], key=id)]
    assert [id(v) for v in versions if v is not first] == [id(old), id(second), id(old)]
    assert sum(here[2] is first for here in seen) <= len(first.steps)
    assert_no_step_is_skipped(list(seen))
    assert_every_end_is_met_within_its_blend(seen)
    assert_accelerations_keep_limits(rig)


def test_when_the_planner_is_late_the_edit_waits_for_a_pass_that_has_not_begun() -> None:
    executor = LateExecutor()
    old, new = (program(*steps) for steps in SHAPES["three short moves"])
    rig = make_rig(executor).enable()
    rig.do(RunProgram(old, None))
    for _ in range(40):
        executor.work()
        rig.run(0.1)
    edit = rig.do(UpdateProgram(new))
    executor.work()
    rig.run(0.04)
    edit.result(0)
    rig.run(1.5)  # by now all that was handed out has begun, and the arm waits
    for _ in range(60):
        executor.work()
        rig.run(0.1)
    seen = motions_seen(rig)
    assert any(here[2] is new for here in seen)
    assert_no_step_is_skipped(list(seen))
    assert_every_end_is_met_within_its_blend(seen)
    assert_keeps_limits(rig)


@pytest.mark.parametrize("loops", [2, 3])
def test_a_program_that_ends_is_run_as_often_as_it_was_asked_for(loops: int) -> None:
    old, new = (program(*steps) for steps in SHAPES["three short moves"])
    rig = stands_at_the_end_of(old.steps)
    ticket = rig.do(RunProgram(old, loops))
    rig.run(0.1)
    rig.finishes(UpdateProgram(new))
    ticket.result(0)
    seen = list(motions_seen(rig))
    assert_no_step_is_skipped(seen)
    assert [here[2] is new for here in seen] == [False] * 3 + [True] * 4 * (loops - 1)
    end = new.steps[-1].plan(ROBOT, MIDDLE).end  # type: ignore[attr-defined]
    np.testing.assert_allclose(rig.now.q_command, end, atol=1e-12)


def test_an_edit_that_is_still_being_checked_is_answered_when_the_arm_is_released() -> None:
    old, new = (program(*steps) for steps in SHAPES["three short moves"])
    executor = LateExecutor()
    rig = make_rig(executor).enable()
    rig.do(RunProgram(old, None))
    executor.work()
    rig.run(0.1)
    edit = rig.do(UpdateProgram(new))
    rig.do(Release())
    with pytest.raises(StateError, match="released"):
        edit.result(0)
