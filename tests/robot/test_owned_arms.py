"""Shipped arms that people own: where their sources put the tool, what is solved, and that they move."""

from __future__ import annotations

import numpy as np
import pytest
from tests.arms import FIVE

import armctl
from armctl import load_robot, shipped_robots
from armctl.motion import plan_joints, preflight

OWNED = tuple(name for name in shipped_robots() if name not in FIVE)
TOOL_MM = {
    # joint angles [degrees] and the tool point [mm] as the sources have them
    "al5d": ([0, 90, -90, 0], [187.325 + 100, 0, 67.31 + 146.05]),
    "ar4": ([0, 0, 0, 0, 0, 0], [64.2 + 222.63 + 36.25, 0, 169.77 + 305]),
    "braccio": ([0, 0, 0, 0, 0], [0, 0, 71.5 + 125 + 125 + 192]),
    "eezybotarm_mk2": ([0, 90, 0], [147 + 87, 0, 92 + 135]),
    "mearm": ([0, 90, 0], [80 + 68, 0, 60 + 80]),
    "open_manipulator_x": ([0, 0, 0, 0], [286, 0, 204.5]),
    "parol6": ([0, -90, 180, 0, 0, 180], [262.57, 0, 288.75]),
    "pincherx100": ([0, 0, 0, 0], [248.575, 0, 193.1]),
    "so100": ([0, 0, 0, 0, 0], [436.27, 0, 96.2]),
    "so101": ([0, 0, 0, 0, 0], [391.36, 0.04, 226.47]),
    "uarm": ([0, 90, 0, 0], [13.2 + 158.81 + 56.55, 0, 106.1 + 142.07 - 74.55]),
    "ur5": ([0, 0, 0, 0, 0, 0], [-817.25, -191.45, -5.491]),
}


@pytest.mark.parametrize("name", OWNED)
def test_the_tool_is_where_the_source_puts_it(name: str) -> None:
    robot = load_robot(name)
    q, point = TOOL_MM[name]
    assert 1000 * robot.forward(np.radians(q))[:3, 3] == pytest.approx(point, abs=0.02)
    assert robot.source and any("home" in assumed for assumed in robot.assumed)
    if robot.output_map is None:
        assert any(assumed.startswith("no board") for assumed in robot.assumed)


@pytest.mark.parametrize("name", OWNED)
def test_every_pose_leads_back_to_its_configuration(name: str) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(11)
    some = rng.uniform(*robot.limits.T, (24, robot.n))
    for q in some[robot.chain.keeps_turns(some)][:12]:
        T = robot.forward(q)
        found = robot.inverse(T[:3, 3], rotation=T[:3, :3])
        assert found.residual_m.max() < 1e-9
        assert found.residual_rad.max() < 1e-7
        away = np.abs(np.exp(1j * found.q) - np.exp(1j * q)).max(axis=1)
        assert away.min() < 1e-6


@pytest.mark.parametrize("name", OWNED)
def test_home_and_rest_can_be_gone_to(name: str) -> None:
    robot = load_robot(name)
    for start, end in (("rest", "home"), ("home", "rest")):
        motion = plan_joints(robot, robot.pose(start), robot.pose(end))
        assert [one for one in preflight(robot, motion) if one.severity == "error"] == []


def test_an_arm_without_a_board_of_ours_runs_simulated() -> None:
    with armctl.Arm.open("so101") as arm:
        arm.enable()
        arm.go_pose("home")
        assert arm.joints_deg == pytest.approx(np.degrees(arm.robot.pose("home")), abs=0.2)
