from __future__ import annotations

import numpy as np
import pytest

from armctl.errors import MotionRefusedError, ProgramError
from armctl.motion import GripperStep, MoveStep, PointStep, Program, WaitStep, plan_joints
from armctl.robot import load_robot
from armctl.ui.widgets.twin_plan import plan_pose, plan_program

ROBOT = load_robot("uzuner")
HOME, REST = ROBOT.pose("home"), ROBOT.pose("rest")
PROGRAM = Program(
    robot="uzuner",
    steps=(
        MoveStep(joints_deg=(30.0, 90.0, -80.0, -40.0, 0.0)),
        WaitStep(seconds=2.0),
        GripperStep(open_percent=100),
        MoveStep(joints_deg=(0.0, 90.0, -80.0, -40.0, 0.0), duration_s=3.0),
    ),
)


def test_a_motion_is_that_of_the_arm() -> None:
    plan, real = plan_pose(ROBOT, REST, HOME, 0.5), plan_joints(ROBOT, REST, HOME)
    assert plan.duration == real.duration
    for t in np.linspace(-0.5, real.duration + 0.5, 9).tolist():
        assert np.array_equal(plan.sample(t).q, real.sample(t).q)
    assert plan.sample(0.1).opening == 0.5


def test_a_program_goes_step_by_step() -> None:
    plan = plan_program(ROBOT, PROGRAM, HOME, 0.0)
    first, wait, grip, last = plan.parts
    assert (wait.duration, last.duration) == (2.0, 3.0)
    assert grip.duration == pytest.approx(1 / ROBOT.gripper.speed)  # type: ignore[union-attr]
    assert plan.duration == pytest.approx(first.duration + 5.0 + grip.duration)
    waiting = plan.sample(first.duration + 1.0)
    assert (waiting.step, waiting.opening) == (1, 0.0)
    assert np.degrees(waiting.q) == pytest.approx([30, 90, -80, -40, 0])
    gripping = plan.sample(first.duration + 2.0 + grip.duration / 2)
    assert (gripping.step, gripping.opening) == (2, pytest.approx(0.5))
    end = plan.sample(plan.duration)
    assert (end.step, end.opening) == (3, 1.0)
    assert end.q == pytest.approx(HOME)


def test_the_way_is_without_a_jump() -> None:
    plan = plan_program(ROBOT, PROGRAM, REST, None)
    times = np.linspace(0, plan.duration, 2000)
    q = np.array([plan.sample(t).q for t in times.tolist()])
    assert (np.abs(np.diff(q, axis=0)) <= ROBOT.speed_limits * (times[1] - times[0]) * 1.001).all()
    path = plan.tool_path(ROBOT, 50)
    assert path.shape == (50, 3)
    assert path[0] == pytest.approx(ROBOT.forward(REST)[:3, 3])
    assert path[-1] == pytest.approx(ROBOT.forward(HOME)[:3, 3])


def test_an_unknown_opening_is_known_after_the_gripper_step() -> None:
    plan = plan_program(ROBOT, PROGRAM, HOME, None)
    assert plan.sample(0.0).opening is None
    assert plan.sample(plan.duration).opening == 1.0


def test_what_the_arm_would_refuse_is_refused() -> None:
    def program(*steps: MoveStep | PointStep) -> Program:
        return Program(robot="uzuner", steps=steps)

    far = MoveStep(joints_deg=(200.0, 90.0, -80.0, -40.0, 0.0))
    with pytest.raises(ProgramError, match=r"step 1: Base: 200\.00° is outside"):
        plan_program(ROBOT, program(far), HOME, None)
    with pytest.raises(ProgramError, match="step 1: "):
        plan_program(ROBOT, program(PointStep(x_mm=900, y_mm=0, z_mm=100)), HOME, None)
    with pytest.raises(ProgramError, match="it has no steps"):
        plan_program(ROBOT, program(), HOME, None)
    with pytest.raises(MotionRefusedError):
        plan_pose(ROBOT, HOME, ROBOT.limits[:, 1] + 0.1, None)
