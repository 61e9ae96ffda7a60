"""Shipped arms that people own: where their sources put the tool, what is solved, and that they move."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from tests.arms import FIVE

import armctl
from armctl import load_robot, shipped_robots
from armctl.motion import plan_joints, preflight

OWNED = tuple(name for name in shipped_robots() if name not in FIVE)
BESIDE = 1500 if os.environ.get("ARMCTL_LONG") else 60
TOOL_MM = {
    # joint angles [degrees] and the tool point [mm] as the sources have them
    "al5d": ([0, 90, -90, 0], [187.325 + 100, 0, 67.31 + 146.05]),
    "ar4": ([0, 0, 0, 0, 0, 0], [64.2 + 222.63 + 36.25, 0, 169.77 + 305]),
    "braccio": ([0, 0, 0, 0, 0], [0, 0, 71.5 + 125 + 125 + 192]),
    "eezybotarm_mk2": ([0, 90, 0], [147 + 87, 0, 92 + 135]),
    "koch": ([0, 0, 0, 0, 0], [318.705, 1.67, 35.754]),
    "lekiwi": ([0, 0, 0, 0, 0], [391.36 + 28.313, 0.04, 226.47 + 89.94]),
    "mearm": ([0, 90, 0], [80 + 68, 0, 60 + 80]),
    "open_manipulator_x": ([0, 0, 0, 0], [286, 0, 204.5]),
    "parol6": ([0, -90, 180, 0, 0, 180], [262.57, 0, 288.75]),
    "pincherx100": ([0, 0, 0, 0], [248.575, 0, 193.1]),
    "so100": ([0, 0, 0, 0, 0], [436.27, 0, 96.2]),
    "so101": ([0, 0, 0, 0, 0], [391.36, 0.04, 226.47]),
    "uarm": ([0, 90, 0, 0], [13.2 + 158.81 + 56.55, 0, 106.1 + 142.07 - 74.55]),
    "ur5": ([0, 0, 0, 0, 0, 0], [-817.25, -191.45, -5.491]),
    "widowx250s": ([0, 0, 0, 0, 0, 0], [458.325, 0, 360.65]),
}


@pytest.mark.parametrize("name", OWNED)
def test_the_tool_is_where_the_source_puts_it(name: str) -> None:
    robot = load_robot(name)
    q, point = TOOL_MM[name]
    assert 1000 * robot.forward(np.radians(q))[:3, 3] == pytest.approx(point, abs=0.02)
    assert robot.source and any("home" in assumed for assumed in robot.assumed)
    if robot.output_map is None:
        assert robot.no_board or any(assumed.startswith("no board") for assumed in robot.assumed)


@pytest.mark.parametrize("name", OWNED)
def test_every_pose_leads_back_to_its_configuration(name: str) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(11)
    some = rng.uniform(*robot.limits.T, (24, robot.n))
    for q in some[robot.chain.keeps_turns(some)][:12]:
        T = robot.forward(q)
        found = robot.inverse(T[:3, 3], rotation=T[:3, :3])
        assert found.residual_m.max() < 1e-9
        assert found.residual_rad.max() < 1e-9
        away = np.abs(np.exp(1j * found.q) - np.exp(1j * q)).max(axis=1)
        assert away.min() < 1e-6


@pytest.mark.parametrize("name", shipped_robots())
def test_beside_singular_poses_and_limits_each_configuration_is_listed_or_told(name: str) -> None:
    """Joints at quarter turns or limits, or beside them by 1e-9 to 0.01 rad: roots may be double there."""
    robot, rng, listed = load_robot(name), np.random.default_rng(41), 0
    for _ in range(BESIDE):
        beside = 10.0 ** rng.uniform(-9, -2) * rng.choice([-1, 0, 1], robot.n)
        one, other = rng.uniform(*robot.limits.T, (2, robot.n))
        quarter = np.round(one / (np.pi / 2)) * (np.pi / 2) + beside
        q = np.clip(np.where(rng.random(robot.n) < 0.4, quarter, other), *robot.limits.T)
        if not robot.chain.keeps_turns(q[None])[0]:
            continue
        T = robot.forward(q)
        found = robot.inverse(T[:3, 3], rotation=T[:3, :3])
        assert found.residual_m.max() < 1e-9 and found.residual_rad.max() < 2e-9, q.tolist()
        there = np.abs(found.q - q).max(axis=1).min() < 1e-6
        assert there or not found.complete, q.tolist()
        listed += there
    assert listed > 0.7 * BESIDE


@pytest.mark.parametrize("name", OWNED)
def test_home_and_rest_can_be_gone_to(name: str) -> None:
    robot = load_robot(name)
    for start, end in (("rest", "home"), ("home", "rest")):
        motion = plan_joints(robot, robot.pose(start), robot.pose(end))
        assert [one for one in preflight(robot, motion) if one.severity == "error"] == []


@pytest.mark.parametrize("name", shipped_robots())
def test_every_link_has_a_mass_and_no_pose_is_too_heavy_for_the_servos(name: str) -> None:
    robot = load_robot(name)
    links = len(robot.chain.segments)
    assert {body.joint for body in robot.gravity.bodies} >= set(range(links - 3, links))
    assert "least-torque" in robot.energy.criteria
    stall = np.array([joint.stall_torque or math.inf for joint in robot.joints])
    q = np.random.default_rng(38).uniform(*robot.limits.T, (2_000, robot.n))
    assert (np.abs(robot.gravity.torque(q)) < stall).all()


def test_a_stretched_ur5_weighs_on_its_shoulder_as_its_maker_says() -> None:
    """Masses and centres of the support article, whose links lie along -x here; the payload is 5 kg."""
    ur5 = load_robot("ur5")
    upper, fore = 0.425, 0.39225
    moment = 8.393 * (upper - 0.2125) + 2.33 * (upper + fore - 0.15)
    moment += (1.219 + 1.219 + 0.1879 + 5.0) * (upper + fore)
    torque = ur5.gravity.torque(np.zeros(6))
    assert abs(torque[1]) == pytest.approx(9.80665 * moment, rel=1e-4)


def test_an_arm_without_a_board_of_ours_runs_simulated() -> None:
    with armctl.Arm.open("so101") as arm:
        arm.enable()
        arm.go_pose("home")
        assert arm.joints_deg == pytest.approx(np.degrees(arm.robot.pose("home")), abs=0.2)
