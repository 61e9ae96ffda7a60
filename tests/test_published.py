"""The papers' printed figures, and what they say beyond the reports."""

from __future__ import annotations

import numpy as np
import pytest
from tests.arms import FIVE

from armctl import load_robot
from armctl.motion import arc, line
from armctl.published import REPORTS


def test_every_shipped_robot_has_a_report() -> None:
    assert sorted(REPORTS) == sorted(FIVE)


@pytest.mark.parametrize(
    ("name", "figures"), [("uzuner", 14), ("abaas", 5), ("scorbot", 4), ("humanoid", 4), ("mico", 3)]
)
def test_every_figure_is_reproduced(name: str, figures: int) -> None:
    report = REPORTS[name]()
    wrong = [one.what for one in report.comparisons if not one.agrees]
    assert report.robot == name and len(report.comparisons) == figures and not wrong
    assert report.agrees


@pytest.mark.parametrize("criterion", ["published", "least-rotation", "least-torque"])
def test_both_trajectories_of_uzuner_solve_completely(criterion: str) -> None:
    robot = load_robot("uzuner")
    path = np.concatenate([arc(), line()])
    assert len(path) == 58 + 29
    assert 1000 * path[:3, :2] == pytest.approx(
        np.array([[10.46, -199.73], [21.08, -198.89], [31.63, -197.48]]), abs=0.02
    )
    for point in path:
        q = robot.check_limits(robot.inverse(point).best(criterion))
        assert np.abs(robot.forward(q)[:3, 3] - point).max() < 1e-9


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


def test_what_the_papers_got_wrong() -> None:
    (speed,) = REPORTS["abaas"]().improvements
    assert speed.paper == 8320
    assert speed.armctl == pytest.approx(355 * np.radians(20), rel=1e-9)
    miss, _ = REPORTS["humanoid"]().improvements
    assert miss.paper == pytest.approx(np.linalg.norm([0.064, 0.003, 0.016]), abs=1e-3)
    assert miss.armctl < 1e-7
    assert "82.6 mm" in load_robot("mico").inverse([0.5, 0, 0.7]).explanation
