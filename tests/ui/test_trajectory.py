"""Motions of the Trajectory screen: planned, drawn with what is wrong with them, compared, reported."""

from __future__ import annotations

import itertools
import math
import re
from typing import Any, get_args

import numpy as np
import pytest

from armctl.errors import InputError, MotionRefusedError, ProgramError, UnreachableError
from armctl.hardware import Source
from armctl.kinematics import Target
from armctl.motion import Profile
from armctl.motion.analysis import ErrorReport, PathError, Turning, closest_on_path, distances, report_csv
from armctl.motion.plan import Passing
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
from armctl.robot import Robot, load_robot
from armctl.ui.tabs.trajectory.graphs import (
    OF,
    QUANTITIES,
    compare_html,
    curves,
    joints_html,
    named_html,
    peaks_html,
    title,
    tool_html,
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
    PlannedMotion,
    plan_motion,
    why_not,
)
from armctl.ui.tabs.trajectory.screen import (
    MEANING,
    between_html,
    point_row,
    summary_html,
    theoretical,
)
from armctl.ui.tabs.trajectory.study import (
    ShownStudy,
    fastest_words,
    make_study,
    study_curves,
    study_html,
)
from armctl.ui.widgets.graph import Bound

ROBOT = load_robot("uzuner")
REST, HOME, ZERO = ROBOT.pose("rest"), ROBOT.pose("home"), ROBOT.pose("zero")
TIP = ROBOT.forward(HOME)[:3, 3]
STRETCHED = Target.of([0.5, 0.0, 0.3])
GO_HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))


def planned(motion: str = JOINTS, start: np.ndarray | Target = REST, **asked: Any) -> PlannedMotion:
    return plan_motion(ROBOT, MotionRequest(motion, motion, start, **asked))


def of_program(*steps: Step) -> PlannedMotion:
    return planned(PROGRAM, program=Program(robot="uzuner", name="test", steps=steps))


def bounds_of(found: PlannedMotion, of: str, quantity: str, limits: str) -> tuple[Bound, ...]:
    """What limits are drawn."""
    return curves(found, of, quantity, limits, None).bounds


def test_from_pose_to_pose_and_from_point_to_point() -> None:
    found = planned(end=HOME, duration_s=3.0)
    assert found.trajectory.duration == 3.0 and found.refusal is None
    assert (found.motion.q[0], found.motion.q[-1]) == (pytest.approx(REST), pytest.approx(HOME))
    assert planned(end=REST).note == "It ends where it begins."
    begin, end = Target.of([0.2, 0.0, 0.1]), Target.of([0.2, 0.1, 0.1])
    between = planned(start=begin, end=end).motion.position[[0, -1]]
    assert between == pytest.approx(np.array([begin.point, end.point]), abs=1e-9)
    nearest = planned(start=begin, end=HOME, choose="least-travel", present=HOME)
    assert nearest.motion.position[0] == pytest.approx(begin.point)
    with pytest.raises(UnreachableError, match="too far"):
        planned(end=Target.of([0.9, 0.0, 0.1]))
    with pytest.raises(MotionRefusedError, match=r"Base: 171\.89° is outside"):
        planned(end=np.array([3.0, 0, 0, 0, 0]))
    down = np.radians([0.0, -3.0, -84.0, -10.0, 0.0])  # the hand below the floor: drawn, and refused
    found = planned(end=down)
    assert found.trajectory.end == pytest.approx(down)
    assert found.refusal is not None and found.refusal.kind in ("floor", "self-collision")


