"""The loop on its thread: real time, no sleeps."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import closing

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TEST, TICK, RecordingDriver, Rig, fails, make_rig

from armctl.errors import ArmctlError, InputError, MotionRefusedError, StateError
from armctl.facts import State
from armctl.motion import PointToPoint, plan_joints
from armctl.program import Program, WaitStep
from armctl.protocol import (
    ClearFault,
    Command,
    Connect,
    Disconnect,
    Enable,
    Follow,
    ManualClock,
    MonotonicClock,
    MoveGripper,
    MoveJoints,
    Origin,
    Pause,
    Release,
    Resume,
    RunProgram,
    SetSpeed,
    UpdateProgram,
)
from armctl.runtime import Controller
from armctl.runtime.mover import PathMover

PATIENCE_S = 20.0
REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")


class LiveDriver(RecordingDriver):
    """Tells a waiting test of each write."""

    def __init__(self) -> None:
        super().__init__(ManualClock())
        self.written = threading.Event()

    def write(self, setpoints: dict[int, float]) -> None:  # type: ignore[override]
        super().write(setpoints)
        self.written.set()


@pytest.fixture
def driver() -> LiveDriver:
    return LiveDriver()


@pytest.fixture
def live(driver: LiveDriver):
    with closing(Controller(ROBOT, lambda _: driver, MonotonicClock(), rate_hz=100)) as controller:
        controller.start()
        controller.submit(Connect("sim"), TEST).result(PATIENCE_S)
        controller.submit(Enable(), TEST).result(PATIENCE_S)
        yield controller


def near(degrees: float) -> np.ndarray:
    return REST + np.radians([degrees, 0, 0, 0, 0])


def test_a_motion_runs_from_end_to_end(live: Controller) -> None:
    live.submit(MoveJoints(near(3)), TEST).result(PATIENCE_S)
    assert np.array_equal(live.snapshot.q_command, near(3))
    assert live.snapshot.state is State.HOLDING


def test_a_stop_is_acted_on_at_once(live: Controller) -> None:
    motion = live.submit(MoveJoints(near(60), duration_s=30), TEST)
    motion.accepted.result(PATIENCE_S)
    live.stop(TEST).result(PATIENCE_S)
    with pytest.raises(StateError, match="stopped by test"):
        motion.finished.result(PATIENCE_S)
    assert live.snapshot.state is State.HOLDING


def test_a_refusal_can_be_awaited(live: Controller) -> None:
    async def ask() -> None:
        await asyncio.wrap_future(live.submit(MoveJoints(np.full(5, 9.0)), TEST).accepted)

    with pytest.raises(ArmctlError, match="is outside"):
        asyncio.run(ask())


def test_an_awaiting_task_that_is_cancelled_does_not_disturb_the_controller(live: Controller) -> None:
    async def ask() -> None:
        ticket = live.submit(MoveJoints(near(2)), TEST)
        task = asyncio.ensure_future(asyncio.wrap_future(ticket.finished))
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await asyncio.to_thread(ticket.result, PATIENCE_S)

    asyncio.run(ask())
    assert np.array_equal(live.snapshot.q_command, near(2))


def test_closing_brings_a_moving_arm_to_rest_first(live: Controller, driver: LiveDriver) -> None:
    motion = live.submit(MoveJoints(near(60)), TEST)
    motion.accepted.result(PATIENCE_S)
    driver.written.clear()
    assert driver.written.wait(PATIENCE_S)
    live.close()
    fails(motion.finished, "stopped by close")
    assert driver.calls[-1] == "close"
    assert "release" not in driver.calls
    assert live.snapshot.state is State.DISCONNECTED
    live.close()


def test_closing_stops_a_program_that_stands_in_a_wait(live: Controller) -> None:
    program = Program(robot="uzuner", name="p", steps=(WaitStep(seconds=600.0),))
    run = live.submit(RunProgram(program), TEST)
    run.accepted.result(PATIENCE_S)
    live.close()
    fails(run.finished, "stopped by close")  # so its outputs are as at a STOP


def test_after_closing_everything_is_refused(rig: Rig) -> None:
    waiting = rig.controller.submit(Connect("sim"), TEST)
    rig.controller.close()
    for ticket in (waiting, rig.controller.submit(Connect("sim"))):
        fails(ticket.accepted, "the controller is closed")
    rig.controller.stop().result(0)
    with pytest.raises(StateError, match="started already"):
        rig.controller.start()


def test_many_threads_may_ask_at_once(live: Controller) -> None:
    tickets = []

    def ask(k: int) -> None:
        for _ in range(20):
            tickets.append(live.submit(MoveJoints(near(k)), Origin(f"thread {k}")))
            live.stop(Origin(f"thread {k}"))

    threads = [threading.Thread(target=ask, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    live.stop(TEST).result(PATIENCE_S)
    for ticket in tickets:
        error = ticket.finished.exception(PATIENCE_S)
        assert error is None or isinstance(error, StateError)
    assert live.snapshot.state is State.HOLDING


def test_the_thread_survives_a_driver_that_breaks(live: Controller, driver: LiveDriver) -> None:
    driver.fail["read"] = RuntimeError("oops")
    driver.fail["write"] = RuntimeError("oops")
    ticket = live.submit(MoveJoints(near(5)), TEST)
    assert isinstance(ticket.finished.exception(PATIENCE_S), ArmctlError)
    driver.fail.clear()
    live.submit(Connect("sim"), TEST).result(PATIENCE_S)
    assert live.snapshot.state is State.OFF


def test_a_wake_between_two_ticks_writes_nothing_and_loses_no_time(holding: Rig) -> None:
    moving = holding.do(MoveJoints(HOME, duration_s=2))
    began = holding.now.stamp
    holding.run(0.2)
    count = len(holding.driver.writes)
    for _ in range(3):
        holding.tick(0.001)
    assert len(holding.driver.writes) == count
    holding.tick(0.017)
    holding.until(lambda _: moving.finished.done())
    assert holding.now.stamp - began == pytest.approx(2.0, abs=0.03)


def test_a_rate_that_cannot_be() -> None:
    with pytest.raises(InputError, match="5 Hz is outside 10 … 200 Hz"):
        make_rig(rate_hz=5)


def test_whoever_waits_for_a_ticket_finds_the_snapshot_that_shows_it(rig: Rig) -> None:
    seen: list[tuple[State, np.ndarray]] = []

    def note(_: object) -> None:
        seen.append((rig.now.state, rig.now.q_command))

    rig.controller.submit(Connect("sim"), TEST).finished.add_done_callback(note)
    rig.tick()
    rig.controller.submit(Enable(), TEST).finished.add_done_callback(note)
    rig.rests()
    rig.controller.submit(MoveJoints(HOME), TEST).finished.add_done_callback(note)
    rig.until(lambda s: s.state is State.MOVING)
    rig.rests()
    assert [state for state, _ in seen] == [State.OFF, State.HOLDING, State.HOLDING]
    assert np.array_equal(seen[2][1], HOME)


def test_closing_answers_a_disconnect_that_waits_for_a_standstill(holding: Rig) -> None:
    holding.do(MoveJoints(HOME))
    holding.run(0.4)
    leaving = holding.do(Disconnect())
    assert not leaving.finished.done()
    holding.controller.close()
    leaving.result(0)


@pytest.mark.logs_a_defect
def test_a_snapshot_that_cannot_be_made_is_a_fault_and_the_ticks_go_on(
    holding: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = holding.do(MoveJoints(HOME))
    with monkeypatch.context() as patch:
        patch.setattr(PathMover, "program", property(lambda _: 1 / 0))
        holding.tick()
    holding.tick()
    assert holding.now.state is State.FAULT
    assert isinstance(motion.finished.exception(0), ArmctlError)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (Release(), "nothing to release: disconnected"),
        (Enable(), "needs the arm off, it is disconnected; connect first"),
        (MoveJoints(HOME), "it is disconnected; connect and enable first"),
        (MoveGripper(0.5), "uzuner is not connected"),
    ],
)
def test_what_is_refused_without_a_board(rig: Rig, command: Command, words: str) -> None:
    rig.refuses(command, words)


@pytest.mark.parametrize(
    ("command", "words", "error"),
    [
        (Connect("sim"), "connected already, and holding; disconnect first", StateError),
        (ClearFault(), "no fault to clear: holding", StateError),
        (Enable(HOME), "the arm is enabled already", StateError),
        (
            Pause(),
            r"a pause needs the arm moving, it is holding \(.*\); there is nothing",
            StateError,
        ),
        (Resume(), "nothing to resume: holding", StateError),
        (UpdateProgram(Program(robot="uzuner", steps=())), "no program runs", StateError),
        (MoveGripper(-0.1), "outside 0 … 100 %", InputError),
        (MoveGripper(1.1), "outside 0 … 100 %", InputError),
        (SetSpeed(0.0), "a speed of 0 % is outside 5 … 100 %", InputError),
        (SetSpeed(1.001), "a speed of 100.1 % is outside", InputError),
        (SetSpeed(np.nan), "the speed must be a finite number", InputError),
        (
            Follow(plan_joints(ROBOT, HOME, REST)),
            r"starts with Wrist pitch at -40\.00°, the arm stands at -70\.00°",
            StateError,
        ),
        (Follow(PointToPoint.lasting(REST, HOME, 0.1)), "is over its limit", MotionRefusedError),
        (Command(), "not a command", InputError),
    ],
)
def test_what_is_refused_at_rest(rig: Rig, command: Command, words: str, error: type[Exception]) -> None:
    rig.enable().refuses(command, words, error)
    assert rig.now.state is State.HOLDING
    assert len(rig.driver.writes) == 1


# How often a thread of its own ticks.


def waits_of(rig: Rig, count: int, given: Callable[[int], None] = lambda _: None) -> list[float]:
    """How long [s] its own loop waits ahead of the next ticks; ``given`` is called before each wait."""
    waits: list[float] = []
    clock, controller = rig.clock, rig.controller

    def wait_until(deadline: float, wake: threading.Event) -> bool:
        waits.append(round(deadline - clock.now(), 6))
        given(len(waits))
        if len(waits) == count:
            controller._closing.set()
        return ManualClock.wait_until(clock, deadline, wake)

    clock.wait_until = wait_until
    controller._run()
    return waits


def test_an_arm_that_holds_is_looked_at_less_often(holding: Rig) -> None:
    calls = holding.driver.calls
    before = calls.count("read")
    waits = waits_of(holding, 100)
    assert set(waits[1:51]) == {TICK} and set(waits[51:]) == {0.05}
    assert calls.count("read") - before >= 99  # at each tick
    assert holding.now.state is State.DISCONNECTED and not holding.now.warnings
    assert not [text for text in holding.texts if "ms late" in text]


def test_a_motion_from_rest_begins_at_once(holding: Rig) -> None:
    writes: list[int] = []

    def given(number: int) -> None:
        if number == 80:
            holding.controller.submit(MoveJoints(HOME), TEST)
        writes.append(len(holding.driver.writes))

    waits = waits_of(holding, 90, given)
    assert waits[78] == 0.05 and set(waits[81:]) == {TICK}
    assert writes[79] == writes[0] and writes[83] >= writes[0] + 2  # a tick to plan it, then a setpoint each


@pytest.mark.parametrize("why", ["led by hand", "still to be sent"])
def test_what_may_move_is_looked_at_each_tick(holding: Rig, why: str) -> None:
    board = holding.controller._core.board
    assert board is not None
    if why == "led by hand":
        board._let_go_of(np.arange(5) == 0)
    else:
        board._behind = {0: 1.0}
    assert set(waits_of(holding, 80)[1:]) == {TICK}
