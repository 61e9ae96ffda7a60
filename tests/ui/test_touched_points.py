"""Touching a sheet in the browser: which crosshair is next, what is told, the correction, and its check."""

from __future__ import annotations

import asyncio
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.runtime.kit import make_rig

from armctl.arrays import FloatArray
from armctl.calibration import CalibrationStore, TouchFit, TouchSheet, calibrated, touch_sheet
from armctl.errors import InputError, StateError
from armctl.facts import State
from armctl.hardware import Source
from armctl.robot import load_robot
from armctl.ui import CalibrationInForce
from armctl.ui.tabs.calibration.points import next_html, points_html, result_html
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration, standing_touch
from armctl.ui.tabs.calibration.touched_points import TouchedPoint, TouchedPoints

ROBOT = load_robot("uzuner")
OFF = np.radians([0.0, 0.0, 4.0, -2.0, 0.0])
"""how far the joints truly are from what the arm believes"""
NOISE_M = 0.0003
"""how well a person sees where the tip is"""
PLACE, HEADING = np.array([0.17, 0.02, 0.004]), np.radians(25.0)
"""where the sheet truly lies"""


def plain(html: str) -> str:
    return re.sub(r"<[^>]+>", " ", html)


@cache
def the_sheet() -> TouchSheet:
    return touch_sheet(ROBOT)


def in_base(point: FloatArray) -> FloatArray:
    c, s = np.cos(HEADING), np.sin(HEADING)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ point + PLACE


def touch(points: TouchedPoints, number: int, wrong_m: float = 0.0, height_m: float | None = None) -> None:
    """Touch a crosshair, or a block on it, as somebody does who looks at the true tip."""
    count = len(points.touches)
    height = 0.08 * (count % 2) if height_m is None else height_m
    point = points.crosshair(number) + np.array((0.0, 0.0, height))
    at = in_base(point) + np.array((wrong_m, 0.0, 0.0))
    found = ROBOT.inverse(at + np.random.default_rng(count).normal(0.0, NOISE_M, 3)).q
    truly = found[count * 7919 % len(found)]  # in ever another pose
    assert ROBOT.output_map is not None
    x, y, z = point.tolist()
    points.add(TouchedPoint(ROBOT.output_map.outputs(truly - OFF), (x, y, z), number))


def touched(points: TouchedPoints, count: int) -> list[int]:
    """Touch what is proposed; gives the numbers."""
    numbers: list[int] = []
    for _ in range(count):
        assert points.next is not None
        numbers.append(points.next.number)
        touch(points, numbers[-1])
        asyncio.run(points.compute())
    return numbers


@pytest.fixture
def desk(tmp_path: Path) -> SharedCalibration:
    made = SharedCalibration(CalibrationInForce(ROBOT, "77", CalibrationStore(tmp_path)))
    made.points.sheet = the_sheet()
    asyncio.run(made.points.compute())
    return made


def test_touches_of_a_sheet_that_lies_anywhere_are_corrected_applied_and_checked(
    desk: SharedCalibration, tmp_path: Path
) -> None:
    points = desk.points
    with pytest.raises(StateError, match="there is no correction yet: 6 points"):
        desk.correction()
    numbers = touched(points, 10)
    assert len(set(numbers[:3])) == 3
    fit = points.result
    assert isinstance(fit, TouchFit) and fit.correct
    assert fit.after.rms < 0.001 < 0.002 < fit.before.rms
    told = plain(result_html(points))
    assert "Tool error" in told and "with the correction" in told and "zero off by" in told

    asyncio.run(desk.correct())
    kept = CalibrationStore(tmp_path).load("uzuner", "77")
    assert kept is not None and "touched points" in kept.note
    again = SharedCalibration(CalibrationInForce(ROBOT, "77", CalibrationStore(tmp_path)))
    again.adopt(desk)
    asyncio.run(again.points.compute())
    assert "Touch 3 more points to check it" in plain(result_html(again.points))
    assert again.points.errors_m is not None and again.points.errors_m.max() < 0.0015
    with pytest.raises(StateError, match="no number explains the error better than chance"):
        again.correction()
    touched(again.points, 3)
    checked = plain(result_html(again.points))
    assert re.search(r"Checked by points touched since \(3\):\s+0\.\d\d mm RMS", checked)
    before, now, home = ROBOT.output_map, calibrated(ROBOT, kept).output_map, ROBOT.pose("home")
    assert before is not None and now is not None
    wanted, bare = ROBOT.forward(home)[:3, 3], ROBOT.forward(home + OFF)[:3, 3]
    reached = ROBOT.forward(before.angles(now.outputs(home)) + OFF)[:3, 3]  # at a pose that nobody touched
    assert np.linalg.norm(reached - wanted) < 0.3 * np.linalg.norm(bare - wanted)


