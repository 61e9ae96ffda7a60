from __future__ import annotations

import numpy as np
import pytest
from tests.program.kit import program

from armctl import load_robot
from armctl.errors import InputError, ProgramError, UnreachableError
from armctl.motion import PointToPoint, SlowedTrajectory, peaks_of
from armctl.program import (
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SpeedStep,
    WaitStep,
)
from armctl.program.rehearsal import pose_after, rehearse, rehearse_pose
from armctl.robot import CarriedPart

ROBOT = load_robot("uzuner")
REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")
TO_HOME = MoveStep(joints_deg=tuple(np.degrees(HOME).tolist()))
TO_REST = MoveStep(joints_deg=tuple(np.degrees(REST).tolist()))


def test_each_step_takes_its_time() -> None:
    found = rehearse(
        ROBOT, program(TO_HOME, WaitStep(seconds=0.5), GripperStep(open_percent=100), TO_REST), REST, 0.0
    )
    way = PointToPoint.plan(ROBOT, REST, HOME).duration
    assert ROBOT.gripper is not None
    grip = 1 / ROBOT.gripper.speed
    begins = [step.begins for step in found.steps]
    there = 0.02 * np.ceil(way / 0.02)  # at a tick
    np.testing.assert_allclose(begins, [0, there, there + 0.5, there + 0.5 + grip])
    assert found.duration == found.trajectory.duration == pytest.approx(begins[-1] + way)
    assert [s.index for s in found.steps] == [0, 1, 2, 3]
    assert found.sample(there + 0.5 + grip / 2).opening == pytest.approx(0.5)
    assert found.sample(there + 0.1).index == 1
    np.testing.assert_array_equal(found.sample(there + 0.1).q, HOME)
    np.testing.assert_array_equal(found.sample(1e9).q, REST)
    np.testing.assert_array_equal(found.sample(-1).q, REST)
    assert not found.cut
    assert found.tool_path(ROBOT, 50).shape == (50, 3)


def test_a_part_is_carried_from_the_step_that_grips_it() -> None:
    grip = GripperStep(open_percent=30, part_x_mm=20, part_y_mm=30, part_z_mm=40)
    steps = (TO_HOME, grip, WaitStep(seconds=1), TO_REST, GripperStep(open_percent=100), TO_HOME)
    part, before = CarriedPart((20, 30, 40)), CarriedPart((9, 9, 9))
    found = rehearse(ROBOT.carrying(before), program(*steps), REST, 1.0)
    assert [step.part for step in found.steps] == [before, part, part, part, None, None]
    assert found.sample(found.steps[3].begins + 0.1).part == part
    assert rehearse_pose(ROBOT.carrying(part), REST, HOME, 0.3).steps[0].part == part


def test_blended_steps_do_not_stop() -> None:
    corners = [(180, -60), (180, 60), (220, 60), (220, -60)]
    steps = [LineStep(x_mm=x, y_mm=y, z_mm=100, pitch="free", blend_mm=10) for x, y in corners]
    found = rehearse(ROBOT, program(PointStep(x_mm=220, y_mm=-60, z_mm=100), *steps), REST)
    motion = found.trajectory
    begin, end = found.steps[1].begins, found.steps[-1].begins
    speed = np.abs(motion.sample(np.linspace(begin + 0.1, end, 500)).velocity).max(axis=1)
    assert speed.min() > 0.02


def test_a_block_is_shown_as_often_as_it_runs_and_slowly_where_asked() -> None:
    steps = (RepeatStep(times=3), TO_HOME, TO_REST, EndStep(), SpeedStep(percent=50), TO_HOME)
    found = rehearse(ROBOT, program(*steps), REST)
    assert [s.index for s in found.steps] == [1, 2, 1, 2, 1, 2, 4, 5]
    assert found.steps[-1].duration == pytest.approx(2 * found.steps[0].duration)


