from __future__ import annotations

import numpy as np
import pytest

from armctl.errors import InputError, MotionRefusedError, UnreachableError
from armctl.kinematics import Target
from armctl.motion import PointToPoint, plan_joints, plan_target
from armctl.program import MoveStep, PointStep
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def test_planned_is_cubic_and_normal_is_each_joint_for_itself() -> None:
    end = ROBOT.pose("rest")
    assert isinstance(plan_joints(ROBOT, HOME, end), PointToPoint)
    normal, cubic = plan_joints(ROBOT, HOME, end, profile="normal"), plan_joints(ROBOT, HOME, end)
    middle = 0.5 * cubic.duration
    assert np.abs(normal.sample(middle).q - cubic.sample(middle).q).max() > 0.01
    timed = plan_joints(ROBOT, HOME, end, 5.0, profile="normal")
    assert isinstance(timed, PointToPoint)
    assert timed.duration == 5.0


def test_a_target_is_met() -> None:
    point = np.array([0.2, 0.05, 0.085])
    trajectory = plan_target(ROBOT, HOME, Target.of(point))
    np.testing.assert_allclose(ROBOT.forward(trajectory.end)[:3, 3], point, atol=1e-9)
    assert np.array_equal(trajectory.start, HOME)


def test_what_cannot_be_is_refused_in_words() -> None:
    with pytest.raises(UnreachableError, match="the nearest reachable point is"):
        plan_target(ROBOT, HOME, Target.of([0.6, 0.0, 0.1]))
    with pytest.raises(InputError, match="criterion 'cheapest'"):
        plan_target(ROBOT, HOME, Target.of([0.2, 0.0, 0.1]), "cheapest")
    with pytest.raises(MotionRefusedError, match="Base: 170"):
        plan_joints(ROBOT, HOME, np.radians([170, 90, 0, 0, 0]))


def test_steps_are_in_degrees_and_millimetres() -> None:
    move = MoveStep(joints_deg=(10, 80, -70, -30, 5), duration_s=4).plan(ROBOT, HOME)
    np.testing.assert_allclose(np.degrees(move.end), [10, 80, -70, -30, 5])
    assert move.duration == 4
    point = PointStep(x_mm=250, y_mm=-50, z_mm=85, pitch_deg=-45, roll_deg=5).plan(ROBOT, HOME)
    tool = ROBOT.forward(point.end)
    np.testing.assert_allclose(1000 * tool[:3, 3], [250, -50, 85], atol=1e-6)
    assert np.degrees(np.arcsin(tool[2, 2])) == pytest.approx(-45)
