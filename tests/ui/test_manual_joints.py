from __future__ import annotations

import asyncio
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from armctl.errors import InputError, MotionRefusedError, StateError
from armctl.robot import load_robot, shipped_robots
from armctl.ui.session import Session
from armctl.ui.tabs.manual.jog import KEYS, HeldJog, tool_axes, tool_jog
from armctl.ui.tabs.manual.joints import checked_percent, stepped
from armctl.ui.widgets.joint_angles import slider_degrees, slider_limits

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def test_a_step_turns_one_joint_as_far_as_its_limit() -> None:
    q = stepped(ROBOT, HOME, 3, -5.0)
    assert np.degrees(q - HOME) == pytest.approx([0, 0, 0, -5, 0])
    with pytest.raises(MotionRefusedError, match=r"Elbow: -10° from -80\.00° .*; it can turn 4\.36° more"):
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


@pytest.mark.parametrize("value", [-0.1, 100.5, float("nan"), float("inf")])
def test_a_percentage_outside_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"gripper: .* % is outside 0 … 100 %"):
        checked_percent(value, "gripper")


def test_one_hold_is_refused_once_and_the_next_one_counts_again() -> None:
    asked: list[float] = []

    async def submit(command: object) -> None:
        asked.append(page.snapshot.stamp)
        if len(asked) == 1:
            raise StateError("enable it first")

    page = SimpleNamespace(snapshot=SimpleNamespace(stamp=1.0), submit=submit)
    jog = HeldJog(cast(Session, page))
    with pytest.raises(StateError):
        asyncio.run(jog.send(lambda: tool_jog("X", 1.0, 30, "base")))
    for stamp in (1.05, 1.3, 1.55, 2.5, 2.55):
        page.snapshot.stamp = stamp
        asyncio.run(jog.send(lambda: tool_jog("X", 1.0, 30, "base")))
    assert asked == [1.0, 2.5, 2.55]


def test_an_axis_becomes_a_velocity_of_the_tool() -> None:
    jog = tool_jog("Y", -1.0, 30, "tool")
    assert jog.linear == pytest.approx([0, -0.03, 0])
    assert (jog.pitch_rate, jog.roll_rate, jog.frame) == (0.0, 0.0, "tool")


@pytest.mark.parametrize(("axis", "rates"), [("Pitch", (15.0, 0.0)), ("Roll", (0.0, 15.0))])
def test_a_turn_goes_half_a_degree_for_each_millimetre(axis: str, rates: tuple[float, float]) -> None:
    jog = tool_jog(axis, 1.0, 30, "base")
    assert np.degrees([jog.pitch_rate, jog.roll_rate]) == pytest.approx(rates)
    assert not jog.linear.any()


def test_no_key_is_used_twice_and_none_that_moves_the_camera() -> None:
    keys = [key for pair in KEYS for key in pair]
    assert len(set(keys)) == len(keys)
    assert not set(keys) & set("WASDQE")
    for robot in map(load_robot, shipped_robots()):
        assert max(robot.n, len(tool_axes(robot))) <= len(KEYS)


def test_a_turn_that_an_arm_has_not_has_no_buttons() -> None:
    assert tool_axes(load_robot("uzuner")) == ("X", "Y", "Z", "Pitch", "Roll")
    assert tool_axes(load_robot("mico")) == ("X", "Y", "Z", "Roll")
    assert tool_axes(load_robot("humanoid")) == ("X", "Y", "Z", "Pitch")