def test_a_long_one_is_cut() -> None:
    found = rehearse(ROBOT, program(RepeatStep(times=1000), TO_HOME, TO_REST, EndStep()), REST, longest_s=9)
    assert found.cut
    assert 9 <= found.duration < 20
    few = rehearse(ROBOT, program(RepeatStep(times=1000), TO_HOME, TO_REST, EndStep()), REST, most_steps=4)
    assert few.cut
    assert len(few.steps) == 4


@pytest.mark.parametrize(
    ("what", "text"),
    [
        (program(), "no steps"),
        (program(TO_HOME, robot="mico"), "for the robot 'mico'"),
        (program(TO_HOME, PointStep(x_mm=900, y_mm=0, z_mm=0)), "pick: step 2: too far"),
    ],
)
def test_what_cannot_be_run_is_refused(what: Program, text: str) -> None:
    with pytest.raises(ProgramError, match=text):
        rehearse(ROBOT, what, REST)


def test_a_pose() -> None:
    found = rehearse_pose(ROBOT, REST, HOME, 0.25)
    np.testing.assert_array_equal(found.sample(found.duration).q, HOME)
    assert found.sample(0.1).opening == 0.25


def test_slower_is_the_same_way() -> None:
    motion = PointToPoint.plan(ROBOT, REST, HOME, profile="s-curve")
    slow = SlowedTrajectory(motion, 4.0)
    t = np.linspace(0, motion.duration, 200)
    here, there = motion.sample(t), slow.sample(4 * t)
    np.testing.assert_allclose(there.q, here.q, atol=1e-12)
    np.testing.assert_allclose(there.velocity, here.velocity / 4, atol=1e-12)
    np.testing.assert_allclose(there.acceleration, here.acceleration / 16, atol=1e-9)
    np.testing.assert_allclose(there.jerk, here.jerk / 64, atol=1e-6)
    np.testing.assert_allclose(peaks_of(slow).speed, peaks_of(motion).speed / 4)
    for factor in (0.5, np.nan, np.inf):
        with pytest.raises(InputError, match=r"factor of 1 or more|must be a finite number"):
            SlowedTrajectory(motion, factor)


def test_where_a_step_leads_is_where_the_rehearsal_of_those_ahead_of_it_ends() -> None:
    x, y, z = (1000 * ROBOT.forward(HOME)[:3, 3]).tolist()
    led = program(
        SpeedStep(percent=50),
        LineStep(x_mm=x, y_mm=y, z_mm=z - 15, pitch="free"),
        PointStep(x_mm=x, y_mm=y, z_mm=z - 15),
        LineStep(x_mm=x - 10, y_mm=y, z_mm=z - 15, pitch="free"),
        LineStep(x_mm=x - 10, y_mm=y, z_mm=z, pitch="free"),
        WaitStep(seconds=1),
        TO_REST,
        PointStep(x_mm=x, y_mm=y, z_mm=z - 5, choose="least-travel"),
        TO_HOME,
    )
    ends = {step.index: step.trajectory.end for step in rehearse(ROBOT, led, HOME).steps}
    for row, step in enumerate(led.steps):
        q = pose_after(ROBOT, led, row, HOME)
        if isinstance(step, SpeedStep | WaitStep):
            assert q is None
        else:
            np.testing.assert_allclose(q, ends[row], atol=1e-9)


def test_a_step_that_leads_nowhere_says_why() -> None:
    with pytest.raises(UnreachableError):
        pose_after(ROBOT, program(PointStep(x_mm=5000, y_mm=0, z_mm=0)), 0, HOME)


def test_it_is_cut_where_it_may_not_go_on_but_never_before_its_first_step() -> None:
    led = program(TO_HOME, WaitStep(seconds=1), TO_REST, TO_HOME)
    left = iter([True, False])
    found = rehearse(ROBOT, led, REST, go_on=lambda: next(left))
    assert found.cut and [step.index for step in found.steps] == [0, 1]
    assert len(rehearse(ROBOT, led, REST, go_on=lambda: False).steps) == 1
