"""Calibrating in the browser: marks, limits, gripper, known points and saving, and what the page shows."""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.arms import FIVE
from tests.runtime.kit import make_rig

from armctl.arrays import FloatArray
from armctl.calibration import (
    Calibration,
    CalibrationStore,
    JointCalibration,
    TouchedPoint,
    TouchFit,
    calibrated,
    check_pose,
    own_calibration,
)
from armctl.errors import CalibrationError, InputError, PortError, StateError
from armctl.facts import State
from armctl.facts.causes import ZeroOff
from armctl.hardware import Source
from armctl.protocol import Snapshot
from armctl.robot import OutputMap, load_robot
from armctl.ui import CalibrationInForce
from armctl.ui.tabs.calibration.joint import (
    STEPS,
    fit_html,
    limits_html,
    marks_html,
)
from armctl.ui.tabs.calibration.screen import (
    check_pose_html,
    draft_html,
    earlier_versions,
    in_force_html,
    kept_html,
    overview_html,
)
from armctl.ui.tabs.calibration.shared_calibration import (
    CalibrationWork,
    SharedCalibration,
    present_outputs,
    standing_gripper,
    standing_outputs,
)
from armctl.ui.tabs.calibration.touched_points import TouchedPoints
from armctl.ui.tabs.manual.joints import slow_duration, slow_speeds

ROBOT = load_robot("uzuner")
FILE = own_calibration(ROBOT, "base")


def work(in_force: Calibration | None = None) -> CalibrationWork:
    return CalibrationWork(ROBOT, in_force)


def mark(desk: CalibrationWork, joint: str, *pairs: tuple[float, float]) -> None:
    for output, degrees in pairs:
        desk.add_mark(joint, output, math.radians(degrees))


def saved(**joints: JointCalibration) -> Calibration:
    return Calibration("uzuner", "simulated", "µs", joints, (1100.0, 1900.0), "2026-01-01T10:00:00+00:00")


def test_three_marks_make_a_line_two_none_and_the_same_mark_is_refused() -> None:
    desk = work()
    mark(desk, "base", (1500, 0), (1400, 10))
    assert desk.fit("base") is None
    assert desk.unfinished == ("Base",)
    with pytest.raises(InputError, match=r"mark 1 says the same already \(1500\.0 µs, 0°\); jog"):
        mark(desk, "base", (1500, 0))
    for degrees in (721.0, -1e9, math.inf):
        with pytest.raises(InputError, match=r"is outside ±720°; type the angle that the protractor shows"):
            mark(desk, "base", (1500, degrees))
    mark(desk, "base", (1300, 20))
    fit = desk.fit("base")
    assert fit is not None
    assert (math.radians(fit.per_rad), fit.zero) == pytest.approx((-10, 1500))
    assert desk.unfinished == ()
    assert desk.measured().keys() == {"base"}


def test_every_change_raises_the_version_and_what_is_refused_does_not() -> None:
    desk = work()
    versions = [desk.version]
    for change in (
        lambda: desk.add_mark("base", 1500, 0.0),
        lambda: desk.choose("elbow"),
        lambda: desk.set_limit("base", "low", 700),
        lambda: desk.set_jaw("closed", 1200),
        lambda: desk.delete_mark("base", 0),
        desk.clear,
    ):
        change()
        versions.append(desk.version)
    assert versions == sorted(set(versions))
    for refused in (
        lambda: desk.add_mark("base", 1500, math.nan),
        lambda: desk.delete_mark("base", 0),
        lambda: desk.set_limit("base", "high", 100),
    ):
        with pytest.raises(InputError):
            refused()
    assert desk.version == versions[-1]


