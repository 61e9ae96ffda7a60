"""Forward kinematics and Jacobian of uzuner against the naive products."""

from __future__ import annotations

import numpy as np
from benchmarks.measure import Ratio, compare
from benchmarks.naive_forward import naive_forward

from armctl import Robot

POSES = 1_000_000


def forward_ratios(robot: Robot, poses: int = POSES) -> list[Ratio]:
    rng = np.random.default_rng(2011)
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (poses, robot.n))
    one, chunk = q[0], min(poses, 50_000)

    def naive_many() -> None:
        for at in range(0, poses, chunk):
            naive_forward(robot.chain, q[at : at + chunk])

    return [
        compare(
            "uzuner, forward, one pose",
            lambda: [naive_forward(robot.chain, one) for _ in range(200)],
            lambda: [robot.forward(one) for _ in range(200)],
            each=200,
        ),
        compare(
            f"uzuner, forward, {poses} poses, a pose",
            naive_many,
            lambda: robot.forward(q),
            each=poses,
            rounds=2,
        ),
    ]
