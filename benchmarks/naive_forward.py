"""Forward kinematics as 4 x 4 products, one row after the other: the plain way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import Chain

FloatArray = NDArray[np.float64]


def naive_forward(chain: Chain, q: FloatArray) -> FloatArray:
    """(..., 4, 4) tool poses of (..., n) joint angles of a chain of modified rows."""
    T = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    joint = 0
    for row in chain.rows:
        theta = np.full(q.shape[:-1], row.theta_rad)
        if row.joint:
            theta = theta + q[..., joint]
            joint += 1
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(row.alpha_rad), np.sin(row.alpha_rad)
        A = np.zeros((*q.shape[:-1], 4, 4))
        A[..., 0, 0], A[..., 0, 1], A[..., 0, 3] = ct, -st, row.a_m
        A[..., 1, 0], A[..., 1, 1], A[..., 1, 2], A[..., 1, 3] = st * ca, ct * ca, -sa, -sa * row.d_m
        A[..., 2, 0], A[..., 2, 1], A[..., 2, 2], A[..., 2, 3] = st * sa, ct * sa, ca, ca * row.d_m
        A[..., 3, 3] = 1.0
        T = T @ A
    return T