def test_safe_limits_are_the_files_until_set_and_stay_when_the_line_is_measured_anew() -> None:
    desk = work()
    assert desk.limits("base") == (FILE.low, FILE.high)
    desk.set_limit("base", "low", 700.0)
    assert desk.limits("base") == (700.0, FILE.high)
    with pytest.raises(InputError, match=r"600\.0 µs cannot be the upper limit, the lower one is 700\.0"):
        desk.set_limit("base", "high", 600.0)
    with pytest.raises(InputError, match=r"cannot be the lower limit, the upper one is 2446"):
        desk.set_limit("base", "low", 2446.0)
    desk.set_limit("base", "high", 2100.0)
    assert desk.measured()["base"] == JointCalibration(FILE.zero, FILE.per_rad, 700.0, 2100.0)
    desk.limits_by_default("base")
    assert desk.limits("base") == (FILE.low, FILE.high)
    mark(desk, "base", (1340, -20), (1500, 0), (1660, 20))
    assert desk.measured()["base"].angles() == pytest.approx(tuple(ROBOT.limits[0]))
    desk = work(saved(base=JointCalibration(1500, 500, 800, 2200)))
    assert desk.limits("base") == (800, 2200)
    desk.set_limit("base", "low", 900)
    assert desk.measured() == {"base": JointCalibration(1500, 500, 900, 2200)}
    desk.set_limit("base", "low", 800)
    mark(desk, "base", (1300, -20), (1500, 0), (1700, 20))
    assert desk.limits("base") == (800, 2200)
    for _ in ("by the new marks", "by the line in force"):
        desk.limits_by_default("base")
        low, high = desk.limits("base")
        assert FILE.low <= low < 800 < 2200 < high <= FILE.high
        for _ in desk.joint("base").marks:
            desk.delete_mark("base", 0)


def test_the_gripper_has_two_outputs_and_another_desk_goes_on_with_all() -> None:
    desk = work()
    assert desk.jaw("closed") == desk.map.gripper_closed
    desk.set_jaw("closed", 1150.0)
    assert (desk.jaw("closed"), desk.jaw("open")) == (1150.0, desk.map.gripper_open)
    with pytest.raises(
        InputError, match=r"the gripper is closed at 1150\.0 µs; move it before you call it open"
    ):
        desk.set_jaw("open", 1150.2)
    assert work(saved()).jaw("open") == 1900.0
    first, second = work(), work(saved())
    mark(first, "elbow", (1500, 3))
    first.choose("elbow")
    first.set_jaw("open", 1800.0)
    second.take_over(first)
    assert second.joint("elbow") == first.joint("elbow")
    assert (second.chosen, dict(second.jaws)) == ("elbow", {"open": 1800.0})
    second.delete_mark("elbow", 0)
    assert len(first.joint("elbow").marks) == 1


def test_a_joint_that_is_held_is_not_the_first_to_be_chosen() -> None:
    humanoid = load_robot("humanoid")
    held = [joint.name for joint in humanoid.joints if joint.lower == joint.upper]
    assert held
    assert CalibrationWork(humanoid, None).chosen not in held
    assert np.isfinite(humanoid.limits).all()


NOON = 1_767_268_800.0


@pytest.fixture
def store(tmp_path: Path) -> CalibrationStore:
    return CalibrationStore(tmp_path)


def desk(store: CalibrationStore, board: str | None = "00123456") -> SharedCalibration:
    return SharedCalibration(CalibrationInForce(ROBOT, board, store), lambda: NOON)


def measure(one: SharedCalibration, joint: str = "base", zero: float = 1510.0, per_deg: float = -9.5) -> None:
    for degrees in (-40, -15, 10, 45):
        one.work.add_mark(joint, zero + per_deg * degrees, math.radians(degrees))


def save(one: SharedCalibration, note: str = "") -> Path:
    return asyncio.run(one.save(note)).path


