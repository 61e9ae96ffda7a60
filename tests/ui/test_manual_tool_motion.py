from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.runtime.kit import make_rig

from armctl.motion import PointToPoint
from armctl.robot import load_robot
from armctl.ui.tabs.manual.live_readout import joint_table, tool_motion, tool_table

ROBOT = load_robot("uzuner")
FRACTIONS = st.lists(st.floats(0.02, 0.98), min_size=ROBOT.n, max_size=ROBOT.n).map(np.array)


@settings(max_examples=30)
@given(FRACTIONS, FRACTIONS, st.floats(0.1, 0.9))
def test_velocity_and_acceleration_are_the_derivatives_of_the_position(
    a: np.ndarray, b: np.ndarray, at: float
) -> None:
    low, high = ROBOT.limits[:, 0], ROBOT.limits[:, 1]
    path = PointToPoint.plan(ROBOT, low + a * (high - low), low + b * (high - low))
    if path.duration < 0.05:
        return
    t, h = at * path.duration, 1e-4
    state = path.sample(t)
    before, here, after = (ROBOT.forward(path.sample(s).q)[:3, 3] for s in (t - h, t, t + h))
    position, velocity, acceleration = tool_motion(ROBOT, state.q, state.velocity, state.acceleration)
    assert position == pytest.approx(here, abs=1e-12)
    assert velocity == pytest.approx((after - before) / (2 * h), abs=1e-5)
    assert acceleration == pytest.approx((after - 2 * here + before) / h**2, abs=1e-4)


def test_the_live_tables_show_units_signs_and_what_is_not_known() -> None:
    snapshot = make_rig().enable(ROBOT.pose("home")).now
    html = tool_table(ROBOT, snapshot)
    assert all(head in html for head in ("position mm", "velocity mm/s", "acceleration mm/s²"))
    assert "pitch <b>−30.00°</b> · roll <b>0.00°</b>" in html
    turned = tool_table(ROBOT, replace(snapshot, q_command=np.radians([20.0, 60.0, -40.0, -50.0, 33.0])))
    assert "pitch <b>−30.00°</b> · roll <b>33.00°</b>" in turned
    assert ">−0.0" not in html
    joints = joint_table(ROBOT, replace(snapshot, q=np.array([np.nan, *snapshot.q[1:]])))
    assert all(text in joints for text in (">transmitted<", ">–<", "−80.00"))


def test_an_arm_that_was_told_nothing_has_no_commanded_figures() -> None:
    snapshot = make_rig().now
    assert not snapshot.commanded
    figures = tool_table(ROBOT, snapshot) + joint_table(ROBOT, snapshot)
    assert re.findall(r">(−?\d[^<]*)</td>", figures) == []
    assert figures.count(">–<") == 3 + 2 * ROBOT.n
