"""The sampled workspace, its extent, and the search for extremes behind it."""

from __future__ import annotations

import numpy as np
import pytest
from tests.kinematics.kit import plain_forward

from armctl.kinematics.samples import greatest, joint_samples
from armctl.kinematics.workspace import longest_levers, sample_workspace, workspace_extent
from armctl.robot import load_robot

NAMES = ("uzuner", "abaas", "scorbot", "mico", "humanoid")


@pytest.mark.parametrize("name", NAMES)
def test_every_point_is_that_of_a_configuration_inside_the_limits(name: str) -> None:
    robot = load_robot(name)
    cloud = sample_workspace(robot.chain, robot.limits, 1500)
    assert 1000 < len(cloud.points) <= 1800
    assert (cloud.q >= robot.limits[:, 0]).all() and (cloud.q <= robot.limits[:, 1]).all()
    plain = np.array([plain_forward(robot.chain, q)[:3, 3] for q in cloud.q[::50]])
    assert np.abs(plain - cloud.points[::50]).max() < 1e-12
    assert (cloud.manipulability >= 0).all() and cloud.manipulability.max() > 0
    again = sample_workspace(robot.chain, robot.limits, 1500)
    assert np.array_equal(cloud.points, again.points)
    for point in cloud.points[:: len(cloud.points) // 12]:
        assert robot.inverse(point, step=0.02).success


@pytest.mark.parametrize("name", NAMES)
def test_the_cloud_comes_close_to_the_ends_of_the_workspace_and_not_beyond(name: str) -> None:
    robot = load_robot(name)
    cloud = sample_workspace(robot.chain, robot.limits, 8000)
    extent = workspace_extent(robot.chain, robot.limits)
    base, axes = robot.chain.axes()
    sideways = np.linalg.norm(np.cross(axes[0], cloud.points - base[0]), axis=1)
    z = cloud.points[:, 2]
    near = 0.03 * extent.reach
    assert extent.reach - near < sideways.max() <= extent.reach + 1e-9
    assert extent.highest - near < z.max() <= extent.highest + 1e-9
    assert extent.lowest + near > z.min() >= extent.lowest - 1e-9


def test_the_points_are_spread_evenly() -> None:
    robot = load_robot("uzuner")
    points = sample_workspace(robot.chain, robot.limits, 2000).points
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    # random configurations crowd: there the closest tenth lies ten times closer
    assert np.quantile(apart.min(axis=1), 0.1) > 0.003


def test_known_extents() -> None:
    abaas, mico = load_robot("abaas"), load_robot("mico")
    extent = workspace_extent(abaas.chain, abaas.limits)
    assert extent.reach == pytest.approx(0.355, abs=1e-9)
    assert extent.highest == pytest.approx(0.460, abs=1e-9)
    assert workspace_extent(mico.chain, mico.limits).highest == pytest.approx(0.2755 + 0.5733, abs=1e-9)


def test_the_longest_levers_are_those_of_the_stretched_arm() -> None:
    robot = load_robot("abaas")
    levers = longest_levers(robot.chain, robot.limits)
    assert levers == pytest.approx([0.355, 0.355, 0.25, 0.15, 0.0], abs=1e-9)


def test_the_greatest_value_is_found_inside_and_at_the_limits() -> None:
    limits = np.array([[-1.0, 2.0], [-1.0, 1.0], [0.5, 0.5]])

    def hill(q: np.ndarray) -> np.ndarray:
        return np.cos(q[:, 0] - 0.3) + np.sin(q[:, 1]) + q[:, 2]

    value, at = greatest(hill, limits)
    assert at == pytest.approx([0.3, 1.0, 0.5], abs=1e-6)
    assert value == pytest.approx(1.0 + np.sin(1.0) + 0.5, abs=1e-12)


def test_samples_stay_inside_reach_the_limits_and_hold_what_is_held() -> None:
    limits = np.array([[-1.0, 2.0], [0.3, 0.3], [0.0, 0.5]])
    q = joint_samples(limits, 999)
    assert q.shape == (999, 3)
    assert (q >= limits[:, 0]).all() and (q <= limits[:, 1]).all()
    assert set(q[:, 1]) == {0.3}
    for k in (0, 2):
        assert limits[k, 0] in q[:, k] and limits[k, 1] in q[:, k]
    assert np.array_equal(q, joint_samples(limits, 999))
    assert not np.array_equal(q, joint_samples(limits, 999, seed=1))
    assert np.array_equal(joint_samples(limits[1:2], 3), np.full((3, 1), 0.3))
