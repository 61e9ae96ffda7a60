"""An arm goes to the best of the solutions to which it may go, by whichever way it is asked."""

from __future__ import annotations

import numpy as np
import pytest

from armctl.errors import MotionRefusedError
from armctl.kinematics import Target
from armctl.motion.choices import choose_end, plan_choice, solve
from armctl.motion.plan import plan_joints
from armctl.program import PointStep
from armctl.robot import load_robot

UR5 = load_robot("ur5")


@pytest.mark.parametrize("point_mm", [(108.1, 137.5, 123.4), (-566.0, -101.7, 421.6), (-35.6, -50.0, 257.7)])
def test_a_step_of_a_program_goes_where_a_single_motion_goes_though_the_best_is_refused(
    point_mm: tuple[float, float, float],
) -> None:
    x, y, z = point_mm
    start, target = UR5.pose("home"), Target.of((x / 1000, y / 1000, z / 1000))
    best = solve(UR5, start, target, "least-rotation")
    with pytest.raises(MotionRefusedError):
        plan_joints(UR5, start, best)
    trajectory, why = plan_choice(UR5, start, target)
    assert why is not None and np.abs(trajectory.end - best).max() > 0.1
    assert choose_end(UR5, start, target) == pytest.approx(trajectory.end)
    assert PointStep(x_mm=x, y_mm=y, z_mm=z).plan(UR5, start).end == pytest.approx(trajectory.end)
