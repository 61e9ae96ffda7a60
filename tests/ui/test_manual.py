from __future__ import annotations

import asyncio
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.arms import FIVE
from tests.long import examples
from tests.runtime.kit import make_rig

from armctl.errors import InputError, MotionRefusedError, StateError
from armctl.motion import PointToPoint
from armctl.protocol import ManualClock
from armctl.robot import CarriedPart, load_robot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.jog import KEYS, HeldJog, part_of, tool_axes, tool_jog
from armctl.ui.tabs.manual.joints import checked_percent, joint_table, stepped, tool_motion, tool_table
from armctl.ui.widgets.angle_fields import slider_degrees, slider_limits

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")
FRACTIONS = st.lists(st.floats(0.02, 0.98), min_size=ROBOT.n, max_size=ROBOT.n).map(np.array)


@pytest.mark.parametrize(
    ("text", "edges"),
    [
        ("", None),
        (" Empty ", None),
        ("20 × 30 × 40", (20, 30, 40)),
        ("20x30X12.5", (20, 30, 12.5)),
        ("20, 30; 40", (20, 30, 40)),
        ("(20 30 40)", (20, 30, 40)),
    ],
)
def test_the_size_of_a_part_is_written_as_people_do(text: str, edges: tuple[float, ...] | None) -> None:
    assert part_of(text) == CarriedPart.of(edges)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("20 × 30", r"Part mm: 3 numbers are needed \(X, Y, Z\), got 2"),
        ("a cube", "Part mm: 3 numbers are needed"),
        ("20 × 30 × high", "Part mm: Z: 'high' is not a number"),
        ("20 × 0 × 40", "the edge along y of the tool, 0 mm is outside 0.1 … 1000 mm"),
    ],
)
def test_what_is_no_size_is_refused(text: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        part_of(text)


def test_a_step_turns_one_joint_as_far_as_its_limit() -> None:
    q = stepped(ROBOT, HOME, 3, -5.0)
    assert np.degrees(q - HOME) == pytest.approx([0, 0, 0, -5, 0])
    with pytest.raises(MotionRefusedError, match=r"Elbow: -10° from -80\.00° .*; it can turn 4\.36° more"):
        stepped(ROBOT, HOME, 2, -10.0)
    at_limit = HOME.copy()
    at_limit[0] = ROBOT.limits[0, 1]
    for size in (0.1, 1.0, 5.0, 10.0):  # it may end on the limit, and always leaves it
        inside = stepped(ROBOT, at_limit, 0, -size)
        assert stepped(ROBOT, inside, 0, size)[0] == pytest.approx(ROBOT.limits[0, 1])
        with pytest.raises(MotionRefusedError):
            stepped(ROBOT, at_limit, 0, size)


def test_slider_positions_are_hundredths_inside_the_limits_and_can_be_sent_back() -> None:
    joints = [replace(joint, lower=-1.91986, upper=1.91987) for joint in ROBOT.joints]
    joints[1] = replace(joints[1], lower=0.2, upper=0.20001)  # no hundredth inside
    robot = replace(ROBOT, joints=tuple(joints))
    ends = slider_limits(robot)
    assert ends[0].tolist() == [-109.99, 110.0]
    assert ends[1] == pytest.approx(np.degrees([0.2, 0.20001]), abs=0)
    assert slider_limits(ROBOT)[1].tolist() == [-3.19, 146.83]
    poses = [(one, q) for one in (ROBOT, robot) for q in one.limits.T] + [(ROBOT, HOME)]
    for one, q in poses:
        degrees = slider_degrees(one, q)
        sent = one.check_limits(np.radians(degrees))  # not refused
        assert np.abs(sent - q).max() < np.radians(0.01)
        assert slider_degrees(one, sent) == pytest.approx(degrees, abs=1e-9)


@pytest.mark.parametrize("value", [-0.1, 100.5, float("nan"), float("inf")])
def test_a_percentage_outside_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"gripper: .* % is outside 0 … 100 %"):
        checked_percent(value, "gripper")


def test_one_hold_is_refused_once_and_the_next_one_counts_again() -> None:
    asked: list[float] = []

    async def submit(command: object) -> None:
        asked.append(clock.now())
        if len(asked) == 1:
            raise StateError("enable it first")

    clock = ManualClock(1.0)
    jog = HeldJog(cast(Session, SimpleNamespace(submit=submit)), now=clock.now)
    with pytest.raises(StateError):
        asyncio.run(jog.send(lambda: tool_jog("X", 1.0, 30, "base")))
    for stamp in (1.05, 1.3, 1.55, 2.5, 2.55):
        clock.advance(stamp - clock.now())
        asyncio.run(jog.send(lambda: tool_jog("X", 1.0, 30, "base")))
    assert asked == pytest.approx([1.0, 2.5, 2.55])


@pytest.mark.parametrize(
    ("axis", "way", "linear", "turns_deg"),
    [
        ("Y", -1.0, [0, -0.03, 0], [0, 0]),
        ("Pitch", 1.0, [0, 0, 0], [15, 0]),  # half a degree for each millimetre
        ("Roll", 1.0, [0, 0, 0], [0, 15]),
    ],
)
def test_an_axis_becomes_a_velocity_of_the_tool(
    axis: str, way: float, linear: list[float], turns_deg: list[float]
) -> None:
    jog = tool_jog(axis, way, 30, "tool")
    assert (jog.linear.tolist(), jog.frame) == (pytest.approx(linear), "tool")
    assert np.degrees([jog.pitch_rate, jog.roll_rate]) == pytest.approx(turns_deg)


def test_no_key_is_used_twice_or_moves_the_camera_and_only_turns_that_an_arm_has_have_buttons() -> None:
    keys = [key for pair in KEYS for key in pair]
    assert len(set(keys)) == len(keys)
    assert not set(keys) & set("WASDQE")
    for robot in map(load_robot, FIVE):
        assert max(robot.n, len(tool_axes(robot))) <= len(KEYS)
    assert tool_axes(load_robot("uzuner")) == ("X", "Y", "Z", "Pitch", "Roll")
    assert tool_axes(load_robot("mico")) == ("X", "Y", "Z", "Roll")
    assert tool_axes(load_robot("humanoid")) == ("X", "Y", "Z", "Pitch")


@settings(max_examples=examples(30))
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
    snapshot = make_rig().now
    assert not snapshot.commanded
    figures = tool_table(ROBOT, snapshot) + joint_table(ROBOT, snapshot)
    assert re.findall(r">(−?\d[^<]*)</td>", figures) == []
    assert figures.count(">–<") == 3 + 2 * ROBOT.n
