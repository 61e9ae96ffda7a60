"""A drawing planned for arms: where the pen goes, how fast, and what is said of what it cannot draw."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.runtime.kit import make_rig

from armctl.arrays import FloatArray
from armctl.drawing import DrawingPlane, PenDrawing
from armctl.drawing.pen_path import pen_paths, stroke_line
from armctl.drawing.plan import DrawingPlan, DrawnPart, distances, plan_drawing
from armctl.drawing.strokes import Stroke, ordered
from armctl.drawing.svg import read_svg
from armctl.errors import DrawingError, MotionRefusedError, ProgramError
from armctl.facts import State, StrokeLeftOut
from armctl.facts.words import fact_of, fact_record, say
from armctl.motion.preflight import preflight
from armctl.motion.trajectory import Trajectory
from armctl.program import DrawStep, Program, check_program, load_program, read_csv, save_program, write_csv
from armctl.program.scripts import write_script
from armctl.protocol import RunProgram
from armctl.robot import load_robot, robots_folder

UZUNER = load_robot("uzuner")
PLANE = (190.0, 30.0, 30.0, 190.0, -70.0, 30.0, 260.0, 30.0, 30.0)
LINE_ERROR_M, SPEED = 0.1e-3, 0.03
NAME = """<svg xmlns="http://www.w3.org/2000/svg" width="40mm" height="20mm" viewBox="0 0 40 20">
  <path d="M2 18 L8 2 L14 18 M4.5 12 H11.5"/>
  <path d="M18 18 V8 M18 11 C19 8 22 7 24 8"/><circle cx="33" cy="13" r="5"/>
