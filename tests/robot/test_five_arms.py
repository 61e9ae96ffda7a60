"""The shipped arms against plain 4 x 4 products in each row's own convention, and each pose back again."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from tests.arms import FIVE
from tests.robot.urdf_kit import turn

from armctl import Robot, load_robot
from armctl.arrays import FloatArray
from armctl.kinematics import DHRow, Solutions

LONG = bool(os.environ.get("ARMCTL_LONG"))
CONFIGURATIONS = 100_000 if LONG else 300


def plain_row(row: DHRow, convention: str, q: FloatArray) -> FloatArray:
    """(k, 4, 4) of one row at joint angles (k,), written out from the definition of each convention."""
    theta = row.theta_rad + q
    zero = np.zeros_like(q)
    c, s, one = np.cos(theta), np.sin(theta), np.ones_like(q)
    ca, sa, a, d = np.cos(row.alpha_rad), np.sin(row.alpha_rad), row.a_m, row.d_m
    if convention == "standard":  # Rz Tz Tx Rx
        entries = [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [zero, zero + sa, zero + ca, zero + d],
        ]
    else:  # Rx Tx Rz Tz
        entries = [
            [c, -s, zero, zero + a],
            [s * ca, c * ca, zero - sa, zero - sa * d],
            [s * sa, c * sa, zero + ca, zero + ca * d],
        ]
    entries.append([zero, zero, zero, one])
    return np.moveaxis(np.array(entries), -1, 0)


def plain_forward(robot: Robot, q: FloatArray) -> FloatArray:
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    joint = 0
    for row in robot.chain.rows:
        angle = q[:, joint] if row.joint else np.zeros(len(q))
        joint += row.joint
        T = T @ plain_row(row, robot.chain.convention, angle)
    return T


def configurations(robot: Robot, count: int, seed: int) -> FloatArray:
    """Inside the limits; a third of them with joints at limits, at 0° or ±90°: singular poses."""
    rng = np.random.default_rng(seed)
    low, high = robot.limits.T
    q = rng.uniform(low, high, (count, robot.n))
    special = np.stack(
        [low, high, *(np.clip(np.full(robot.n, v), low, high) for v in (0, np.pi / 2, -np.pi / 2))]
    )
    which = rng.integers(len(special), size=q.shape)
    chosen = np.take_along_axis(special, which, axis=0)
    singular = (rng.random(q.shape) < 0.5) & (rng.random(count) < 1 / 3)[:, None]
    return np.where(singular, chosen, q)


@pytest.fixture(params=FIVE)
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def test_forward_of_many_configurations(robot: Robot) -> None:
    q = configurations(robot, CONFIGURATIONS, 1)
    expected = plain_forward(robot, q)
    assert np.abs(robot.forward(q) - expected).max() < 1e-12
    assert (
        max(np.abs(robot.forward(one) - T).max() for one, T in zip(q[:500], expected, strict=False)) < 1e-12
    )


def test_jacobian_against_central_differences(robot: Robot) -> None:
    q = configurations(robot, CONFIGURATIONS, 2)
    J, step = robot.jacobian(q), 1e-6
    T = plain_forward(robot, q)
    for k in range(robot.n):
        ahead, behind = q.copy(), q.copy()
        ahead[:, k] += step
        behind[:, k] -= step
        rate = (plain_forward(robot, ahead) - plain_forward(robot, behind)) / (2 * step)
        spin = rate[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
        angular = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        assert np.abs(J[:, :3, k] - rate[:, :3, 3]).max() < 1e-6
        assert np.abs(J[:, 3:, k] - angular).max() < 1e-6


@pytest.mark.slow
def test_every_pose_leads_back_to_its_configuration(robot: Robot) -> None:
    """Position and rotation of many configurations: none may be lost, singular ones included."""
    q = configurations(robot, CONFIGURATIONS, 3)
    T = plain_forward(robot, q)
    found = [robot.inverse(pose[:3, 3], rotation=pose[:3, :3]) for pose in T]
    listed = [contains(robot, *one) for one in zip(found, q, T, strict=True)]
    assert_none_is_lost(robot, q, T, found, listed)


@pytest.mark.slow
def test_position_pitch_and_roll_lead_back_too(robot: Robot) -> None:
    q = configurations(robot, CONFIGURATIONS, 4)
    T = plain_forward(robot, q)
    asked = [robot.inverse_kinematics.pitch_and_roll(one) for one in q]
    found = [robot.inverse(pose[:3, 3], *angles) for pose, angles in zip(T, asked, strict=True)]
    listed = [among(robot, one, *rest) for one, *rest in zip(found, q, asked, strict=True)]
    assert_none_is_lost(robot, q, T, found, listed)


def assert_none_is_lost(
    robot: Robot, q: FloatArray, T: FloatArray, found: list[Solutions], listed: list[bool]
) -> None:
    lost: list[str] = []
    for one, solutions, off_m, there in zip(q, found, farthest_off(robot, found, T), listed, strict=True):
        if not solutions.success:
            lost.append(f"{np.degrees(one)}: {solutions.reason}")
        elif off_m > 1e-9:
            lost.append(f"{np.degrees(one)}: off its point")
        elif not there:
            lost.append(f"{np.degrees(one)}: not among {np.degrees(solutions.q).round(4).tolist()}")
    assert not lost, f"{len(lost)} lost, for example {lost[:5]}"


def farthest_off(robot: Robot, found: list[Solutions], T: FloatArray) -> list[float]:
    """How far (m) the farthest solution for each pose is off its point, by plain products; inf: none."""
    reached = plain_forward(robot, np.concatenate([solutions.q for solutions in found]))
    ends = np.cumsum([len(solutions.q) for solutions in found])
    return [
        float(np.abs(poses[:, :3, 3] - pose[:3, 3]).max()) if len(poses) else math.inf
        for poses, pose in zip(np.split(reached, ends[:-1]), T, strict=True)
    ]


def among(
    robot: Robot, solutions: Solutions, q: FloatArray, asked: tuple[float | None, float | None]
) -> bool:
    """``q`` is listed; where position, pitch and roll do not determine it, all that is listed has them."""
    found, (pitch, roll) = solutions.q, asked
    away = np.abs(found - q).max(axis=1).min(initial=np.inf)
    if away < 1e-6:
        return True
    J, z = robot.jacobian(q), robot.forward(q)[:3, 2]
    task = [*J[:3], np.cross(z, [0, 0, 1]) @ J[3:]]  # the elevation of z changes with (z x up) . omega
    if roll is not None:
        task.append(np.eye(robot.n)[-1])
    smallest = np.linalg.svd(np.array(task), compute_uv=False)[robot.n - 1]
    if away < 1e-4 and smallest <= 1e-2:
        return True
    alike = [robot.inverse_kinematics.pitch_and_roll(one) for one in found]
    return smallest < 1e-6 and all(
        abs((p or 0) - (pitch or 0)) < 1e-6 and abs(math.remainder((r or 0) - (roll or 0), math.tau)) < 1e-6
        for p, r in alike
    )


@pytest.mark.slow
def test_a_pose_off_the_manifold_is_met_in_position_and_nearly_in_orientation(robot: Robot) -> None:
    """The pose of a configuration turned by 0.5°: it misses that by 0.5°, so the nearest may miss no more."""
    rng = np.random.default_rng(5)
    q = configurations(robot, 1000 if LONG else 300, 5)
    T = plain_forward(robot, q)
    found: list[Solutions] = []
    for pose in T:
        axis = rng.normal(size=3)
        wanted = turn(axis, math.radians(0.5))[:3, :3] @ pose[:3, :3]
        found.append(robot.inverse(pose[:3, 3], rotation=wanted))
    for one, solutions, off_m in zip(q, found, farthest_off(robot, found, T), strict=True):
        where = np.degrees(one)
        assert solutions.success, where
        assert off_m < 1e-9, where
        # tangent to the base axis a square root leaves 1e-8 rad
        assert np.degrees(solutions.residual_rad.min()) <= 0.5 + 1e-5, where


def contains(robot: Robot, solutions: Solutions, q: FloatArray, pose: FloatArray) -> bool:
    """``q`` is listed; where the pose does not determine it (singular), a solution with the same pose is."""
    found = solutions.q
    away = np.abs(found - q).max(axis=1).min(initial=np.inf)
    if away < 1e-6:
        return True
    smallest = np.linalg.svd(robot.jacobian(q), compute_uv=False)[-1]
    if away < 1e-4 and smallest <= 1e-2:
        return True
    if smallest > 1e-6:
        return False
    return bool(np.abs(plain_forward(robot, found) - pose).max(axis=(1, 2)).min(initial=np.inf) < 1e-7)
