"""Arms of six joints, with oracles that share nothing with the solvers: products, multi-start Newton."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics import Chain, DHRow, EnergyModel, GravityModel, InverseKinematics, Solutions, Target
from armctl.kinematics.families.registry import FAMILIES

QUARTER = math.pi / 2
STEP = math.radians(0.01)
TURN = 2.0 * math.pi


class SixJoints(NamedTuple):
    chain: Chain
    limits: FloatArray


def rotation(rng: np.random.Generator) -> FloatArray:
    """(3, 3) evenly spread."""
    R, triangle = np.linalg.qr(rng.normal(size=(3, 3)))
    R = R * np.sign(np.diag(triangle))
    return R * np.linalg.det(R)


def random_limits(rng: np.random.Generator) -> FloatArray:
    """(6, 2) [rad]: from 100 degrees to two turns, off centre; one joint in ten held nearly still."""
    width = rng.uniform(math.radians(100), 2 * TURN, 6)
    width[rng.random(6) < 0.1] = 0.2
    middle = rng.uniform(-1.5, 1.5, 6)
    return np.stack([middle - width / 2, middle + width / 2], axis=1)


def random_general(rng: np.random.Generator) -> SixJoints:
    """Twists, offsets and a tilted base; a third with right angles and zeros, as people build arms."""
    tidy = rng.random() < 0.35
    segments: list[FloatArray] = []
    for _ in range(7):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation(rng), rng.uniform(-0.3, 0.3, 3)
        if tidy and segments:
            T[:3, :3] = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) if rng.random() < 0.8 else np.eye(3)
            T[:3, 3] = rng.choice([0.0, 0.05, 0.2, 0.3], 3, p=[0.5, 0.2, 0.2, 0.1])
        segments.append(T)
    return SixJoints(Chain(segments[:6], segments[6]), random_limits(rng))


def random_three_parallel(rng: np.random.Generator, first: int) -> SixJoints:
    """Three parallel axes in a row, some against each other; every second arm with a wrist that meets."""
    meets = rng.random() < 0.5
    segments: list[FloatArray] = []
    for joint in range(7):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation(rng), rng.uniform(-0.3, 0.3, 3)
        if first < joint <= first + 2:
            T[:3, :3] = np.diag([1.0, 1.0, 1.0] if rng.random() < 0.6 else [1.0, -1.0, -1.0])
        if meets and joint == (first + 4 if first < 2 else 1):
            T[:3, 3] = 0.0
        segments.append(T)
    return SixJoints(Chain(segments[:6], segments[6]), random_limits(rng))


def dh(rows: list[tuple[float, float, float]], limit_deg: float) -> SixJoints:
    """Rows of a, alpha, d (standard), all joints within ± a limit."""
    limit = math.radians(limit_deg)
    return SixJoints(Chain.from_dh([DHRow(*row) for row in rows]), np.tile([-limit, limit], (6, 1)))


def universal(a2: float, a3: float, d1: float, d4: float, d5: float, d6: float) -> SixJoints:
    """The rows of Universal Robots; myCobot 280 and OpenMANIPULATOR-Y are built alike."""
    rows = [(0, QUARTER, d1), (a2, 0, 0), (a3, 0, 0), (0, QUARTER, d4), (0, -QUARTER, d5), (0, 0, d6)]
    return dh(rows, 360)


def with_links(second: float, offset: float) -> SixJoints:
    """As those, with links of 0.3 m and ``second``, the parallel axes at an ``offset`` from the first [m]."""
    return SixJoints(
        universal(0.3, second, 0.1, offset, 0.1, 0.1).chain, np.tile([-math.pi, math.pi], (6, 1))
    )


def calibrated_ur5() -> SixJoints:
    """A UR5 as its own calibration has it: no two axes quite parallel, none that quite meet."""
    rng = np.random.default_rng(5)
    nominal = UR5.chain.rows
    changes = rng.normal(scale=(2e-4, 1e-3, 2e-4), size=(6, 3))
    rows = [(r.a_m + a, r.alpha_rad + b, r.d_m + d) for r, (a, b, d) in zip(nominal, changes, strict=True)]
    return dh(rows, 360)


def kinova() -> SixJoints:
    """Kinova j2s6s200: the last three axes at 60 degrees to each other, none of them in one point."""
    aa = math.pi / 6
    slant = math.sin(aa) / math.sin(2 * aa) * 0.0741
    return dh(
        [
            (0, QUARTER, 0.2755), (0.29, math.pi, 0), (0, QUARTER, -0.007),
            (0, 2 * aa, -(0.1661 + slant)), (0, 2 * aa, -2 * slant), (0, math.pi, -(slant + 0.1600)),
        ],
        360,
    )  # fmt: skip


def beside_a_wrist(offset: float) -> SixJoints:
    """An arm whose last axis passes the wrist at an offset [m]: mechArm 270 has half a millimetre."""
    return dh(
        [
            (0, -QUARTER, 0.139), (0.1, 0, 0), (0.01, -QUARTER, 0),
            (0, QUARTER, 0.107), (offset, -QUARTER, 0), (0, 0, 0.0657),
        ],
        165,
    )  # fmt: skip


UR3 = universal(-0.24365, -0.21325, 0.1519, 0.11235, 0.08535, 0.0819)
UR5 = universal(-0.425, -0.39225, 0.089159, 0.10915, 0.09465, 0.0823)
UR10 = universal(-0.612, -0.5723, 0.1273, 0.163941, 0.1157, 0.0922)
MYCOBOT = universal(-0.1104, -0.096, 0.13122, 0.0634, 0.07505, 0.0456)
OMY = universal(-0.247, -0.2195, 0.1715, -0.1095, 0.1155, 0.113)
CRX = dh(
    [
        (0, -QUARTER, 0.0), (0.54, math.pi, 0), (0, -QUARTER, 0),
        (0, QUARTER, -0.54), (0, -QUARTER, 0.15), (0, math.pi, -0.16),
    ],
    190,
)  # fmt: skip
THREE_PARALLEL = {"UR3": UR3, "UR5": UR5, "UR10": UR10, "myCobot 280": MYCOBOT, "OMY": OMY}
GENERAL = {
    "mechArm 270": beside_a_wrist(5e-4),
    "beside by a µm": beside_a_wrist(1e-6),
    "j2s6s200": kinova(),
    "CRX": CRX,
    "UR5, calibrated": calibrated_ur5(),
}


def solver_of(arm: SixJoints, family: str | None) -> InverseKinematics:
    """The solver that the registry gives; it is of that family, if one is named."""
    energy = EnergyModel(
        speed_limits=np.ones(6), acceleration_limits=np.ones(6), gravity=GravityModel(arm.chain, ())
    )
    titles = [f"Joint {k + 1}" for k in range(6)]
    made = (kind.of(arm.chain, arm.limits, energy, titles) for kind in FAMILIES)
    solver = next(one for one in made if one is not None)
    assert family in (None, solver.family)
    return solver


def plain_pose(chain: Chain, q: FloatArray) -> FloatArray:
    """(..., 4, 4) by products of 4 x 4 matrices, one joint after the other; q (..., 6)."""
    T = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    for joint, segment in enumerate(chain.segments):
        turn = np.zeros(T.shape)
        turn[..., 2, 2] = turn[..., 3, 3] = 1.0
        turn[..., 0, 0] = turn[..., 1, 1] = np.cos(q[..., joint])
        turn[..., 1, 0] = np.sin(q[..., joint])
        turn[..., 0, 1] = -turn[..., 1, 0]
        T = T @ segment @ turn
    return T @ chain.tail


def target_of(pose: FloatArray) -> Target:
    return Target.of(pose[:3, 3], rotation=pose[:3, :3])


def apart(a: FloatArray, b: FloatArray) -> FloatArray:
    """Largest joint difference of configurations (..., 6), whole turns not counted [rad]."""
    off = a - b
    return np.abs(off - TURN * np.rint(off / TURN)).max(axis=-1)


def assert_sound(arm: SixJoints, solutions: Solutions, pose: FloatArray, q: FloatArray | None = None) -> None:
    """Every solution meets the pose inside the limits, none is there twice, and ``q`` is there."""
    found = solutions.q
    assert len(found), solutions.explanation
    assert ((found >= arm.limits[:, 0]) & (found <= arm.limits[:, 1])).all()
    off = plain_pose(arm.chain, found) - pose
    assert np.linalg.norm(off[:, :3, 3], axis=1).max() <= 1e-9
    assert np.linalg.norm(off[:, :3, :3], axis=(1, 2)).max() / math.sqrt(2) <= 1e-9
    keys = found[np.lexsort(np.round(found, 4).T)]
    near = np.abs(np.diff(keys, axis=0)).max(axis=1, initial=0.0)
    assert near.min(initial=1.0) > 1e-6
    if q is not None:
        assert np.abs(found - q).max(axis=1).min() <= 2e-6


def multi_start(arm: SixJoints, pose: FloatArray, rng: np.random.Generator, starts: int) -> FloatArray:
    """(k, 6) what Newton steps from random configurations lead to: isolated ones, each once, limits aside."""
    q = rng.uniform(-math.pi, math.pi, (starts, 6))
    reach = np.abs(np.array([segment[:3, 3] for segment in (*arm.chain.segments, arm.chain.tail)])).sum()
    for _ in range(60):
        off, J = _errors(arm.chain, pose, q, reach)
        H = np.swapaxes(J, 1, 2) @ J
        size = (off * off).sum(axis=1)
        H += (0.05 * size + 1e-14)[:, None, None] * np.eye(6)
        step = np.linalg.solve(H, np.swapaxes(J, 1, 2) @ off[:, :, None])[:, :, 0]
        q = q - step * np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=1), 1e-9))[:, None]
    off, J = _errors(arm.chain, pose, q, reach)
    good = (np.abs(off).max(axis=1) < 1e-12) & (np.linalg.svd(J, compute_uv=False)[:, -1] > 1e-4)
    kept: list[FloatArray] = []
    for one in q[good]:
        if all(apart(one, other) > 1e-5 for other in kept):
            kept.append(one)
    return np.array(kept).reshape(-1, 6)


def _errors(chain: Chain, pose: FloatArray, q: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
    """Position over the reach and the skew part of the rotation to go (m, 9), with derivatives (m, 9, 6)."""
    frames: list[FloatArray] = []
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for joint, segment in enumerate(chain.segments):
        T = T @ segment
        frames.append(T)
        c, s = np.cos(q[:, joint]), np.sin(q[:, joint])
        turn = np.tile(np.eye(4), (len(q), 1, 1))
        turn[:, 0, 0], turn[:, 1, 1], turn[:, 1, 0], turn[:, 0, 1] = c, c, s, -s
        T = T @ turn
    T = T @ chain.tail
    off = np.concatenate([(T - pose)[:, :3, 3] / reach, (T - pose)[:, :3, :3].reshape(-1, 9)], axis=1)
    columns: list[FloatArray] = []
    for frame in frames:
        z = frame[:, :3, 2]
        linear = np.cross(z, T[:, :3, 3] - frame[:, :3, 3]) / reach
        turned = np.cross(z[:, :, None], T[:, :3, :3], axis=1)
        columns.append(np.concatenate([linear, turned.reshape(-1, 9)], axis=1))
    return off, np.stack(columns, axis=-1)


def assert_all_listed(arm: SixJoints, solutions: Solutions, others: FloatArray) -> None:
    """Every configuration that another search found, and that has an image inside the limits, is listed."""
    low, high = arm.limits.T
    for one in others:
        first, last = np.ceil((low - one) / TURN + 1e-6), np.floor((high - one) / TURN - 1e-6)
        if (last >= first).all():
            assert len(solutions) and apart(solutions.q, one).min() < 1e-5, (one, solutions.explanation)
