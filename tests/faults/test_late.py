"""Answers and commands that come late: no wrong first pulse, no late one, none that is only said to be on."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest
from tests.faults.kit import Bench
from tests.runtime.kit import TEST, TICK

from armctl.facts import State
from armctl.protocol import ClearFault, Connect, Enable, HomeAxes, MoveJoints, Release, Snapshot

LONG = bool(os.environ.get("ARMCTL_LONG"))
BOARDS = ("maestro", "firmata", "encoder")
DELAYS_S = (0.01, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4)
_STEP = {"maestro": 0.3, "firmata": 1.0, "encoder": 20.0}
"""how far an output may be beside its setpoint, in the board's unit: its resolution, a motor's play"""
_END_RAD = np.radians(1.0)


@pytest.fixture(params=BOARDS)
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = Bench(request.param)
    bench.does(Connect("/dev/ttyACM7"), State.OFF)
    if bench.kind == "encoder":
        bench.does(HomeAxes(), State.HOLDING, seconds=300.0)
        bench.does(Release(), State.OFF)
    yield bench
    bench.close()


class PlantWatch:
    """Looks at the outputs of the board at each tick, and at what is said of them."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.stood = np.isnan(bench.outputs())
        self.pose = bench.robot.outputs.outputs(bench.robot.pose("rest"))

    def tick(self, asked: bool) -> Snapshot:
        """``asked``: servos may come on."""
        bench = self.bench
        now = bench.tick()
        outputs = bench.outputs()
        off = np.isnan(outputs)
        if now.commanded and now.state in (State.HOLDING, State.MOVING, State.PAUSED):
            assert bench.kind == "encoder" or not off.any(), f"{now.state}: {now.cause}; {outputs}"
            assert now.powered
        came_on = self.stood & ~off
        if bench.kind != "encoder":  # there the outputs are where the axes stand
            assert asked or not came_on.any(), f"came on unasked: {np.flatnonzero(came_on)}, {now.cause}"
            wrong = np.abs(outputs - np.array([*self.pose.values()])) > _STEP[bench.kind]
            assert not (came_on & wrong).any(), f"first pulse {outputs[came_on & wrong]}"
        self.stood = off
        return now


def enabled(watch: PlantWatch) -> bool:
    """Enable, and three seconds more; whether it is on. What is refused says what to do."""
    bench = watch.bench
    pose = None if bench.kind == "encoder" else bench.robot.pose("rest")
    ticket = bench.controller.submit(Enable(pose), TEST)
    for _ in range(round(30 / TICK)):
        watch.tick(asked=True)
        if ticket.finished.done():
            break
    failed = ticket.finished.exception(0)
    if failed is not None:
        told = str(failed)
        assert "ms" in told or "confirm" in told or "answer" in told or "nothing ran for" in told, told
    for _ in range(round(3 / TICK)):  # the latest line is late by less than half of one
        watch.tick(asked=False)
    return failed is None


def back_off(bench: Bench) -> None:
    """On a line that is as good as new again."""
    bench.trouble()
    bench.run(1.0)
    if bench.now.state is State.FAULT and bench.now.board is None:
        bench.does(Connect("/dev/ttyACM7"), State.OFF)
    elif bench.now.state is State.FAULT:
        bench.does(ClearFault(), State.OFF, State.HOLDING)
    bench.does(Release(), State.OFF)
    bench.run(0.5)


@pytest.mark.parametrize("way", ["delay", "delay-reply"])
def test_enable_on_a_late_line(bench: Bench, way: str) -> None:
    on: list[float] = []
    for delay_s in DELAYS_S:
        bench.trouble(f"{way}={delay_s}:1")
        bench.run(1.0)
        if bench.now.board is not None and enabled(PlantWatch(bench)):
            on.append(delay_s)
        back_off(bench)
    assert on[0] == DELAYS_S[0]
    assert on[-1] < 0.25, "a line with a quarter of a second is too slow"


def test_a_line_that_is_too_slow_is_refused_with_the_delay(bench: Bench) -> None:
    slow_s = 0.18 if bench.kind == "firmata" else 0.09
    bench.trouble(f"delay-reply={slow_s}:1")
    bench.run(1.0)
    ticket = bench.controller.submit(
        Enable(None if bench.kind == "encoder" else bench.robot.pose("rest")), TEST
    )
    bench.run(0.5)
    failed = ticket.finished.exception(0)
    assert failed is not None
    assert "too slow" in str(failed)
    assert bench.now.state is State.OFF and not bench.now.powered


@pytest.mark.parametrize("delay_s", DELAYS_S)
def test_a_motion_that_is_called_finished_has_gone_out(bench: Bench, delay_s: float) -> None:
    assert enabled(PlantWatch(bench))
    watch = PlantWatch(bench)
    goal = bench.robot.pose("home")
    bench.trouble(f"delay={delay_s}:1")
    ticket = bench.controller.submit(MoveJoints(goal), TEST)
    for _ in range(round(20 / TICK)):
        watch.tick(asked=False)
        if ticket.finished.done():
            break
    bench.run(1.0)
    if ticket.finished.done() and ticket.finished.exception(0) is None:
        stands = bench.robot.outputs.angles(
            dict(zip(bench.robot.outputs.channels, bench.outputs(), strict=True))
        )
        assert np.abs(stands - goal).max() < _END_RAD


@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.06])
def test_after_a_stop_no_servo_comes_on(bench: Bench, delay_s: float) -> None:
    if bench.kind == "encoder":
        return  # its motors come on all at once, before Enable is answered
    if delay_s:
        bench.trouble(f"delay={delay_s}:1")
        bench.run(1.0)
    for ticks in range(1, 20, 1 if LONG or not delay_s else 3):
        watch = PlantWatch(bench)
        bench.controller.submit(Enable(bench.robot.pose("rest")), TEST)
        for _ in range(ticks):
            watch.tick(asked=True)
        stop = bench.controller.stop(TEST)
        while not stop.finished.done():
            watch.tick(asked=True)
        for _ in range(round(2 * delay_s / TICK)):  # what is on the line already arrives
            watch.tick(asked=True)
        for _ in range(round(1.5 / TICK)):
            watch.tick(asked=False)
        back_off(bench)
        if delay_s:
            bench.trouble(f"delay={delay_s}:1")
            bench.run(0.3)
