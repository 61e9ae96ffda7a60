from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TICK, Rig, fails, make_rig

from armctl.errors import InputError
from armctl.runtime import MoveGripper, MoveJoints, SetSpeed, State


def openings(rig: Rig) -> list[float]:
    return [(values[5] - 1000) / 1000 for _, values in rig.driver.writes if 5 in values]


def test_from_an_unknown_opening_it_goes_there_at_once(holding: Rig) -> None:
    assert holding.now.gripper is None
    holding.do(MoveGripper(0.3))
    holding.tick()
    assert openings(holding) == [pytest.approx(0.3)]
    assert holding.now.gripper == 0.3


def test_then_at_its_own_speed(holding: Rig) -> None:
    holding.do(MoveGripper(0.0))
    holding.tick()
    ticket = holding.do(MoveGripper(1.0))
    began = holding.now.stamp
    holding.until(lambda _: ticket.finished.done(), seconds=2)
    assert holding.now.stamp - began == pytest.approx(0.5, abs=1.5 * TICK)  # 200 %/s
    steps = np.diff(openings(holding))
    assert (steps <= 2.0 * TICK + 1e-9).all()
    assert openings(holding)[-1] == 1.0
    assert holding.now.state is State.HOLDING
    holding.sends_nothing(1)


def test_the_override_slows_it_down(holding: Rig) -> None:
    holding.do(SetSpeed(0.5))
    holding.do(MoveGripper(0.0))
    holding.tick()
    ticket = holding.do(MoveGripper(1.0))
    holding.run(0.8)
    assert not ticket.finished.done()
    holding.run(0.3)
    ticket.result(0)


def test_with_the_arm_moving_both_go_in_one_write(holding: Rig) -> None:
    holding.do(MoveGripper(0.0))
    holding.do(MoveJoints(ROBOT.pose("home")))
    holding.do(MoveGripper(1.0))
    holding.run(0.2)
    times = [t for t, _ in holding.driver.writes]
    assert len(times) == len(set(times))
    assert len(holding.driver.writes[-1][1]) == 6


def test_a_newer_command_takes_the_place_of_an_older_one(holding: Rig) -> None:
    holding.do(MoveGripper(0.0))
    first = holding.do(MoveGripper(1.0))
    second = holding.do(MoveGripper(0.5))
    fails(first.finished, "a newer gripper command took its place")
    holding.run(1)
    second.result(0)
    assert holding.now.gripper == 0.5


@pytest.mark.parametrize("opening", [-0.1, 1.1, np.nan])
def test_an_opening_that_cannot_be(holding: Rig, opening: float) -> None:
    holding.refuses(MoveGripper(opening), "outside 0 … 100 %", InputError)


def test_it_needs_power_and_a_gripper(rig: Rig) -> None:
    rig.refuses(MoveGripper(0.5), "not connected")
    bare = make_rig(robot=replace(ROBOT, gripper=None)).enable()
    bare.refuses(MoveGripper(0.5), "has no gripper")
