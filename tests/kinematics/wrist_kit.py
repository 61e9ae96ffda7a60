"""Arms with a spherical wrist at one end, known and random, and a search of their solutions of its own."""

from __future__ import annotations

import math

import numpy as np
from tests.kinematics.kit import rotation_about

from armctl.arrays import FloatArray
from armctl.kinematics import Chain, DHRow

R = math.pi / 2
REGIONAL = ("skew", "meet-12", "meet-23", "parallel-12", "parallel-23", "usual")


KNOWN: dict[str, tuple[list[tuple[float, ...]], list[tuple[float, float]]]] = {
    # Corke and Armstrong-Hélouvry 1994
    "PUMA 560": (
        [(0, R, 0), (0.4318, 0, 0), (0.0203, -R, 0.15005), (0, R, 0.4318), (0, -R, 0), (0, 0, 0)],
        [(-160, 160), (-225, 45), (-45, 225), (-110, 170), (-100, 100), (-266, 266)],
    ),
    # product manual 3HAC041346
    "IRB 140": (
        [(0.07, -R, 0.352), (0.36, 0, 0, -R), (0, -R, 0), (0, R, 0.38), (0, -R, 0), (0, 0, 0.065)],
        [(-180, 180), (-90, 110), (-230, 50), (-200, 200), (-115, 115), (-400, 400)],
    ),
    # Annin Robotics, AR4 mk3: DH table of the control software
    "AR4": (
        [(0.0642, -R, 0.16977), (0.305, 0, 0), (0, -R, 0, -R), (0, R, 0.22263), (0, -R, 0), (0, 0, 0.041)],
        [(-170, 170), (-42, 90), (-89, 52), (-180, 180), (-105, 105), (-180, 180)],
    ),
    # Source Robotics: DH table of the control software
    "PAROL6": (
        [
            (0.02342, -R, 0.1105),
            (0.18, 0, 0),
            (-0.0435, R, 0),
            (0, -R, 0.17635),
            (0, R, 0),
            (0.0621, 0, 0.045),
        ],
        [(-123, 123), (-145, -3.4), (107.9, 287.9), (-105, 105), (-90, 90), (0, 360)],
    ),
    # KR 6 R900 sixx: data sheet
    "KUKA KR 6": (
        [(0.025, R, -0.4), (0.455, 0, 0), (0.035, R, 0, -R), (0, -R, -0.42), (0, R, 0), (0, 2 * R, -0.08)],
        [(-170, 170), (-190, 45), (-120, 156), (-185, 185), (-120, 120), (-350, 350)],
    ),
    # Interbotix wx250s: a step in the upper arm makes it longer and tilts it
    "WidowX 250s": (
        [(0, -R, 0.11), (math.hypot(0.25, 0.05), 0, 0), (0, -R, 0), (0, R, 0.25), (0, -R, 0), (0, 0, 0.159)],
        [(-180, 180), (-108, 114), (-123, 92), (-180, 180), (-100, 123), (-180, 180)],
    ),
}
"""DH rows (a, alpha, d, theta), metres and radians, and limits in degrees"""


def known_arm(name: str) -> tuple[Chain, FloatArray]:
    rows, limits = KNOWN[name]
    return Chain.from_dh([DHRow(*row) for row in rows]), np.radians(limits)


