"""Touching a sheet in the browser: which crosshair is next, what is told, the correction, and its check."""

from __future__ import annotations

import asyncio
import re
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.robot.test_tools import arm_with_tools
from tests.runtime.kit import make_rig

from armctl.arrays import FloatArray
from armctl.calibration import (
    Calibration,
    CalibrationStore,
    JointDeflection,
    LengthChange,
    TouchedPoint,
    TouchFit,
    TouchSheet,
    calibrated,
    own_map,
    touch_sheet,
)
from armctl.errors import CalibrationError, InputError, StateError
from armctl.facts import State
from armctl.hardware import Source
from armctl.robot import OutputMap, load_robot
from armctl.ui import CalibrationInForce
from armctl.ui.tabs.calibration.points_html import next_html, offered_html, points_html, result_html
from armctl.ui.tabs.calibration.screen import load_html
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration, standing_touch
from armctl.ui.tabs.calibration.touch_scene import pose_above, sheet_lines
from armctl.ui.tabs.calibration.touched_points import TouchedPoints

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
    points.use(0.08, 0.0, 0.0)
    assert points.unknown  # what is proposed counts it at once
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


def test_a_sheet_that_lies_on_books_is_come_to_from_above_them(desk: SharedCalibration) -> None:
    points = desk.points
    assert points.use(0.0, 0.04, 0.0) and not points.use(0.0, 0.04, 0.0)
    asyncio.run(points.compute())
    proposed = points.next
    assert proposed is not None
    assert ROBOT.forward(proposed.q)[2, 3] == pytest.approx(ROBOT.floor_z + 0.04, abs=1e-6)
    q, _ = pose_above(ROBOT, ROBOT.forward(proposed.q)[:3, 3], proposed.q, ROBOT.pose("home"))
    assert ROBOT.forward(q)[2, 3] == pytest.approx(ROBOT.floor_z + 0.07, abs=1e-6)
    kept = points.as_kept.sheet
    assert kept is not None and kept.height_m == 0.04


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
    assert points_html(points).count("✗") == 1
    told = re.search(r"Point 10 is (\S+) mm .* the tip was (\S+), (\S+), \S+ mm", plain(result_html(points)))
    assert told is not None
    away, *off = (float(one.replace("−", "-")) for one in told.groups())
    assert away == pytest.approx(20, abs=1.5)
    along = np.array([np.cos(HEADING), -np.sin(HEADING)])  # the sheet is turned, and so are its axes
    assert off == pytest.approx((20 * along).tolist(), abs=1.5)


def test_the_point_that_does_not_fit_is_touched_again_in_its_place(desk: SharedCalibration) -> None:
    points = desk.points
    touched(points, 3)
    assert points.doubtful is None
    proposed = points.next
    assert proposed is not None
    touch(points, proposed.number, wrong_m=0.02, height_m=proposed.height_m)
    asyncio.run(points.compute())
    numbers = [*(one.number for one in points.touches), *touched(points, 6)]
    assert points.doubtful == 3
    points.retake(3)
    again = points.next
    assert again is not None and again.number == proposed.number
    assert f"Touch crosshair {again.number} again, for point 4" in plain(next_html(points))
    touch(points, again.number, height_m=again.height_m)
    asyncio.run(points.compute())
    assert points.doubtful is None and points.retaken is None
    assert [one.number for one in points.touches] == numbers
    fit = points.result
    assert isinstance(fit, TouchFit) and not fit.mistaken and fit.after.rms < 0.001
    assert fit.missed_m.shape == (10, 3)

    points.retake(0)
    other = 1 + points.touches[0].number % 10 if points.touches[0].number else 1
    touch(points, other, height_m=0.0)  # another one is touched all the same: nothing is lost
    assert len(points.touches) == 11
    asyncio.run(points.compute())
    points.retake(0)
    points.skip()
    assert points.retaken is None and not points.skipped
    with pytest.raises(InputError, match="there is no point 12"):
        points.retake(11)


def test_the_arm_comes_near_to_a_crosshair_before_it_is_corrected(desk: SharedCalibration) -> None:
    """By the touches so far: the zeros of this arm put its tip 25 mm beside the point that it is sent to."""
    points, missed = desk.points, dict[str, list[float]]()
    for count in (3, 4):
        touched(points, count)
        aim = points.aim
        assert aim is not None
        for number in range(1, 1 + len(the_sheet().points_m)):
            crosshair, start, lifts = points.crosshair(number), ROBOT.pose("home"), (0.03,)
            above = in_base(crosshair) + np.array((0.0, 0.0, 0.03))
            if not (found := ROBOT.inverse(above)).success:
                continue
            near = found.best("least-travel", start)
            for how, ahead in (("plain", None), ("aimed", aim.ahead)):
                with suppress(InputError):  # no free way there
                    q, _ = pose_above(ROBOT, aim.in_base(crosshair), near, start, lifts=lifts, ahead=ahead)
                    off = float(np.linalg.norm(ROBOT.forward(q + OFF)[:3, 3] - above))
                    missed.setdefault(f"{how} {len(points.touches)}", []).append(off)
    worst = {how: max(one) for how, one in missed.items()}
    assert worst["aimed 3"] < 0.5 * worst["plain 3"]
    assert worst["aimed 7"] < 0.004 < worst["plain 7"]


