"""The sampled workspace, its extent, and the search for extremes behind it."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.kinematics.kit import plain_forward, random_q

from armctl.arrays import FloatArray
from armctl.kinematics.samples import greatest, joint_samples
from armctl.kinematics.workspace import (
    WorkspaceShell,
    longest_levers,
    sample_workspace,
    workspace_extent,
)
from armctl.robot import Robot, load_robot

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


# The shell.

SHELLS = ("uzuner", "so101", "ur5", "humanoid", "mearm")


@pytest.fixture(scope="module", params=SHELLS)
def shelled(request: pytest.FixtureRequest) -> tuple[Robot, WorkspaceShell]:
    robot = load_robot(request.param)
    return robot, WorkspaceShell(robot.chain, robot.limits, robot.floor_z)


def tips_of(robot: Robot, count: int, seed: int) -> FloatArray:
    q = random_q(np.random.default_rng(seed), robot.limits, count)
    return robot.forward(q[robot.chain.keeps_turns(q)])[:, :3, 3]


def test_the_shell_holds_what_is_reached_and_nothing_else(shelled: tuple[Robot, WorkspaceShell]) -> None:
    robot, shell = shelled
    tips = tips_of(robot, 4000, 5)
    assert shell.holds(tips[tips[:, 2] > robot.floor_z + shell.cell_m]).mean() > 0.995
    assert not shell.holds(tips[tips[:, 2] < robot.floor_z - 1e-9]).any()
    # What it holds is no farther than two cells from where the tool was in far more configurations.
    low, high = tips.min(axis=0) - 0.05, tips.max(axis=0) + 0.05
    tried = np.random.default_rng(6).uniform(low, high, (3000, 3))
    held = tried[shell.holds(tried)]
    assert 50 < len(held) < 2900
    reached = cKDTree(tips_of(robot, 200_000, 7))
    away = reached.query(held)[0]
    assert np.quantile(away, 0.98) < 2 * shell.cell_m


@pytest.mark.parametrize("side", [-1, 1])
def test_the_shell_is_closed_but_where_it_is_cut_and_lies_behind_the_cut(
    shelled: tuple[Robot, WorkspaceShell], side: Literal[-1, 1]
) -> None:
    robot, shell = shelled
    q = robot.pose("home")
    cut, plane, cell = shell.cut(q, side), shell.plane(q), shell.cell_m
    local = (cut.vertices - plane[:3, 3]) @ plane[:3, :3]
    assert (side * local[:, 1]).min() > -1e-9
    tip = (robot.forward(q)[:3, 3] - plane[:3, 3]) @ plane[:3, :3]
    assert tip[0] > 0 and tip[1] == pytest.approx(0.0, abs=1e-9)
    # Sides of triangles that have one neighbour only: in the plane of the cut, on the floor, or on the axis.
    sides = np.sort(
        np.concatenate([cut.faces[:, [0, 1]], cut.faces[:, [1, 2]], cut.faces[:, [2, 0]]]), axis=1
    )
    sides, count = np.unique(sides, axis=0, return_counts=True)
    assert count.max() <= 2 or (count > 2).mean() < 0.01  # where two parts of it touch
    middle = local[sides[count == 1]].mean(axis=1)
    floor = cut.vertices[sides[count == 1]].mean(axis=1)[:, 2] - robot.floor_z
    in_plane, on_floor = np.abs(middle[:, 1]) < 1e-6, np.abs(floor) < 1e-6
    on_axis = np.hypot(middle[:, 0], middle[:, 1]) < cell
    assert (in_plane | on_floor | on_axis).all()
    assert len(cut.edge) > 20
    assert np.abs((cut.edge.reshape(-1, 3) - plane[:3, 3]) @ plane[:3, 1]).max() < 1e-6
    # Outwards of its triangles nothing is held, inwards something is.
    corners = cut.vertices[cut.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)
    large = size > 0.1 * cell**2
    centres, normals = corners[large].mean(axis=1), normals[large] / size[large, None]
    inside, outside = shell.holds(centres - 1.5 * cell * normals), shell.holds(centres + 1.5 * cell * normals)
    assert inside.mean() > 0.85 and outside.mean() < 0.15


def test_the_shell_ends_where_the_first_joint_does() -> None:
    robot = load_robot("abaas")
    q = np.tile(robot.pose("home"), (4, 1))
    for low, high in ((-30.0, 50.0), (20.0, 100.0)):  # too narrow for a way over the back
        limits = robot.limits.copy()
        limits[0] = np.radians([low, high])
        shell = WorkspaceShell(robot.chain, limits)
        q[:, 0] = np.radians([low - 4, low + 3, high - 3, high + 4])
        assert shell.holds(robot.forward(q)[:, :3, 3]).tolist() == [False, True, True, False]
