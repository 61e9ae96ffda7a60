from __future__ import annotations

import numpy as np

from armctl.motion import PointToPoint
from armctl.runtime.mover import Track

A = PointToPoint.lasting([0.0], [1.0], 1.0)
B = PointToPoint.lasting([1.0], [3.0], 2.0, "quintic")
C = PointToPoint.lasting([3.0], [0.0], 0.7)


def make() -> Track:
    track = Track()
    for number, trajectory in enumerate((A, B, C)):
        track.append(trajectory, number)
    return track


def test_one_time_axis() -> None:
    track = make()
    assert track.end == A.duration + B.duration + C.duration
    times = np.array([0.0, 0.5, 1.0, 1.5, 2.9, 3.0, 3.1, 3.7, 9.0])
    expected = [
        *A.sample(times[:3]).q,
        *B.sample(times[3:6] - 1).q,
        *C.sample(times[6:] - 3).q,
    ]
    state = track.sample(times)
    np.testing.assert_allclose(state.q, expected, atol=1e-12)
    assert state.velocity.shape == state.acceleration.shape == state.jerk.shape == (9, 1)
    np.testing.assert_allclose(state.velocity[4], B.sample(1.9).velocity, atol=1e-12)


def test_what_lies_behind_is_forgotten_and_the_last_one_stays() -> None:
    track = make()
    assert (track.tag, track.goal[0], track.left(0.25), track.progress(0.25)) == (0, 1.0, 0.75, 0.25)
    track.forget(1.0)
    assert (track.tag, track.goal[0], track.left(2.0), track.progress(2.0)) == (1, 3.0, 1.0, 0.5)
    np.testing.assert_allclose(track.sample(np.array([3.2])).q, C.sample(np.array([0.2])).q, atol=1e-12)
    track.forget(100.0)
    assert (track.tag, track.left(100.0), track.progress(100.0)) == (2, 0.0, 1.0)
    np.testing.assert_array_equal(track.sample(np.array([100.0])).q[0], C.end)


def test_a_thousand_trajectories_take_no_more_room_than_one() -> None:
    track = Track()
    for k in range(1000):
        track.append(A, k)
        track.forget(float(k))
    assert len(track._stretches) <= 2


def test_a_trajectory_of_no_duration_is_passed_over() -> None:
    track = Track()
    track.append(PointToPoint.lasting([0.0], [0.0], 0.0), "nothing")
    track.append(A, "something")
    track.forget(0.0)
    assert track.tag == "something"
    np.testing.assert_allclose(track.sample(np.array([0.5, 1.0])).q[:, 0], [0.5, 1.0])


def test_what_has_not_begun_can_be_dropped() -> None:
    track = make()
    track.drop_from(1)
    assert (track.tag, track.end) == (0, A.duration)
    track.append(B, "again")
    assert track.end == A.duration + B.duration
    np.testing.assert_allclose(track.sample(np.array([2.0])).q, B.sample(np.array([1.0])).q, atol=1e-12)