def test_with_a_block_some_points_are_proposed_on_it(desk: SharedCalibration) -> None:
    points = desk.points
    points.use_block(0.08)
    points.skip()  # it counts from the next change on
    asyncio.run(points.compute())
    heights: list[float] = []
    while len(points.touches) < 8:
        proposed = points.next
        assert proposed is not None
        on_it = "on the block (80.0 mm)" in plain(next_html(points))
        assert on_it is (proposed.height_m > 0)
        near, more = points.pose(proposed.number, proposed.height_m)
        assert near is proposed.q and not more.any()
        _, more = points.pose(proposed.number, proposed.height_m + 0.01)
        np.testing.assert_allclose(more, (0, 0, 0.01), atol=1e-12)
        above = np.array((0.0, 0.0, proposed.height_m + NOISE_M))
        if ROBOT.inverse(in_base(points.crosshair(proposed.number) + above)).success:
            heights.append(proposed.height_m)
            touch(points, proposed.number, height_m=proposed.height_m)
        else:  # the sheet lies elsewhere than it is drawn
            points.skip()
        asyncio.run(points.compute())
    assert set(np.round(heights, 9)) == {0.0, 0.08}
    fit = points.result
    assert isinstance(fit, TouchFit) and fit.after.rms < 0.001 < 0.002 < fit.before.rms


def test_what_was_touched_wrongly_is_marked_and_what_is_skipped_is_not_proposed(
    desk: SharedCalibration,
) -> None:
    points = desk.points
    assert points.next is not None
    first = points.next.number
    assert f"Touch crosshair {first} next" in plain(next_html(points))
    points.skip()
    asyncio.run(points.compute())
    assert points.next is not None and points.next.number != first
    touched(points, 9)
    assert first not in {one.number for one in points.touches}
    touch(points, 4, wrong_m=0.02)
    asyncio.run(points.compute())
    assert "✗" in points_html(points)
    assert "Point 10 is" in plain(result_html(points))
    assert points_html(points).count("✗") == 1
    points.delete(len(points.touches) - 1)
    asyncio.run(points.compute())
    assert "✗" not in points_html(points)


def test_points_of_two_kinds_are_not_mixed() -> None:
    points = TouchedPoints(ROBOT)
    x, y, z = ROBOT.forward(ROBOT.pose("home"))[:3, 3].tolist()
    assert ROBOT.output_map is not None
    points.add(TouchedPoint(ROBOT.output_map.outputs(ROBOT.pose("home")), (x, y, z)))
    with pytest.raises(StateError, match="1 points of another kind are touched"):
        asyncio.run(points.use_sheet("a4"))
    points.clear()
    asyncio.run(points.use_sheet("a4"))
    assert points.frame == "sheet"
    with pytest.raises(InputError, match="there is no crosshair 99"):
        points.crosshair(99)


def test_a_joint_stays_on_the_side_from_which_it_came() -> None:
    points, now = TouchedPoints(ROBOT), make_rig().enable().now
    for shoulder in (90.0, 95.0, 95.05, 94.95, 96.0, 90.0):
        q = np.radians([0.0, shoulder, -80.0, -40.0, 0.0])
        points.follow(replace(now, q=np.full(5, np.nan), q_command=q))
        if shoulder == 96.0:
            assert points.sense == (0.0, 1.0, 0.0, 0.0, 0.0)
    assert points.sense == (0.0, -1.0, 0.0, 0.0, 0.0)


def test_a_measured_touch_has_what_was_read_and_what_was_sent() -> None:
    now = make_rig().enable().now
    read = now.q_command - 0.02
    outputs = ROBOT.output_map
    assert outputs is not None
    measured = replace(now, q=read, source=Source.MEASURED)
    one = standing_touch(ROBOT, measured, np.zeros(3), 4, (1.0,) * 5)
    assert one.measured and one.number == 4
    assert outputs.angles(one.outputs, measured=True) == pytest.approx(read)
    assert one.sent is not None and outputs.angles(one.sent) == pytest.approx(now.q_command)
    assert standing_touch(ROBOT, replace(measured, state=State.OFF), np.zeros(3), 4, ()).sent is None
    assert not standing_touch(ROBOT, now, np.zeros(3), None, ()).measured
