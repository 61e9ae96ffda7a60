"""Many motions at once are the same as one by one, and nothing is missed between samples."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.kinematics.kit import plain_frames
from tests.motion.preflight.kit import brute_gap, random_arm

from armctl.errors import InputError
from armctl.motion import JoinedTrajectory, Trajectory
from armctl.motion.preflight import FLOOR_TOLERANCE_M, preflight, preflight_batch
from armctl.motion.preflight.batch import stacked_angles
from armctl.motion.profiles import PROFILES, PointToPoint
from armctl.robot import Robot, load_robot

FloatArray = NDArray[np.float64]
UZUNER, SCORBOT = load_robot("uzuner"), load_robot("scorbot")


def motions(robot: Robot, seed: int, count: int) -> list[Trajectory]:
    rng = np.random.default_rng(seed)
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (count + 1, robot.n))
    return [
        PointToPoint.plan(robot, a, b, None, PROFILES[k % len(PROFILES)])
        for k, (a, b) in enumerate(pairwise(q))
    ]


@pytest.mark.parametrize("robot", [UZUNER, SCORBOT, random_arm(3)], ids=lambda robot: robot.name)
def test_a_batch_is_the_motions_one_by_one(robot: Robot) -> None:
    many = motions(robot, 4, 60)
    many.append(JoinedTrajectory(many[:3]))
    many.append(PointToPoint.lasting(many[5].end, many[5].end, 0.0))
    many.append(PointToPoint.lasting(many[0].start, many[0].end + 9.0, 0.1))
    paths = [k % 2 == 0 for k in range(len(many))]
    together = preflight_batch(robot, many, 0.3, tool_paths=paths)
    apart = [preflight(robot, one, 0.3, tool_path=path) for one, path in zip(many, paths, strict=True)]
    assert [[str(f) for f in found] for found in together] == [[str(f) for f in found] for found in apart]
    assert {f.kind for found in together for f in found} >= {"limits", "speed", "acceleration", "singularity"}


def test_nothing_at_all() -> None:
    assert preflight_batch(UZUNER, []) == []
    with pytest.raises(InputError, match="need as many tool_paths"):
        preflight_batch(UZUNER, motions(UZUNER, 0, 2), tool_paths=[True])


def test_stacked_motions_are_those_of_their_samples() -> None:
    many = [m for m in motions(UZUNER, 8, 24) if isinstance(m, PointToPoint)]
    many.append(PointToPoint.lasting(many[0].end, many[0].end, 0.0))
    many.append(PointToPoint.each_for_itself(UZUNER, many[0].start, many[0].end))
    times = [np.linspace(0.0, m.duration, 2 + 4 * k) for k, m in enumerate(many)]
    stacked = stacked_angles(many, times)
    plain = np.concatenate([m.sample(time).q for m, time in zip(many, times, strict=True)])
    np.testing.assert_allclose(stacked, plain, atol=1e-12)


def dense(trajectory: Trajectory, count: int = 1500) -> FloatArray:
    return trajectory.sample(np.linspace(0.0, trajectory.duration, count)).q


@settings(max_examples=12)
@given(st.integers(0, 10_000))
def test_no_dip_below_the_floor_is_missed(seed: int) -> None:
    robot = random_arm(seed % 7) if seed % 2 else UZUNER
    for trajectory in motions(robot, seed, 3):
        q = dense(trajectory, 200)
        heights = np.array([lowest_corners(robot, row) for row in q]) - robot.floor_z
        allowed = np.minimum(heights[0], 0.0) - FLOOR_TOLERANCE_M
        lacking = float((allowed - heights).max())
        found = any(f.kind == "floor" for f in preflight(robot, trajectory))
        if lacking > 1e-3:
            assert found
        if lacking < -1e-3:
            assert not found


def lowest_corners(robot: Robot, q: FloatArray) -> list[float]:
    """Heights of origins and of the ends of a and d, by plain products."""
    chain = robot.chain
    frames = plain_frames(chain.rows, chain.convention, q)
    heights: list[float] = []
    for row, before, after in zip(chain.rows, frames[:-1], frames[1:], strict=True):
        corner = before @ ([row.a_m, 0, 0, 1] if chain.convention == "modified" else [0, 0, row.d_m, 1])
        heights += [corner[2], after[2, 3]]
    return heights


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_no_touch_is_missed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # folded more than not, so that many motions touch
    low, high = np.radians([[-20, 0, 80, -60, 0], [20, 35, 130, 0, 1]])
    a, b = rng.uniform(low, high, (2, 5))
    trajectory = PointToPoint.plan(SCORBOT, a, b)
    model = SCORBOT.collision
    pairs = [(model.capsules[i], model.capsules[j]) for i, j in model.pairs]
    gaps = np.array([[brute_gap(SCORBOT, *pair, q, 40) for pair in pairs] for q in dense(trajectory, 30)])
    lacking = float((np.minimum(gaps[0], 0.0) - gaps).max())
    found = any(f.kind == "self-collision" for f in preflight(SCORBOT, trajectory))
    if lacking > 0.008:  # what 40 points an axis can be wrong by
        assert found
    if lacking < -0.02:
        assert not found


def test_a_motion_of_another_arm_is_refused() -> None:
    with pytest.raises(InputError, match="uzuner has 5 joints, the trajectory has 2"):
        preflight_batch(UZUNER, [*motions(UZUNER, 0, 1), PointToPoint.lasting([0.0, 0.0], [1.0, 1.0], 1.0)])