def test_above_a_crosshair_the_arm_comes_from_the_side_that_is_proposed_where_it_may() -> None:
    start = ROBOT.pose("home")
    near = start + np.radians([25.0, 0.0, 0.0, 0.0, 0.0])
    point = ROBOT.forward(near)[:3, 3] - (0.0, 0.0, 0.05)
    for side in ("end-plus", "end-minus"):
        q, how = pose_above(ROBOT, point, near, start, side)
        assert how == side
        assert ROBOT.forward(q)[2, 3] == pytest.approx(point[2] + 0.03, abs=1e-4)
    no_room = replace(ROBOT.joints[0], upper=float(q[0]) + 0.001)
    robot = replace(ROBOT, joints=(no_room, *ROBOT.joints[1:]))
    assert pose_above(robot, point, near, start, "end-minus")[1] == "cubic"
    assert pose_above(robot, point, near, start, "end-plus")[1] == "end-plus"


def test_a_button_that_is_pressed_twice_makes_one_touch(desk: SharedCalibration) -> None:
    points = desk.points
    touch(points, 3)
    with pytest.raises(InputError, match="the arm stands as in point 1"):
        points.add(points.touches[0])
    points.add(replace(points.touches[0], sense=(1.0, -1.0, 0.0, 0.0, 0.0)))  # from the other side
    points.add(replace(points.touches[0], number=4, point_m=(0.05, 0.0, 0.0)))
    assert len(points.touches) == 3


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


def test_the_correction_follows_the_load_that_is_set(tmp_path: Path) -> None:
    """Touched with 0.3 kg in the gripper; at work the arm carries nothing, and then 0.1 kg."""
    bends = {name: JointDeflection(np.radians(1.2)) for name in ("shoulder", "elbow")}

    def truly(load_kg: float) -> OutputMap:
        return own_map(calibrated(ROBOT, Calibration("uzuner", "77", "µs", {}, None, "", "", bends, load_kg)))

    desk, rng = opened(tmp_path), np.random.default_rng(2)
    low, high = ROBOT.limits.T
    for q in rng.uniform(0.7 * low, 0.7 * high, (14, ROBOT.n)) + ROBOT.pose("home") * 0.3:
        x, y, z = ROBOT.forward(q)[:3, 3].tolist()
        desk.points.add(TouchedPoint(truly(0.3).outputs(q), (x, y, z)))
    with pytest.raises(StateError, match="no joint is known to give way"):
        desk.with_load(0.1)
    desk.points.use(0.0, 0.0, 0.3)
    asyncio.run(desk.points.compute())
    fit = desk.points.result
    assert isinstance(fit, TouchFit) and fit.correct and fit.after.rms < 0.0005
    asyncio.run(desk.correct())
    asyncio.run(desk.points.keep())

    desk = opened(tmp_path)
    assert desk.in_force is not None and desk.in_force.load_kg == 0.3
    assert "a load of <b>0.3 kg</b>" in load_html(desk.in_force)
    asyncio.run(desk.set_load(0.1))
    desk = opened(tmp_path)
    assert desk.in_force is not None
    home = ROBOT.pose("home")
    for load_kg in (0.1, 0.0):
        drawn = desk.in_force if load_kg else desk.with_load(0.0)
        told = own_map(calibrated(ROBOT, drawn)).outputs(home)
        wanted, other = truly(load_kg).outputs(home), truly(0.3).outputs(home)
        off, as_before = (max(abs(told[i] - one[i]) for i in told) for one in (wanted, other))
        assert off < 0.4 < as_before  # µs; 0.04°
    with pytest.raises(StateError, match=r"0.1 kg is in force already"):
        desk.with_load(0.1)
    with pytest.raises(CalibrationError, match="more than 10° is broken"):
        desk.with_load(20.0)
    desk.points.go_on()  # touched with another load than the one in force
    asyncio.run(desk.points.compute())
    assert desk.points.load_kg == 0.3 and desk.points.errors_m is not None
    assert desk.points.errors_m.max() < 0.0005


def opened(tmp_path: Path) -> SharedCalibration:
    """As after a start of armctl."""
    return SharedCalibration(CalibrationInForce(ROBOT, "77", CalibrationStore(tmp_path)), lambda: 1.7e9)