@pytest.mark.parametrize("via", [None, TIP + np.array([0, 0.04, 0.02])])
def test_the_tool_is_led_to_its_end_at_the_speed_that_is_asked_for(via: np.ndarray | None) -> None:
    end, motion = TIP + np.array([0, 0.08, 0]), TOOL_LINE if via is None else TOOL_ARC
    found = planned(motion, HOME, profile="trapezoid", end=Target.of(end), via=via, speed=0.02)
    assert found.refusal is None
    assert found.motion.position[-1] == pytest.approx(end, abs=1e-5)
    assert found.motion.tool_speed.max() == pytest.approx(0.02, rel=1e-3)
    assert np.degrees(found.motion.pitch) == pytest.approx(-30.0, abs=0.02)
    assert found.points is not None and len(found.points) == 25
    report, html = theoretical(found)
    assert report.distance.max() < 0.05e-3
    assert "Off the ideal line or arc" in html and "As printed" not in html
    assert "(asked for: 20 mm/s)" in peaks_html(found)
    turned = planned(motion, HOME, end=Target.of(end, np.radians(-40)), via=via, pitch="interpolated")
    assert np.degrees(turned.motion.pitch[-1]) == pytest.approx(-40.0, abs=0.02)


def test_a_line_that_ends_on_the_way_is_drawn_so_far_and_its_limit_told_once() -> None:
    request = MotionRequest(TOOL_LINE, "Tool line", HOME, "trapezoid", end=STRETCHED)
    found = plan_motion(ROBOT, request)
    assert found.title == "Tool line"  # it follows no profile
    assert found.refusal is not None
    assert re.match(r"(?!at ).*\d+ % of the line", found.refusal.what)
    assert found.refusal.time == pytest.approx(found.trajectory.duration)
    assert found.note.startswith("Drawn as far as the arm can follow, as fast as its limits allow")
    assert found.points is None
    assert found.motion.position[-1, 0] > TIP[0] + 0.05
    with pytest.raises(InputError, match="normal leads each joint for itself"):
        planned(TOOL_LINE, HOME, profile="normal", end=STRETCHED)
    start = np.radians([0.0, 80.0, -50.0, -60.0, 0.0])
    found = planned(TOOL_LINE, start, profile="trapezoid", end=Target.of([0.22, -0.06, 0.2]))
    limits = [finding for finding in found.findings if finding.kind == "limits"]
    assert [finding.part for finding in limits] == ["Elbow"]
    assert "Elbow would need" in limits[0].what


def test_a_line_that_cannot_keep_the_pitch_yields_it_or_knows_what_would_help() -> None:
    end, keep = Target.of([0.22, -0.06, 0.1]), {"profile": "trapezoid", "pitch": "kept"}
    kept = planned(TOOL_LINE, HOME, end=end, **keep)
    assert kept.refusal is not None and kept.freer == "free"
    free = planned(TOOL_LINE, HOME, end=end, yields=True, **keep)
    assert free.refusal is None and free.freer is None
    assert free.motion.position[-1] == pytest.approx(end.point, abs=1e-5)
    assert "The tool pitch cannot be kept: the arm would get 5 % of the way." in free.note
    asked = MotionRequest(TOOL_LINE, "Tool line", HOME, end=end, yields=True, **keep)
    assert plan_motion(ROBOT, asked).title == "Tool line, pitch free, trapezoid"
    near = planned(TOOL_LINE, HOME, end=Target.of(TIP + np.array([0, 0.08, 0])), yields=True, **keep)
    assert near.note == "" and np.degrees(near.motion.pitch) == pytest.approx(-30.0, abs=0.02)
    behind = Target.of(-TIP * [1, 1, -1])  # the line leads through the base; a joint motion does not
    beyond = planned(TOOL_LINE, HOME, end=behind, yields=True, **keep)
    reached = ROBOT.inverse(behind.position).success
    assert beyond.refusal is not None and beyond.freer is None
    assert reached == ("choose Joint motion" in beyond.note)