def test_what_is_saved_is_in_force_at_the_next_desk(store: CalibrationStore, tmp_path: Path) -> None:
    first = desk(store)
    assert first.in_force is None
    measure(first)
    path = save(first, "new horn")
    assert path.is_file()
    assert path.is_relative_to(tmp_path)
    second = desk(store)
    assert second.in_force is not None
    assert second.in_force.note == "new horn"
    now = CalibrationInForce(ROBOT, "00123456", store).robot.output_map
    assert now is not None
    assert math.radians(now.per_rad[0]) == pytest.approx(-9.5)
    assert desk(store, "another board").in_force is None


def test_what_was_not_measured_stays_as_in_force(store: CalibrationStore) -> None:
    first = desk(store)
    measure(first)
    first.work.set_jaw("closed", 1200.0)
    save(first)
    second = desk(store)
    measure(second, "elbow", 1450, 10.2)
    drawn = second.draft()
    assert second.in_force is not None
    assert drawn.joints["base"] == second.in_force.joints["base"]
    assert drawn.joints.keys() == {"base", "elbow"}
    assert drawn.gripper == (1200.0, second.work.map.gripper_open)


def test_nothing_is_saved_twice_and_nothing_out_of_nothing(store: CalibrationStore) -> None:
    first = desk(store)
    with pytest.raises(StateError, match="there is nothing to save yet: a joint needs three marks"):
        first.draft()
    first.work.add_mark("base", 1500, 0.0)
    with pytest.raises(StateError, match=r"nothing to save yet \(Base: too few marks\)"):
        first.draft()
    first.work.clear()
    measure(first)
    save(first)
    second = desk(store)
    second.adopt(first)
    with pytest.raises(StateError, match="everything is saved"):
        second.draft()


def test_a_measurement_that_leaves_nothing_of_a_joint_is_not_saved(store: CalibrationStore) -> None:
    one = desk(store)
    measure(one, "base", 5000, 20)
    with pytest.raises(CalibrationError, match="Base: its limits"):
        one.draft()
    assert store.versions("uzuner", "00123456") == ()


def test_marks_go_on_at_the_new_desk_of_the_same_arm_only(store: CalibrationStore) -> None:
    first = desk(store)
    measure(first)
    first.points.add(touched(ROBOT.pose("home"), ROBOT.forward(ROBOT.pose("home"))[:3, 3]))
    same, other = desk(store), desk(store, "another board")
    nameless = desk(store, None)
    for one in (same, other, nameless):
        one.adopt(first)
    assert len(same.work.joint("base").marks) == 4
    assert len(same.points.touches) == 1
    assert not other.work.joint("base").marks
    assert not nameless.work.joint("base").marks
    nameless.adopt(desk(store, None))


def test_reverting_brings_an_earlier_one_or_the_robot_file_back(store: CalibrationStore) -> None:
    one = desk(store)
    measure(one)
    save(one, "first")
    two = desk(store)
    measure(two, zero=1600)
    save(two, "second")
    three = desk(store)
    assert [version.note for version in three.versions()] == ["second", "first"]
    asyncio.run(three.revert(three.versions()[1].number))
    back = desk(store)
    assert back.in_force is not None
    assert back.in_force.note == "first"
    asyncio.run(back.revert(None))
    assert desk(store).in_force is None
    assert len(desk(store).versions()) == 4
    with pytest.raises(StateError, match="the robot file is in force already"):
        asyncio.run(desk(store).revert(None))


def test_an_earlier_one_that_no_longer_fits_is_not_brought_back(store: CalibrationStore) -> None:
    one = desk(store)
    measure(one)
    drawn = one.draft()
    impossible = JointCalibration(1500, 500, 3000, 3100)
    broken = store.save(msgspec.structs.replace(drawn, joints={"base": impossible}))
    store.forget("uzuner", "00123456", "2026-01-01T00:00:00+00:00")
    with pytest.raises(CalibrationError, match="nothing is left"):
        asyncio.run(desk(store).revert(broken.number))
    assert desk(store).in_force is None


def test_without_a_board_nothing_is_kept(store: CalibrationStore) -> None:
    one = desk(store, None)
    measure(one)
    with pytest.raises(StateError, match="there is none to keep a calibration for; connect it first"):
        one.draft()
    with pytest.raises(StateError, match="no board was found"):
        asyncio.run(one.revert(None))
    assert one.versions() == ()


