"""Shipped arms against what is published of them, at random poses: joints of a URDF file, or screw axes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armctl import load_robot
from armctl.arrays import FloatArray

KOCH = (
    # follower_arm_v1.1.urdf: origin [mm], its roll, pitch and yaw [quarter turns], axis
    ((0.5, -67.858, 41.066), (0, 0, 0), (0, 0, -1)),
    ((20.713, 0, 15.368), (1, 0, 0), (-1, 0, 0)),
    ((-38.026, -14.951, 108.424), (-1, 0, 0), (1, 0, 0)),
    ((-0.251, -100.502, 2.641), (-1, 0, 0), (1, 0, 0)),
    ((19.234, 0.37, -44.779), (0, 0, -1), (0, 0, -1)),
)
KOCH_TOOL_MM = (-8, 0, -65)
SCREWS = (
    # WidowX 250 6DOF, product of exponentials of its documentation: axis, and its moment [m]
    ((0, 0, 1), (0, 0, 0)),
    ((0, 1, 0), (-0.11065, 0, 0)),
    ((0, 1, 0), (-0.36065, 0, 0.04975)),
    ((1, 0, 0), (0, 0.36065, 0)),
    ((0, 1, 0), (-0.36065, 0, 0.29975)),
    ((1, 0, 0), (0, 0.36065, 0)),
)
SCREWS_TOOL_M = (0.458325, 0, 0.36065)


def placed(rotation: FloatArray, mm: tuple[float, ...]) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, np.array(mm) / 1000
    return T


def turned(axis: tuple[float, ...], angle: float) -> FloatArray:
    return placed(Rotation.from_rotvec(angle * np.array(axis)).as_matrix(), (0, 0, 0))


def koch(q: FloatArray) -> FloatArray:
    """The tool in our base frame: x ahead, which is -y of the file, and below the pan axis."""
    pose = placed(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]), (-67.858, -0.5, 0))
    for (mm, quarters, axis), angle in zip(KOCH, q, strict=True):
        pose = pose @ placed(
            Rotation.from_euler("xyz", 90 * np.array(quarters), degrees=True).as_matrix(), mm
        )
        pose = pose @ turned(axis, angle)
    return pose @ placed(np.diag([1.0, -1, -1]), KOCH_TOOL_MM)  # the file's tool points backwards


def widowx(q: FloatArray) -> FloatArray:
    """The tool: each axis turns what lies behind it, about the point of it that is nearest to the base."""
    pose = np.eye(4)
    for (axis, moment), angle in zip(SCREWS, q, strict=True):
        at = placed(np.eye(3), tuple(1000 * np.cross(axis, moment)))
        pose = pose @ at @ turned(axis, angle) @ np.linalg.inv(at)
    ahead = np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0.0]])  # the source's tool points along x
    return pose @ placed(ahead, tuple(1000 * np.array(SCREWS_TOOL_M)))


def lekiwi(q: FloatArray) -> FloatArray:
    """The SO-101, on the upper plate."""
    return placed(np.eye(3), (28.313, 0, 89.94)) @ load_robot("so101").forward(q)


@pytest.mark.parametrize("name", ["koch", "widowx250s", "lekiwi"])
def test_the_tool_is_where_the_maker_s_description_has_it(name: str) -> None:
    robot, maker = load_robot(name), {"koch": koch, "widowx250s": widowx, "lekiwi": lekiwi}[name]
    low, high = robot.limits.T
    for q in np.random.default_rng(52).uniform(low, high, (200, robot.n)):
        T, told = robot.forward(q), maker(q)
        assert 1000 * T[:3, 3] == pytest.approx(1000 * told[:3, 3], abs=0.005)
        assert T[:3, :3] == pytest.approx(told[:3, :3], abs=1e-5)
