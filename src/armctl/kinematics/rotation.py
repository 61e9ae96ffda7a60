"""Rotations in the forms that people and programs read."""

from __future__ import annotations

import math

import numpy as np

from armctl.arrays import FloatArray


def roll_pitch_yaw(rotation: FloatArray) -> FloatArray:
    """Roll, pitch, yaw [rad] with ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    Args:
        rotation: (..., 3, 3).

    Returns:
        (..., 3). At pitch = ±90°, where only yaw ∓ roll is defined, yaw is 0.
    """
    sin_pitch = -rotation[..., 2, 0]
    cos_pitch = np.hypot(rotation[..., 2, 1], rotation[..., 2, 2])
    pitch = np.arctan2(sin_pitch, cos_pitch)
    locked = cos_pitch < 1e-9
    roll = np.where(
        locked,
        np.arctan2(-rotation[..., 1, 2], rotation[..., 1, 1]),
        np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2]),
    )
    yaw = np.where(locked, 0.0, np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0]))
    return np.stack([roll, pitch, yaw], axis=-1)


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """``Rz(yaw) Ry(pitch) Rx(roll)`` (3, 3) from angles [rad]."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def quaternion_wxyz(rotation: FloatArray) -> FloatArray:
    """Unit quaternion (4,) ``w, x, y, z`` of one rotation (3, 3); w is not negative (Shepperd's method)."""
    m = rotation
    trace = float(m[0, 0] + m[1, 1] + m[2, 2])
    squares = [trace, float(m[0, 0]), float(m[1, 1]), float(m[2, 2])]
    k = max(range(4), key=squares.__getitem__)
    if k == 0:
        q = np.array([1 + trace, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    else:
        i, j, h = k - 1, k % 3, (k + 1) % 3
        q = np.zeros(4)
        q[0] = m[h, j] - m[j, h]
        q[1 + i] = 1 + m[i, i] - m[j, j] - m[h, h]
        q[1 + j] = m[j, i] + m[i, j]
        q[1 + h] = m[h, i] + m[i, h]
    q /= np.linalg.norm(q)
    return -q if q[0] < 0 else q


def quaternion_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product (4,) ``a b`` of two quaternions ``w, x, y, z``: b turns first."""
    (w, u), (v, t) = (a[0], a[1:]), (b[0], b[1:])
    return np.array([w * v - u @ t, *(w * t + v * u + np.cross(u, t))])


def rotation_angle(rotation: FloatArray) -> FloatArray:
    """Angles (...) [rad] in 0..pi by which rotations (..., 3, 3) turn."""
    skew = rotation - np.swapaxes(rotation, -1, -2)
    sine = np.sqrt(0.5 * (skew * skew).sum(axis=(-2, -1)))
    return np.arctan2(sine, np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
