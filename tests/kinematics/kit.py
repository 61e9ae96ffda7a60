"""Independent oracles: plain 4 x 4 products, and arms built from a planar geometry that the tests know."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from benchmarks.naive_sweep import PlanarArm

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.kinematics import Chain, DHRow, EnergyModel, GravityModel, InverseKinematics, inverse_kinematics


def turn(axis: int, angle: float) -> FloatArray:
    """Rotation about x (0) or z (2) as (4, 4)."""
    T = np.eye(4)
    i, j = (1, 2) if axis == 0 else (0, 1)
    T[i, i] = T[j, j] = math.cos(angle)
    T[j, i], T[i, j] = math.sin(angle), -math.sin(angle)
    return T


def shift(x: float, z: float) -> FloatArray:
    T = np.eye(4)
    T[0, 3], T[2, 3] = x, z
    return T


def plain_frames(rows: tuple[DHRow, ...], convention: str | None, q: FloatArray) -> list[FloatArray]:
    """The base and the frame behind each row, one product after the other, for one q (n,)."""
    frames, k = [np.eye(4)], 0
    for row in rows:
        angle = row.theta_rad
        if row.joint:
            angle += float(q[k])
            k += 1
        z_part = turn(2, angle) @ shift(0.0, row.d_m)
        x_part = turn(0, row.alpha_rad) @ shift(row.a_m, 0.0)
        frames.append(frames[-1] @ (z_part @ x_part if convention == "standard" else x_part @ z_part))
    return frames


def plain_forward(chain: Chain, q: FloatArray) -> FloatArray:
    return plain_frames(chain.rows, chain.convention, q)[-1]


def plain_jacobian(chain: Chain, q: FloatArray, h: float = 1e-5) -> FloatArray:
    """(6, n) by central differences of the plain products."""
    J = np.zeros((6, chain.n))
    R = plain_forward(chain, q)[:3, :3]
    for k in range(chain.n):
        ahead, behind = (plain_forward(chain, q + sign * h * np.eye(chain.n)[k]) for sign in (1, -1))
        D = (ahead - behind) / (2 * h)
        spin = D[:3, :3] @ R.T
        J[:, k] = [*D[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
    return J


def random_planar_arm(rng: np.random.Generator, *, offsets: bool = True, lateral: float = 0.15) -> PlanarArm:
    """One of the family: links, offsets, senses and limits at random; no limit spans a whole turn."""
    low = -rng.uniform(5, 190, 4)
    high = rng.uniform(5, 190, 4)
    if rng.random() < 0.3:  # a joint that cannot pass zero
        k = rng.integers(4)
        low[k] = rng.uniform(5, 60)
        high[k] = low[k] + rng.uniform(20, 200)
    high = np.minimum(high, low + 350)
    return PlanarArm(
        lateral=float(rng.choice([0.0, rng.uniform(-lateral, lateral)])),
        shoulder_r=float(rng.choice([0.0, rng.uniform(-0.06, 0.06)])),
        shoulder_z=float(rng.uniform(-0.1, 0.3)),
        lengths=tuple(rng.uniform(0.03, 0.3, 3).tolist()),
        limits=np.radians(np.stack([low, high], axis=1)),
        yaw_sign=int(rng.choice([1, -1])),
        signs=tuple(int(s) for s in rng.choice([1, -1], 3)),
        offsets=tuple(rng.uniform(-2, 2, 3).tolist()) if offsets and rng.random() < 0.6 else (0.0, 0.0, 0.0),
    )


def chain_of(
    arm: PlanarArm, convention: str, *, roll: bool = False, rng: np.random.Generator | None = None
) -> Chain:
    """DH rows of an arm, with its lateral offset spread over the rows and, if asked for, a roll joint."""
    parts = np.zeros(4) if rng is None else rng.uniform(-0.03, 0.03, 4)
    lateral = [*parts[:3], -arm.lateral - parts[:3].sum()]  # the plane's normal points to the right
    steps: list[tuple[str, float, float, bool]] = []  # about and along x or z, and whether it is a joint

    def sensed(sign: int) -> None:
        if sign < 0:
            steps.append(("x", math.pi, 0.0, False))
        steps.append(("z", 0.0, 0.0, True))
        if sign < 0:
            steps.append(("x", -math.pi, 0.0, False))

    sensed(arm.yaw_sign)
    steps += [("z", 0.0, arm.shoulder_z, False), ("x", math.pi / 2, arm.shoulder_r, False)]
    for k in range(3):
        sensed(arm.signs[k])
        # the bend belongs ahead of the joint's own turn, which it commutes with
        steps.append(("z", arm.offsets[k], lateral[k] + (lateral[3] if k == 2 else 0.0), False))
        if k < 2:
            steps.append(("x", 0.0, arm.lengths[k], False))
    if roll:
        steps += [("z", math.pi / 2, 0.0, False), ("x", math.pi / 2, 0.0, False)]
        steps += [("z", 0.0, arm.lengths[2], True)]
    else:
        steps += [("x", 0.0, arm.lengths[2], False)]
    return Chain.from_dh(rows_of(steps, convention), convention)  # type: ignore[arg-type]


def rows_of(steps: list[tuple[str, float, float, bool]], convention: str) -> list[DHRow]:
    """Elementary steps packed into rows: z then x in standard rows, x then z in modified ones."""
    rows: list[DHRow] = []
    first, second = ("z", "x") if convention == "standard" else ("x", "z")
    i = 0
    while i < len(steps):
        pair = {"x": (0.0, 0.0, False), "z": (0.0, 0.0, False)}
        for kind in (first, second):
            if i < len(steps) and steps[i][0] == kind:
                pair[kind] = steps[i][1:]
                i += 1
        (alpha, a, _), (theta, d, joint) = pair["x"], pair["z"]
        rows.append(DHRow(a_m=a, alpha_rad=alpha, d_m=d, theta_rad=theta, joint=joint))
    return rows


def planar_arms(seed: int, count: int) -> list[tuple[Chain, FloatArray]]:
    """Chain and limits of uzuner, abaas, scorbot and random ones, most of them with a roll joint."""
    rng = np.random.default_rng(seed)
    out = [(robot.chain, robot.limits) for robot in map(load_robot, ("uzuner", "abaas", "scorbot"))]
    for i in range(count):
        arm = random_planar_arm(rng)
        chain = chain_of(arm, "standard" if i % 2 else "modified", roll=i % 4 != 0, rng=rng)
        out.append((chain, arm.limits if chain.n == 4 else np.vstack([arm.limits, [[-2.0, 2.5]]])))
    return out


def solver_of(chain: Chain, limits: FloatArray, titles: tuple[str, ...] = ()) -> InverseKinematics:
    energy = EnergyModel(np.ones(chain.n), np.ones(chain.n), GravityModel(chain, ()))
    return inverse_kinematics(
        chain, limits, energy, titles or tuple(f"Joint {k + 1}" for k in range(chain.n))
    )


def rotation_about(axis: FloatArray, angle: float) -> FloatArray:
    """(3, 3) rotation about an axis of any length (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def least_distance(
    tip: Callable[[FloatArray], FloatArray],
    limits: FloatArray,
    position: FloatArray,
    rng: np.random.Generator,
    samples: int,
) -> float:
    """Of a tip (..., 3) from a position, by samples, then by ever smaller random steps from the best ones."""

    def distance(q: FloatArray) -> FloatArray:
        return np.linalg.norm(tip(q) - position, axis=-1)

    q = random_q(rng, limits, samples)
    starts = q[distance(q).argsort()[:4]]
    size = 0.5
    for _ in range(45):
        tried = np.clip(starts[:, None] + rng.normal(scale=size, size=(4, 150, len(limits))), *limits.T)
        tried[:, 0] = starts
        starts = tried[np.arange(4), distance(tried).argmin(axis=1)]
        size *= 0.75
    return float(distance(starts).min())


def random_q(rng: np.random.Generator, limits: FloatArray, *count: int) -> FloatArray:
    return rng.uniform(limits[:, 0], limits[:, 1], (*count, len(limits)))
