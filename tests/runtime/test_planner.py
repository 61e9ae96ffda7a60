"""A plan that nobody waits for any more keeps nothing else from being planned, opened or closed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, LateExecutor, RecordingDriver, Rig, fails, make_rig

from armctl.errors import StateError
from armctl.facts import State
from armctl.motion.trajectory import Sample
from armctl.program import MoveStep, Program
from armctl.protocol import (
    Cancel,
    Connect,
    Disconnect,
    Enable,
    Follow,
    MonotonicClock,
    MoveJoints,
    RunProgram,
    UpdateProgram,
)
from armctl.runtime import Controller
from armctl.runtime.planner import LONGEST_PLAN_S, Openers, Planner

HOME = ROBOT.pose("home")
NEAR = MoveJoints(HOME + np.radians([2, 0, 0, 0, 0]))
PATIENCE_S = 20.0


class Endless:
    """A trajectory of a caller's own whose check computes until ``go_on``."""

    duration = 1.0
    start = end = HOME

    def __init__(self) -> None:
        self.begun, self.go_on, self.ended = threading.Event(), threading.Event(), threading.Event()

    def sample(self, t: object) -> Sample:
        self.begun.set()
        try:
            while not self.go_on.is_set():
                pass
        finally:
            self.ended.set()
        q = np.tile(HOME, (np.size(t), 1))
        return Sample(q, 0 * q, 0 * q, 0 * q)


class Stuck(Endless):
    """One that is in a call of C, which nothing interrupts, until then."""

    def sample(self, t: object) -> Sample:
        self.begun.set()
        try:
            self.go_on.wait(PATIENCE_S)
        finally:
            self.ended.set()
        q = np.tile(HOME, (np.size(t), 1))
        return Sample(q, 0 * q, 0 * q, 0 * q)


@pytest.fixture
def controller() -> Iterator[Controller]:
    clock = MonotonicClock()
    controller = Controller(ROBOT, lambda _: RecordingDriver(clock), clock)  # pyright: ignore
    controller.start()
    for command in (Connect("sim"), Enable(HOME)):
        controller.submit(command).result(PATIENCE_S)
    yield controller
    controller.close()


DROPS: dict[str, Callable[[Controller], Any]] = {
    "STOP": lambda controller: controller.stop(),
    "cancel": lambda controller: controller.submit(Cancel("long")),
}


@pytest.mark.parametrize("drops", DROPS)
@pytest.mark.parametrize("kind", [Endless, Stuck])
def test_a_plan_that_is_dropped_does_not_keep_the_next_from_being_planned(
    controller: Controller, drops: str, kind: type[Endless]
) -> None:
    endless = kind()
    asked = controller.submit(Follow(endless, motion="long"))
    assert endless.begun.wait(PATIENCE_S)
    DROPS[drops](controller).result(PATIENCE_S)
    assert isinstance(asked.finished.exception(PATIENCE_S), StateError)
    controller.submit(NEAR).result(PATIENCE_S)
    np.testing.assert_allclose(controller.snapshot.q_command, NEAR.q)
    endless.go_on.set()
    assert endless.ended.wait(PATIENCE_S)  # what was left ends with its plan


def test_a_board_is_opened_while_a_plan_hangs(controller: Controller) -> None:
    stuck = Stuck()
    controller.submit(Follow(stuck))
    assert stuck.begun.wait(PATIENCE_S)
    controller.submit(Disconnect()).result(PATIENCE_S)
    controller.submit(Connect("sim")).result(PATIENCE_S)
    assert controller.snapshot.state is not State.DISCONNECTED
    stuck.go_on.set()


def test_a_line_that_hangs_keeps_no_other_from_being_opened() -> None:
    clock, begun, go_on = MonotonicClock(), threading.Event(), threading.Event()

    def opened(port: str) -> RecordingDriver:
        if port == "hangs":
            begun.set()
            assert go_on.wait(PATIENCE_S)
        return RecordingDriver(clock)  # pyright: ignore

    controller = Controller(ROBOT, opened, clock)
    controller.start()
    try:
        hanging = controller.submit(Connect("hangs"))
        assert begun.wait(PATIENCE_S)
        controller.submit(Disconnect()).result(PATIENCE_S)
        assert isinstance(hanging.finished.exception(PATIENCE_S), StateError)
        controller.submit(Connect("sim")).result(PATIENCE_S)
    finally:
        go_on.set()
        controller.close()


def test_closing_waits_for_no_plan(controller: Controller) -> None:
    stuck = Stuck()
    controller.submit(Follow(stuck))
    assert stuck.begun.wait(PATIENCE_S)
    controller.close()
    assert not stuck.ended.is_set()
    stuck.go_on.set()


def waits_for_long(rig: Rig) -> None:
    for _ in range(int(LONGEST_PLAN_S / 0.4) + 2):
        rig.tick(0.4)


def test_a_plan_that_takes_too_long_is_refused() -> None:
    rig = make_rig(LateExecutor()).enable(HOME)
    asked = rig.do(NEAR)
    waits_for_long(rig)
    fails(asked.finished, "planning took longer than 120 s")
    program = Program(robot="uzuner", steps=(MoveStep(joints_deg=tuple(np.degrees(NEAR.q).tolist())),))
    running = rig.do(RunProgram(program, None))
    while not running.accepted.done():
        rig.executor.work()
        rig.tick()
    edit = rig.do(UpdateProgram(program))
    waits_for_long(rig)
    fails(edit.finished, "planning took longer than 120 s")


def test_what_waits_and_what_was_left_are_bounded() -> None:
    planner, go_on, begun = Planner(), threading.Event(), threading.Semaphore(0)

    def hang() -> None:
        begun.release()
        assert go_on.wait(PATIENCE_S)

    try:
        planner.submit(hang)
        assert begun.acquire(timeout=PATIENCE_S)
        for _ in range(16):
            planner.submit(hang)
        with pytest.raises(StateError, match="16 motions wait to be planned already"):
            planner.submit(hang)
        planner.shutdown()
        planner = Planner()
        for _ in range(4):
            running = planner.submit(hang)
            assert begun.acquire(timeout=PATIENCE_S)
            assert running.cancel()
        with pytest.raises(StateError, match="4 motions that were dropped are still being given up"):
            planner.submit(hang)
        openers = Openers()
        for _ in range(4):
            openers.submit(hang)
        with pytest.raises(StateError, match="4 lines are still being opened"):
            openers.submit(hang)
    finally:
        go_on.set()
        planner.shutdown()
    with pytest.raises(StateError, match="the planner is closed"):
        planner.submit(hang)