def unit(rng: np.random.Generator) -> FloatArray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_chain(rng: np.random.Generator, regional: str, *, backward: bool = False) -> Chain:
    """Axes at random, the first three as asked for, of which the last three meet; tilted as it comes."""
    h = [unit(rng) for _ in range(6)]
    p = [rng.uniform(-0.3, 0.3, 3) for _ in range(4)]
    if regional in ("parallel-23", "usual"):
        h[2] = h[1] * rng.choice([1.0, -1.0])
    if regional == "parallel-12":
        h[1] = h[0] * rng.choice([1.0, -1.0])
    if regional == "meet-12":
        p[1] = p[0] + rng.uniform(-0.3, 0.3) * h[0]
    if regional == "meet-23":
        p[2] = p[1] + rng.uniform(-0.3, 0.3) * h[1]
    if regional == "usual":  # all at right angles
        h[1] = np.cross(h[0], unit(rng))
        h[1] /= np.linalg.norm(h[1])
        h[2] = h[1].copy()
        h[4] = h[1].copy()
        h[3] = h[5] = h[0].copy()
        p[1] = p[0] + rng.choice([0.0, 0.05]) * np.cross(h[0], h[1])
    wrist = p[3]
    for k in (3, 4):
        if abs(h[k] @ h[k + 1]) > 0.9:
            h[k + 1] = np.cross(h[k], unit(rng))
            h[k + 1] /= np.linalg.norm(h[k + 1])
    points = [*p[:3], *(wrist + rng.uniform(-0.2, 0.2) * h[k] for k in (3, 4, 5))]
    if backward:
        h, points = [-axis for axis in h[::-1]], points[::-1]
    origins = [np.eye(4) for _ in range(6)]
    for k, origin in enumerate(origins):
        origin[:3, 3] = points[k] - (points[k - 1] if k else 0.0)
    tool = np.eye(4)
    tool[:3, :3] = rotation_about(unit(rng), rng.uniform(0, 3))
    tool[:3, 3] = rng.uniform(-0.1, 0.1, 3)
    return Chain.from_joints(origins, h, tool)


def random_limits(rng: np.random.Generator) -> FloatArray:
    """Up to two turns."""
    low = -rng.uniform(0.5, 4.5, 6)
    high = rng.uniform(0.5, 4.5, 6)
    if rng.random() < 0.3:
        k = rng.integers(6)
        low[k], high[k] = -2 * math.pi, 2 * math.pi
    return np.stack([low, high], axis=1)


def random_arms(seed: int, count: int) -> list[tuple[Chain, FloatArray]]:
    rng = np.random.default_rng(seed)
    return [
        (random_chain(rng, REGIONAL[i % len(REGIONAL)], backward=i % 4 == 3), random_limits(rng))
        for i in range(count)
    ]


# A search of its own: Newton steps from many starts, on plain products of 4 x 4 matrices.


def product(chain: Chain, q: FloatArray) -> list[FloatArray]:
    """The frames of the joints and the tool at q (k, 6): (k, 4, 4) each."""
    frames: list[FloatArray] = []
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for segment, angle in zip(chain.segments, q.T, strict=True):
        Z = np.zeros((len(q), 4, 4))
        Z[:, 0, 0] = Z[:, 1, 1] = np.cos(angle)
        Z[:, 1, 0] = np.sin(angle)
        Z[:, 0, 1] = -Z[:, 1, 0]
        Z[:, 2, 2] = Z[:, 3, 3] = 1.0
        T = T @ segment @ Z
        frames.append(T)
    return [*frames, T @ chain.tail]


def newton(chain: Chain, pose: FloatArray, q: FloatArray, steps: int = 40) -> FloatArray:
    """Those of starts (k, 6) that come to a pose, as they come [rad]."""
    for _ in range(steps):
        *frames, T = product(chain, q)
        turn = T[:, :3, :3] @ pose[:3, :3].T
        skew = [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]
        off = np.concatenate([T[:, :3, 3] - pose[:3, 3], 0.5 * np.stack(skew, axis=1)], axis=1)
        z = np.stack([frame[:, :3, 2] for frame in frames], axis=2)
        arm = np.stack([T[:, :3, 3] - frame[:, :3, 3] for frame in frames], axis=2)
        J = np.concatenate([np.cross(z, arm, axis=1), z], axis=1)
        H = J.swapaxes(1, 2) @ J + 1e-12 * np.eye(6)
        step = np.linalg.solve(H, J.swapaxes(1, 2) @ off[:, :, None])[:, :, 0]
        q = q - step * np.minimum(1.0, 0.7 / np.maximum(np.abs(step).max(axis=1), 1e-9))[:, None]
    T = product(chain, q)[-1]
    there = np.abs(T - pose).max(axis=(1, 2)) < 1e-9
    return q[there]
