from __future__ import annotations

import gc
import os
import tracemalloc
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from typing import ParamSpec, TypeVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.program.kit import program
from tests.runtime.kit import (
    MIDDLE,
    ROBOT,
    TICK,
    LateExecutor,
    Rig,
    assert_keeps_limits,
    make_rig,
    steps_seen,
    swings,
)

from armctl.errors import ProgramError
from armctl.facts import State
from armctl.motion import arc
from armctl.program import (
    ArcStep,
    CommentStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    SpeedStep,
    Step,
    WaitStep,
)
from armctl.protocol import Pause, Resume, RunProgram, UpdateProgram
from armctl.runtime import InlineExecutor

P = ParamSpec("P")
T = TypeVar("T")
ARC_MM = 1000 * arc()


def through_the_arc(blend_mm: float) -> Program:
    return program(*(PointStep(x_mm=x, y_mm=y, z_mm=z, blend_mm=blend_mm) for x, y, z in ARC_MM.tolist()))


def speeds(rig: Rig) -> np.ndarray:
    """(k,) the fastest joint at each tick while the program ran."""
    return np.array([np.abs(s.velocity_command).max() for s in rig.history if s.program is not None])


def test_the_published_arc_runs_without_a_pause(holding: Rig) -> None:
    holding.finishes(RunProgram(through_the_arc(2.0)))
    assert steps_seen(holding) == [(0, k) for k in range(58)]
    moving = [s for s in holding.history if s.program is not None and 0 < s.program.step < 57]
    assert min(np.abs(s.velocity_command).max() for s in moving) > np.radians(5)
    assert_keeps_limits(holding)


def test_with_stops_it_stands_in_every_point(holding: Rig) -> None:
    holding.finishes(RunProgram(through_the_arc(0.0)))
    tools = ROBOT.forward(np.array([s.q_command for s in holding.history]))[:, :3, 3]
    for point in ARC_MM / 1000:
        assert np.linalg.norm(tools - point, axis=1).min() < 1e-9


def test_lines_and_arcs_of_the_tool(holding: Rig) -> None:
    x, y, z = ARC_MM[0].tolist()
    via, end = (dict(zip(("x_mm", "y_mm", "z_mm"), ARC_MM[k].tolist(), strict=True)) for k in (28, -1))
    to_the_end = ArcStep(**{f"via_{key}": mm for key, mm in via.items()}, **end, speed_mm_s=150)
    up = LineStep(**end | {"z_mm": 120}, pitch="free")
    holding.finishes(RunProgram(program(PointStep(x_mm=x, y_mm=y, z_mm=z), to_the_end, up)))
    seen = [s for s in holding.history if s.program is not None and s.program.step == 1]
    tools = 1000 * ROBOT.forward(np.array([s.q_command for s in seen]))[:, :3, 3]
    np.testing.assert_allclose(np.hypot(tools[:, 0], tools[:, 1]), 200.0, atol=0.05)
    np.testing.assert_allclose(tools[:, 2], 85.0, atol=0.05)
    assert np.linalg.norm(np.diff(tools, axis=0), axis=1).max() <= 150 * TICK * 1.001
    assert_keeps_limits(holding)


def test_a_loop_that_is_blended_over_its_end_never_stands(holding: Rig) -> None:
    corners = [(180, -60), (180, 60), (220, 60), (220, -60)]
    square = program(*(LineStep(x_mm=x, y_mm=y, z_mm=100, pitch="free", blend_mm=10) for x, y in corners))
    holding.finishes(RunProgram(program(PointStep(x_mm=220, y_mm=-60, z_mm=100))))
    holding.history.clear()
    holding.do(RunProgram(square, None))
    holding.run(30)
    fast = speeds(holding)
    assert fast[5:].min() > np.radians(2)
    assert {step for _, step in steps_seen(holding)} == {0, 1, 2, 3}
    holding.stops()
    assert_keeps_limits(holding)


def random_program(rng: np.random.Generator) -> Program:
    """Six moving steps of all kinds with all sorts of radii, and now and then something between them."""
    steps: list[Step] = []
    for _ in range(6):
        radius = float(rng.choice([0.0, 3.0, 30.0]))
        x, y, z = rng.uniform([170, -60, 80], [220, 60, 140]).tolist()
        match int(rng.integers(4)):
            case 0:
                pose = np.degrees(MIDDLE + rng.uniform(-0.25, 0.25, 5))
                steps.append(MoveStep(joints_deg=tuple(pose.tolist()), blend_mm=radius))
            case 1:
                steps.append(PointStep(x_mm=x, y_mm=y, z_mm=z, blend_mm=radius))
            case _:  # a line only from where the tool is on the box's side of the arm
                steps.append(PointStep(x_mm=200, y_mm=0, z_mm=100, blend_mm=radius))
                steps.append(LineStep(x_mm=x, y_mm=y, z_mm=z, pitch="free", blend_mm=radius))
        if rng.random() < 0.2:
            steps.append(WaitStep(seconds=float(rng.uniform(0, 0.3))))
        if rng.random() < 0.2:
            steps.append(SpeedStep(percent=float(rng.uniform(30, 100))))
    return program(*steps)


