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
    """A long straight way in three parts."""
    legs = [leg(0.0, 0.4, 0.05), leg(0.4, 0.7, 0.05), leg(0.7, 1.0, 0.0)]
    return blend(ROBOT, legs).trajectories


def at_full_speed_before_the_end_of_the_first(first: PathTrajectory) -> PathMover:
    mover = PathMover(ROBOT, first, 1.0, tag="first", goes_on=True)
    mover.append(three()[1], "second", goes_on=True)
    mover.append(three()[2], "third", goes_on=False)
    for _ in range(int(first.duration / TICK) - 1):
        mover.advance(0.0, TICK)
    assert mover.tag == "first"
    return mover


def run(mover: PathMover) -> list[Setpoint]:
    seen: list[Setpoint] = []
    while (setpoint := mover.advance(0.0, TICK)) is not None:
        seen.append(setpoint)
    return seen


def test_what_has_not_begun_may_be_taken_back_for_something_else() -> None:
    first, second, third = three()
    mover = at_full_speed_before_the_end_of_the_first(first)
    mover.drop_from("second")
    assert mover.goes_on
    mover.append(second, "other", goes_on=True)
    mover.append(third, "last", goes_on=False)
    seen = run(mover)
    assert mover.done and mover.notice is None
    np.testing.assert_allclose(seen[-1].q, START + WAY, atol=1e-12)
    steps = np.diff([s.q[0] for s in seen])
    assert (steps > 0).all() and steps.max() <= ROBOT.speed_limits[0] * TICK * (1 + 1e-9)


def test_at_the_end_of_what_is_known_it_says_so_and_goes_on_from_rest() -> None:
    first, second, third = three()
    mover = at_full_speed_before_the_end_of_the_first(first)
    mover.drop_from("second")  # nothing is left to slow down on
    seen = run(mover)
    assert not mover.done and mover.standing and mover.goes_on
    np.testing.assert_allclose(seen[-1].q, first.end, atol=1e-12)
    assert not seen[-1].velocity.any()
    assert mover.notice is not None and "what comes next was not planned in time" in mover.notice
    mover.append(second, "second", goes_on=True)
    mover.append(third, "third", goes_on=False)
    rest = run(mover)
    assert mover.done
    np.testing.assert_allclose(rest[-1].q, START + WAY, atol=1e-12)
    pushes = np.abs([s.acceleration for s in rest])
    assert (pushes <= ROBOT.acceleration_limits * (1 + 1e-6)).all()


def test_where_nothing_follows_any_more_it_is_done_at_the_end_of_what_is_known() -> None:
    mover = at_full_speed_before_the_end_of_the_first(three()[0])
    mover.drop_from("second")
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
