"""What is the best is the best: nothing that another search finds is better."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from benchmarks.best_solutions import compared
from benchmarks.own_search import Search

from armctl import load_robot
from armctl.kinematics.angles import rotation_angle

LONG = bool(os.environ.get("ARMCTL_LONG"))
_SAME = 2e-6
"""[s] or [rad]"""


@pytest.mark.parametrize("work", ["time", "travel"])
@pytest.mark.parametrize("name", ["uzuner", "humanoid", "so101", "ur5", "ar4", "mico", "uarm"])
def test_no_search_finds_a_shorter_way_to_a_point(name: str, work: str) -> None:
    for mine, least in compared(load_robot(name), work, 3 if LONG else 1, np.random.default_rng(31)):
        assert mine <= 1.001 * least + _SAME


@pytest.mark.parametrize("name", ["ur5", "parol6", "so101"])
def test_no_search_finds_a_shorter_time_with_a_pitch(name: str) -> None:
    for mine, least in compared(
        load_robot(name), "time", 2 if LONG else 1, np.random.default_rng(32), "pitch"
    ):
        assert mine <= 1.001 * least + _SAME


@pytest.mark.parametrize("name", ["uzuner", "humanoid", "so101", "ur5"])
def test_no_search_comes_nearer_to_an_orientation(name: str) -> None:
    for mine, least in compared(load_robot(name), "orientation", 2 if LONG else 1, np.random.default_rng(33)):
        assert mine <= least + _SAME


def test_a_nearest_orientation_beside_a_limit_is_not_short_of_the_nearest() -> None:
    """A few degrees from one that the arm has: a search that stops early is 0.03° off."""
    robot = load_robot("so101")
    rng = np.random.default_rng(5)
    for i in range(4):
        q = rng.uniform(*robot.limits.T)
        q[4] = robot.limits[4, i % 2]
        T = robot.forward(q)
        turn = 0.3 * rng.normal(size=3)
        angle = float(np.linalg.norm(turn))
        x, y, z = turn / angle
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = (np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K)) @ T[:3, :3]
        found = robot.inverse(T[:3, 3], rotation=rotation)
        best = int(found.residual_rad.argmin())
        search = Search(robot, T[:3, 3])
        for begin in (found.q[best], q):
            least, at = search.nearest_rotation(rotation, begin)
            assert found.residual_rad[best] <= least + _SAME
            if math.isfinite(least):
                assert rotation_angle(robot.forward(at)[:3, :3].T @ rotation) == pytest.approx(
                    least, abs=1e-9
                )


def test_of_ways_that_take_the_same_time_the_one_of_least_travel_is_taken() -> None:
    """The base alone sets the time: the others need not turn for nothing."""
    robot = load_robot("uzuner")
    start = robot.pose("home")
    there = start + np.radians([80.0, 3.0, -2.0, 1.0, 0.0])
    there = np.clip(there, *robot.limits.T)
    found = robot.inverse(robot.forward(there)[:3, 3], start=start)
    best = found.best("shortest-time", start)
    time, travel = (found.energies(one, start) for one in ("shortest-time", "least-travel"))
    quick = time < time.min() + 1e-9
    assert np.count_nonzero(quick) > 1
    spent = (np.abs(best - start) / robot.speed_limits).sum()
    assert spent <= travel[quick].min() + 1e-9


def test_a_shortest_time_is_found_on_the_far_side_of_the_roll() -> None:
    """Where roll and wrist turn the tool alike, the way there leads over worse postures."""
    robot = load_robot("so101")
    start = np.radians([-69.0583, -84.6589, 36.9962, 78.9544, -146.2528])
    known = np.radians([-85.0258, -99.9999, -76.5217, -13.9801, -157.21])
    search = Search(robot, robot.forward(known)[:3, 3])
    found = robot.inverse(search.point, start=start).best("shortest-time", start)
    assert search.time(found, start) <= 1.001 * search.time(known, start)
