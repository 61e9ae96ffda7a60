"""Arms whose rods keep the hand level, against plain 4x4 products and brute force."""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.sticks import of_sticks

import armctl
from armctl.arrays import FloatArray
from armctl.errors import MotionRefusedError, RobotFileError
from armctl.kinematics import Body, Chain, DHRow, GravityModel
from armctl.kinematics.chain import TurnLimit
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.families.registry import inverse_kinematics
from armctl.kinematics.target import Target
from armctl.motion import plan_joints
from armctl.robot import robots_folder

LONG = bool(os.environ.get("ARMCTL_LONG"))
ARMS = 60 if LONG else 12
"""random arms"""
TITLES = ("Base", "Shoulder", "Elbow", "Hand")


class Palletiser:
    """A random arm, and its tool pose by plain products of its links' absolute angles."""

    def __init__(
        self, rng: np.random.Generator, *, geared: bool, rolls: bool, bounded: bool = False, aside: float = 0
    ) -> None:
        self.lengths, self.aside = rng.uniform(0.04, 0.3, 2), aside
        self.ahead, self.height, self.hand, self.drop = rng.uniform(-0.05, 0.1, 4)
        self.geared, self.rolls = geared, rolls
        ahead, (first, second) = float(self.ahead), self.lengths.tolist()
        rows = [
            DHRow(ahead, math.pi / 2, float(self.height)),
            DHRow(first, 0.0, 0.0),
            DHRow(second, 0.0, aside),
            DHRow(float(self.hand), -math.pi / 2, 0.0),  # its z points up
        ]
        if rolls:
            rows.append(DHRow(0.0, math.pi, float(-self.drop)))
        joints = 4 if rolls else 3
        coupling = np.zeros((len(rows), joints))
        coupling[0, 0] = coupling[1, 1] = coupling[2, 2] = 1.0
        if geared:  # the elbow's motor stands in the base: it sets the forearm's angle to the ground
            coupling[2, 1] = -1.0
        coupling[3] = -coupling[1] - coupling[2]
        if rolls:
            coupling[4, 3] = 1.0
        low = rng.uniform(-2.5, 0.0, joints)
        self.limits = np.column_stack([low, low + rng.uniform(0.5, 5.0, joints)])
        middle = self.turn(self.limits.mean(axis=1))
        self.between = (middle - 0.4, middle + 0.7) if bounded else (-math.inf, math.inf)
        limits = [TurnLimit(2, *self.between, "the angle from Shoulder to Elbow")] if bounded else []
        self.chain = Chain.from_dh(rows, "standard", coupling, limits)
        energy = EnergyModel(np.ones(joints), np.ones(joints), GravityModel(self.chain, ()))
        self.solver = inverse_kinematics(self.chain, self.limits, energy, TITLES[:joints])

    def turn(self, q: FloatArray) -> Any:
        """(...) the angle from the upper arm to the forearm."""
        return q[..., 2] - q[..., 1] if self.geared else q[..., 2]

    def keeps(self, q: FloatArray) -> Any:
        """Where that angle is inside its limits."""
        return (self.turn(q) >= self.between[0] - 1e-9) & (self.turn(q) <= self.between[1] + 1e-9)

    def point(self, q: FloatArray) -> FloatArray:
        """(..., 3) the tool point, from the absolute angles of upper arm and forearm."""
        upper = q[..., 1]
        fore = q[..., 2] if self.geared else q[..., 1] + q[..., 2]
        r = self.ahead + self.lengths[0] * np.cos(upper) + self.lengths[1] * np.cos(fore) + self.hand
        z = self.height + self.lengths[0] * np.sin(upper) + self.lengths[1] * np.sin(fore)
        if self.rolls:
            z = z - self.drop
        c, s = np.cos(q[..., 0]), np.sin(q[..., 0])
        return np.stack([r * c + self.aside * s, r * s - self.aside * c, z], axis=-1)


