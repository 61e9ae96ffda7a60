"""Random commands, random trouble: whatever comes together, no setpoint leaves what the arm is allowed."""

from __future__ import annotations

import os
import random
from collections.abc import Callable

import numpy as np
import pytest
from tests.faults.kit import PORT, Bench
from tests.runtime.kit import TEST, TICK

from armctl.facts import State
from armctl.hardware.boards import channel_settings
from armctl.program import MoveStep, Program, WaitStep
from armctl.protocol import (
    ClearFault,
    Command,
    Connect,
    Disconnect,
    Enable,
    HomeAxes,
    Jog,
    JogTool,
    MoveGripper,
    MoveJoints,
    Pause,
    Release,
    Resume,
    RunProgram,
    SetSpeed,
    StreamJoints,
)

TICKS = 1_000_000 if os.environ.get("ARMCTL_LONG") else 9_000
"""of all boards together"""
_RUN = 2_000
"""ticks of one arm; then another one with another seed"""
_COMMAND_EVERY, _FAULT_EVERY = 12, 150
_LONGEST_S = 2 * TICK
"""what a setpoint may count for, however long ago the one before was"""
_LINE = (
    "drop:1@0+0.3",
    "drop:0.2@0+2",
    "delay=0.2@0+1",
    "delay=0.05:0.5@0+3",
    "double:0.5@0+2",
    "drop@0+1.5",
)
_SPOILT = ("garble:0.1@0+2", "half:0.1@0+2", "garble:0.5@0+0.5")
_GAPS_S = (0.05, 0.07, 0.15, 0.45, 0.55, 3.0, 60.0)


class Checked:
    """Sees every setpoint before it goes to the driver."""

    def __init__(self, bench: Bench) -> None:
        self.count = self.first = 0
        self._bench = bench
        self._ranges = {one.channel: (one.minimum, one.maximum) for one in channel_settings(bench.robot)}
        outputs, robot = bench.robot.outputs, bench.robot
        self._units = dict(zip(outputs.channels, np.abs(outputs.per_rad), strict=True))
        self._speeds = dict(zip(outputs.channels, robot.speed_limits * np.abs(outputs.per_rad), strict=True))
        self._last: dict[int, tuple[float, float]] = {}
        self._read = 0
        self.poses: list[dict[int, float]] = [dict(outputs.outputs(robot.pose("rest")))]
        self._before = bench.outputs()

    def look(self) -> None:
        """Check what was sent since it last looked."""
        bench = self._bench
        for time, what, setpoints in bench.log[self._read :]:
            if what in ("open", "close", "release", "home"):
                self._last.clear()
            for channel, value in setpoints.items():
                self._check(channel, value, time)
        del bench.log[:]
        self._read = 0
        if not bench.now.commanded and bench.now.state in (State.OFF, State.FAULT, State.DISCONNECTED):
            self._last.clear()
        self._before = bench.outputs()

    def _check(self, channel: int, value: float, time: float) -> None:
        self.count += 1
        low, high = self._ranges[channel]
        assert low <= value <= high, f"{channel}: {value} is outside {low} … {high}"  # and no NaN
        if channel not in self._units:
            return  # the gripper: its gate is the same, its unit another
        before = self._last.get(channel)
        self._last[channel] = value, time
        if before is not None:
            step, allowed = abs(value - before[0]), self._speeds[channel] * min(time - before[1], _LONGEST_S)
            assert step <= allowed * (1 + 1e-6) + 1e-6, f"{channel}: {step} in {time - before[1]} s"
            return
        self.first += 1
        index = list(self._units).index(channel)
        stood = self._before[index]
        if np.isnan(stood):
            assert any(abs(value - pose[channel]) <= 1e-6 for pose in self.poses), "a pose that nobody named"
            return
        # What the board said twice may be a frame and a little rounding old.
        tolerance = self._speeds[channel] * _LONGEST_S + 0.01 * self._units[channel] + 2
        if self._bench.spoilt:  # answers without checksum may say anything, and the host believes two of them
            return
        assert abs(value - stood) <= tolerance, f"{channel}: first {value}, it stood at {stood}"


