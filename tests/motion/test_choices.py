"""An arm goes to the best of the solutions to which it may go, by whichever way it is asked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from armctl.errors import MotionRefusedError
from armctl.kinematics import Solutions, Target
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


def test_a_target_is_solved_once_though_the_best_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    start, target = UR5.pose("home"), Target.of((0.1081, 0.1375, 0.1234))
    family, asked = type(UR5.inverse_kinematics), list[Target]()
    solve_it = family.solve

    def counted(solver: Any, target: Target, *more: Any) -> Solutions:
        asked.append(target)
        return solve_it(solver, target, *more)

    monkeypatch.setattr(family, "solve", counted)
    assert plan_choice(UR5, start, target)[1] is not None and len(asked) == 1
    choose_end(UR5, start, target)
    assert len(asked) == 2


def test_a_roll_that_is_free_is_turned_where_the_jaws_would_touch_as_it_stands() -> None:
    robot = load_robot("uzuner").with_body()
    home, passing = robot.pose("home"), np.radians([23.2, -2.3, -75.7, -75.0, -6.7])
    target = Target.of(robot.forward(passing)[:3, 3])
    with pytest.raises(MotionRefusedError, match="right jaw"):
        plan_joints(robot, home, solve(robot, home, target, "least-rotation"))
    end = plan_choice(robot, home, target)[0].end
    assert robot.forward(end)[:3, 3] == pytest.approx(target.position, abs=1e-9)
    assert abs(end[4]) == pytest.approx(np.radians(10.0))