def random_arms(aside: float = 0.0) -> list[Palletiser]:
    rng = np.random.default_rng(5)
    kinds = [
        {"geared": bool(k % 2), "rolls": bool(k // 2 % 2), "bounded": bool(k // 4 % 2)} for k in range(ARMS)
    ]
    return [Palletiser(rng, **kind, aside=aside) for kind in kinds]


def test_the_tool_is_where_plain_trigonometry_puts_it() -> None:
    rng = np.random.default_rng(1)
    for arm in random_arms():
        q = rng.uniform(-3, 3, (20, arm.chain.n))
        poses = arm.chain.forward(q)
        assert poses[:, :3, 3] == pytest.approx(arm.point(q), abs=1e-12)
        assert arm.chain.forward(q[0]) == pytest.approx(poses[0], abs=1e-12)
        assert arm.chain.frames(q[0]) == pytest.approx(arm.chain.frames(q)[0], abs=1e-12)
        assert poses[:, 2, 2] == pytest.approx(-1.0 if arm.rolls else 1.0)
        step = 1e-6
        for j in range(arm.chain.n):
            ahead, behind = q.copy(), q.copy()
            ahead[:, j] += step
            behind[:, j] -= step
            slope = (arm.point(ahead) - arm.point(behind)) / (2 * step)
            assert arm.chain.jacobian(q)[:, :3, j] == pytest.approx(slope, abs=1e-8)
            assert arm.chain.jacobian(q[0])[:3, j] == pytest.approx(slope[0], abs=1e-8)


def test_the_pose_that_made_a_point_is_listed_and_each_one_once() -> None:
    rng = np.random.default_rng(2)
    for arm in random_arms():
        assert arm.solver.family == "yaw, two pitch joints, level hand"
        for _ in range(8):
            q = rng.uniform(*arm.limits.T)
            if rng.random() < 0.3:  # at a limit
                k = rng.integers(arm.chain.n)
                q[k] = arm.limits[k, rng.integers(2)]
            if not arm.keeps(q):
                refused = arm.solver.solve(Target.of(arm.point(q)), 0.01)
                assert arm.keeps(refused.q).all()
                continue
            T = arm.chain.forward(q)
            roll = float(q[3]) if arm.rolls else None
            for target in (Target.of(T[:3, 3], None, roll), Target.of(T[:3, 3], rotation=T[:3, :3])):
                found = arm.solver.solve(target, 0.01)
                assert np.abs(found.q - q).max(axis=1).min() < 1e-7
                assert found.residual_m.max() < 1e-9 and arm.keeps(found.q).all()
                assert (found.q >= arm.limits[:, 0]).all() and (found.q <= arm.limits[:, 1]).all()
                apart = np.abs(found.q[:, None] - found.q[None]).max(axis=2) + np.eye(len(found))
                assert apart.min() > 1e-9
                assert found.residual_rad.max() < 1e-7


def test_every_solution_that_a_sweep_finds_is_listed() -> None:
    """Brute force: the first two joints over their limits, the third by bisection of the miss."""
    rng = np.random.default_rng(3)
    for arm in random_arms()[:12]:
        q = rng.uniform(*arm.limits.T)
        point = arm.point(q)
        found = arm.solver.solve(Target.of(point), 0.01)
        starts = rng.uniform(*arm.limits[:3].T, (400, 3))
        for _ in range(60):
            full = np.column_stack([starts, np.zeros(len(starts))]) if arm.rolls else starts
            J = arm.chain.jacobian(full)[:, :3, :3]
            miss = point - arm.point(full)
            step = np.linalg.solve(J @ J.swapaxes(1, 2) + 1e-12 * np.eye(3), miss[..., None])
            starts = starts + np.clip((J.swapaxes(1, 2) @ step)[..., 0], -0.3, 0.3)
        low, high = arm.limits[:3].T
        starts = starts - 2 * np.pi * np.rint((starts - (low + high) / 2) / (2 * np.pi))
        full = np.column_stack([starts, np.zeros(len(starts))]) if arm.rolls else starts
        there = np.linalg.norm(arm.point(full) - point, axis=1) < 1e-10
        inside = ((starts >= low) & (starts <= high)).all(axis=1)
        for one in starts[there & inside & arm.keeps(starts)]:
            assert np.abs(found.q[:, :3] - one).max(axis=1).min() < 1e-5


@pytest.mark.parametrize("aside", [0.0, 0.12])
def test_too_far_and_too_near_are_the_way_in_space(aside: float) -> None:
    """Compared with stretched and folded arms at all yaws, point by point."""
    rng, seen = np.random.default_rng(8), set()
    ways = (("far", 0.0, 4, 0.8, slice(2)), ("near", math.pi, 14, 0.3, slice(4, 7)))
    angle: FloatArray = np.linspace(-math.pi, math.pi, 361)
    yaw, upper = (one.ravel() for one in np.meshgrid(angle, angle))
    for arm in random_arms(aside)[:8]:
        q = np.zeros((len(yaw), len(arm.limits)))
        for which, bend, points, cube, few in ways:
            q[:, 0], q[:, 1], q[:, 2] = yaw, upper, bend + (upper if arm.geared else 0.0)
            ends = arm.point(q)
            for point in rng.uniform(-cube, cube, (points, 3))[slice(None) if LONG else few]:
                said = arm.solver.solve(Target.of(point), 0.01).explanation or ""
                found = re.search(rf"too {which} by ([\d.]+) mm: (?:the wrist|from the shoulder)", said)
                if found is not None:
                    seen.add(which)
                    least = 1000 * np.linalg.norm(ends - point, axis=1).min()
                    told = float(found[1])
                    assert told <= least + 0.05 and least <= math.hypot(told, 8.0) + 0.2, (
                        said
                    )  # the grid is coarse
    assert seen == {"far", "near"}


@pytest.mark.parametrize("aside", [0.0, 0.12])
def test_the_nearest_point_is_never_beaten(aside: float) -> None:
    rng = np.random.default_rng(4)
    refused = 0
    for arm in random_arms(aside):
        grid = np.stack(np.meshgrid(*[np.linspace(low, high, 41) for low, high in arm.limits[:3]]), axis=-1)
        grid = grid.reshape(-1, 3)
        grid = grid[arm.keeps(grid)]
        points = arm.point(np.column_stack([grid, np.zeros(len(grid))]))
        target = rng.uniform(-0.5, 0.5, 3)
        found = arm.solver.solve(Target.of(target), 0.01)
        if found.success:
            continue
        refused += 1
        assert found.reason
        assert found.nearest_q is not None and found.nearest_m is not None
        assert (found.nearest_q >= arm.limits[:, 0]).all() and (found.nearest_q <= arm.limits[:, 1]).all()
        assert arm.keeps(found.nearest_q)
        away = np.linalg.norm(found.nearest_m - target)
        assert away <= np.linalg.norm(points - target, axis=1).min() + 1e-9
    assert refused > ARMS // 2


def test_a_pitch_that_the_rods_do_not_keep_is_refused() -> None:
    arm = random_arms()[0]
    q = arm.limits.mean(axis=1)
    pitch, _ = arm.solver.pitch_and_roll(q)
    assert pitch is not None
    assert arm.solver.solve(Target.of(arm.point(q), pitch), 0.01).success
    refused = arm.solver.solve(Target.of(arm.point(q), pitch + 0.1), 0.01)
    assert refused.reason is not None and "the rods keep the tool" in refused.reason


def test_a_held_roll_is_listed_once() -> None:
    arm = next(arm for arm in random_arms() if arm.rolls)
    limits = arm.limits.copy()
    limits[3] = 0.2
    solver = inverse_kinematics(
        arm.chain, limits, EnergyModel(np.ones(4), np.ones(4), GravityModel(arm.chain, ())), TITLES
    )
    T = arm.chain.forward(np.append(arm.limits[:3].mean(axis=1), 1.0))
    found = solver.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), 0.01)
    assert found.success
    assert len(np.unique(found.q, axis=0)) == len(found)