def command(bench: Bench, chance: random.Random) -> Command | None:
    """Mostly something that fits the state; None: STOP."""
    robot, now = bench.robot, bench.now
    low, high = robot.limits.T
    q = low + (high - low) * np.array([chance.uniform(-0.02, 1.02) for _ in range(robot.n)])
    near = now.q_command + np.array([chance.gauss(0.0, 0.05) for _ in range(robot.n)])
    rates = np.array([chance.uniform(-1.2, 1.2) for _ in range(robot.n)])
    anything: list[Command | None] = [
        None, Release(), Pause(), Resume(), Disconnect(), HomeAxes(), Enable(), ClearFault(), Connect(PORT),
        SetSpeed(chance.uniform(0.0, 1.2)), MoveJoints(np.full(robot.n, np.nan)), Enable(q), Enable(near),
    ]  # fmt: skip
    if chance.random() < 0.12:
        return chance.choice(anything)
    match now.state:
        case State.DISCONNECTED:
            return Connect(PORT)
        case State.FAULT:
            return Connect(PORT) if now.board is None else ClearFault()
        case State.OFF if not all(axis.homed for axis in now.homing):
            return HomeAxes()
        case State.OFF:
            return Enable(chance.choice([robot.pose("rest"), robot.pose("home")]))
        case _:
            steps = (
                MoveStep(joints_deg=tuple(np.degrees(np.clip(near, low, high)).tolist())),
                WaitStep(seconds=0.1),
                MoveStep(joints_deg=tuple(np.degrees(now.q_command).tolist())),
            )
            return chance.choice([
                MoveJoints(q), MoveJoints(near), MoveJoints(q, duration_s=chance.uniform(0.1, 8.0)),
                Jog(rates), Jog(rates), JogTool(rates[:3] * 0.1, rates[3], rates[4]), StreamJoints(near),
                StreamJoints(np.clip(near, low, high)), MoveGripper(chance.uniform(-0.1, 1.1)),
                RunProgram(Program(robot=robot.name, steps=steps)), None,
            ])  # fmt: skip


def trouble(bench: Bench, chance: random.Random) -> Callable[[], None]:
    """Something breaks; gives what makes it good."""
    spoilt = chance.random() < 0.3
    what = chance.choice(("line", "line", "unplug", "brown-out", "reset", "gap"))
    if what == "line":
        text = chance.choice(_SPOILT if spoilt else _LINE)
        bench.spoilt |= spoilt
        bench.seed = chance.randrange(1 << 30)
        bench.trouble(text)
        return bench.trouble
    if what == "unplug":
        bench.line.unplug()
        return bench.line.plug_in
    if what == "brown-out":
        bench.line.advance(bench.clock.now())
        bench.line.brown_out(chance.uniform(0.0, 0.6))
    elif what == "reset":
        bench.line.reset()
    else:
        bench.clock.advance(chance.choice(_GAPS_S))
    return lambda: None


@pytest.mark.parametrize("board", ["maestro", "firmata", "encoder"])
def test_no_setpoint_leaves_what_the_arm_is_allowed(
    board: str, bench_of: Callable[..., Bench], record_property: Callable[[str, object], None]
) -> None:
    sent = first = moved = faults = 0
    for seed in range(max(1, round(TICKS / 3 / _RUN))):
        bench = bench_of(board, None, seed)
        counts = one_run(bench, random.Random(seed))
        bench.close()
        sent, first, moved, faults = (
            a + b for a, b in zip((sent, first, moved, faults), counts, strict=True)
        )
    record_property(
        "figures", f"{sent} setpoints, {first} first ones, {moved} ticks in motion, {faults} faults"
    )
    assert sent > 1000
    assert first >= 10
    assert moved > 100
    assert faults >= 1


def one_run(bench: Bench, chance: random.Random) -> tuple[int, int, int, int]:
    """Setpoints, first ones, ticks in motion, faults."""
    checked = Checked(bench)
    mend: Callable[[], None] = lambda: None  # noqa: E731
    good_at, moved, faults = 0, 0, 0
    for tick in range(_RUN):
        if tick == good_at:
            mend()
        if chance.random() < 1 / _FAULT_EVERY and tick > good_at:
            mend, good_at = trouble(bench, chance), tick + chance.randrange(5, 100)
        if chance.random() < 1 / _COMMAND_EVERY:
            wanted = command(bench, chance)
            if isinstance(wanted, Enable) and wanted.q is not None:
                checked.poses = [*checked.poses[-3:], dict(bench.robot.outputs.outputs(wanted.q))]
            if wanted is None:
                bench.controller.stop(TEST)
            else:
                bench.controller.submit(wanted, TEST)
        before = bench.now.state
        bench.tick(chance.choice((0.02, 0.02, 0.02, 0.02, 0.019, 0.022, 0.003, 0.03, 0.05)))
        del bench.history[:]
        checked.look()
        moved += bench.now.velocity_command.any()
        faults += bench.now.state is State.FAULT and before is not State.FAULT
        assert np.isfinite(bench.now.q_command).all()
    return checked.count, checked.first, int(moved), int(faults)