def test_what_is_in_force_depends_on_the_board_at_the_port(store: CalibrationStore) -> None:
    one = CalibrationInForce.of(ROBOT, "sim", store)
    assert one.board == "simulated"
    assert one.robot is ROBOT
    assert asyncio.run(one.holds_for("sim"))
    assert not asyncio.run(one.holds_for("socket://127.0.0.1:5000"))
    assert CalibrationInForce.of(ROBOT, "socket://127.0.0.1:5000", store).board == "unnumbered"
    with pytest.raises(PortError, match="/dev/nobody: no such port"):
        asyncio.run(one.holds_for("/dev/nobody"))
    for port in ("auto", "/dev/nobody"):  # a program may start before its board is plugged in
        assert CalibrationInForce.of(ROBOT, port, store).board is None
    other = desk(store, "simulated")
    measure(other)
    save(other)
    assert not asyncio.run(one.holds_for("sim"))


def test_what_somebody_else_saved_meanwhile_is_not_overwritten(store: CalibrationStore) -> None:
    first, second = desk(store), desk(store)
    measure(first)
    measure(second, "elbow", 1450.0, 10.2)
    save(first)
    with pytest.raises(StateError, match="was saved since it was opened; press Disconnect and Connect"):
        save(second)
    assert len(store.versions("uzuner", "00123456")) == 1
    third = desk(store)
    third.adopt(second)
    save(third)
    kept = store.load("uzuner", "00123456")
    assert kept is not None and set(kept.joints) == {"base", "elbow"}


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


def touched(q: FloatArray, point: FloatArray, number: int | None = None) -> TouchedPoint:
    x, y, z = point.tolist()
    return TouchedPoint(the_map().outputs(q), (x, y, z), number)


def touch(points: TouchedPoints, count: int = len(TOUCHED_DEG)) -> None:
    """Touch with an elbow that stands 2° from where the arm believes it."""
    for pose in TOUCHED_DEG[:count]:
        q = np.radians(np.array(pose, dtype=float))
        really = q.copy()
        really[2] += ELBOW_OFF
        points.add(touched(q, ROBOT.forward(really)[:3, 3]))


def test_five_points_tell_nothing_and_six_name_the_joint() -> None:
    points = TouchedPoints(ROBOT)
    touch(points, 5)
    asyncio.run(points.compute())
    assert points.result is None
    assert points.errors_m is not None and (points.errors_m > 0.001).all()
    points = TouchedPoints(ROBOT)
    touch(points)
    before = points.version
    asyncio.run(points.compute())
    assert isinstance(points.result, TouchFit)
    assert points.version > before
    assert isinstance(cause := points.result.causes[0], ZeroOff) and cause.part == "Elbow"
    assert points.errors_m is not None
    assert points.result.before.largest == pytest.approx(points.errors_m.max())
    assert "zero_us" in points.suggestion
    points, q = TouchedPoints(ROBOT), ROBOT.pose("home")
    for i in range(6):
        points.add(touched(q, ROBOT.forward(q)[:3, 3] + 0.0001 * i))
    asyncio.run(points.compute())
    assert "spread them over the arm's workspace" in str(points.result)


def test_touches_stay_true_when_the_calibration_changes() -> None:
    points = TouchedPoints(ROBOT)
    touch(points)
    own = own_calibration(ROBOT, "elbow")
    right = JointCalibration(own.zero - ELBOW_OFF * own.per_rad, own.per_rad, own.low, own.high)
    mended = calibrated(ROBOT, Calibration("uzuner", "simulated", "µs", {"elbow": right}))
    later = TouchedPoints(mended)
    later.take_over(points)
    asyncio.run(later.compute())
    assert later.errors_m == pytest.approx(np.zeros(6), abs=1e-6)


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
        points.add(touched(ROBOT.pose("home"), np.array(point)))
    with pytest.raises(InputError, match="there is no point 1; there are 0"):
        points.delete(0)


