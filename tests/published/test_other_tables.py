"""The printed figures of abaas, scorbot, humanoid and mico."""

from __future__ import annotations

import numpy as np
import pytest

from armctl import load_robot
from armctl.published import REPORTS
from armctl.robot import shipped_robots


def test_every_shipped_robot_has_a_report() -> None:
    assert sorted(REPORTS) == sorted(shipped_robots())


@pytest.mark.parametrize("name", list(REPORTS))
def test_every_figure_is_reproduced(name: str) -> None:
    report = REPORTS[name]()
    wrong = [one.what for one in report.comparisons if not one.agrees]
    assert report.robot == name and report.comparisons and not wrong
    assert report.agrees


@pytest.mark.parametrize(
    ("servo", "tip"),
    [((86, 130, 125, 60, 90), (-21.05, 308.3, 172.5)), ((144, 110, 135, 54, 90), (221.4, 160.9, 218.0))],
)
def test_abaas_servo_angles_through_the_servo_map(
    servo: tuple[float, ...], tip: tuple[float, float, float]
) -> None:
    robot = load_robot("abaas")
    assert robot.output_map is not None
    q = robot.output_map.angles({2 + i: 544 + 1856 * angle / 180 for i, angle in enumerate(servo)})
    s1, s2, s3, s4, s5 = servo
    assert np.degrees(q) == pytest.approx([-s1, s2, s3 - 90, 180 - s4, s5], abs=1e-6)
    assert np.abs(1000 * robot.forward(robot.check_limits(q))[:3, 3] - tip).max() < 0.7


def test_abaas_tip_speed_at_20_degrees_a_second_stays_under_124_mm() -> None:
    (speed,) = REPORTS["abaas"]().improvements
    assert speed.paper == 8320
    assert speed.armctl == pytest.approx(355 * np.radians(20), rel=1e-9)


@pytest.mark.parametrize("q", [(0, 0, 0, 0, 0), (33, -70, 44, -120, 12), (-150, 20, -100, 10, -170)])
def test_scorbot_tip_formula(q: tuple[float, ...]) -> None:
    t1, t2, t3, t4, _ = np.radians(q)
    r = 25 + 222 * np.cos(t2) + 222 * np.cos(t2 + t3) - 135 * np.sin(t2 + t3 + t4)
    z = 325 - 222 * np.sin(t2) - 222 * np.sin(t2 + t3) - 135 * np.cos(t2 + t3 + t4)
    tip = 1000 * load_robot("scorbot").forward(np.radians(q))[:3, 3]
    assert tip == pytest.approx([r * np.cos(t1), r * np.sin(t1), z], abs=1e-9)


def test_humanoid_pose_and_the_papers_own_error() -> None:
    robot = load_robot("humanoid")
    T = robot.forward(np.radians([45, 0, 30, 50, 0]))
    assert 100 * T[:3, 3] == pytest.approx([32.5689, 32.5689, -35.3467], abs=5e-5)
    assert T[2, 2] == pytest.approx(-0.1736, abs=5e-5) and T[2, 1] == pytest.approx(0.0, abs=1e-12)
    miss, _ = REPORTS["humanoid"]().improvements
    assert miss.paper == pytest.approx(np.linalg.norm([0.064, 0.003, 0.016]), abs=1e-3)
    assert miss.armctl < 1e-7


def test_mico_has_both_printed_solutions_inside_its_limits() -> None:
    robot = load_robot("mico")
    found = np.degrees(robot.inverse([0, 0, 0.7]).q)
    for printed in ([0, -131.626, -5.532, 0], [0, -48.374, -174.468, 0]):
        assert np.abs(found - printed).max(axis=1).min() < 0.001
    assert "82.6 mm" in robot.inverse([0.5, 0, 0.7]).explanation
