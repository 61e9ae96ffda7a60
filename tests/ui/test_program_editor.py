"""Recording steps where the arm stands, and the list that shows them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.arms import FIVE
from tests.robot.test_tools import arm_with_tools
from tests.runtime.kit import make_rig
from tests.runtime.signal_kit import robot_with

from armctl.errors import StateError
from armctl.facts import State
from armctl.hardware import Source
from armctl.kinematics import rotation_from_rpy
from armctl.program import (
    ArcStep,
    CallStep,
    CountStep,
    DrawStep,
    EndStep,
    GripperStep,
    IfStep,
    LineStep,
    MoveStep,
    PickStep,
    PlaceStep,
    PointStep,
    WaitForStep,
    WhileStep,
)
from armctl.program.steps import KINDS
from armctl.protocol import MoveGripper
from armctl.robot import Robot, load_robot
from armctl.ui.tabs.manual.new_step import (
    present_pose_deg,
    quick_kinds,
    recorded_kinds,
    step_here,
    tool_point_mm,
)

ROBOT = load_robot("uzuner")
HOME_DEG = (0.0, 90.0, -80.0, -40.0, 0.0)


def standing(robot: Robot, gripper: float | None = None) -> Any:
    """A snapshot of an arm in its first pose."""
    return SimpleNamespace(commanded=True, q_command=robot.pose("home"), gripper=gripper, part_mm=None)


@pytest.mark.parametrize("name", FIVE)
def test_a_recorded_point_leads_back_to_where_the_arm_stood(name: str) -> None:
    robot = load_robot(name)
    step = cast(PointStep, step_here(PointStep, robot, standing(robot)))
    pitch, roll = (None if angle is None else np.radians(angle) for angle in (step.pitch_deg, step.roll_deg))
    solutions = robot.inverse(np.array([step.x_mm, step.y_mm, step.z_mm]) / 1000, pitch=pitch, roll=roll)
    tip = robot.forward(robot.pose("home"))[:3, 3]
    assert np.abs(robot.forward(solutions.q)[:, :3, 3] - tip).max() < 5e-6


def test_each_kind_records_what_it_says() -> None:
    here = standing(ROBOT, gripper=0.3)
    held = SimpleNamespace(**vars(here) | {"part_mm": (20.0, 30.0, 40.0)})
    assert step_here(GripperStep, ROBOT, held) == GripperStep(
        open_percent=30, part_x_mm=20, part_y_mm=30, part_z_mm=40
    )
    x, y, z = tool_point_mm(ROBOT, HOME_DEG)
    assert step_here(MoveStep, ROBOT, here) == MoveStep(joints_deg=HOME_DEG)
    assert step_here(GripperStep, ROBOT, here) == GripperStep(open_percent=30)
    assert step_here(LineStep, ROBOT, here) == LineStep(x_mm=x, y_mm=y, z_mm=z)
    assert step_here(ArcStep, ROBOT, here, (1.0, 2.0, 3.0)) == ArcStep(
        via_x_mm=1, via_y_mm=2, via_z_mm=3, x_mm=x, y_mm=y, z_mm=z
    )
    with pytest.raises(StateError, match="an arc needs a point on its way: bring the tool there"):
        step_here(ArcStep, ROBOT, here)
    with pytest.raises(StateError, match="the gripper has not been told to move yet"):
        step_here(GripperStep, ROBOT, standing(ROBOT))
    mico = load_robot("mico")
    line, point = (step_here(kind, mico, standing(mico)) for kind in (LineStep, PointStep))
    assert (cast(LineStep, line).pitch, cast(PointStep, point).pitch_deg) == ("free", None)


@pytest.mark.parametrize("kind", [PointStep, LineStep])
def test_of_six_joints_the_whole_pose_of_the_tool_is_recorded(kind: type[PointStep | LineStep]) -> None:
    ur5 = load_robot("ur5")
    step, there = step_here(kind, ur5, standing(ur5)), ur5.forward(ur5.pose("home"))
    step.check(ur5)
    start = ur5.inverse(
        there[:3, 3] + [0.0, 0.03, 0.02], rotation=rotation_from_rpy(0.1, 0.2, 0) @ there[:3, :3]
    )
    end = step.plan(ur5, start.best("least-travel", ur5.pose("home"))).end
    np.testing.assert_allclose(ur5.forward(end), there, atol=2e-5)
    assert step.pitch_deg is None


def test_an_arm_without_a_gripper_has_no_button_for_it() -> None:
    tool = {"Point": PointStep, "Line": LineStep, "Arc": ArcStep}
    arm = {"Record pose": MoveStep, "Record gripper": GripperStep}
    assert quick_kinds(ROBOT) == {"Record": arm, "Record tool": tool}
    assert recorded_kinds(ROBOT)["Pick and place"] == {"Pick": PickStep, "Place": PlaceStep}
    bare = replace(ROBOT, gripper=None)
    assert quick_kinds(bare) == {"Record": {"Record pose": MoveStep}, "Record tool": tool}
    assert "Pick and place" not in recorded_kinds(bare)


def test_every_kind_of_step_that_a_file_holds_can_be_put_on_the_list(tmp_path: Path) -> None:
    """But an end, which comes with its block. What is made is right as it is, but for what it is about."""
    robot, here = arm_with_tools(tmp_path), standing(ROBOT, gripper=0.3)
    offered = recorded_kinds(robot)
    assert "Tool" not in recorded_kinds(ROBOT)["Program"]
    kinds = [kind for group in offered.values() for kind in group.values()]
    assert set(kinds) == set(KINDS) - {EndStep} and "Set output" not in recorded_kinds(ROBOT)["In and out"]
    names = {"program": "turn", "file": str(tmp_path / "name.svg"), "frame": "table", "counter": "cups"}
    (tmp_path / "name.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'><path d='M0 0h9'/></svg>")
    made = {kind: step_here(kind, robot, here, (1.0, 2.0, 3.0), names) for kind in kinds}
    for step in made.values():
        step.check(robot)
    assert made[IfStep] == IfStep(watch="button") and made[CountStep] == CountStep(counter="cups", add=1)
    assert step_here(WhileStep, ROBOT, here) == WhileStep(
        watch="counter", counter="parts", compare="below", value=3
    )
    step_here(WaitForStep, ROBOT, here).check(ROBOT)
    for kind, why in ((CallStep, "no other program is saved"), (DrawStep, "there is no drawing yet")):
        with pytest.raises(StateError, match=why):
            step_here(kind, ROBOT, here)


def test_a_pick_is_recorded_at_the_part_with_the_gripper_as_it_holds_it(tmp_path: Path) -> None:
    rig = make_rig().enable()
    rig.do(MoveGripper(0.3, (10, 20, 30)))
    rig.run(2.0)
    tip = np.round(1000 * ROBOT.forward(rig.now.q_command)[:3, 3], 3).tolist()
    pick, place = step_here(PickStep, ROBOT, rig.now), step_here(PlaceStep, ROBOT, rig.now)
    assert isinstance(pick, PickStep) and isinstance(place, PlaceStep)
    assert [pick.x_mm, pick.y_mm, pick.z_mm] == tip == [place.x_mm, place.y_mm, place.z_mm]
    assert pick.close_percent == 30 and pick.part_mm == (10, 20, 30) and place.open_percent == 100
    rig.do(MoveGripper(0.8))
    rig.run(2.0)
    pick = step_here(PickStep, ROBOT, rig.now)  # jaws that are open hold nothing: it is to close them
    assert isinstance(pick, PickStep) and pick.close_percent == 0
    sucker = replace(robot_with(tmp_path), gripper=None)
    pick = step_here(PickStep, sucker, rig.now)
    assert isinstance(pick, PickStep) and pick.output == "lamp"


def test_the_recorded_pose_is_the_commanded_one_or_one_that_the_board_knows() -> None:
    snapshot = make_rig().enable().now
    assert present_pose_deg(ROBOT, snapshot) == pytest.approx((0, 110, -80, -70, 0))
    off = replace(make_rig().now, powered=False, state=State.OFF, q=np.full(5, np.nan))
    with pytest.raises(StateError, match="the arm is off, so its pose is not known"):
        present_pose_deg(ROBOT, replace(off, source=Source.TRANSMITTED))
    with pytest.raises(StateError, match="so its pose is not known"):
        present_pose_deg(ROBOT, replace(off, source=Source.MEASURED, powered=True))  # motors on, not homed
    q = np.radians([10.0, 100, -30, -20, 5])
    by_hand = replace(off, source=Source.MEASURED, q=q)
    found_on = replace(off, source=Source.TRANSMITTED, powered=True, q=q)  # the board holds it
    for known in (by_hand, found_on):
        assert present_pose_deg(ROBOT, known) == pytest.approx((10, 100, -30, -20, 5))
