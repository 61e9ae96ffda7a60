from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.motion import (
    JoinedTrajectory,
    PathTrajectory,
    PiecewisePolynomial,
    PointToPoint,
    Sample,
    SlowedTrajectory,
    Trajectory,
)
from armctl.motion.trajectory import peaks_of
from armctl.program import MoveStep, Program

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


@dataclass
class Sway:
    """A caller's own: 1 - cos, there and back."""

    duration: float = 2.0
    breaks: BaseException | None = None
    slope: float | np.ndarray = 1.0

    @property
    def start(self) -> np.ndarray:
        return np.zeros(2)

    end = start

    def sample(self, t: float | np.ndarray) -> Sample:
        if self.breaks is not None:
            raise self.breaks
        w = np.pi
        x = w * np.asarray(t)[..., None] * np.ones(2)
        q, v, a, j = 1 - np.cos(x), w * np.sin(x), w**2 * np.cos(x), -(w**3) * np.sin(x)
        return Sample(q, v * self.slope, a, j)


LINE = PiecewisePolynomial([0.0, 2.0], [[[0.0, 0.0], [1.0, 2.0]]])
MOTIONS: list[Trajectory] = [
    A,
    PathTrajectory(LINE, PiecewisePolynomial([0.0, 1.0], [[[0.0], [2.0]]])),
    JoinedTrajectory([A, B]),
    SlowedTrajectory(JoinedTrajectory([A, B]), 2.0),
]


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: type(motion).__name__)
def test_a_motion_is_pickled_copied_and_compared(motion: Trajectory) -> None:
    times = np.linspace(0.0, motion.duration, 7)
    for other in (pickle.loads(pickle.dumps(motion)), copy.copy(motion), copy.deepcopy(motion)):
        assert (other, hash(other), repr(other)) == (motion, hash(motion), repr(motion))
        assert other.sample(times) == motion.sample(times)
        assert peaks_of(other) == peaks_of(motion)
        assert not other.start.flags.writeable
    assert motion != SlowedTrajectory(motion, 1.5)
    assert all(motion != another for another in MOTIONS if another is not motion)


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_state_at_one_time_is_what_it_is_among_many(motion: Trajectory) -> None:
    inside = np.random.default_rng(0).uniform(0.0, motion.duration, 60)
    times = [-0.1, 0.0, *inside.tolist(), motion.duration, motion.duration + 0.1]
    many = motion.sample(np.array(times))
    for k, time in enumerate(times):
        one = motion.sample(time)
        for alone, among in zip(one.made_of(), many.made_of(), strict=True):
            np.testing.assert_array_equal(alone, among[k], strict=True)


def test_motions_say_in_a_line_what_they_are() -> None:
    assert repr(A) == "PointToPoint(2.000 s, from (0.0, 0.0)° to (57.3, -57.3)°)"
    joined = JoinedTrajectory([A, B])
    assert repr(joined) == "JoinedTrajectory(3.500 s, from (0.0, 0.0)° to (114.6, 0.0)°)"
    assert repr(A.way) == "PiecewisePolynomial(1 piece of degree 3 over 0 … 2, 2 coordinates)"


def test_targets_and_programs_are_pickled_and_compared() -> None:
    for value in (
        Target.of([0.2, 0, 0.1], -1.0, 0.5),
        Target.of([0.2, 0, 0.1], rotation=np.eye(3)),
        Program(robot="uzuner", steps=(MoveStep(joints_deg=(0.0, 1.0)),)),
    ):
        other = pickle.loads(pickle.dumps(value))
        assert (other, hash(other)) == (value, hash(value))
    turned = Target.of([0.2, 0, 0.1], rotation=np.diag([1.0, -1.0, -1.0]))
    assert Target.of([0.2, 0, 0.1], rotation=np.eye(3)) != turned
    assert turned != (0.2, 0.0, 0.1)


def test_a_motion_of_a_callers_own_is_met_between_the_samples() -> None:
    sway = Sway()
    same, times = PathTrajectory.sampled(sway), np.linspace(0.0, 2.0, 1001)
    found, true = same.sample(times), sway.sample(times)
    assert same.duration == 2.0
    for name, close in (("q", 1e-11), ("velocity", 1e-9), ("acceleration", 1e-6)):
        np.testing.assert_allclose(getattr(found, name), getattr(true, name), atol=close)
    assert PathTrajectory.sampled(Sway(0.0)).duration == 0.01


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        (Sway(breaks=SystemExit(3)), "cannot be sampled: SystemExit: 3"),
        (Sway(breaks=ZeroDivisionError("division")), "cannot be sampled: ZeroDivisionError: division"),
        (Sway(duration=float("nan")), "duration of a motion must be a finite number"),
        (Sway(slope=np.ones((3, 1, 1))), r"201 times need states \(k, n\)"),
        (Sway(slope=np.inf), "finite numbers"),
    ],
)
def test_what_breaks_in_a_motion_of_a_callers_own_is_said(motion: Sway, says: str) -> None:
    with np.errstate(invalid="ignore"), pytest.raises(InputError, match=says):
        PathTrajectory.sampled(motion)