def farthest_from(way: np.ndarray, places: np.ndarray) -> float:
    """How far (m) the tool of some configurations is at most from the tool's way through others."""
    tool, seen = (ROBOT.forward(q)[:, :3, 3] for q in (way, places))
    steps = np.diff(tool, axis=0)
    squares = np.maximum((steps**2).sum(axis=1), 1e-30)
    along = np.clip(np.einsum("kmi,mi->km", seen[:, None] - tool[:-1], steps) / squares, 0, 1)
    off = np.linalg.norm(tool[:-1] + along[..., None] * steps - seen[:, None], axis=2)
    return float(off.min(axis=1).max())


def commanded(rig: Rig) -> np.ndarray:
    return np.array([s.q_command for s in rig.history])


@given(seed=st.integers(0, 10_000), at=st.floats(0.02, 9.0), stand=st.floats(0.0, 1.0), stops=st.booleans())
@settings(max_examples=8 if os.environ.get("ARMCTL_LONG") else 3)
def test_a_pause_or_stop_stays_on_the_path_and_skips_no_step(
    seed: int, at: float, stand: float, stops: bool
) -> None:
    what = random_program(np.random.default_rng(seed))
    fine, rig = make_rig(rate_hz=200.0).enable(), make_rig().enable()
    fine.do(RunProgram(what), 0.005)
    while fine.tick(0.005).state is not State.HOLDING:
        pass
    undisturbed = commanded(fine)
    ticket = rig.do(RunProgram(what))
    rig.run(at)
    if stops:
        rig.stops()
        expected = steps_seen(fine)[: len(steps_seen(rig))]
    else:
        if rig.now.state is State.MOVING:
            rig.do(Pause())
            rig.until(lambda s: s.state is not State.MOVING, 2)
            rig.run(stand)
            if rig.now.state is State.PAUSED:
                rig.do(Resume())
        rig.rests()
        ticket.result(0)
        expected = steps_seen(fine)
    # a step that is over within a tick may not be seen
    seen = steps_seen(rig)
    assert seen == [step for step in expected if step in seen]
    assert len(seen) >= len(expected) - sum(isinstance(s, SpeedStep | WaitStep) for s in what.steps)
    # between the ticks of the fine run the tool is on a chord, at most 0.01 mm off
    assert farthest_from(undisturbed, commanded(rig)) < 5e-5
    assert_keeps_limits(rig)


def test_when_the_planner_is_late_the_arm_waits_on_the_path(late: Rig) -> None:
    ticket = late.do(RunProgram(through_the_arc(2.0)))
    for _ in range(400):
        if late.now.state is State.HOLDING and late.now.program is None and ticket.finished.done():
            break
        late.executor.work()
        late.run(1.0)  # much longer than what is planned ahead
    ticket.result(0)
    assert steps_seen(late) == [(0, k) for k in range(58)]
    assert_keeps_limits(late)


def test_a_single_step(holding: Rig) -> None:
    a, b = swings(0, 0.1, 0.2)
    holding.finishes(RunProgram(program(a, b), 1, first=1, count=1))
    assert steps_seen(holding) == [(0, 1)]
    np.testing.assert_allclose(holding.now.q_command, MIDDLE + 0.2, atol=1e-12)


def test_a_speed_step_slows_down_what_follows_it(holding: Rig) -> None:
    a, b = swings(0, 0.3, -0.3)
    holding.finishes(RunProgram(program(a)))
    holding.history.clear()
    holding.finishes(RunProgram(program(b)))
    fast = len(holding.history)
    holding.finishes(RunProgram(program(a)))
    holding.history.clear()
    holding.finishes(RunProgram(program(SpeedStep(percent=50), b)))
    assert len(holding.history) == pytest.approx(2 * fast, abs=6)
    assert holding.now.speed == 1.0


def test_an_endless_loop_takes_no_more_memory_the_longer_it_runs(holding: Rig) -> None:
    a, b, c = swings(5, 0.1, 0.2, 0.0)
    up = LineStep(x_mm=200, y_mm=20, z_mm=100, pitch="free")
    to = PointStep(x_mm=200, y_mm=-20, z_mm=100, blend_mm=5)
    holding.do(RunProgram(program(a, b, WaitStep(seconds=0.1), c, to, up), None))
    seconds = 40 if os.environ.get("ARMCTL_LONG") else 16
    ours = tracemalloc.Filter(True, "*/src/armctl/*")

    def in_use() -> int:
        holding.history.clear()
        holding.driver.writes.clear()
        holding.driver.calls.clear()
        gc.collect()
        return sum(s.size for s in tracemalloc.take_snapshot().filter_traces([ours]).statistics("filename"))

    tracemalloc.start()
    try:
        holding.run(10)
        before, passes = in_use(), holding.now.program
        holding.run(seconds)
        after = in_use()
    finally:
        tracemalloc.stop()
    assert holding.now.program.loop > passes.loop + 3
    # what is planned ahead differs from moment to moment; a leak of a setpoint a tick would be twice as much
    assert after - before < 2_500 * seconds


