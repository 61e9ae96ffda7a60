from __future__ import annotations

import numpy as np
import pytest

from armctl.robot import load_robot, shipped_robots
from armctl.ui.tabs.manual.jog import KEYS, tool_axes, tool_jog


def test_an_axis_becomes_a_velocity_of_the_tool() -> None:
    jog = tool_jog("Y", -1.0, 30, "tool")
    assert jog.linear == pytest.approx([0, -0.03, 0])
    assert (jog.pitch_rate, jog.roll_rate, jog.frame) == (0.0, 0.0, "tool")


@pytest.mark.parametrize(("axis", "rates"), [("Pitch", (15.0, 0.0)), ("Roll", (0.0, 15.0))])
def test_a_turn_goes_half_a_degree_for_each_millimetre(axis: str, rates: tuple[float, float]) -> None:
    jog = tool_jog("Pitch" if axis == "Pitch" else "Roll", 1.0, 30, "base")
    assert np.degrees([jog.pitch_rate, jog.roll_rate]) == pytest.approx(rates)
    assert not jog.linear.any()


def test_no_key_is_used_twice_and_none_that_moves_the_camera() -> None:
    keys = [key for pair in KEYS for key in pair]
    assert len(set(keys)) == len(keys)
    assert not set(keys) & set("WASDQE")


@pytest.mark.parametrize("name", shipped_robots())
def test_every_arm_has_keys_for_all_its_joints_and_axes(name: str) -> None:
    robot = load_robot(name)
    assert robot.n <= len(KEYS)
    assert tool_axes(robot)[:3] == ("X", "Y", "Z")
    assert len(tool_axes(robot)) <= len(KEYS)


def test_a_turn_that_an_arm_has_not_has_no_buttons() -> None:
    assert tool_axes(load_robot("uzuner")) == ("X", "Y", "Z", "Pitch", "Roll")
    assert tool_axes(load_robot("mico")) == ("X", "Y", "Z", "Roll")
    assert tool_axes(load_robot("humanoid")) == ("X", "Y", "Z", "Pitch")
