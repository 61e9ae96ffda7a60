from __future__ import annotations

import numpy as np
import pytest

from armctl.motion import arc, line
from armctl.robot import load_robot


def test_the_arc_has_58_points_and_begins_as_printed() -> None:
    points = arc()
    assert points.shape == (58, 3)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 0.2)
    assert (points[:, 2] == 0.085).all()
    printed = [[10.46, -199.73], [21.08, -198.89], [31.63, -197.48]]
    np.testing.assert_allclose(1000 * points[:3, :2], printed, atol=0.03)


def test_the_line_has_29_points_from_minus_196_to_196() -> None:
    points = line()
    assert points.shape == (29, 3)
    np.testing.assert_allclose(1000 * points[:3], [[220, -196, 85], [220, -182, 85], [220, -168, 85]])
    np.testing.assert_allclose(1000 * points[-1], [220, 196, 85])


@pytest.mark.parametrize("path", [arc, line])
def test_the_arm_reaches_every_point(path: object) -> None:
    robot = load_robot("uzuner")
    assert callable(path)
    assert all(robot.inverse(point).success for point in path())