@pytest.mark.parametrize(("motion", "count"), [(ARC, 58), (LINE, 29)])
@pytest.mark.parametrize("passing", [*get_args(Passing), None])
def test_a_published_path_in_every_way_of_passing_its_points(
    motion: str, count: int, passing: Passing | None
) -> None:
    found = planned(motion, choose="published", passing=passing)
    assert found.points is not None and found.solved is not None and found.ideal is not None
    assert found.points.shape == (count, 3)
    assert np.abs(ROBOT.forward(found.solved)[:, :3, 3] - found.points).max() < 1e-9
    assert found.trajectory.start == pytest.approx(found.solved[0])
    report, html = theoretical(found)
    assert report.rmse.max() < 5e-12
    assert "As printed" in html and "at most 0.005 mm" in html
    if passing is None:
        closest = closest_on_path(found.points, found.motion.position)
        assert np.linalg.norm(closest - found.points, axis=1).max() < 5e-3
        assert distances(found.ideal, found.motion.position).max() < 5e-5
    if passing == "stop":
        assert found.refusal is None
        assert found.trajectory.end == pytest.approx(found.solved[-1])
    if motion == LINE:  # the printed first row
        first = [-42.402, 14.4, -45.909, -1.305, 0]
        assert np.degrees(found.solved[0]) == pytest.approx(first, abs=0.0006)


@pytest.mark.parametrize("motion", [ARC, LINE])
@pytest.mark.parametrize("name", ["abaas", "scorbot", "mico", "humanoid"])
def test_another_arm_follows_a_published_path_or_it_is_said_why_not(name: str, motion: str) -> None:
    robot, points = load_robot(name), TEST_PATHS[motion]()
    request = MotionRequest(motion, motion, robot.pose("home"))
    if name == "humanoid":
        assert re.match(r"point 1 of \d+: .*Elbow needs", why_not(robot, points) or "")
        with pytest.raises(UnreachableError, match=r"point 1 of .*Elbow needs"):
            plan_motion(robot, request)
        return
    solved = plan_motion(robot, request).solved
    assert why_not(robot, points) is None and solved is not None
    assert np.abs(robot.forward(solved)[:, :3, 3] - points).max() < 1e-9


@pytest.mark.parametrize("profile", ["cubic", "trapezoid", "s-curve"])
def test_the_duration_of_a_path_is_that_of_the_whole(profile: Profile) -> None:
    asked = {"profile": profile, "choose": "published"}
    quick = planned(ARC, **asked)
    slow = planned(ARC, duration_s=2 * quick.trajectory.duration, **asked)
    assert slow.trajectory.duration == pytest.approx(2 * quick.trajectory.duration)
    assert slow.peaks.speed == pytest.approx(quick.peaks.speed / 2)
    assert slow.peaks.acceleration == pytest.approx(quick.peaks.acceleration / 4)
    with pytest.raises(MotionRefusedError, match=r"shortest possible duration is \d"):
        planned(ARC, duration_s=0.5, **asked)
    with pytest.raises(InputError, match="radius must be positive, got 0 mm"):
        planned(ARC, passing="blend", blend_m=0.0)


def test_a_program_is_shown_as_it_runs_as_far_as_it_can_be_run() -> None:
    there = MoveStep(joints_deg=(0, 90, -80, -40, 0), duration_s=2.0)
    twice = RepeatStep(times=2), MoveStep(joints_deg=(0, 80, -80, -40, 0)), there, EndStep()
    found = of_program(there, WaitStep(seconds=1.5), GripperStep(open_percent=20), *twice)
    assert "1 gripper step " in found.note
    assert found.program is not None
    assert found.trajectory.sample(3.0).q == pytest.approx(HOME)
    assert [step for _, step in found.steps] == [0, 1, 2, 4, 5, 4, 5]
    assert [found.step_at(time) for time in (0.0, 3.0, 1e9)] == [0, 1, 5]
    assert "step 2" in tool_html(found, 3.0)
    assert of_program(SpeedStep(percent=50), there).trajectory.duration == pytest.approx(4.0, abs=0.03)
    found = of_program(GO_HOME, LineStep(x_mm=900, y_mm=0, z_mm=100))
    assert found.trajectory.end == pytest.approx(HOME)
    assert found.refusal is not None and "step 2" in str(found.refusal)
    assert found.note == "Drawn as far as step 2, which cannot be run."
    endless = of_program(GO_HOME, RepeatStep(times=1_000_000), WaitStep(seconds=10.0), EndStep())
    assert 600 <= endless.trajectory.duration < 625
    assert re.match(r"The first \d+ steps of a pass", endless.note)


