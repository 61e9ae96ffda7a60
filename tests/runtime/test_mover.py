"""The mover on trajectories that do not end at rest: what follows may change, or come too late."""

from __future__ import annotations

import numpy as np
from tests.runtime.kit import ROBOT, TICK

from armctl.motion import PathTrajectory, PiecewisePolynomial, PointToPoint
from armctl.motion.blend import Leg, blend
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


def test_a_thousand_trajectories_take_no_more_room_than_one() -> None:
    step = PointToPoint.lasting(START, START, 2 * TICK)
    mover = PathMover(ROBOT, step, 1.0, goes_on=False)
    for number in range(1000):
        mover.append(step, number, goes_on=False)
        for _ in range(2):
            mover.advance(0.0, TICK)
    assert len(mover._stretches) <= 2