def test_touches_are_offered_again_after_a_restart_and_lose_nothing(tmp_path: Path) -> None:
    desk = opened(tmp_path)
    desk.points.sheet = the_sheet()
    asyncio.run(desk.points.compute())
    touched(desk.points, 7)
    asyncio.run(desk.points.keep())
    before = desk.points.result
    assert isinstance(before, TouchFit)

    points = opened(tmp_path).points
    assert points.offered is not None and points.touches == () and points.frame == "base"
    assert "Kept from before: 7 points on a sheet, the last one " in plain(offered_html(points))
    one = points.offered.touches[0]
    for refused in (lambda: points.add(one), lambda: asyncio.run(points.use_sheet("a4"))):
        with pytest.raises(StateError, match="7 points are kept from before; press 'Go on with them'"):
            refused()
    asyncio.run(points.keep())  # of another page: what is offered stays
    points = opened(tmp_path).points
    points.go_on()
    asyncio.run(points.compute())
    assert points.offered is None and offered_html(points) == ""
    fit = points.result
    assert isinstance(fit, TouchFit) and fit.after.rms == pytest.approx(before.after.rms)
    touched(points, 1)
    asyncio.run(points.keep())

    desk = opened(tmp_path)
    assert desk.points.offered is not None and len(desk.points.offered.touches) == 8
    desk.points.forget()
    asyncio.run(desk.points.keep())
    assert opened(tmp_path).points.offered is None
    with pytest.raises(StateError, match="no points are kept"):
        desk.points.go_on()


def test_points_of_one_tool_are_not_counted_for_another(tmp_path: Path) -> None:
    arm, store = arm_with_tools(tmp_path), CalibrationStore(tmp_path / "calibrations")
    desks = {
        tool: SharedCalibration(CalibrationInForce(arm.with_tool(tool), "7", store))
        for tool in ("jaws", "pen")
    }
    jaws = desks["jaws"].points
    jaws.add(TouchedPoint(arm.outputs.outputs(arm.pose("home")), (0.2, 0.0, 0.0)))
    asyncio.run(jaws.keep())
    desks["pen"].adopt(desks["jaws"])
    pen = desks["pen"].points
    assert not pen.touches and pen.offered is not None and pen.offered.tool == "jaws"
    with pytest.raises(StateError, match="touched with the tool 'jaws', and 'pen' is on"):
        pen.go_on()
    again = SharedCalibration(CalibrationInForce(arm.with_tool("pen"), "7", store)).points
    assert again.offered is not None and again.offered.tool == "jaws"  # also over a restart
    back = SharedCalibration(CalibrationInForce(arm, "7", store))
    back.adopt(desks["pen"])
    back.points.go_on()
    assert back.points.touches == jaws.touches


def test_a_check_of_a_correction_goes_on_after_a_restart(desk: SharedCalibration, tmp_path: Path) -> None:
    touched(desk.points, 8)
    asyncio.run(desk.correct())
    points = opened(tmp_path).points
    points.go_on()
    asyncio.run(points.compute())
    assert "Touch 3 more points to check it" in plain(result_html(points))
    touched(points, 3)
    assert "Checked by points touched since (3)" in plain(result_html(points))


def test_kept_touches_that_cannot_be_read_stay_and_are_said(tmp_path: Path) -> None:
    desk = opened(tmp_path)
    desk.points.sheet = the_sheet()
    touch(desk.points, 1)
    asyncio.run(desk.points.keep())
    (file,) = tmp_path.rglob("touched-points.toml")
    file.write_text("format = 2")
    points = opened(tmp_path).points
    assert points.offered is None and str(file) in plain(offered_html(points))
    points.sheet = the_sheet()
    touch(points, 2)
    asyncio.run(points.keep())
    assert file.read_text() == "format = 2"


def test_touches_that_cannot_be_kept_are_said_until_they_can(tmp_path: Path) -> None:
    points = opened(tmp_path / "file").points
    (tmp_path / "file").write_text("in the way")
    points.sheet = the_sheet()
    touch(points, 1)
    asyncio.run(points.keep())
    assert "would not survive a restart" in plain(offered_html(points)) and len(points.touches) == 1
    (tmp_path / "file").unlink()
    asyncio.run(points.keep())
    assert offered_html(points) == ""


def test_a_sheet_has_the_crosshairs_of_the_robot_file_whatever_is_calibrated() -> None:
    """Else the one that lies there would have other numbers than the one that is proposed."""
    longer = Calibration("uzuner", "1", "µs", {}, lengths=(LengthChange(4, "a", -0.05),))
    points = TouchedPoints(calibrated(ROBOT, longer), file_robot=ROBOT)
    asyncio.run(points.use_sheet("a4"))
    assert points.sheet is not None
    np.testing.assert_array_equal(points.sheet.points_m, the_sheet().points_m)


def test_the_sheet_stands_in_the_scene_where_it_should_lie() -> None:
    lies = the_sheet()
    lines = sheet_lines(lies)
    edge, crosses = lines[:4].reshape(-1, 3), lines[4:].reshape(-1, 2, 2, 3)
    assert np.ptp(edge, axis=0) == pytest.approx([0.21, 0.297, 0.0])
    assert edge.mean(axis=0) == pytest.approx(lies.place_m)
    assert crosses.mean(axis=(1, 2)) == pytest.approx(lies.laid_m)


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
    assert standing_touch(ROBOT, replace(measured, limp=("Elbow",)), np.zeros(3), 4, ()).sent is None
    assert not standing_touch(ROBOT, now, np.zeros(3), None, ()).measured