@pytest.mark.parametrize(
    ("steps", "why"),
    [
        ((), "no steps"),
        ((GripperStep(open_percent=5),), "no step of it moves a joint"),
        ((MoveStep(joints_deg=(300, 0, 0, 0, 0)),), r"test: step 1: Base: 300\.00° is outside"),
    ],
)
def test_a_program_that_cannot_be_shown_says_why(steps: tuple[Step, ...], why: str) -> None:
    with pytest.raises(ProgramError, match=why):
        of_program(*steps)


def test_graphs_have_a_line_a_coordinate_and_dashed_limits_where_they_matter() -> None:
    found = planned(end=HOME)
    for of, quantity in itertools.product(OF, QUANTITIES):
        drawn = curves(found, of, quantity, "none", None)
        assert re.fullmatch(rf"(Tool|Joint) {quantity.lower()} \((mm|°)(/s[²³]?)?\)", title(of, quantity))
        assert len(drawn.lines) == (3 if of == "Tool" else 5) and drawn.bounds == ()
        assert all(len(line.y) == len(drawn.x) and np.isfinite(line.y).all() for line in drawn.lines)
        values = drawn.at(np.array([0.3])).lines[0].y  # where the cursor stands
        assert values == pytest.approx(np.interp(0.3, drawn.x, drawn.lines[0].y))
    html = named_html(found) + peaks_html(found)
    duration = f"{found.trajectory.duration:.2f} s"
    assert all(word in html for word in (duration, "Shoulder", "speed °/s", ">360<", ">60<", "mm/s²"))
    numbers = tool_html(found, 0.0) + joints_html(found, 0.0)
    assert "at 0.00 s: tool (<b>124.7, 3.6, 267.5</b>) mm, 0.0 mm/s" in numbers
    assert all(joint.title in numbers for joint in ROBOT.joints)
    fast = planned(end=ZERO, profile="trapezoid")
    (near,) = bounds_of(fast, "Joints", "Velocity", "near")
    assert (near.name, near.value, near.is_upper) == ("Shoulder ≥ −60", pytest.approx(-60.0), False)
    assert near.color == curves(fast, "Joints", "Position", "near", None).lines[1].color
    every = bounds_of(fast, "Joints", "Velocity", "all")
    assert sorted(bound.value for bound in every) == pytest.approx([-120, -90, -60, 60, 90, 120])
    assert all(bound.is_upper is (bound.value > 0) for bound in every)
    assert "2 joints ≤ 120" in {bound.name for bound in every}
    low = planned(end=np.radians([0, 0, -40.0, 0, 0]))
    assert low.motion.position[-1, 2] < 0.105
    (floor,) = bounds_of(low, "Tool", "Position", "all")
    assert floor.name == "floor" and floor.value == pytest.approx(1000 * ROBOT.floor_z)


def test_another_motion_is_drawn_beside_it_over_the_longer_time() -> None:
    a, b = planned(end=HOME, duration_s=6.0), planned(end=HOME, profile="trapezoid")
    for first, second in ((a, b), (b, a)):
        drawn = curves(second, "Joints", "Velocity", "none", first)
        assert [line.name[:2] for line in drawn.lines] == ["B "] * 5 + ["A "] * 5
        assert all(line.dash is not None for line in drawn.lines[5:])
        assert drawn.x[-1] == pytest.approx(6.0) and (np.diff(drawn.x) > 0).all()
        short = drawn.lines[1 if second is b else 6].y
        assert np.isnan(short[drawn.x > b.trajectory.duration + 1e-9]).all()
        assert np.isfinite(short[drawn.x <= b.trajectory.duration]).all()
        looked_at = drawn.at(np.linspace(0.0, 6.0, 1000))  # another part of the time, or a zoom
        assert np.isfinite(looked_at.lines[1 if second is a else 6].y).all()
    html = compare_html(a, b)
    assert all(part in html for part in ("6.000", f"{b.trajectory.duration:.3f}", "jerk A", "Shoulder"))


