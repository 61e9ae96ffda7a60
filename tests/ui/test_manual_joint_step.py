from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import make_rig

from armctl.errors import InputError, MotionRefusedError, StateError
from armctl.hardware import Source
from armctl.robot import load_robot
from armctl.runtime import State
from armctl.ui.tabs.manual.joints import checked_percent, stepped
from armctl.ui.tabs.program.record import checked_seconds, present_pose_deg
from armctl.ui.widgets.events import Hold
from armctl.ui.widgets.joint_angles import slider_degrees, slider_limits

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def test_a_step_turns_one_joint_from_the_commanded_pose() -> None:
    q = stepped(ROBOT, HOME, 3, -5.0)
    assert np.degrees(q - HOME) == pytest.approx([0, 0, 0, -5, 0])


def test_a_step_past_a_limit_is_refused_and_says_how_far_it_can_go() -> None:
    with pytest.raises(
        MotionRefusedError,
        match=r"Elbow: -10° from -80\.00° leads to -90\.00°, the limit is -84\.36°; it can turn 4\.36° more",
    ):
        stepped(ROBOT, HOME, 2, -10.0)


def test_a_step_may_end_on_the_limit_and_always_leaves_it() -> None:
    at_limit = HOME.copy()
    at_limit[0] = ROBOT.limits[0, 1]
    for size in (0.1, 1.0, 5.0, 10.0):
        inside = stepped(ROBOT, at_limit, 0, -size)
        assert stepped(ROBOT, inside, 0, size)[0] == pytest.approx(ROBOT.limits[0, 1])
        with pytest.raises(MotionRefusedError):
            stepped(ROBOT, at_limit, 0, size)


def test_slider_positions_are_hundredths_inside_the_limits_and_can_be_sent_back() -> None:
    for q in (ROBOT.limits[:, 0], ROBOT.limits[:, 1], HOME, ROBOT.limits.mean(axis=1)):
        degrees = slider_degrees(ROBOT, q)
        assert np.abs(ROBOT.check_limits(np.radians(degrees)) - q).max() < np.radians(0.0051)
        assert slider_degrees(ROBOT, ROBOT.check_limits(np.radians(degrees))) == pytest.approx(
            degrees, abs=1e-9
        )


def test_the_ends_of_a_slider_are_hundredths_inside_the_limits() -> None:
    joints = [replace(joint, lower=-1.91986, upper=1.91987) for joint in ROBOT.joints]
    joints[1] = replace(joints[1], lower=0.2, upper=0.20001)  # no hundredth inside
    robot = replace(ROBOT, joints=tuple(joints))
    ends = slider_limits(robot)
    assert ends[0].tolist() == [-109.99, 110.0]
    assert ends[1] == pytest.approx(np.degrees([0.2, 0.20001]), abs=0)
    for q in robot.limits.T:
        robot.check_limits(np.radians(slider_degrees(robot, q)))  # not refused
    assert slider_limits(ROBOT)[1].tolist() == [-3.19, 146.83]


def test_the_recorded_pose_is_the_commanded_one_while_the_pulses_are_on() -> None:
    snapshot = make_rig().enable().now
    assert present_pose_deg(ROBOT, snapshot) == pytest.approx((0, 110, -80, -70, 0))


def test_without_pulses_only_a_measured_pose_can_be_recorded() -> None:
    off = replace(
        make_rig().now, powered=False, state=State.OFF, source=Source.TRANSMITTED, q=np.full(5, np.nan)
    )
    with pytest.raises(StateError, match="the arm is off, so nobody knows where it stands"):
        present_pose_deg(ROBOT, off)
    with pytest.raises(StateError, match="nobody knows where it stands"):
        present_pose_deg(ROBOT, replace(off, source=Source.MEASURED, powered=True))  # motors on, not homed
    by_hand = replace(off, source=Source.MEASURED, q=np.radians([10.0, 100, -30, -20, 5]))
    assert present_pose_deg(ROBOT, by_hand) == pytest.approx((10, 100, -30, -20, 5))


def test_an_arm_that_nobody_has_enabled_yet_is_recorded_where_its_board_holds_it() -> None:
    q = np.radians([10.0, 100, -30, -20, 5])
    found_on = replace(make_rig().now, powered=True, state=State.OFF, source=Source.TRANSMITTED, q=q)
    assert present_pose_deg(ROBOT, found_on) == pytest.approx((10, 100, -30, -20, 5))


@pytest.mark.parametrize("value", [-0.1, 100.5, float("nan"), float("inf")])
def test_a_percentage_outside_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"gripper: .* % is outside 0 … 100 %"):
        checked_percent(value, "gripper")


@pytest.mark.parametrize("value", [-1.0, 1e9, float("nan")])
def test_a_wait_outside_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"a wait of .* s is outside 0 … 86400 s"):
        checked_seconds(value)


def test_one_hold_is_refused_once_and_the_next_one_counts_again() -> None:
    hold = Hold()
    assert hold.wants(1.0)
    hold.refuse()
    assert not any(hold.wants(1.0 + 0.05 * k) for k in range(1, 20))
    assert hold.wants(2.5)