def holding() -> Snapshot:
    return make_rig().enable().now


def test_a_mark_is_taken_where_the_arm_stands_and_is_known_to() -> None:
    snapshot = holding()
    there = snapshot.q_command + 0.1
    known = replace(snapshot, q=there)
    assert standing_outputs(ROBOT, known) == pytest.approx(the_map().outputs(there))
    partly = replace(snapshot, q=np.where(np.arange(5) == 1, np.nan, there))
    expected = np.where(np.arange(5) == 1, snapshot.q_command, there)
    assert standing_outputs(ROBOT, partly) == pytest.approx(the_map().outputs(expected))
    for state in (State.MOVING, State.PAUSED):
        moving = replace(holding(), state=state)
        with pytest.raises(StateError, match="wait until it stands"):
            standing_outputs(ROBOT, moving)
        assert present_outputs(ROBOT, moving)  # it may be looked at
    with pytest.raises(CalibrationError, match="nothing to calibrate"):
        standing_outputs(replace(ROBOT, output_map=None), holding())
    off = replace(holding(), powered=False, commanded=False, state=State.OFF, q=np.full(5, np.nan))
    with pytest.raises(StateError, match="the arm is off, so its pose is not known"):
        standing_outputs(ROBOT, off)
    by_hand = replace(off, source=Source.MEASURED, q=ROBOT.pose("home"))
    assert standing_outputs(ROBOT, by_hand) == pytest.approx(the_map().outputs(ROBOT.pose("home")))
    for powered in (False, True):  # motors hold an arm whose homing was stopped
        with pytest.raises(StateError, match="home the arm first"):
            standing_outputs(ROBOT, replace(by_hand, q=off.q, powered=powered))


def test_a_gripper_that_was_never_told_stands_nowhere() -> None:
    snapshot = replace(holding(), gripper=None)
    with pytest.raises(StateError, match="press 'Move gripper' first"):
        standing_gripper(ROBOT, snapshot)
    outputs = the_map()
    half = (outputs.gripper_closed + outputs.gripper_open) / 2
    assert standing_gripper(ROBOT, replace(snapshot, gripper=0.5)) == pytest.approx(half)


LINE = JointCalibration(1500, 500, 800, 2200)


def plain(html: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html)).strip()


def measured(*pairs: tuple[float, float]) -> CalibrationWork:
    desk = work()
    mark(desk, "base", *pairs)
    return desk


def test_what_is_in_force_is_named_with_its_board_and_its_note_as_text() -> None:
    said = plain(in_force_html(None, "simulated"))
    assert said == "In force: the robot file This arm is not calibrated on the simulated board."
    made = Calibration("uzuner", "77", "µs", {"base": LINE}, None, "2026-03-01T12:00:00+00:00", "<b>horn</b>")
    html = in_force_html(made, "77")
    assert "<b>horn" not in html
    assert re.search(r"calibration of 2026-0\d-\d\d \d\d:\d\d “&lt;b&gt;horn", html)
    assert "1 joint of this arm on board 77" in plain(html)
    assert "one calibration for all such boards" in in_force_html(None, "unnumbered")
    assert "not connected yet" in in_force_html(None, None)