def test_the_error_report_is_that_of_the_paper() -> None:
    reached = np.array([[0.001, 0, 0], [-0.001, 0, 0], [0.003, 0, 0], [-0.003, 0, 0.004]])
    report = ErrorReport(np.zeros((4, 3)), reached)
    html = summary_html("Applied", MEANING[Source.TRANSMITTED], report)
    for part in ("4 points", "transmitted by the board, not measured", "5.000", "2.236", "4.000"):
        assert part in html
    assert point_row(report, 4) == ["4", *["0.00"] * 3, "−3.00", "0.00", "4.00", "5.000"]
    strays = between_html(PathError(np.arange(2.0), np.array([0.0, 0.0015])), "of 2 readings")
    assert "of 2 readings" in strays and "1.500" in strays and "1.061" in strays
    head, _, second, *_ = report_csv(report, report).splitlines()
    assert head.startswith("point,desired_x_mm") and head.endswith("applied_z_mm")
    assert second == "2" + ",0.000000" * 3 + ",-1.000000,0.000000,0.000000" * 2
    assert "applied" not in report_csv(report, None)
    path = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]])
    points = np.array([[0.25, 0.1, 0], [1.2, 0.5, 0], [-1, 0, 0], [2, 2, 0]])
    expected = [[0.25, 0, 0], [1, 0.5, 0], [0, 0, 0], [1, 1, 0]]
    assert closest_on_path(points, path) == pytest.approx(np.array(expected))
    assert closest_on_path(points, path[:1]) == pytest.approx(np.zeros((4, 3)))
    with pytest.raises(InputError, match="without points"):
        closest_on_path(points, path[:0])


# The study joint by joint.


def studied(robot: Robot, turning: Turning = "in turn", deg_s: float = 20.0) -> ShownStudy:
    return make_study(robot, "home", robot.pose("home"), turning, math.radians(deg_s), None)


def test_the_fastest_joint_is_named_and_the_printed_speed_set_right() -> None:
    robot = load_robot("abaas")
    alone = studied(robot)
    words = "Shoulder moves the tip fastest: 84.4 mm/s; next is Elbow with 83.4 mm/s."
    assert fastest_words(alone) == words
    assert "Shoulder moves the tip fastest: 122.0 mm/s" in fastest_words(studied(robot, "all at once"))
    html = study_html(alone)
    for part in ("355.0 mm at most", "20 °/s give 123.9", "8.32·10³ mm/s", "23.8 m", "right is 124 mm/s"):
        assert part in html
    assert "8.32·10³" not in study_html(studied(load_robot("mico")))
    assert "its limits hold it still: Wrist roll." in study_html(studied(load_robot("humanoid")))
    scorbot = load_robot("scorbot")
    assert "Faster than" not in study_html(studied(scorbot))
    html = study_html(studied(scorbot, deg_s=50.0))
    assert "Faster than the real arm may turn: Waist (20 °/s), Shoulder (26 °/s), Elbow (26 °/s)." in html


@pytest.mark.parametrize("name", ["uzuner", "humanoid"])
def test_the_plot_has_a_line_a_joint_in_millimetres_a_second(name: str) -> None:
    robot = load_robot(name)
    alone, together = studied(robot), studied(robot, "all at once")
    titles = [joint.title for joint in robot.joints if joint.upper > joint.lower]
    assert [line.name for line in study_curves(alone).lines] == titles
    picture = study_curves(together)
    assert [line.name for line in picture.lines] == [*titles, "all together"]
    assert len({line.color for line in picture.lines}) == len(picture.lines)
    highest = max(float(np.nanmax(line.y)) for line in picture.lines[:-1])
    assert highest == pytest.approx(1000 * together.study.peaks.max())
