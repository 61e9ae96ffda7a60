"""Motions of the Trajectory screen: planned, drawn with what is wrong with them, compared, reported."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from armctl.errors import InputError, MotionRefusedError, ProgramError, UnreachableError
from armctl.hardware import Source
from armctl.kinematics import Target
from armctl.motion import Profile
from armctl.motion.error_report import ErrorReport, PathError, closest_on_path, distances, report_csv
from armctl.motion.plan import Passing, plan_blended, plan_through, solve_points
from armctl.motion.trajectory import peaks_of
from armctl.program import (
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    Program,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
)
from armctl.robot import load_robot
from armctl.ui.tabs.trajectory.error_report import (
    MEANING,
    between_html,
    points_html,
    summary_html,
    theoretical,
)
from armctl.ui.tabs.trajectory.graphs import (
    OF,
    QUANTITIES,
    compare_html,
    cursor_html,
    graph,
    peaks_html,
)
from armctl.ui.tabs.trajectory.plan import (
    ARC,
    JOINTS,
    LINE,
    PROGRAM,
    TEST_PATHS,
    TOOL_ARC,
    TOOL_LINE,
    MotionRequest,
    ShownMotion,
    ToolWish,
    plan_motion,
    plan_shown,
    why_not,
)

ROBOT = load_robot("uzuner")
REST, HOME, ZERO = ROBOT.pose("rest"), ROBOT.pose("home"), ROBOT.pose("zero")
TIP = ROBOT.forward(HOME)[:3, 3]


def joints(
    end: np.ndarray | Target = HOME, profile: Profile = "cubic", duration: float | None = None
) -> MotionRequest:
    return MotionRequest(JOINTS, "a joint motion", REST, profile, duration, end=end)


def published(
    motion: str, profile: Profile = "cubic", passing: Passing | None = "stop", duration: float | None = None
) -> MotionRequest:
    return MotionRequest(motion, motion, REST, profile, duration, "published", passing=passing)


def led(wish: ToolWish, profile: Profile = "trapezoid", duration: float | None = None) -> MotionRequest:
    motion = TOOL_LINE if wish.via is None else TOOL_ARC
    return MotionRequest(motion, motion, HOME, profile, duration, tool=wish)


def of_program(*steps: Step) -> MotionRequest:
    program = Program(robot="uzuner", name="test", steps=steps)
    return MotionRequest(PROGRAM, PROGRAM, REST, program=program)


def shown(request: MotionRequest) -> ShownMotion:
    return plan_shown(ROBOT, request)


def test_from_pose_to_pose_and_from_point_to_point() -> None:
    planned = plan_motion(ROBOT, joints(duration=3.0))
    assert planned.trajectory.duration == 3.0
    assert planned.trajectory.start == pytest.approx(REST)
    assert planned.trajectory.end == pytest.approx(HOME)
    assert planned.refusal is None
    assert plan_motion(ROBOT, joints(REST)).note == "It ends where it begins."
    begin, end = Target.of([0.2, 0.0, 0.1]), Target.of([0.2, 0.1, 0.1])
    between = plan_motion(ROBOT, MotionRequest(JOINTS, "points", begin, end=end)).trajectory
    assert ROBOT.forward(between.start)[:3, 3] == pytest.approx([0.2, 0.0, 0.1], abs=1e-9)
    assert ROBOT.forward(between.end)[:3, 3] == pytest.approx([0.2, 0.1, 0.1], abs=1e-9)
    nearest = MotionRequest(JOINTS, "", begin, choose="least-travel", end=HOME, present=HOME)
    assert ROBOT.forward(plan_motion(ROBOT, nearest).trajectory.start)[:3, 3] == pytest.approx(
        [0.2, 0.0, 0.1]
    )
    with pytest.raises(UnreachableError, match="too far"):
        plan_motion(ROBOT, joints(Target.of([0.9, 0.0, 0.1])))
    with pytest.raises(MotionRefusedError, match=r"Base: 171\.89° is outside"):
        plan_motion(ROBOT, joints(np.array([3.0, 0, 0, 0, 0])))


def test_a_motion_that_must_not_be_run_is_drawn_with_what_is_wrong() -> None:
    down = np.radians([0.0, -3.0, -84.0, -10.0, 0.0])  # the hand below the floor
    planned = plan_motion(ROBOT, joints(down))
    assert planned.trajectory.end == pytest.approx(down)
    assert planned.refusal is not None and planned.refusal.severity == "error"
    assert planned.refusal.kind in ("floor", "self-collision")


@pytest.mark.parametrize("via", [None, TIP + np.array([0, 0.04, 0.02])])
def test_the_tool_is_led_to_its_end_at_the_speed_that_is_asked_for(via: np.ndarray | None) -> None:
    end = TIP + np.array([0, 0.08, 0])
    found = shown(led(ToolWish(end, via, speed=0.02)))
    assert found.planned.refusal is None
    assert found.motion.position[-1] == pytest.approx(end, abs=1e-5)
    assert found.motion.tool_speed.max() == pytest.approx(0.02, rel=1e-3)
    assert np.degrees(found.motion.pitch) == pytest.approx(-30.0, abs=0.02)
    assert found.planned.points is not None and len(found.planned.points) == 25
    report, html = theoretical(ROBOT, found.planned)
    assert report.distance.max() < 0.05e-3
    assert "Off the ideal line or arc" in html and "As printed" not in html
    assert "(asked for: 20 mm/s)" in peaks_html(ROBOT, found)
    turned = shown(led(ToolWish(end, via, "interpolated", np.radians(-40))))
    assert np.degrees(turned.motion.pitch[-1]) == pytest.approx(-40.0, abs=0.02)


def test_a_line_that_ends_on_the_way_is_drawn_as_far_as_that_and_refused() -> None:
    planned = plan_motion(ROBOT, led(ToolWish(np.array([0.5, 0.0, 0.3]))))
    assert planned.refusal is not None
    assert re.search(r"\d+ % of the line", planned.refusal.what)
    assert not planned.refusal.what.startswith("at ")
    assert planned.refusal.time == pytest.approx(planned.trajectory.duration)
    assert planned.note.startswith("Drawn as far as the arm can follow, as fast as its limits allow")
    assert planned.points is None
    path = ROBOT.forward(planned.trajectory.sample(np.linspace(0, planned.trajectory.duration, 50)).q)[
        :, :3, 3
    ]
    assert path[-1, 0] > TIP[0] + 0.05
    with pytest.raises(InputError, match="normal leads each joint for itself"):
        plan_motion(ROBOT, led(ToolWish(TIP + np.array([0, 0.05, 0])), "normal"))


def test_a_line_cut_short_is_not_called_after_a_profile_that_it_does_not_follow() -> None:
    request = MotionRequest(
        TOOL_LINE,
        "Tool line, quintic",
        HOME,
        "quintic",
        tool=ToolWish(np.array([0.5, 0.0, 0.3])),
    )
    assert plan_motion(ROBOT, request).title == "Tool line"
    near = replace(request, tool=ToolWish(TIP + np.array([0, 0.05, 0])))
    assert plan_motion(ROBOT, near).title == "Tool line, quintic"


def test_the_limit_that_ends_a_line_is_told_once() -> None:
    start = np.radians([0.0, 80.0, -50.0, -60.0, 0.0])
    request = MotionRequest(
        TOOL_LINE, TOOL_LINE, start, "trapezoid", tool=ToolWish(np.array([0.22, -0.06, 0.2]))
    )
    limits = [finding for finding in plan_motion(ROBOT, request).findings if finding.kind == "limits"]
    assert [finding.part for finding in limits] == ["Elbow"]
    assert "Elbow would need" in limits[0].what


@pytest.mark.parametrize(("motion", "count"), [(ARC, 58), (LINE, 29)])
@pytest.mark.parametrize("passing", [*get_args(Passing), None])
def test_a_published_path_in_every_way_of_passing_its_points(
    motion: str, count: int, passing: Passing | None
) -> None:
    planned = plan_motion(ROBOT, published(motion, passing=passing))
    assert planned.points is not None and planned.solved is not None and planned.ideal is not None
    assert planned.points.shape == (count, 3)
    assert np.abs(ROBOT.forward(planned.solved)[:, :3, 3] - planned.points).max() < 1e-9
    assert planned.trajectory.start == pytest.approx(planned.solved[0])
    report, html = theoretical(ROBOT, planned)
    assert report.rmse.max() < 5e-12
    assert "As printed" in html and "at most 0.005 mm" in html
    if passing is None:
        time = np.arange(0.0, planned.trajectory.duration, 0.02)
        path = ROBOT.forward(planned.trajectory.sample(time).q)[:, :3, 3]
        assert np.linalg.norm(closest_on_path(planned.points, path) - planned.points, axis=1).max() < 5e-3
        assert distances(planned.ideal, path).max() < 5e-5
    if passing == "stop":
        assert planned.refusal is None
        assert planned.trajectory.end == pytest.approx(planned.solved[-1])


@pytest.mark.parametrize("motion", [ARC, LINE])
@pytest.mark.parametrize("name", ["abaas", "scorbot", "mico", "humanoid"])
def test_another_arm_follows_a_published_path_or_it_is_said_why_not(name: str, motion: str) -> None:
    robot = load_robot(name)
    request = MotionRequest(motion, motion, robot.pose("home"))
    reason = why_not(robot, TEST_PATHS[motion]())
    assert (reason is None) is (name != "humanoid")
    if reason is None:
        planned = plan_motion(robot, request)
        assert planned.solved is not None
        reached = robot.forward(planned.solved)[:, :3, 3]
        assert np.abs(reached - TEST_PATHS[motion]()).max() < 1e-9
    else:
        assert re.match(r"point 1 of \d+: .*Elbow needs", reason)
        with pytest.raises(UnreachableError, match="Elbow needs"):
            plan_motion(robot, request)


def test_the_first_point_of_the_line_is_the_printed_one() -> None:
    planned = plan_motion(ROBOT, published(LINE))
    assert planned.solved is not None
    assert np.degrees(planned.solved[0]) == pytest.approx([-42.402, 14.4, -45.909, -1.305, 0], abs=0.0006)


@pytest.mark.parametrize("profile", ["cubic", "trapezoid", "s-curve"])
def test_the_duration_of_a_path_is_that_of_the_whole(profile: Profile) -> None:
    quick = plan_motion(ROBOT, published(ARC, profile)).trajectory
    planned = plan_motion(ROBOT, published(ARC, profile, duration=2 * quick.duration)).trajectory
    assert planned.duration == pytest.approx(2 * quick.duration)
    slow, fast = peaks_of(planned), peaks_of(quick)
    assert slow.speed == pytest.approx(fast.speed / 2)
    assert slow.acceleration == pytest.approx(fast.acceleration / 4)
    with pytest.raises(MotionRefusedError, match=r"shortest possible duration is \d"):
        plan_motion(ROBOT, published(ARC, profile, duration=0.5))


def test_a_path_that_leaves_the_workspace_names_the_point() -> None:
    with pytest.raises(UnreachableError, match=r"^point 2 of 2: too far"):
        solve_points(ROBOT, np.array([[0.2, 0, 0.1], [0.9, 0, 0.1]]), "least-rotation", HOME)
    with pytest.raises(InputError, match="at least two"):
        plan_through(ROBOT, [HOME])
    with pytest.raises(MotionRefusedError, match="from point 2 to point 3: Base"):
        plan_through(ROBOT, [HOME, REST, np.array([3.0, 0, 0, 0, 0])])
    with pytest.raises(InputError, match="radius must be positive, got 0 mm"):
        plan_blended(ROBOT, [HOME, REST], 0.0)
    with pytest.raises(InputError, match="all the same"):
        plan_blended(ROBOT, [HOME, HOME], 0.01)


def test_a_program_is_shown_as_it_runs_with_its_waits_repeats_and_speeds() -> None:
    there, back = (
        MoveStep(joints_deg=(0, 90, -80, -40, 0), duration_s=2.0),
        MoveStep(joints_deg=(0, 80, -80, -40, 0)),
    )
    twice = RepeatStep(times=2), back, there, EndStep()
    planned = plan_motion(
        ROBOT,
        of_program(there, WaitStep(seconds=1.5), GripperStep(open_percent=20), *twice),
    )
    assert "1 gripper step " in planned.note
    assert planned.program is not None
    assert planned.trajectory.sample(3.0).q == pytest.approx(HOME)
    assert [step for _, step in planned.steps] == [0, 1, 2, 4, 5, 4, 5]
    assert (planned.step_at(0.0), planned.step_at(3.0), planned.step_at(1e9)) == (0, 1, 5)
    assert "step 2" in cursor_html(ROBOT, planned, 3.0)
    slow = plan_motion(ROBOT, of_program(SpeedStep(percent=50), there)).trajectory
    assert slow.duration == pytest.approx(4.0)


def test_a_program_is_drawn_as_far_as_the_step_that_cannot_be_run() -> None:
    step = LineStep(x_mm=900, y_mm=0, z_mm=100)
    planned = plan_motion(ROBOT, of_program(MoveStep(joints_deg=(0, 90, -80, -40, 0)), step))
    assert planned.trajectory.end == pytest.approx(HOME)
    assert planned.refusal is not None and "step 2" in str(planned.refusal)
    assert planned.note == "Drawn as far as step 2, which cannot be run."


def test_an_endless_repeat_is_drawn_as_far_as_it_makes_sense() -> None:
    steps = RepeatStep(times=1_000_000), WaitStep(seconds=10.0), EndStep()
    planned = plan_motion(ROBOT, of_program(MoveStep(joints_deg=(0, 90, -80, -40, 0)), *steps))
    assert 600 <= planned.trajectory.duration < 625
    assert re.match(r"The first \d+ steps of a pass", planned.note)


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (MotionRequest(PROGRAM, PROGRAM, REST), "no steps"),
        (of_program(), "no steps"),
        (of_program(GripperStep(open_percent=5)), "no step of it moves a joint"),
        (of_program(MoveStep(joints_deg=(300, 0, 0, 0, 0))), r"test: step 1: Base: 300\.00° is outside"),
    ],
)
def test_a_program_that_cannot_be_shown_says_why(request_: MotionRequest, why: str) -> None:
    with pytest.raises(ProgramError, match=why):
        plan_motion(ROBOT, request_)


@pytest.mark.parametrize("of", OF)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_graphs_have_a_title_with_its_unit_and_one_line_a_coordinate(of: str, quantity: str) -> None:
    picture = graph(ROBOT, shown(joints()), of, quantity, "none")
    assert re.fullmatch(rf"(Tool|Joint) {quantity.lower()} \((mm|°)(/s[²³]?)?\)", picture.title)
    assert len(picture.lines) == (3 if of == "Tool" else 5)
    assert all(len(line.y) == len(picture.x) and np.isfinite(line.y).all() for line in picture.lines)


def test_limits_are_dashed_and_drawn_where_they_matter() -> None:
    fast = shown(joints(ZERO, "trapezoid"))
    near = graph(ROBOT, fast, "Joints", "Velocity", "near").lines[5:]
    assert {(line.name, float(line.y[0])) for line in near} == {("Shoulder ≥ −60", -60.0)}
    assert (
        near[0].dash is not None
        and near[0].color == graph(ROBOT, fast, "Joints", "Position", "near").lines[1].color
    )
    every = graph(ROBOT, fast, "Joints", "Velocity", "all").lines[5:]
    assert sorted(float(line.y[0]) for line in every) == pytest.approx([-120, -90, -60, 60, 90, 120])
    assert "2 joints ≤ 120" in {line.name for line in every}
    low = shown(joints(np.radians([0, 0, -40.0, 0, 0])))
    assert low.motion.position[-1, 2] < 0.105
    floor = graph(ROBOT, low, "Tool", "Position", "all").lines[3]
    assert floor.name == "floor" and float(floor.y[0]) == pytest.approx(1000 * ROBOT.floor_z)


def test_the_cursor_is_an_upright_line_at_its_time() -> None:
    found = shown(joints())
    for time in (0.0, 0.3, found.planned.trajectory.duration):
        cursor = graph(ROBOT, found, "Tool", "Position", "near", time).lines[-1]
        at = np.flatnonzero(np.isfinite(cursor.y))
        assert cursor.name == "cursor" and len(at) == 2
        x = graph(ROBOT, found, "Tool", "Position", "near").x
        assert x[at] == pytest.approx([time, time], abs=0.01)


def test_another_motion_is_drawn_beside_it_over_the_longer_time() -> None:
    a, b = shown(joints(duration=6.0)), shown(joints(profile="trapezoid"))
    for first, second in ((a, b), (b, a)):
        picture = graph(ROBOT, second, "Joints", "Velocity", "none", None, first)
        assert [line.name[:2] for line in picture.lines] == ["B "] * 5 + ["A "] * 5
        assert all(line.dash is not None for line in picture.lines[5:])
        assert picture.x[-1] == pytest.approx(6.0) and (np.diff(picture.x) > 0).all()
        short = picture.lines[1 if second is b else 6].y
        assert np.isnan(short[picture.x > b.planned.trajectory.duration + 1e-9]).all()
        assert np.isfinite(short[picture.x <= b.planned.trajectory.duration]).all()
    html = compare_html(ROBOT, a, b)
    for part in (
        "duration s",
        "6.000",
        f"{b.planned.trajectory.duration:.3f}",
        "% of limit",
        "jerk A",
        "Shoulder",
    ):
        assert part in html


def test_the_peak_table_tells_duration_and_limits() -> None:
    found = shown(joints())
    html = peaks_html(ROBOT, found)
    assert f"{found.planned.trajectory.duration:.3f} s" in html
    for word in ("Shoulder", "speed °/s", ">360<", ">60<", "mm/s²"):
        assert word in html
    cursor = cursor_html(ROBOT, found.planned, 0.0)
    assert "at 0.00 s: tool (<b>124.7, 3.6, 267.5</b>) mm, 0.0 mm/s" in cursor
    assert all(joint.title in cursor for joint in ROBOT.joints)


def test_the_error_report_is_that_of_the_paper() -> None:
    desired = np.zeros((4, 3))
    reached = np.array([[0.001, 0, 0], [-0.001, 0, 0], [0.003, 0, 0], [-0.003, 0, 0.004]])
    report = ErrorReport(desired, reached)
    assert report.mse == pytest.approx([5e-6, 0, 4e-6])
    assert report.rmse == pytest.approx([np.sqrt(5e-6), 0, 2e-3])
    assert report.largest == pytest.approx([0.003, 0, 0.004])
    assert report.distance[3] == pytest.approx(0.005)
    html = summary_html("Applied", MEANING[Source.TRANSMITTED], report)
    for part in ("4 points", "transmitted by the board, not measured", "5.000", "2.236", "4.000"):
        assert part in html
    assert points_html(report, 0, 2).count("background") == 1
    strays = between_html(PathError(np.arange(2.0), np.array([0.0, 0.0015])), "of 2 readings")
    assert "of 2 readings" in strays and "1.500" in strays and "1.061" in strays


@pytest.mark.parametrize(
    ("desired", "reached"),
    [
        (np.zeros((2, 3)), np.zeros((3, 3))),
        (np.zeros((0, 3)), np.zeros((0, 3))),
        (np.zeros((2, 3)), np.full((2, 3), np.nan)),
    ],
)
def test_a_report_refuses_what_cannot_be_compared(desired: np.ndarray, reached: np.ndarray) -> None:
    with pytest.raises(InputError):
        ErrorReport(desired, reached)


def test_the_closest_point_of_a_path_may_lie_between_its_readings() -> None:
    path = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]])
    points = np.array([[0.25, 0.1, 0], [1.2, 0.5, 0], [-1, 0, 0], [2, 2, 0]])
    expected = [[0.25, 0, 0], [1, 0.5, 0], [0, 0, 0], [1, 1, 0]]
    assert closest_on_path(points, path) == pytest.approx(np.array(expected))
    assert closest_on_path(points, path[:1]) == pytest.approx(np.zeros((4, 3)))
    with pytest.raises(InputError, match="without points"):
        closest_on_path(points, path[:0])


def test_the_report_s_file_names_its_units() -> None:
    report = ErrorReport(np.full((2, 3), 0.1), np.full((2, 3), 0.2))
    head, _, second = report_csv(report, report).splitlines()
    assert head.startswith("point,desired_x_mm") and head.endswith("applied_z_mm")
    assert second == "2" + ",100.000000" * 3 + ",200.000000" * 6
    assert "applied" not in report_csv(report, None)
