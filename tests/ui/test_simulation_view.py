from __future__ import annotations

import asyncio
import re

import numpy as np
import pytest

from armctl.robot import load_robot
from armctl.ui.tabs.simulation.screen import Trail
from armctl.ui.tabs.simulation.workspace import (
    CloudStore,
    cloud_html,
    in_plane,
    section_svg,
    section_words,
    workspace_cloud,
)

ROBOT = load_robot("uzuner")


def trail_of(*x: float) -> Trail:
    """Of tool points on the x axis; NaN: not known."""
    trail = Trail()
    for value in x:
        trail.add(np.array([value, 0.0, 0.0]) if np.isfinite(value) else np.full(3, np.nan))
    return trail


def test_the_trail_keeps_points_that_lie_apart_and_leaves_out_what_is_not_known() -> None:
    trail = trail_of(0.0, 0.001, 0.003, 0.006)
    assert trail.count == 3
    assert trail.since(2)[:, 0] == pytest.approx([0.006])
    assert trail.since(3).shape == (0, 3)
    trail = trail_of(*(0.01 * k for k in range(1000)))  # a long one forgets its beginning but counts on
    assert (trail.count, len(trail.since(0))) == (1000, 600)
    assert trail.since(990)[:, 0] == pytest.approx(0.01 * np.arange(990, 1000))
    trail = trail_of(np.nan, 0.0, np.nan, np.nan, 0.0)  # near the last one, but after a gap
    assert trail.count == 3
    assert trail.since(0)[:, 0] == pytest.approx([0.0, np.nan, 0.0], nan_ok=True)


def test_the_cloud_lies_within_reach_above_the_floor_and_is_coloured_by_its_values() -> None:
    cloud = workspace_cloud(ROBOT, 2000)
    assert 1000 < len(cloud.points) <= 2200
    assert (cloud.points[:, 2] >= ROBOT.floor_z).all()
    shoulder = np.array([0.0, 0.0, 0.163])
    assert 0.320 < np.linalg.norm(cloud.points - shoulder, axis=1).max() < 0.331
    assert (cloud.manipulability >= 0).all()
    assert np.array_equal(cloud.points, workspace_cloud(ROBOT, 2000).points)
    for colouring, values in (("height", cloud.points[:, 2]), ("manipulability", cloud.manipulability)):
        green = cloud.colors(colouring)[np.argsort(values), 1].astype(int)
        assert (np.diff(green) >= 0).all()
        assert green[0] < 10 and green[-1] > 220
    html = cloud_html(ROBOT, cloud, "height")
    assert "<b>330 mm</b> from the base axis" in html
    assert "<b>−49</b> to <b>493 mm</b>" in html
    assert "below the floor (0 mm) is left out" in html


def test_the_cloud_is_computed_once_for_all_pages() -> None:
    async def ask_twice() -> bool:
        store = CloudStore(ROBOT)
        first, second = await asyncio.gather(store.get(), store.get())
        return first is second and await store.get() is first

    assert asyncio.run(ask_twice())


@pytest.mark.parametrize(("name", "words"), [("abaas", "exact boundary"), ("humanoid", "Sampled")])
def test_the_section_is_drawn_to_scale_with_floor_and_tip(name: str, words: str) -> None:
    robot = load_robot(name)
    cloud = workspace_cloud(robot, 500)
    assert words in section_words(cloud)
    for pose in ("home", "rest"):
        q = robot.pose(pose)
        T = cloud.section.plane(q)
        outline, arm, floor = in_plane(robot, T, cloud.section.outline(q), q)
        x, y, z = (1000 * robot.forward(q)[:3, 3]).tolist()
        assert arm[-1] == pytest.approx((np.hypot(x, y), z), abs=1e-6)
        assert floor == 1000 * robot.floor_z
        corners = np.concatenate(outline)
        assert corners[:, 1].max() == pytest.approx(
            1000 * cloud.extent.highest, abs=0.3 if name == "abaas" else 15
        )
        svg = section_svg(outline, arm, floor)
        assert svg.count("<path") == 1 and svg.count("<circle") == 1 and ">floor<" in svg
        assert svg.count("M") == len(outline)
        assert "nan" not in svg
        labels = [float(text.replace("−", "-")) for text in re.findall(r">(−?\d+)</text>", svg)]
        assert min(labels) >= corners.min() - 120 and max(labels) <= corners.max() + 120
        assert 6 <= len(labels) <= 24
