"""Independent oracles for the pre-flight: dense samples, plain 4 x 4 products, points on segments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from tests.kinematics.kit import chain_of, plain_frames, random_planar_arm
from tests.sticks import of_sticks

from armctl.arrays import FloatArray
from armctl.kinematics import Chain, GravityModel
from armctl.robot import Joint, Robot
from armctl.robot.body.arm_body import Capsule


def arm(chain: Chain, limits: FloatArray) -> Robot:
    """A robot with a chain and limits, home in the middle."""
    joints = tuple(
        Joint(f"j{k}", f"Joint {k}", float(low), float(high), 1.0, 4.0, 40.0, None)
        for k, (low, high) in enumerate(limits)
    )
    home = limits.mean(axis=1)
    return Robot(
        name="random",
        title="Random",
        source="",
        assumed=(),
        joints=joints,
        chain=chain,
        poses={"home": home, "rest": home},
        output_map=None,
        gripper=None,
        gravity=GravityModel(chain, ()),
        floor_z=-0.1,
    )


def random_arm(seed: int) -> Robot:
    rng = np.random.default_rng(seed)
    planar = random_planar_arm(rng)
    convention = "standard" if rng.random() < 0.5 else "modified"
    chain = chain_of(planar, convention, roll=bool(rng.random() < 0.5), rng=rng)
    limits = planar.limits
    if chain.n > len(limits):
        limits = np.concatenate([limits, [[-2.0, 2.0]]])
    return of_sticks(arm(chain, limits))


def axis_points(robot: Robot, capsule: Capsule, q: FloatArray, count: int = 60) -> FloatArray:
    """(count, 3) points of a capsule's axis by plain products, base frame."""
    frame = np.eye(4)
    if capsule.link >= 0:
        row = robot.chain.joint_rows[capsule.link]
        # the link's frame: everything ahead of the joint, and its turn about z
        rows = robot.chain.rows[: row + 1]
        bare = replace(rows[row], d_m=0.0, theta_rad=0.0)
        if robot.chain.convention == "standard":
            bare = replace(bare, a_m=0.0, alpha_rad=0.0)
        frame = plain_frames((*rows[:row], bare), robot.chain.convention, q)[-1]
    share = np.linspace(0, 1, count)[:, None]
    points = capsule.start + share * (capsule.end - capsule.start)
    return points @ frame[:3, :3].T + frame[:3, 3]


def brute_gap(robot: Robot, one: Capsule, other: Capsule, q: FloatArray, count: int = 60) -> float:
    a, b = axis_points(robot, one, q, count), axis_points(robot, other, q, count)
    apart = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(apart.min()) - one.radius - other.radius