def test_the_arm_is_braked_in_time_for_a_corner_that_was_not_known_yet(holding: Rig) -> None:
    # With a radius longer than the steps, each new corner takes half of what the arm had to brake in.
    poses = [
        (22.92, 78.54, -74.27, -22.81, 11.46),
        (22.92, 112.92, -84.36, -45.73, 0.0),
        (-22.92, 61.35, -62.81, -11.35, 17.19),
        (2.29, 87.71, -77.71, -42.29, 3.44),
        (28.65, 118.65, -57.08, -17.08, 11.46),
        (22.92, 67.08, -84.36, -34.27, 0.0),
        (3.44, 86.56, -84.36, -44.58, 5.73),
    ]
    holding.finishes(RunProgram(program(*(MoveStep(joints_deg=pose, blend_mm=200) for pose in poses))))
    assert steps_seen(holding) == [(0, k) for k in range(7)]
    np.testing.assert_allclose(np.degrees(holding.now.q_command), poses[-1])
    assert_keeps_limits(holding)


def test_a_step_that_goes_nowhere_does_not_interrupt_a_blended_motion(holding: Rig) -> None:
    there = swings(5, 0.2)
    holding.finishes(RunProgram(program(*there, *there, *there, *swings(5, -0.2), *swings(0, 0.1))))
    between = [s for s in holding.history if s.program is not None and s.program.step in (0, 3)]
    assert np.abs([s.velocity_command for s in between[2:]]).max(axis=1).min() > np.radians(1)
    np.testing.assert_allclose(holding.now.q_command, MIDDLE + 0.1, atol=1e-12)
    assert_keeps_limits(holding)


def test_a_program_of_comments_is_over_at_once(holding: Rig) -> None:
    holding.finishes(RunProgram(program(CommentStep(note="nothing yet")), None), 1)


class FailingExecutor(InlineExecutor):
    """Breaks at some of the plans it is asked for."""

    def __init__(self, *numbers: int) -> None:
        self.numbers, self.count = numbers, -2  # to open the line, and to look at the jaws

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        self.count += 1
        if self.count not in self.numbers:
            return super().submit(fn, *args, **kwargs)
        broken: Future[T] = Future()
        broken.set_exception(RuntimeError("out of memory"))
        return broken


@pytest.mark.parametrize("number", [2, 3, 5])
@pytest.mark.logs_a_defect
def test_when_the_planner_breaks_in_a_blended_motion_the_arm_comes_to_rest(number: int) -> None:
    rig = make_rig(FailingExecutor(number)).enable()
    ticket = rig.do(RunProgram(program(*swings(5, *[0.25, -0.25] * 6))))
    rig.rests(20)
    with pytest.raises(ProgramError, match="out of memory"):
        ticket.result(0)
    assert rig.now.program is None
    assert_keeps_limits(rig)


@pytest.mark.logs_a_defect
def test_an_edit_mends_what_could_not_be_planned(late: Rig) -> None:
    def broken() -> None:
        raise RuntimeError("out of memory")

    late.do(RunProgram(program(*swings(0, 0.1, 0.2)), None))
    while late.executor.waiting:
        late.executor.work()
        late.tick()
    late.until(lambda _: bool(late.executor.waiting))
    late.executor.waiting = [(future, broken) for future, _ in late.executor.waiting]
    late.executor.work()
    late.tick()
    edit = late.do(UpdateProgram(program(*swings(0, 0.1, -0.1))))
    late.executor.work()
    late.run(10)  # what is left of the old version runs out before the new one is planned
    edit.result(0)
    for _ in range(100):
        late.executor.work()
        late.run(0.1)
    assert late.now.state is State.MOVING
    assert np.abs(commanded(late) - (MIDDLE - 0.1)).max(axis=1).min() < 1e-9


@pytest.mark.parametrize("asleep_s", [2.0, 5.0])
def test_an_arm_that_needs_seconds_to_stand_waits_for_a_late_planner_on_the_path(asleep_s: float) -> None:
    joints = tuple(replace(joint, acceleration=joint.speed / 2) for joint in ROBOT.joints)
    executor = LateExecutor()
    rig = make_rig(executor, replace(ROBOT, joints=joints)).enable()
    along = [MIDDLE + np.array([-1.2 + 0.3 * k, 0, 0, 0, 0]) for k in range(9)]
    steps = (MoveStep(joints_deg=tuple(np.degrees(q).tolist()), blend_mm=60) for q in along)
    ticket = rig.do(RunProgram(program(*steps)))
    for _ in range(100):
        executor.work()
        rig.run(asleep_s)
        if ticket.finished.done():
            break
    ticket.result(0)
    assert_keeps_limits(rig)
