"""A line that loses, delays, doubles, halves and garbles packets makes no arm jump; in simulated time."""

from __future__ import annotations

import os
import random
from collections import Counter

import pytest
from tests.hardware.bus_kit import BusBench, Moments

from armctl.errors import ArmctlError
from armctl.hardware.boards import board_type
from armctl.hardware.bus.board import BusBoard
from armctl.hardware.bus.packets import BROADCAST, Instruction
from armctl.hardware.faults import Fault
from armctl.robot import load_robot

PARTS = 5  # which several processes work on
RUNS, TICKS = (100, 350) if os.environ.get("ARMCTL_LONG") else (2, 60)
"""of each part: in a long run 10,000 faults a part"""
TROUBLE = 0.3
"""share of ticks at which something befalls the line"""
STEP, WANDER = 12.0, 550.0
"""steps that the goal moves in a tick, and in all"""
ROBOTS = {name: load_robot(name) for name in ("so101", "open_manipulator_x")}


class BadLine:
    """An arm on a line that somebody spoils at random; one in seven has two servos with one id."""

    def __init__(self, name: str, seed: int) -> None:
        self.rng, robot = random.Random(seed), ROBOTS[name]
        board = board_type(robot.board)
        assert isinstance(board, BusBoard)
        self.make = board.make()
        self.first = robot.outputs.channels[0]
        twin = {"twin": robot.outputs.channels[-1]} if seed % 7 == 3 else {}
        self.arm = BusBench(robot, {"echo": seed % 3 == 0, **twin})
        self.twins = bool(twin)
        self.befell = Counter[Fault]()
        self.middle = self.goal = self.target = float(self.arm.bus.servo(self.first).shaft)

    def run(self, ticks: int) -> None:
        """A stream of goals on the first joint, which is taken up again after each refusal."""
        arm, rng = self.arm, self.rng
        arm.open()
        self.moments = Moments(arm.bus)
        on = arm.enable() is None
        for _ in range(ticks):
            if rng.random() < TROUBLE:
                fault = rng.choice(list(Fault))
                arm.faulty.inject(fault, 1, rng.choice([0.002, 0.01, 0.05]))
                self.befell[fault] += 1
            if not on:
                on = self._taken_up()
            before = arm.bus.servo(self.first).shaft
            wanted = self.target + rng.choice([-1, 1]) * STEP
            self.target = min(self.middle + WANDER, max(self.middle - WANDER, wanted))
            self.goal += max(-STEP, min(STEP, self.target - self.goal))
            if on:
                arm.driver.write({self.first: self.goal})
            arm.ticks()
            self._require_inside()
            assert abs(arm.bus.servo(self.first).shaft - before) < 90
        assert max((steps for _, steps in self.moments.jumps), default=0.0) <= 1.0

    def _taken_up(self) -> bool:
        """Release, which may not be confirmed on such a line, and enable again."""
        arm = self.arm
        try:
            arm.driver.release()
        except ArmctlError:
            return False
        arm.ticks(2)
        on = arm.enable() is None
        self.goal = self.target = float(arm.back.positions[self.first] or self.middle)
        return on

    def _require_inside(self) -> None:
        """No goal that went out was beyond what the robot file allows its servo."""
        arm, make = self.arm, self.make
        size = make.table["goal_position"].size
        allowed = {one.channel: (one.minimum, one.maximum) for one in arm.setup.channels}
        for packet in arm.bus.heard:
            if packet.code != Instruction.SYNC_WRITE or packet.id != BROADCAST:
                continue
            if make.form.asked_size(packet) != (make.goal_address, size):
                continue
            rows = packet.data[2 * make.form.word :]
            for start in range(0, len(rows), size + 1):
                low, high = allowed[rows[start]]
                goal = make.table.decode("goal_position", rows[start + 1 : start + 1 + size])
                assert low <= goal <= high


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("name", ROBOTS)
def test_random_trouble_on_the_line_never_makes_an_arm_jump(name: str, part: int) -> None:
    befell = Counter[Fault]()
    for seed in range(part, PARTS * RUNS, PARTS):
        bad = BadLine(name, seed)
        try:
            bad.run(TICKS)
        except ArmctlError as error:
            assert bad.twins and "one id" in str(error), (seed, str(error))
        except AssertionError as error:
            raise AssertionError(seed) from error
        befell += bad.befell
    assert befell.total() > 0.1 * RUNS * TICKS


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("echo", [False, True], ids=["", "echo"])
def test_answers_of_all_servos_are_awaited_at_once(
    name: str, echo: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each wait for a piece of them would cost the computer what a tenth of a tick costs."""
    arm, board = BusBench(ROBOTS[name], {"echo": echo}).open(), board_type(ROBOTS[name].board)
    assert isinstance(board, BusBoard)
    read, waits = arm.line.read, list[tuple[int, int]]()

    def noted(count: int, timeout_s: float) -> bytes:
        data = read(count, timeout_s)
        if timeout_s:
            waits.append((count, len(data)))
        return data

    monkeypatch.setattr(arm.line, "read", noted)
    arm.driver.read()
    assert all(asked == came > len(arm.ids) for asked, came in waits)
    assert len(waits) == (2 if board.make().in_turn else 1)
