"""Touched points, and where the arm stands when one is added."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import make_rig

from armctl.calibration import Calibration, JointCalibration, ToolError, calibrated, own_calibration
from armctl.errors import CalibrationError, InputError, StateError
from armctl.hardware import Source
from armctl.robot import OutputMap, load_robot
from armctl.runtime import Snapshot, State
from armctl.ui.tabs.calibration.shared_calibration import (
    TouchedPoints,
    present_outputs,
    standing_gripper,
    standing_outputs,
)

ROBOT = load_robot("uzuner")
ELBOW_OFF = np.radians(2.0)
TOUCHED_DEG = (
    (0, 90, -80, -40, 0),
    (40, 70, -60, -30, 0),
    (-40, 100, -40, -60, 0),
    (60, 60, -20, -70, 0),
    (-60, 110, -75, -20, 0),
    (20, 80, -30, -80, 0),
)


def the_map() -> OutputMap:
    assert ROBOT.output_map is not None
    return ROBOT.output_map


def touch(points: TouchedPoints, count: int = len(TOUCHED_DEG)) -> None:
    """Touch with an elbow that stands 2° from where the arm believes it."""
    for pose in TOUCHED_DEG[:count]:
        q = np.radians(np.array(pose, dtype=float))
        really = q.copy()
        really[2] += ELBOW_OFF
        points.add(the_map().outputs(q), ROBOT.forward(really)[:3, 3])


def test_five_points_tell_nothing_and_six_name_the_joint() -> None:
    points = TouchedPoints(ROBOT)
    touch(points, 5)
    asyncio.run(points.compute())
    assert points.result is None
    assert (points.distances_m > 0.001).all()
    points = TouchedPoints(ROBOT)
    touch(points)
    before = points.version
    asyncio.run(points.compute())
    assert isinstance(points.result, ToolError)
    assert points.version > before
    assert points.result.blame is not None and "Elbow" in points.result.blame.title
    assert points.result.largest_m == pytest.approx(points.distances_m.max())
    assert "zero_us" in points.result.toml()


def test_points_of_one_place_are_answered_in_words() -> None:
    points = TouchedPoints(ROBOT)
    q = ROBOT.pose("home")
    for _ in range(6):
        points.add(the_map().outputs(q), ROBOT.forward(q)[:3, 3])
    asyncio.run(points.compute())
    assert isinstance(points.result, str)
    assert "spread them over the arm's workspace" in points.result


def test_touches_stay_true_when_the_calibration_changes() -> None:
    points = TouchedPoints(ROBOT)
    touch(points)
    own = own_calibration(ROBOT, "elbow")
    right = JointCalibration(own.zero - ELBOW_OFF * own.per_rad, own.per_rad, own.low, own.high)
    mended = calibrated(ROBOT, Calibration("uzuner", "simulated", "µs", {"elbow": right}))
    later = TouchedPoints(mended)
    later.take_over(points)
    assert later.distances_m == pytest.approx(np.zeros(6), abs=1e-6)


def test_what_is_found_out_about_touches_that_have_changed_is_dropped() -> None:
    async def change_meanwhile() -> TouchedPoints:
        points = TouchedPoints(ROBOT)
        touch(points)
        computing = asyncio.create_task(points.compute())
        await asyncio.sleep(0)
        points.delete(0)
        await computing
        return points

    points = asyncio.run(change_meanwhile())
    assert points.result is None
    assert len(points.touches) == 5


@pytest.mark.parametrize("point", [(np.nan, 0, 0), (np.inf, 0, 0), (11.0, 0, 0)])
def test_no_point_is_no_touch(point: tuple[float, float, float]) -> None:
    points = TouchedPoints(ROBOT)
    with pytest.raises(InputError, match="less than 10 m from the base"):
        points.add(the_map().outputs(ROBOT.pose("home")), np.array(point))
    with pytest.raises(InputError, match="there is no point 1; there are 0"):
        points.delete(0)


def holding() -> Snapshot:
    return make_rig().enable().now


def test_a_mark_is_taken_where_the_board_says_the_arm_stands() -> None:
    snapshot = holding()
    there = snapshot.q_command + 0.1
    known = replace(snapshot, q=there)
    assert standing_outputs(ROBOT, known) == pytest.approx(the_map().outputs(there))
    partly = replace(snapshot, q=np.where(np.arange(5) == 1, np.nan, there))
    expected = np.where(np.arange(5) == 1, snapshot.q_command, there)
    assert standing_outputs(ROBOT, partly) == pytest.approx(the_map().outputs(expected))


@pytest.mark.parametrize("state", [State.MOVING, State.PAUSED])
def test_no_mark_is_taken_on_the_way(state: State) -> None:
    moving = replace(holding(), state=state)
    with pytest.raises(StateError, match="wait until it stands"):
        standing_outputs(ROBOT, moving)
    assert present_outputs(ROBOT, moving)  # it may be looked at


def test_an_arm_that_is_off_has_marks_only_where_its_board_measures() -> None:
    off = replace(holding(), powered=False, commanded=False, state=State.OFF, q=np.full(5, np.nan))
    with pytest.raises(StateError, match="the arm is off, so nobody knows where it stands"):
        standing_outputs(ROBOT, off)
    by_hand = replace(off, source=Source.MEASURED, q=ROBOT.pose("home"))
    assert standing_outputs(ROBOT, by_hand) == pytest.approx(the_map().outputs(ROBOT.pose("home")))
    lost = replace(by_hand, q=np.full(5, np.nan))
    with pytest.raises(StateError, match="home the arm first"):
        standing_outputs(ROBOT, lost)
    held = replace(lost, powered=True)  # motors hold an arm whose homing was stopped
    with pytest.raises(StateError, match="home the arm first"):
        standing_outputs(ROBOT, held)


def test_a_gripper_that_was_never_told_stands_nowhere() -> None:
    snapshot = replace(holding(), gripper=None)
    with pytest.raises(StateError, match="press 'Move gripper' first"):
        standing_gripper(ROBOT, snapshot)
    outputs = the_map()
    half = (outputs.gripper_closed + outputs.gripper_open) / 2
    assert standing_gripper(ROBOT, replace(snapshot, gripper=0.5)) == pytest.approx(half)


def test_an_arm_without_outputs_has_none() -> None:
    with pytest.raises(CalibrationError, match="nothing to calibrate"):
        standing_outputs(replace(ROBOT, output_map=None), holding())
