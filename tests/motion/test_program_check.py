from __future__ import annotations

from dataclasses import replace

import pytest

from armctl.motion import GripperStep, MoveStep, PointStep, Program, Step, WaitStep, check_program
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
NEAR = PointStep(x_mm=200, y_mm=0, z_mm=85)


def found(*steps: Step, robot: str = "uzuner", motions: bool = True) -> list[str]:
    return [str(f) for f in check_program(Program(robot=robot, steps=steps), ROBOT, motions=motions)]


def test_a_good_program() -> None:
    least_travel = PointStep(x_mm=200, y_mm=50, z_mm=100, choose="least-travel")
    assert found(HOME, NEAR, WaitStep(seconds=1), GripperStep(open_percent=0), least_travel, HOME) == []
    assert found(least_travel, NEAR) == []


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (MoveStep(joints_deg=(0, 90)), "step 2: 5 joint angles are needed"),
        (MoveStep(joints_deg=(0, 90, -91.2, 0, 0)), "step 2: Elbow: -91.20° is outside -84.36° … 95.07°"),
        (
            MoveStep(joints_deg=(0, 60, -80, -40, 0), duration_s=0.1),
            "step 2: Shoulder: 30.00° in 0.100 s needs",
        ),
        (PointStep(x_mm=900, y_mm=0, z_mm=0), "step 2: "),
        (PointStep(x_mm=200, y_mm=0, z_mm=85, choose="cheapest"), "step 2: there is no criterion 'cheapest'"),
        (PointStep(x_mm=float("nan"), y_mm=0, z_mm=85), "step 2: the target position must be finite"),
        (GripperStep(open_percent=250), "step 2: the gripper opens 0 … 100 %, not 250"),
        (GripperStep(open_percent=float("nan")), "step 2: the gripper opens 0 … 100 %, not nan"),
        (WaitStep(seconds=-1), "step 2: a wait takes 0 … 86400 s, not -1"),
        (WaitStep(seconds=float("inf")), "step 2: a wait takes 0 … 86400 s, not inf"),
    ],
)
def test_what_is_wrong_with_a_step(step: Step, message: str) -> None:
    (text,) = found(HOME, step, NEAR)
    assert text.startswith(message)


def test_the_program_as_a_whole() -> None:
    assert found(HOME, robot="abaas") == ["it is for the robot 'abaas', this one is 'uzuner'"]
    assert found() == ["it has no steps"]


def test_without_motions_points_are_not_solved() -> None:
    assert found(PointStep(x_mm=900, y_mm=0, z_mm=0), motions=False) == []


def test_an_arm_without_gripper() -> None:
    bare = replace(ROBOT, gripper=None)
    program = Program(robot="uzuner", steps=(GripperStep(open_percent=1),))
    assert [f.what for f in check_program(program, bare)] == ["uzuner has no gripper; delete the step"]