def test_too_near_one_way_and_too_far_the_other_says_both() -> None:
    rows = [
        DHRow(0.2, math.pi / 2, 0.0),
        DHRow(0.2, 0.0, 0.0),
        DHRow(0.1, 0.0, 0.0),
        DHRow(0.0, -math.pi / 2, 0.0),
    ]
    chain = Chain.from_dh(rows, "standard", np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, -1]]))
    energy = EnergyModel(np.ones(3), np.ones(3), GravityModel(chain, ()))
    solver = inverse_kinematics(chain, np.tile([-math.pi, math.pi], (3, 1)), energy, TITLES[:3])
    refused = solver.solve(Target.of([0.25, 0.0, 0.0]), 0.01)
    assert refused.reason == (
        "neither way round: the wrist would be 50.0 mm or 450.0 mm from the shoulder, the two links reach "
        "from 100.0 mm to 300.0 mm"
    )
    assert refused.nearest_m == pytest.approx([0.3, 0.0, 0.0], abs=1e-6)


def test_gravity_is_the_gradient_of_the_potential_energy() -> None:
    arm = Palletiser(np.random.default_rng(7), geared=True, rolls=True)
    bodies = tuple(Body(k, 0.1 * (k + 1), (0.02, -0.01, 0.03)) for k in range(5))
    gravity = GravityModel(arm.chain, bodies, 0.2)
    q = np.array([0.3, 0.8, -0.4, 0.2])

    def potential(q: FloatArray) -> float:
        frames = arm.chain.frames(q)
        energy = 0.2 * frames[-1, 2, 3]
        for body in bodies:
            energy += body.mass_kg * (frames[body.joint + 1] @ [*body.com_m, 1.0])[2]
        return 9.80665 * float(energy)

    slope = [(potential(q + d) - potential(q - d)) / 2e-5 for d in 1e-5 * np.eye(4)]
    assert gravity.torque(q) == pytest.approx(slope, abs=1e-7)


