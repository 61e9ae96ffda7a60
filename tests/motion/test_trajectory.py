from __future__ import annotations

import numpy as np
import pytest

from armctl.errors import InputError
from armctl.motion import JoinedTrajectory, PointToPoint

A = PointToPoint.lasting([0.0, 0.0], [1.0, -1.0], 2.0)
B = PointToPoint.lasting([1.0, -1.0], [2.0, 0.0], 1.5, "quintic")


def test_it_is_its_parts_one_after_the_other() -> None:
    joined = JoinedTrajectory([A, B])
    assert joined.duration == A.duration + B.duration
    assert np.array_equal(joined.start, A.start)
    assert np.array_equal(joined.end, B.end)
    assert joined.starts_at.tolist() == [0.0, 2.0]
    t = np.linspace(-0.5, joined.duration + 0.5, 77)
    many = joined.sample(t)
    for k, time in enumerate(t.tolist()):
        one = joined.sample(time)
        part = A.sample(time) if time <= A.duration else B.sample(time - A.duration)
        for name in ("q", "velocity", "acceleration"):
            assert np.array_equal(getattr(one, name), getattr(part, name))
            assert np.array_equal(getattr(many, name)[k], getattr(part, name))


def test_parts_must_meet() -> None:
    with pytest.raises(InputError, match=r"part 2 starts 57\.2958° away"):
        JoinedTrajectory([A, A])
    with pytest.raises(InputError, match="part 2 has 1 joints, the one before 2"):
        JoinedTrajectory([A, PointToPoint.lasting([1.0], [2.0], 1.0)])
    with pytest.raises(InputError, match="at least one part"):
        JoinedTrajectory([])
