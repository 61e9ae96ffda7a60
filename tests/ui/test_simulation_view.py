from __future__ import annotations

import asyncio

import numpy as np
import pytest

from armctl.robot import load_robot
from armctl.ui.scene.cloud import CloudStore, workspace_cloud
from armctl.ui.scene.trail import Trail
from armctl.ui.widgets.joint_graph import JointHistory

ROBOT = load_robot("uzuner")


def test_the_trail_keeps_points_that_lie_apart_and_gives_those_since() -> None:
    trail = Trail()
    for x in (0.0, 0.001, 0.003, 0.006):
        trail.add(np.array([x, 0.0, 0.0]))
    assert trail.count == 3
    assert trail.since(0)[:, 0] == pytest.approx([0.0, 0.003, 0.006])
    assert trail.since(2)[:, 0] == pytest.approx([0.006])
    assert trail.since(3).shape == (0, 3)


def test_a_long_trail_forgets_its_beginning_but_counts_on() -> None:
    trail = Trail()
    for k in range(1000):
        trail.add(np.array([0.01 * k, 0.0, 0.0]))
    assert (trail.count, len(trail.since(0))) == (1000, 600)
    assert trail.since(990)[:, 0] == pytest.approx(0.01 * np.arange(990, 1000))


def test_the_cloud_lies_within_reach_above_the_floor_and_is_always_the_same() -> None:
    cloud = workspace_cloud(ROBOT, 2000)
    assert 1000 < len(cloud.points) <= 2000
    assert (cloud.points[:, 2] >= ROBOT.floor_z).all()
    shoulder = np.array([0.0, 0.0, 0.163])
    assert np.linalg.norm(cloud.points - shoulder, axis=1).max() < 0.331
    assert (cloud.manipulability >= 0).all()
    assert np.array_equal(cloud.points, workspace_cloud(ROBOT, 2000).points)


def test_colours_rise_with_the_value() -> None:
    cloud = workspace_cloud(ROBOT, 2000)
    for colouring, values in (("height", cloud.points[:, 2]), ("manipulability", cloud.manipulability)):
        green = cloud.colors(colouring)[np.argsort(values), 1].astype(int)  # type: ignore[arg-type]
        assert (np.diff(green) >= 0).all()
        assert green[0] < 10
        assert green[-1] > 220


def test_the_cloud_is_computed_once_for_all_pages() -> None:
    async def ask_twice() -> bool:
        store = CloudStore()
        first, second = await asyncio.gather(store.get(ROBOT), store.get(ROBOT))
        return first is second and await store.get(ROBOT) is first

    assert asyncio.run(ask_twice())


def test_the_graph_grows_to_twenty_seconds_and_then_scrolls() -> None:
    history = JointHistory(2)
    assert all(np.isfinite(part).all() for part in history.table())
    for k in range(100):
        history.add(100.0 + 0.1 * k, np.zeros(2), np.zeros(2))
    assert (np.ptp(history.table()[0]), history.full) == (pytest.approx(9.9), False)
    for k in range(100, 400):
        history.add(100.0 + 0.1 * k, np.zeros(2), np.zeros(2))
    times, commanded, _ = history.table()
    assert history.full
    assert times[-1] == pytest.approx(39.9)
    assert np.ptp(times) == pytest.approx(20.0, abs=0.11)
    assert len(times) == len(commanded)
    assert (np.diff(times) > 0).all()


def test_the_graph_is_in_degrees_and_holds_numbers_only() -> None:
    history = JointHistory(2)
    history.add(5.0, np.radians([1.0, 2.0]), np.array([np.nan, np.radians(2.5)]))
    history.add(5.0, np.zeros(2), np.zeros(2))  # the same tick again
    times, commanded, board = history.table()
    assert times.tolist() == [0.0]
    assert commanded[0] == pytest.approx([1.0, 2.0])
    assert board[0] == pytest.approx([1.0, 2.5])