FILE = """
format = 1
name = "pal"
title = "Palletiser"
[dh]
convention = "standard"
rows = [
  {{ a_mm = 0, alpha_deg = 90, d_mm = 60, joint = "base" }},
  {{ a_mm = 80, alpha_deg = 0, d_mm = 0, joint = "shoulder" }},
  {{ a_mm = 80, alpha_deg = 0, d_mm = 0, joint = "elbow", follows = {{ shoulder = -1 }} }},
  {{ a_mm = 68, alpha_deg = 90, d_mm = 0, {hand} }},
]
[poses]
home = [0, 90, -20]
rest = [0, 100, -40]
[[joints]]
name = "base"
title = "Base"
limit_deg = [-90, 90]
speed_deg_s = 120
acceleration_deg_s2 = 600
[[joints]]
name = "shoulder"
title = "Shoulder"
limit_deg = [15, 130]
speed_deg_s = 120
acceleration_deg_s2 = 600
[[joints]]
name = "elbow"
title = "Elbow"
limit_deg = [-80, 40]
speed_deg_s = 120
acceleration_deg_s2 = 600
"""


def load(folder: Path, hand: str) -> armctl.Robot:
    path = folder / "pal.toml"
    path.write_text(FILE.format(hand=hand))
    return armctl.load_robot(path)


def test_a_robot_file_says_which_joints_a_link_follows(tmp_path: Path) -> None:
    robot = load(tmp_path, 'link = "hand", follows = { elbow = -1 }')
    assert robot.link_titles == ("Base", "Shoulder", "Elbow", "Hand")
    assert robot.chain.coupling is not None
    with armctl.Arm.open(robot) as arm:
        arm.enable()
        arm.go(x_mm=180, y_mm=20, z_mm=80)
        assert robot.forward(arm.snapshot.q_command)[:3, 3] == pytest.approx([0.18, 0.02, 0.08], abs=1e-4)


@pytest.mark.parametrize(
    ("hand", "said"),
    [
        ("follows = { elbow = -1 }", "needs a name"),
        ('link = "hand"', "needs a name"),
        ('link = "hand", follows = { wrist = -1 }', "'wrist', which is no other joint"),
        ('link = "base", follows = { elbow = -1 }', "two links have the same name"),
    ],
)
def test_rods_that_make_no_sense_are_refused(tmp_path: Path, hand: str, said: str) -> None:
    with pytest.raises(RobotFileError, match=said):
        load(tmp_path, hand)


@pytest.mark.parametrize("name", ["mearm", "eezybotarm_mk2", "uarm"])
def test_upper_arm_and_forearm_do_not_fold_onto_each_other(name: str) -> None:
    robot = of_sticks(name)
    (limit,) = robot.chain.turn_limits
    low, high = limit.lower, limit.upper
    folded = robot.pose("home")
    folded[1:3] = robot.limits[1, 1], robot.limits[2, 0]  # each inside its own limits
    turn = folded[2] - folded[1]
    assert turn < low
    words = f"the angle from Shoulder to Elbow: {math.degrees(turn):.2f}° is outside"
    with pytest.raises(MotionRefusedError, match=re.escape(words)):
        robot.check_limits(folded)
    tip = robot.forward(folded)[:3, 3]
    found = robot.inverse(tip)
    assert all(low <= q[2] - q[1] <= high for q in found)
    assert any(
        "the angle from Shoulder to Elbow needs" in one for b in robot.branches(tip) for one in b.forbidden
    )
    if not found.success:
        assert "the angle from Shoulder to Elbow needs" in found.explanation
    # each joint for itself: the slower one leaves the fast one to fold the arm on the way
    slow = replace(robot.joints[1], speed=0.1 * robot.joints[1].speed)
    robot = replace(robot, joints=(robot.joints[0], slow, *robot.joints[2:]))
    start, end = robot.pose("home"), robot.pose("home")
    start[1:3] = robot.limits[1, 1], robot.limits[1, 1] + low + 0.05
    end[1:3] = robot.limits[1, 1] - 0.5, robot.limits[1, 1] + low - 0.4
    with pytest.raises(MotionRefusedError, match="the angle from Shoulder to Elbow: at "):
        plan_joints(robot, start, end, profile="normal")
    plan_joints(robot, start, end)


def test_a_limit_between_links_belongs_to_a_row_that_follows(tmp_path: Path) -> None:
    text = (robots_folder() / "mearm.toml").read_text()
    for old, new, says in (
        ("between_deg = [-150, -20]", "between_deg = [-20, -150]", "row 3: between_deg = [-20.0, -150.0]"),
        (
            'joint = "shoulder" }',
            'joint = "shoulder", between_deg = [0, 1] }',
            "only a row that follows joints",
        ),
        (
            "rest = [0, 110, -30]",
            "rest = [0, 135, -30]",
            "poses.rest: the angle from Shoulder to Elbow: -165.00°",
        ),
    ):
        assert old in text
        path = tmp_path / "mearm.toml"
        path.write_text(text.replace(old, new))
        with pytest.raises(RobotFileError, match=re.escape(says)):
            armctl.load_robot(path)