</svg>"""


def name(width: float = 40.0) -> PenDrawing:
    return read_svg(NAME).placed(width)


@pytest.fixture(scope="module")
def plan() -> DrawingPlan:
    plane = DrawingPlane.touched(PLANE)
    return plan_drawing(UZUNER, UZUNER.first_pose, name(), plane, speed=SPEED, lift=0.01)


def test_the_pen_keeps_to_the_strokes(plan: DrawingPlan) -> None:
    lines = [stroke_line(stroke.points, DrawingPlane.touched(PLANE)) for stroke in name().strokes]
    drawn = [part for part in plan.parts if part.kind == "draw"]
    assert len(drawn) == 5 and not plan.left_out
    for part in drawn:
        tool = tool_points(plan, part.trajectory.duration, part.trajectory)
        assert min(float(distances(tool, line).max()) for line in lines) < LINE_ERROR_M
    assert 0.0 < plan.line_error_m < LINE_ERROR_M
    assert 1000 * plan.drawn_m == pytest.approx(sum(stroke.length for stroke in name().strokes), rel=1e-3)


def tool_points(plan: DrawingPlan, duration: float, trajectory: Trajectory) -> FloatArray:
    sampled = trajectory.sample(np.linspace(0.0, duration, 2001))
    return plan.hold.robot.forward(sampled.q)[:, :3, 3]


def test_outside_corners_the_pen_has_its_speed(plan: DrawingPlan) -> None:
    circle = next(part for part in plan.parts if len(part.line) and np.allclose(part.line[0], part.line[-1]))
    times = np.linspace(0.0, circle.trajectory.duration, 2001)
    steps = np.linalg.norm(np.diff(tool_points(plan, times[-1], circle.trajectory), axis=0), axis=1)
    speeds = steps / np.diff(times)
    inside = (times[1:] > 0.15) & (times[1:] < times[-1] - 0.15)
    assert np.abs(speeds[inside] / SPEED - 1.0).max() < 0.05
    assert plan.at_speed > 0.85


def test_a_jerk_limit_of_the_robot_file_holds_and_the_pen_keeps_its_speed(
    plan: DrawingPlan, tmp_path: Path
) -> None:
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    text, count = re.subn(r"(?m)^(acceleration_deg_s2 = .*)$", r"\1\njerk_deg_s3 = 20000", text)
    assert count == 5
    (tmp_path / "uzuner.toml").write_text(text, encoding="utf-8")
    soft, plane = load_robot(tmp_path / "uzuner.toml"), DrawingPlane.touched(PLANE)
    softly = plan_drawing(soft, soft.first_pose, name(), plane, speed=SPEED, lift=0.01)
    limit = np.radians(20_000)
    assert [part.kind for part in softly.parts] == [part.kind for part in plan.parts]
    assert largest_jerk(plan) > 1.5 * limit
    assert 0.8 * limit < largest_jerk(softly) <= limit * 1.001
    assert softly.at_speed > 0.85 and softly.line_error_m < LINE_ERROR_M
    lasts = softly.trajectory.duration / plan.trajectory.duration
    assert 0.95 < lasts < 1.1  # joint by joint it is even faster than the plain law
    fastest = [drawn_speed(softly, part) for part in softly.parts if part.kind == "draw"]
    assert max(fastest) == pytest.approx(SPEED, rel=0.01)


def drawn_speed(plan: DrawingPlan, part: DrawnPart) -> float:
    """The largest of the pen [m/s]."""
    times = np.linspace(0.0, part.trajectory.duration, 400)
    tool = plan.hold.robot.forward(part.trajectory.sample(times).q)[:, :3, 3]
    return float(np.linalg.norm(np.diff(tool, axis=0), axis=1).max() / (times[1] - times[0]))


def largest_jerk(plan: DrawingPlan) -> float:
    """Of all joints, by the differences of accelerations 1 ms apart [rad/s³]."""
    found = 0.0
    for part in plan.parts:
        times = np.arange(0.0, part.trajectory.duration, 1e-3)
        pushes = part.trajectory.sample(times).acceleration
        found = max(found, float(np.abs(np.diff(pushes, axis=0)).max()) / 1e-3)
    return found


def test_all_of_it_passes_the_pre_flight_and_the_pen_is_lifted_between(plan: DrawingPlan) -> None:
    assert not [one for one in preflight(UZUNER, plan.trajectory, tool_path=True) if one.severity == "error"]
    kinds = [part.kind for part in plan.parts]
    assert kinds == ["go", "down", "draw", "up"] * 5
    for go in (part for part in plan.parts[4:] if part.kind == "go"):
        assert 1000 * tool_points(plan, go.trajectory.duration, go.trajectory)[:, 2].min() > 39.99


@pytest.mark.parametrize("robot", ["so101", "mearm", "ur5"])
def test_arms_of_other_families_draw_it_too(robot: str) -> None:
    arm = load_robot(robot)
    x, z = {"so101": (200, 30), "mearm": (150, 100), "ur5": (400, 100)}[robot]
    plane = DrawingPlane.touched([x, 15, z, x, -85, z, x + 100, 15, z])
    drawing = PenDrawing.of([(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0]]), 1)])
    plan = plan_drawing(arm, arm.first_pose, drawing, plane, speed=0.02, lift=0.005)
    assert not plan.left_out and plan.line_error_m < LINE_ERROR_M


def test_what_is_out_of_reach_is_named_with_its_place_and_why() -> None:
    plane = DrawingPlane.touched(PLANE)
    far = PenDrawing.of(
        [(np.array([[0.0, -10.0], [0.0, -10.0]]), 3), (np.array([[10.0, 20.0], [600.0, 20.0]]), 7)]
    )
    plan = plan_drawing(UZUNER, UZUNER.first_pose, far, plane, speed=SPEED, lift=0.01)
    assert {one.fact.stroke for one in plan.left_out} == {1} and plan.drawn_m > 0.01
    fact = plan.left_out[0].fact
    assert (fact.line, fact.length) == (7, pytest.approx(0.59)) and fact.why is not None
    assert fact_of(fact_record(fact)) == fact
    assert say(fact, "en").startswith("stroke 1 (line 7 of the file) is left out from ")
    assert say(fact, "tr").startswith("1. çizgi (dosyanın 7. satırı) ")
    with pytest.raises(MotionRefusedError, match="none of 1 strokes can be drawn: stroke 1"):
        away = PenDrawing.of([(np.array([[900.0, 0.0], [950.0, 0.0]]), 1)])
        plan_drawing(UZUNER, UZUNER.first_pose, away, plane, speed=SPEED, lift=0.01)


def test_a_whole_stroke_left_out_says_no_places() -> None:
    assert say(StrokeLeftOut(1, 2, 0.0, 0.03, 0.03), "en") == "stroke 1 (line 2 of the file) is left out"


# Strokes and the plane.


def pen_up_mm(strokes: Sequence[Stroke]) -> float:
    """The way of the lifted pen from stroke to stroke [mm]."""
    return sum(
        float(np.linalg.norm(after.points[0] - before.points[-1])) for before, after in pairwise(strokes)
    )


@given(st.lists(st.tuples(*[st.floats(-50, 50)] * 4), min_size=1, max_size=12))
def test_an_order_keeps_all_strokes_and_spares_ways(ends: list[tuple[float, float, float, float]]) -> None:
    lines = [(np.array([[a, b], [c, d + 100.0]]), k) for k, (a, b, c, d) in enumerate(ends, 1)]
    drawing = PenDrawing.of(lines)
    found = ordered(drawing.strokes)
    assert sorted(stroke.number for stroke in found) == [stroke.number for stroke in drawing.strokes]
    for stroke in found:
        before = drawing.strokes[stroke.number - 1].points
        assert stroke.points.tolist() in (before.tolist(), before[::-1].tolist())
    assert (
        pen_up_mm(found) <= pen_up_mm(drawing.strokes) + np.linalg.norm(drawing.strokes[0].points[0]) + 1e-6
    )


@given(st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=2, max_size=12))
def test_a_pen_path_is_smooth_and_near_its_points(corners: list[tuple[float, float]]) -> None:
    points = np.array(corners)
    keep = np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.5)
    if np.count_nonzero(keep) < 2:
        return
    drawing = PenDrawing.of([(points[keep], 1)])
    plane = DrawingPlane.touched(PLANE)
    paths = pen_paths(drawing.strokes[0].points, plane)
    line = stroke_line(drawing.strokes[0].points, plane)
    for path in paths:
        assert not path.slope_jumps().any()
        assert distances(path(np.linspace(0.0, path.high, 3000)), line).max() < 0.05e-3
    assert np.allclose(paths[0](0.0), line[0]) and np.allclose(paths[-1](paths[-1].high), line[-1])


def test_a_surface_goes_through_every_touched_point() -> None:
    more = (220.0, 0.0, 31.0, 230.0, -40.0, 28.5, 250.0, 10.0, 30.5)
    plane = DrawingPlane.touched((*PLANE, *more))
    touched = np.array((*PLANE, *more)).reshape(-1, 3) / 1000
    places = (touched - plane.origin) @ plane.axes[:, :2]
    assert np.allclose(plane.points(places), touched, atol=1e-9)
    (path,) = pen_paths(np.array([[10.0, 10.0], [90.0, 60.0]]), plane)
    on_it = path(np.linspace(0.0, path.high, 200))
    assert np.allclose(plane.points((on_it - plane.origin) @ plane.axes[:, :2]), on_it, atol=0.02e-3)


RIDGE = (205.0, 20.0, 30.0, 205.0, -20.0, 30.0, 195.0, 0.0, 45.0, 205.0, 0.0, 45.0, 215.0, 0.0, 45.0)


def test_a_lifted_pen_passes_over_what_stands_between_strokes() -> None:
    plane = DrawingPlane.touched((*PLANE, *RIDGE))
    lines = [np.array([[x, 5.0], [x, 25.0]]) for x in (0.0, 60.0)]
    strokes = PenDrawing.of([(line, k) for k, line in enumerate(lines, 1)])
    plan = plan_drawing(UZUNER, UZUNER.first_pose, strokes, plane, speed=SPEED, lift=0.005)
    assert not plan.left_out
    goes = [part for part in plan.parts if part.kind == "go"][1:]
    for go in goes:
        tool = (tool_points(plan, go.trajectory.duration, go.trajectory) - plane.origin) @ plane.axes
        assert 1000 * (tool[:, 2] - plane.heights(tool[:, :2])).min() > 4.9
    assert len(goes) == 1


@given(st.lists(st.tuples(st.floats(0, 80), st.floats(0, 60)), min_size=2, max_size=6))
def test_no_way_between_places_is_higher_than_the_highest(places: list[tuple[float, float]]) -> None:
    plane, points = DrawingPlane.touched((*PLANE, *RIDGE)), np.array(places) / 1000
    highest = plane.highest(points)
    assert highest >= plane.heights(plane.knots).max()
    for begin, end in zip(points, np.roll(points, 1, axis=0), strict=True):
        way = begin + np.linspace(0.0, 1.0, 500)[:, None] * (end - begin)
        assert plane.heights(way).max() < highest + 0.1e-3
    assert DrawingPlane.touched(PLANE).highest(points) == 0.0


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (PLANE[:6], "there are 6 numbers"),
        ((0, 0, 0, 2, 0, 0, 0, 90, 0), "touched points 1 and 2 are 2.0 mm apart"),
        ((0, 0, 0, 90, 0, 0, 50, 1, 0), "nearly in one line"),
        ((0, 0, 0, 90, 0, 0, 0, -90, 0), "the pen would come from below"),
        ((*PLANE, 220, 0, 99), "touched point 4 lies 69.0 mm off the plane"),
    ],
)
def test_points_that_are_no_plane_are_refused(points: tuple[float, ...], says: str) -> None:
    with pytest.raises(DrawingError) as refusal:
        DrawingPlane.touched(points)
    assert says in str(refusal.value)


# The step of a program.


@pytest.fixture
def step(tmp_path: Path) -> DrawStep:
    (tmp_path / "name.svg").write_text(NAME)
    return DrawStep(file=str(tmp_path / "name.svg"), plane_mm=PLANE, width_mm=40.0)


def test_a_program_names_its_drawing_as_seen_from_its_folder(step: DrawStep, tmp_path: Path) -> None:
    program = Program(robot="uzuner", name="p", steps=(step,))
    save_program(program, tmp_path / "p.toml")
    assert 'file = "name.svg"' in (tmp_path / "p.toml").read_text()
    assert load_program(tmp_path / "p.toml") == program
    assert read_csv(write_csv(program, UZUNER), UZUNER, "p").steps == (step,)
    assert "armctl.program.DrawStep(file=" in write_script(program)
    assert step.describe() == "name.svg, 40 mm wide, 30 mm/s"


def test_the_check_plans_it_and_warns_of_what_is_left_out(step: DrawStep) -> None:
    program = Program(robot="uzuner", name="p", steps=(step,))
    assert not check_program(program, UZUNER, start=UZUNER.first_pose)
    wide = msgspec.structs.replace(step, width_mm=400.0)
    found = check_program(msgspec.structs.replace(program, steps=(wide,)), UZUNER, start=UZUNER.first_pose)
    assert found and {finding.severity for finding in found} == {"warning"}
    assert all(isinstance(finding.reason, StrokeLeftOut) for finding in found)
    gone = msgspec.structs.replace(step, file="none.svg")
    (finding,) = check_program(msgspec.structs.replace(program, steps=(gone,)), UZUNER, motions=False)
    assert "none.svg: cannot be read" in finding.what


def test_it_can_be_fitted_into_what_is_reachable(step: DrawStep) -> None:
    wide = msgspec.structs.replace(step, width_mm=250.0)
    assert wide.left_out(UZUNER, UZUNER.first_pose)
    fitted = wide.fitted(UZUNER, UZUNER.first_pose)
    assert not fitted.left_out(UZUNER, UZUNER.first_pose)
    assert fitted.width_mm is not None and 20.0 < fitted.width_mm < 250.0


def test_it_takes_as_long_as_it_is_told(step: DrawStep) -> None:
    shortest = step.plan(UZUNER, UZUNER.first_pose).duration
    slow = msgspec.structs.replace(step, duration_s=2 * shortest)
    assert slow.plan(UZUNER, UZUNER.first_pose).duration == pytest.approx(2 * shortest)
    with pytest.raises(MotionRefusedError, match="the drawing cannot take"):
        msgspec.structs.replace(step, duration_s=0.5 * shortest).plan(UZUNER, UZUNER.first_pose)


def test_the_arm_draws_it(step: DrawStep) -> None:
    rig = make_rig().enable()
    rig.finishes(RunProgram(Program(robot="uzuner", name="p", steps=(step,))))
    assert rig.now.state is State.HOLDING


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(
        f'robot = "uzuner"\n[[steps]]\ndo = "draw"\nfile = "x.txt"\nplane_mm = {list(PLANE)}\n'
    )
    program = load_program(tmp_path / "p.toml")
    (finding,) = check_program(program, UZUNER, motions=False)
    assert "a drawing is a file .svg" in finding.what
    with pytest.raises(ProgramError, match="key pen_speed_mm_s"):
        (tmp_path / "q.toml").write_text((tmp_path / "p.toml").read_text() + "pen_speed_mm_s = -1\n")
        load_program(tmp_path / "q.toml")
