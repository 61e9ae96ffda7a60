"""Arms for tool paths, and an oracle: the branch followed by many small steps of the inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from tests.arms import FIVE
from tests.kinematics.kit import FloatArray, chain_of, random_planar_arm, random_q
from tests.sticks import of_sticks

from armctl.kinematics import Chain, GravityModel
from armctl.motion import PitchMode
from armctl.motion.paths.tool_curve import ToolArc, ToolCurve, ToolLine
from armctl.motion.paths.tool_orientation import elevations
from armctl.motion.paths.tool_path import follow
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Joint, Robot, load_robot

ROBOTS = tuple(load_robot(name) for name in FIVE)
UZUNER, ABAAS, SCORBOT, HUMANOID, MICO = (
    load_robot(name) for name in ("uzuner", "abaas", "scorbot", "humanoid", "mico")
)
_JUMP = 0.15
"""the nearest solution this far from the one before is on another branch [rad]"""


@dataclass(frozen=True)
class ToolPath:
    """A curve of the tool, and the joints' way along it."""

    curve: ToolCurve
    polynomial: PiecewisePolynomial


def tool_line(
    robot: Robot, q: ArrayLike, end: ArrayLike, pitch: PitchMode = "kept", end_pitch: float | None = None
) -> ToolPath:
    return led(robot, q, ToolLine(robot.forward(q)[:3, 3], np.asarray(end)), pitch, end_pitch)


def tool_arc(
    robot: Robot, q: ArrayLike, via: ArrayLike, end: ArrayLike, pitch: PitchMode = "kept"
) -> ToolPath:
    return led(robot, q, ToolArc(robot.forward(q)[:3, 3], via, end), pitch, None)


def led(robot: Robot, q: ArrayLike, curve: ToolCurve, pitch: PitchMode, end_pitch: float | None) -> ToolPath:
    polynomial = follow(robot, q, curve, pitch, end_pitch)
    assert polynomial is not None
    return ToolPath(curve, polynomial)


def robot_of(chain: Chain, limits: FloatArray) -> Robot:
    """An arm of any chain, without anything else to it."""
    joints = tuple(
        Joint(f"j{k}", f"Joint {k}", float(low), float(high), 2.0, 8.0, 160.0, None)
        for k, (low, high) in enumerate(limits, 1)
    )
    return replace(
        of_sticks(UZUNER), name="random", chain=chain, joints=joints, gravity=GravityModel(chain, ()),
        poses={}, output_map=None,
    )  # fmt: skip


def random_robot(rng: np.random.Generator) -> Robot:
    """One of the family yaw, parallel pitch joints, roll."""
    arm, roll = random_planar_arm(rng, lateral=0.03), bool(rng.random() < 0.5)
    chain = chain_of(arm, str(rng.choice(["standard", "modified"])), roll=roll, rng=rng)
    limits = np.vstack([arm.limits, np.radians([[-90.0, 90.0]])]) if roll else arm.limits
    return robot_of(chain, limits)


def random_start(rng: np.random.Generator, robot: Robot) -> FloatArray:
    return random_q(rng, robot.limits)


def strays(robot: Robot, path: ToolPath, count: int = 2001) -> tuple[float, FloatArray]:
    """Largest distance of the tool from the curve [m], and the pitch (count,) [rad], on a dense sample."""
    s = np.linspace(0.0, path.curve.length, count)
    poses = robot.forward(path.polynomial(s))
    away = np.linalg.norm(poses[:, :3, 3] - path.curve.positions(s), axis=1)
    return float(away.max()), elevations(robot, poses)


def brute_force(
    robot: Robot, q: FloatArray, curve: ToolCurve, pitch: FloatArray, count: int
) -> tuple[float, FloatArray]:
    """How far a curve can be followed inside the limits (share of it), and the last configuration.

    Every branch at ``count`` places, with the tool pitch (count,) asked for there; the solution nearest to
    the one before is taken, until there is none near.
    """
    shares = np.linspace(0.0, 1.0, count)
    roll = None if robot.n == 4 else float(q[-1])
    found = robot.inverse_batch(curve.positions(shares * curve.length), pitch, roll).q
    reached, before = 0.0, q
    for share, solutions in zip(shares.tolist(), found, strict=True):
        gaps = np.abs(solutions - q).max(axis=1)
        gaps[np.isnan(gaps)] = np.inf
        guess = np.abs(solutions - (2 * q - before)).max(axis=1)
        guess[np.isnan(guess)] = np.inf
        best = int(guess.argmin())
        if not gaps[best] < _JUMP:
            return reached, q
        reached, before, q = share, q, solutions[best]
    return 1.0, q
