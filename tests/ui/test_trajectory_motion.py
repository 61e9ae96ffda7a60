"""Motions of the Trajectory screen: planned, analysed, reported."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armctl.errors import InputError, MotionRefusedError, ProgramError, UnreachableError
from armctl.hardware import Source
from armctl.kinematics import Target
from armctl.motion import GripperStep, MoveStep, Profile, Program, WaitStep, arc, preflight
from armctl.motion.analysis import analyse, analysis_csv, peak_rates
from armctl.motion.error_report import ErrorReport, closest_on_path, report_csv
from armctl.motion.point_path import plan_through, solve_points
from armctl.robot import load_robot
from armctl.ui.screens.trajectory_errors import applied_meaning, points_html, summary_html
from armctl.ui.screens.trajectory_graphs import OF, QUANTITIES, cursor_html, graph, peaks_html
from armctl.ui.screens.trajectory_motion import (
    ARC,
    JOINT_BY_JOINT,
    LINE,
    PROGRAM,
    TEST_PATHS,
    TO_POINT,
    MotionRequest,
    motion_labels,
    plan_motion,
    to_pose,
    why_not,
)

ROBOT = load_robot("uzuner")
REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")


def asked(
    motion: str,
    profile: Profile = "planned",
    duration: float | None = None,
    choose: str = "published",
    target: Target | None = None,
    program: Program | None = None,
) -> MotionRequest:
    return MotionRequest(motion, REST, profile, duration, choose, target, program)


def program(*steps: MoveStep | WaitStep | GripperStep) -> Program:
    return Program(robot="uzuner", name="test", steps=steps)


def test_all_motions_are_offered() -> None:
    assert motion_labels(ROBOT) == (
        "present pose to home", "present pose to rest", "present pose to zero",
        TO_POINT, "Arc (58 points)", "Line (29 points)", PROGRAM, JOINT_BY_JOINT,
    )  # fmt: skip


def test_to_a_named_pose() -> None:
    planned = plan_motion(ROBOT, asked(to_pose("home"), duration=3.0))
    assert planned.trajectory.duration == 3.0
    assert planned.trajectory.end == pytest.approx(HOME)
    assert "already" in plan_motion(ROBOT, asked(to_pose("rest"))).note


def test_to_a_point() -> None:
    planned = plan_motion(ROBOT, asked(TO_POINT, target=Target.of([0.2, 0.0, 0.1])))
    assert ROBOT.forward(planned.trajectory.end)[:3, 3] == pytest.approx([0.2, 0.0, 0.1], abs=1e-9)
    with pytest.raises(UnreachableError, match="too far"):
        plan_motion(ROBOT, asked(TO_POINT, target=Target.of([0.9, 0.0, 0.1])))


@pytest.mark.parametrize(("motion", "count"), [(ARC, 58), (LINE, 29)])
@pytest.mark.parametrize("profile", ["planned", "normal"])
def test_a_published_path_rests_in_every_point_and_is_clear(
    motion: str, count: int, profile: Profile
) -> None:
    planned = plan_motion(ROBOT, asked(motion, profile))
    assert planned.points is not None and planned.solved is not None
    assert planned.points.shape == (count, 3)
    reached = ROBOT.forward(planned.solved)[:, :3, 3]
    assert np.abs(reached - planned.points).max() < 1e-9
    assert preflight(ROBOT, planned.trajectory) == []
    assert planned.trajectory.start == pytest.approx(planned.solved[0])
    assert planned.trajectory.end == pytest.approx(planned.solved[-1])


@pytest.mark.parametrize("motion", [ARC, LINE])
@pytest.mark.parametrize("name", ["abaas", "scorbot", "mico", "humanoid"])
def test_another_arm_follows_a_published_path_or_it_is_said_why_not(name: str, motion: str) -> None:
    robot = load_robot(name)
    request = MotionRequest(motion, robot.pose("home"), "planned", None, "least-rotation")
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
    planned = plan_motion(ROBOT, asked(LINE))
    assert planned.solved is not None
    assert np.degrees(planned.solved[0]) == pytest.approx([-42.402, 14.4, -45.909, -1.305, 0], abs=0.0006)


def test_the_duration_of_a_path_is_that_of_the_whole() -> None:
    shortest = plan_motion(ROBOT, asked(ARC)).trajectory.duration
    planned = plan_motion(ROBOT, asked(ARC, duration=2 * shortest))
    assert planned.trajectory.duration == pytest.approx(2 * shortest)
    speed, push = peak_rates(planned.trajectory)
    fast, hard = peak_rates(plan_motion(ROBOT, asked(ARC)).trajectory)
    assert speed == pytest.approx(fast / 2)
    assert push == pytest.approx(hard / 4)
    with pytest.raises(MotionRefusedError, match=r"shortest possible duration is \d"):
        plan_motion(ROBOT, asked(ARC, duration=1.0))


def test_a_path_that_leaves_the_workspace_names_the_point() -> None:
    with pytest.raises(UnreachableError, match=r"^point 2 of 2: too far"):
        solve_points(ROBOT, np.array([[0.2, 0, 0.1], [0.9, 0, 0.1]]), "least-rotation", HOME)
    with pytest.raises(InputError, match="at least two"):
        plan_through(ROBOT, [HOME])
    with pytest.raises(MotionRefusedError, match="from point 2 to point 3: Base"):
        plan_through(ROBOT, [HOME, REST, np.array([3.0, 0, 0, 0, 0])])


def test_a_program_is_shown_with_its_waits() -> None:
    steps = (
        MoveStep(joints_deg=(0, 90, -80, -40, 0), duration_s=2.0),
        WaitStep(seconds=1.5),
        GripperStep(open_percent=20),
    )
    planned = plan_motion(ROBOT, asked(PROGRAM, program=program(*steps)))
    assert planned.trajectory.duration == pytest.approx(3.5)
    assert "1 gripper step " in planned.note
    assert planned.program is not None
    assert planned.trajectory.sample(3.0).q == pytest.approx(HOME)


@pytest.mark.parametrize(
    ("what", "why"),
    [
        (None, "no steps"),
        (program(), "no steps"),
        (program(GripperStep(open_percent=5)), "no step of it moves a joint"),
        (program(MoveStep(joints_deg=(300, 0, 0, 0, 0))), r"test: step 1: Base: 300\.00° is outside"),
    ],
)
def test_a_program_that_cannot_be_shown_says_why(what: Program | None, why: str) -> None:
    with pytest.raises(ProgramError, match=why):
        plan_motion(ROBOT, asked(PROGRAM, program=what))


def test_tool_velocity_and_acceleration_are_the_derivatives_of_its_position() -> None:
    trajectory = plan_motion(ROBOT, asked(to_pose("zero"), duration=4.0)).trajectory
    motion = analyse(ROBOT, trajectory, 4001)
    inner = slice(2, -2)
    velocity = np.gradient(motion.position, motion.time, axis=0)[inner]
    acceleration = np.gradient(motion.tool_velocity, motion.time, axis=0)[inner]
    assert np.abs(velocity - motion.tool_velocity[inner]).max() < 1e-6
    assert np.abs(acceleration - motion.tool_acceleration[inner]).max() < 1e-4


def test_peaks_of_any_trajectory_are_sampled() -> None:
    cubic = plan_motion(ROBOT, asked(to_pose("home"))).trajectory

    class Unknown:
        """The same motion without its closed form."""

        duration = cubic.duration
        start, end = cubic.start, cubic.end
        sample = staticmethod(cubic.sample)

    for known, sampled in zip(peak_rates(cubic), peak_rates(Unknown()), strict=True):
        assert sampled == pytest.approx(known, rel=1e-6)


@pytest.mark.parametrize("of", OF)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_graphs_have_a_title_with_its_unit_and_one_line_a_coordinate(of: str, quantity: str) -> None:
    motion = analyse(ROBOT, plan_motion(ROBOT, asked(to_pose("home"))).trajectory, 50)
    picture = graph(ROBOT, motion, of, quantity)
    assert re.fullmatch(rf"(Tool|Joint) {quantity.lower()} \((mm|°)(/s²?)?\)", picture.title)
    assert len(picture.lines) == (3 if of == "Tool" else 5)
    assert all(len(line.y) == 50 and np.isfinite(line.y).all() for line in picture.lines)


def test_the_peak_table_tells_duration_and_limits() -> None:
    planned = plan_motion(ROBOT, asked(to_pose("home")))
    html = peaks_html(ROBOT, planned, analyse(ROBOT, planned.trajectory, 50))
    assert f"{planned.trajectory.duration:.3f} s" in html
    for word in ("Shoulder", "speed °/s", ">360<", ">60<", "mm/s²"):
        assert word in html
    assert "at 0.00 s: tool (<b>124.7, 3.6, 267.5</b>) mm" in cursor_html(ROBOT, planned, 0.0)


def test_the_error_report_is_that_of_the_paper() -> None:
    desired = np.zeros((4, 3))
    reached = np.array([[0.001, 0, 0], [-0.001, 0, 0], [0.003, 0, 0], [-0.003, 0, 0.004]])
    report = ErrorReport.of(desired, reached)
    assert report.mse == pytest.approx([5e-6, 0, 4e-6])
    assert report.rmse == pytest.approx([np.sqrt(5e-6), 0, 2e-3])
    assert report.largest == pytest.approx([0.003, 0, 0.004])
    assert report.distance[3] == pytest.approx(0.005)
    html = summary_html("Applied", applied_meaning(Source.TRANSMITTED), report)
    for part in ("4 points", "transmitted by the board, not measured", "5.000", "2.236", "4.000"):
        assert part in html
    assert points_html(report, 0, 2).count("background") == 1


def test_the_theoretical_error_of_the_arc_is_a_rounding_error() -> None:
    solved = plan_motion(ROBOT, asked(ARC)).solved
    assert solved is not None
    report = ErrorReport.of(arc(), ROBOT.forward(solved)[:, :3, 3])
    assert report.rmse.max() < 5e-12  # the paper prints at most 0.005 mm


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
        ErrorReport.of(desired, reached)


def test_the_closest_point_of_a_path_may_lie_between_its_readings() -> None:
    path = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]])
    points = np.array([[0.25, 0.1, 0], [1.2, 0.5, 0], [-1, 0, 0], [2, 2, 0]])
    expected = [[0.25, 0, 0], [1, 0.5, 0], [0, 0, 0], [1, 1, 0]]
    assert closest_on_path(points, path) == pytest.approx(np.array(expected))
    assert closest_on_path(points, path[:1]) == pytest.approx(np.zeros((4, 3)))
    with pytest.raises(InputError, match="without points"):
        closest_on_path(points, path[:0])


def test_csv_files_name_their_units_and_have_a_row_a_sample() -> None:
    motion = analyse(ROBOT, plan_motion(ROBOT, asked(to_pose("home"))).trajectory, 11)
    head, *rows = analysis_csv(ROBOT, motion).splitlines()
    names = head.split(",")
    assert len(rows) == 11 and all(len(row.split(",")) == len(names) == 1 + 15 + 9 for row in rows)
    assert {"time_s", "shoulder_deg", "wrist_roll_deg_s2", "x_mm", "vz_mm_s", "ay_mm_s2"} <= set(names)
    first = dict(zip(names, map(float, rows[0].split(",")), strict=True))
    assert first["shoulder_deg"] == 110 and first["x_mm"] == pytest.approx(124.685, abs=1e-3)
    report = ErrorReport.of(np.full((2, 3), 0.1), np.full((2, 3), 0.2))
    assert report_csv(report, report).splitlines()[2] == "2" + ",100.000000" * 3 + ",200.000000" * 6
    assert "applied" not in report_csv(report, None)