@pytest.mark.parametrize(
    ("pairs", "line", "marks"),
    [
        ([(1400, 10), (1500, 0)], ["1 more mark needed"], "1400.0 10.00 2 1500.0 0.00"),
        ([(1400, 10), (1500, 0.3), (1600, -10)], [], "1500.0 0.30 0.20"),
        (
            [(1400, 10), (1500, 0), (1600, -10), (1700, -20)],
            [
                "sign − +",
                "1500.0 µs 1479.9 µs",
                "10.000 µs/° 9.000 µs/°",
                "Base turns the other way than uzuner",
            ],
            "",
        ),
        ([(1300, -20), (1400, -10), (1500, 15), (1600, 10), (1700, 20)], ["Mark 3 does not fit"], "✗"),
        ([], [], "No marks yet"),
    ],
)
def test_marks_and_their_line_are_told(pairs: list[tuple[float, float]], line: list[str], marks: str) -> None:
    work = measured(*pairs)
    said = plain(fit_html(work, "base"))
    assert all(words in said for words in line)
    assert marks in plain(marks_html(work.joint("base").marks, work.fit("base"), "µs"))
    assert ("✗" in overview_html(work)) is (marks == "✗")


def test_marks_without_a_line_an_encoders_home_and_the_limits_are_told() -> None:
    work = measured((1500, 0), (1500, 1), (1500, 2))
    for html in (fit_html(work, "base"), limits_html(work, "base")):
        assert "All marks are at one place" in plain(html)
    assert "no line" in overview_html(work)
    work = CalibrationWork(load_robot("scorbot"), None)
    for counts, degrees in ((0, 1.0), (1400, 11), (2800, 21)):
        work.add_mark(work.chosen, counts, math.radians(degrees))
    assert "home (0 counts) is at 1.00° 0.00°" in plain(fit_html(work, work.chosen))
    work = CalibrationWork(ROBOT, None)
    assert plain(limits_html(work, "base")) == "554.0 … 2446.0 µs (as the robot file allows)"
    work.set_limit("base", "low", 700)
    assert plain(limits_html(work, "base")) == "700.0 … 2446.0 µs (set here)"
    work = CalibrationWork(ROBOT, Calibration("uzuner", "77", "µs", {"base": LINE}))
    assert plain(limits_html(work, "base")) == "800.0 … 2200.0 µs (as in force)"
    work = CalibrationWork(
        ROBOT, Calibration("uzuner", "77", "µs", {"base": JointCalibration(1480, 515, 600, 2380)})
    )
    mark(work, "base", (1340, -20), (1500, 0), (1660, 20))
    assert plain(limits_html(work, "base")).endswith("(as in force, by the new marks)")
    work.limits_by_default("base")
    assert plain(limits_html(work, "base")).endswith("(as the robot file allows)")


def test_what_saving_takes_from_the_joints_is_told_before(tmp_path: Path) -> None:
    desk = SharedCalibration(CalibrationInForce(ROBOT, "simulated", CalibrationStore(tmp_path)), lambda: 0.0)
    with pytest.raises(StateError, match="nothing to save yet"):
        draft_html(desk)
    desk.work.set_limit("base", "low", 1000)
    assert "Base: −53.33° … 107.26° instead of −102.80°" in plain(draft_html(desk))
    assert "Nothing is saved" in kept_html(())


def test_the_version_before_the_one_in_force_is_offered_first(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    for note in ("a", "b", "<c>"):
        store.save(Calibration("uzuner", "1", "µs", {"base": LINE}, None, "2026-03-01T12:00:00+00:00", note))
    versions = store.versions("uzuner", "1")
    labels = earlier_versions(versions)
    assert list(labels.values()) == [2, 1, None]
    assert "“b”" in next(iter(labels))
    assert str(versions[0].path.parent) in plain(kept_html(versions))
    assert earlier_versions(()) == {"robot file, no calibration": None}


@pytest.mark.parametrize("name", FIVE)
def test_steps_are_slow_and_the_test_pose_names_every_joint(name: str) -> None:
    robot = load_robot(name)
    said = plain(check_pose_html(check_pose(robot)))
    assert all(joint.title in said for joint in robot.joints)
    for step in STEPS.values():
        way = np.zeros(robot.n)
        way[0] = math.radians(step)
        assert abs(way[0]) / slow_duration(robot, way) <= math.radians(10.0) + 1e-12
    assert (slow_speeds(robot) <= 0.15 * robot.speed_limits).all()
