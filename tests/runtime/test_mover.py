"""The mover on trajectories that do not end at rest: what follows may change, or come too late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TICK, Rig, fails, make_rig

from armctl.facts import State
from armctl.motion import PathTrajectory, PiecewisePolynomial
from armctl.motion.blend import Leg, blend
from armctl.protocol import MoveGripper, MoveJoints, SetSpeed
from armctl.runtime.activity import Setpoint
from armctl.runtime.mover import PathMover

START = ROBOT.pose("home")
WAY = np.array([1.5, 0.0, 0.0, 0.0, 0.0])


def leg(begin: float, end: float, blend_m: float) -> Leg:
    path = PiecewisePolynomial([0.0, 1.0], np.stack([START + begin * WAY, (end - begin) * WAY])[None])
    return Leg(path, blend_m)


def three() -> tuple[PathTrajectory, ...]:
    """A long straight way in three parts, the second of which is too short to slow down on."""
    legs = [leg(0.0, 0.4, 1e-5), leg(0.4, 0.4001, 1e-5), leg(0.4001, 1.0, 0.0)]
    return blend(ROBOT, legs).trajectories


def at_full_speed_with_little_left() -> PathMover:
    first, second, _ = three()
    mover = PathMover(ROBOT, first, 1.0, tag="first")
    for _ in range(int(first.duration / TICK) - 1):
        mover.advance(0.0, TICK)
    mover.append(second, "second", goes_on=True)
    return mover


def run(mover: PathMover) -> list[Setpoint]:
    seen: list[Setpoint] = []
    while (setpoint := mover.advance(0.0, TICK)) is not None:
        seen.append(setpoint)
    return seen


def test_at_the_end_of_what_is_known_it_says_so_and_goes_on_from_rest() -> None:
    _, second, third = three()
    mover = at_full_speed_with_little_left()
    seen = run(mover)
    assert not mover.done and mover.standing and mover.goes_on
    np.testing.assert_allclose(seen[-1].q, second.end, atol=1e-12)
    assert not seen[-1].velocity.any()
    assert mover.notice is not None and "what comes next was not planned in time" in mover.notice
    mover.append(third, "third", goes_on=False)
    rest = run(mover)
    assert mover.done
    np.testing.assert_allclose(rest[-1].q, START + WAY, atol=1e-12)
    pushes = np.abs([s.acceleration for s in rest])
    assert (pushes <= ROBOT.acceleration_limits * (1 + 1e-6)).all()


def test_where_nothing_follows_any_more_it_is_done_at_the_end_of_what_is_known() -> None:
    mover = at_full_speed_with_little_left()
    run(mover)
    assert not mover.done
    mover.end()
    assert mover.done


def openings(rig: Rig) -> list[float]:
    return [(values[5] - 1000) / 1000 for _, values in rig.driver.writes if 5 in values]


def test_it_goes_at_its_own_speed(holding: Rig) -> None:
    assert holding.now.gripper == 0.5  # nobody had seen it: it came on half open
    holding.do(MoveGripper(0.0))
    holding.run(0.5)
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
    holding.do(MoveGripper(0.0))
    holding.run(0.5)
    holding.do(SetSpeed(0.5))
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


def test_it_needs_a_gripper() -> None:
    bare = make_rig(robot=replace(ROBOT, gripper=None)).enable()
    bare.refuses(MoveGripper(0.5), "has no gripper")
