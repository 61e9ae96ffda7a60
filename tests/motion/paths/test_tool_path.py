"""Lines and arcs of the tool: where it goes, which pitch it has, and where it is refused beforehand."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from tests.motion.paths.tool_kit import (
    ABAAS,
    HUMANOID,
    MICO,
    ROBOTS,
    SCORBOT,
    UZUNER,
    FloatArray,
    ToolPath,
    brute_force,
    random_robot,
    random_start,
    robot_of,
    strays,
    tool_arc,
    tool_line,
)

from armctl.errors import ArmctlError, InputError, MotionRefusedError, UnreachableError
from armctl.kinematics import Chain, DHRow
from armctl.motion import ToolPathRefusedError, ToolPathUnreachableError
from armctl.motion.analysis import arc, line
from armctl.motion.paths.tool_curve import ToolArc, ToolCurve, ToolLine
from armctl.motion.paths.tool_path import TURN_MODES, PitchMode, follow
from armctl.robot import Robot

ALLOWED_M = 0.05e-3
HELD = math.radians(0.02)
SIX_AXES = robot_of(
    Chain.from_dh(
        [
            DHRow(0.0, math.pi / 2, 0.1),
            DHRow(0.25, 0.0, 0.0),
            DHRow(0.02, math.pi / 2, 0.0),
            DHRow(0.0, -math.pi / 2, 0.22),
            DHRow(0.0, math.pi / 2, 0.0),
            DHRow(0.0, 0.0, 0.08),
        ]
    ),
    np.radians([[-170, 170], [-30, 150], [-120, 120], [-170, 170], [-110, 110], [-170, 170.0]]),
)


def q_end(path: ToolPath) -> FloatArray:
    assert (path.polynomial.low, path.polynomial.high) == (0.0, path.curve.length)
    return path.polynomial(path.curve.length)


def check(robot: Robot, path: ToolPath, q_start: FloatArray) -> FloatArray:
    """All that every path promises; returns the pitch on a dense sample."""
    away, pitch = strays(robot, path)
    assert away <= 0.011e-3
    np.testing.assert_array_equal(path.polynomial(0.0), q_start)
    end = path.curve.positions(path.curve.length)
    np.testing.assert_allclose(robot.forward(q_end(path))[:3, 3], end, atol=1e-10)
    low, high = path.polynomial.extremes()
    assert (low >= robot.limits[:, 0] - 1e-8).all() and (high <= robot.limits[:, 1] + 1e-8).all()
    inner = path.polynomial.breaks[1:-1]
    tiny = 1e-9 * path.curve.length
    before, after = (path.polynomial.derivatives(inner + shift, 2) for shift in (0.0, tiny))
    for order in range(3):
        scale = 1.0 + np.abs(before[order]).max(initial=0.0)
        np.testing.assert_allclose(after[order], before[order], atol=2e-4 * scale)
    return pitch


def start_at(robot: Robot, point: FloatArray, pitch_deg: float) -> FloatArray:
    return robot.inverse(point, math.radians(pitch_deg)).best("least-rotation")


@pytest.mark.parametrize("choose", ["published", "least-rotation"])
def test_published_line(choose: str) -> None:
    q = UZUNER.inverse(line()[0]).best(choose)
    path = tool_line(UZUNER, q, line()[-1], "free")
    pitch = check(UZUNER, path, q)
    assert np.degrees(np.ptp(pitch)) > 20.0  # leads round a limit that the least motion runs into
    assert path.curve.length == pytest.approx(0.392)
    ticks = np.arange(0.0, path.curve.length, 0.1 / 50)  # 100 mm/s at 50 Hz
    tool = UZUNER.forward(path.polynomial(ticks))[:, :3, 3]
    np.testing.assert_allclose(tool[:, [0, 2]], np.tile([0.22, 0.085], (len(ticks), 1)), atol=ALLOWED_M)
    np.testing.assert_allclose(tool[:, 1], ticks - 0.196, atol=ALLOWED_M)


@pytest.mark.parametrize("choose", ["published", "least-rotation"])
@pytest.mark.parametrize("mode", ["free", "kept"])
def test_published_arc_turns_the_base_alone(choose: str, mode: PitchMode) -> None:
    points = arc()
    q = UZUNER.inverse(points[0]).best(choose)
    path = tool_arc(UZUNER, q, points[29], points[-1], mode)
    pitch = check(UZUNER, path, q)
    assert path.curve.length == pytest.approx(0.2 * math.radians(174))
    np.testing.assert_allclose(q_end(path), q + np.array([math.radians(174), 0, 0, 0, 0]), atol=1e-9)
    assert np.ptp(pitch) < HELD


@pytest.mark.parametrize("pitch_deg", [-90.0, -80.0])
def test_published_arc_with_a_kept_pitch(pitch_deg: float) -> None:
    points = arc()
    q = start_at(UZUNER, points[0], pitch_deg)
    pitch = check(UZUNER, tool_arc(UZUNER, q, points[29], points[-1]), q)
    np.testing.assert_allclose(np.degrees(pitch), pitch_deg, atol=0.02)


@pytest.mark.parametrize(("first", "last"), [(-60.0, -85.0), (-90.0, -70.0)])
def test_a_led_pitch_grows_evenly_on_the_side_it_is_on_from_upright_outward(
    first: float, last: float
) -> None:
    q = start_at(SCORBOT, np.array([0.3, 0.0, 0.3]), first)
    path = tool_line(SCORBOT, q, [0.35, 0.1, 0.25], "interpolated", math.radians(last))
    pitch = check(SCORBOT, path, q)
    np.testing.assert_allclose(np.degrees(pitch), np.linspace(first, last, len(pitch)), atol=0.02)
    outward = SCORBOT.forward(q_end(path))[:3, 2] @ [0.35, 0.1, 0.0]
    assert outward > 0.0 or first != -90.0


@pytest.mark.parametrize("robot", [ABAAS, SCORBOT, UZUNER], ids=lambda robot: robot.name)
def test_the_roll_stays(robot: Robot) -> None:
    q = robot.pose("home")
    q[-1] += 0.2
    path = tool_line(robot, q, robot.forward(q)[:3, 3] + [0.0, 0.02, 0.01], "free")
    rolls = path.polynomial(np.linspace(0, path.curve.length, 50))[:, -1]
    np.testing.assert_allclose(rolls, q[-1], atol=1e-12)


@pytest.mark.parametrize("robot", [*ROBOTS, SIX_AXES], ids=lambda robot: robot.name)
@pytest.mark.parametrize("mode", TURN_MODES)
def test_random_lines_of_every_arm(robot: Robot, mode: PitchMode) -> None:
    rng, done, count = np.random.default_rng(7), 0, 25 if os.environ.get("ARMCTL_LONG") else 10
    for _ in range(count):
        q = random_start(rng, robot)
        there = np.clip(q + rng.uniform(-0.5, 0.5, robot.n), *robot.limits.T)
        end_pitch = robot.inverse_kinematics.pitch_and_roll(there)[0] if mode == "interpolated" else None
        try:
            path = tool_line(robot, q, robot.forward(there)[:3, 3], mode, end_pitch)
        except (MotionRefusedError, UnreachableError):
            continue
        pitch = check(robot, path, q)
        if mode == "kept":
            assert np.ptp(pitch) < HELD
        if mode == "interpolated":
            assert abs(pitch[-1] - end_pitch) < HELD
        done += 1
    assert done >= 6 * count / 25 or (robot.name == "mico" and mode != "free")


def test_a_tool_that_points_straight_down_stays_so_on_six_axes() -> None:
    found = SIX_AXES.inverse([0.3, 0.1, 0.15], math.radians(-90.0))
    assert found.success
    path = tool_line(SIX_AXES, found.q[0], [0.32, 0.05, 0.17])
    pitch = check(SIX_AXES, path, found.q[0])
    np.testing.assert_allclose(np.degrees(pitch), -90.0, atol=0.02)


def test_two_pitch_joints_cannot_hold_a_pitch_of_their_own() -> None:
    q = MICO.pose("home")
    tool = MICO.forward(q)[:3, 3]
    with pytest.raises(MotionRefusedError, match=r"the position alone decides .* choose free"):
        tool_line(MICO, q, tool + np.array([0.0, 0.0, 0.05]))
    check(MICO, tool_line(MICO, q, tool + np.array([0.0, 0.0, 0.05]), "free"), q)
    # about the base axis it holds all the same
    turned = [MICO.forward(q + np.array([angle, 0, 0, 0]))[:3, 3] for angle in (0.3, 0.8)]
    pitch = check(MICO, tool_arc(MICO, q, *turned), q)
    assert np.ptp(pitch) < HELD


def test_a_way_along_the_base_axis() -> None:
    solutions = ABAAS.inverse([0.0, 0.0, 0.3])
    q = solutions.q[len(solutions) // 2]
    path = tool_line(ABAAS, q, [0.0, 0.0, 0.29], "free")
    check(ABAAS, path, q)
    np.testing.assert_allclose(q_end(path)[0], q[0], atol=1e-9)


@pytest.mark.parametrize("way", [0.0, 1e-12, 1e-9])
def test_no_way_at_all(way: float) -> None:
    q = UZUNER.pose("home")
    tool = UZUNER.forward(q)[:3, 3]
    curve = ToolLine(tool, tool + np.array([way, 0.0, 0.0]))
    assert follow(UZUNER, q, curve, "kept") is None
    with pytest.raises(InputError, match="leaves no way to turn the tool on"):
        follow(UZUNER, q, curve, "interpolated", 0.5)


@pytest.mark.parametrize("way", [2e-7, 1e-6, 1e-4])
def test_a_very_short_way(way: float) -> None:
    q = UZUNER.pose("home")
    path = tool_line(UZUNER, q, UZUNER.forward(q)[:3, 3] + [0.0, way, 0.0])
    away, _ = strays(UZUNER, path)
    assert away < 1e-9 and path.curve.length == pytest.approx(way, rel=1e-6)


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ({"pitch": "level"}, "tool pitch 'level': allowed are 'kept', 'interpolated', 'free'"),
        ({"pitch": "interpolated"}, "needs the pitch at the end"),
        ({"pitch": "kept", "end_pitch": 0.1}, "does not go with pitch 'kept'"),
        ({"pitch": "interpolated", "end_pitch": math.nan}, "the pitch at the end must be a finite number"),
    ],
)
def test_contradictory_wishes(wish: dict[str, object], said: str) -> None:
    q = UZUNER.pose("home")
    with pytest.raises(InputError, match=said):
        tool_line(UZUNER, q, UZUNER.forward(q)[:3, 3] + [0.0, 0.02, 0.0], **wish)  # type: ignore[arg-type]


def test_what_is_not_finite_or_outside_is_refused() -> None:
    q = UZUNER.pose("home")
    with pytest.raises(InputError, match="finite"):
        tool_line(UZUNER, q, [0.2, math.nan, 0.1])
    with pytest.raises(InputError, match="finite"):
        tool_line(UZUNER, [0, math.nan, 0, 0, 0], [0.2, 0.0, 0.1])
    with pytest.raises(ArmctlError, match=r"Elbow: 100\.00° is outside"):
        tool_line(UZUNER, np.radians([0, 60, 100, 0, 0]), [0.2, 0.0, 0.1])
    with pytest.raises(InputError, match=r"the line begins .* mm from where the tool is"):
        follow(UZUNER, q, ToolLine(np.array([0.2, 0.0, 0.1]), np.array([0.2, 0.1, 0.1])), "kept")


def test_a_pitch_beyond_upright_needs_an_arm_with_a_plane_of_its_own() -> None:
    q = HUMANOID.pose("home")
    with pytest.raises(InputError, match=r"within ±90°, got 100\.00°"):
        tool_line(HUMANOID, q, [0.35, -0.1, -0.45], "interpolated", math.radians(100.0))
    solutions = SCORBOT.inverse([0.3, 0.0, 0.3], math.radians(-80.0))
    q = solutions.q[list(map(str, solutions.branch)).index("front elbow-up")]
    path = tool_line(SCORBOT, q, [0.32, 0.02, 0.3], "interpolated", math.radians(-100.0))
    pitch = check(SCORBOT, path, q)
    assert math.degrees(pitch.min()) == pytest.approx(-90.0, abs=0.1)  # passed on the way
    assert math.degrees(pitch[-1]) == pytest.approx(-80.0, abs=0.02)  # pointing back at the base


def test_an_arm_without_a_pitch_and_one_with_too_few_joints_are_refused() -> None:
    rows = [DHRow(0.0, math.pi / 2, 0.1), *[DHRow(0.2, 0.0, 0.0)] * 3]  # the tool's z axis lies across
    for count, mode, says in ((4, "kept", "it has no pitch; choose free"), (2, "free", "too few joints")):
        robot = robot_of(Chain.from_dh(rows[:count]), np.tile([-2.0, 2.0], (count, 1)))
        q = np.array([0.1, 0.5, -0.7, -0.4])[:count]
        with pytest.raises(InputError, match=says):
            tool_line(robot, q, robot.forward(q)[:3, 3] + [0.01, 0.0, 0.0], mode)  # type: ignore[arg-type]


def test_steps_that_let_the_tool_stray_are_taken_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("armctl.motion.paths.tool_walk._AIM", 1e4)
    q = UZUNER.inverse(line()[0]).best("published")
    check(UZUNER, tool_line(UZUNER, q, line()[-1], "free"), q)


# --- refused

FINE = 4001
Refusal = ToolPathRefusedError | ToolPathUnreachableError


def refused(robot: Robot, q: FloatArray, curve: ToolCurve) -> Refusal | None:
    try:
        path = follow(robot, q, curve, "kept")
    except (ToolPathRefusedError, ToolPathUnreachableError) as error:
        return error
    assert path is not None and np.ptp(check(robot, ToolPath(curve, path), q)) < HELD
    return None


def check_place(robot: Robot, curve: ToolCurve, error: Refusal) -> None:
    place = error.place
    assert place.fraction == pytest.approx(place.s / curve.length, abs=1e-12)
    np.testing.assert_allclose(place.point, curve.positions(place.s), atol=1e-12)
    x, y, z = (1000 * place.point).tolist()
    begins = f"{100 * place.fraction:.0f} % of the {curve.kind} (x {x:.1f}, y {y:.1f}, z {z:.1f} mm): "
    assert str(error).startswith(begins)
    if error.before is None:
        assert place.s == 0.0
        return
    assert error.before.low == 0.0 and error.before.high == pytest.approx(place.s, abs=1e-9)
    low, high = error.before.extremes()
    assert (low >= robot.limits[:, 0] - 1e-7).all() and (high <= robot.limits[:, 1] + 1e-7).all()


def test_random_lines_and_arcs_end_where_small_steps_end() -> None:
    rng, accepted, limits, ends = np.random.default_rng(11), 0, 0, 0
    for _ in range(90):
        robot = random_robot(rng)
        q = random_start(rng, robot)
        tool = robot.forward(q)[:3, 3]
        there = np.clip(q + rng.uniform(-0.8, 0.8, robot.n), *robot.limits.T)
        end = robot.forward(there)[:3, 3] + rng.uniform(-0.03, 0.03, 3)
        via = 0.5 * (tool + end) + rng.uniform(-0.05, 0.05, 3)
        curve = ToolArc(tool, via, end) if rng.random() < 0.3 else ToolLine(tool, end)
        pitch = robot.inverse_kinematics.pitch_and_roll(q)[0]
        if pitch is None or abs(pitch) > 1.2:  # the two readings of a pitch near upright confuse the oracle
            continue
        reached, _ = brute_force(robot, q, curve, np.full(FINE, pitch), FINE)
        error = refused(robot, q, curve)
        if error is None:
            assert reached == 1.0
            accepted += 1
            continue
        assert error.place.fraction == pytest.approx(reached, abs=6e-4)
        check_place(robot, curve, error)
        limits += error.place.needed is not None
        ends += error.place.needed is None
    assert accepted >= 5 and limits >= 10 and ends >= 3


def test_a_joint_limit_is_named_with_what_it_would_need() -> None:
    q = UZUNER.inverse(line()[0]).best("published")
    curve = ToolLine(UZUNER.forward(q)[:3, 3], line()[-1])
    error = refused(UZUNER, q, curve)
    assert isinstance(error, ToolPathRefusedError) and isinstance(error, MotionRefusedError)
    check_place(UZUNER, curve, error)
    place = error.place
    assert place.joint == 2 and place.needed is not None
    assert error.before is not None
    assert math.degrees(error.before(place.s)[2]) == pytest.approx(-84.36, abs=1e-4)
    # what it would need is what the branch needs where the line is nearest to the base, limits or not
    middle = curve.positions(curve.length / 2)
    pitch = UZUNER.inverse_kinematics.pitch_and_roll(q)[0]
    needed = [b.q[2] for b in UZUNER.branches(middle, pitch) if b.name == "front elbow-up"]
    assert place.needed == pytest.approx(min(needed), abs=math.radians(0.02))
    assert f"Elbow would need {math.degrees(place.needed):.2f}°, its limits are -84.36° … 95.07°" in str(
        error
    )
    assert str(error).endswith("; move the line")  # on no other branch it fares better


def test_out_of_reach_says_how_far() -> None:
    q = SCORBOT.pose("home")
    tool = SCORBOT.forward(q)[:3, 3]
    curve = ToolLine(tool, tool + np.array([0.8, 0.0, 0.0]))
    error = refused(SCORBOT, q, curve)
    assert isinstance(error, ToolPathUnreachableError) and isinstance(error, UnreachableError)
    check_place(SCORBOT, curve, error)
    assert "here it leaves what the arm reaches with that pitch; at 100 %, too far by" in str(error)
    # the wrist 444 mm from the shoulder, both links stretched
    assert error.before is not None
    assert abs(math.remainder(error.before(error.place.s)[2], math.pi)) < 0.02


def test_the_cylinder_about_the_base_axis() -> None:
    q = UZUNER.inverse([0.1, 0.05, 0.42]).best("least-rotation")
    start = UZUNER.forward(q)[:3, 3]
    with pytest.raises(
        ToolPathUnreachableError, match=r"inside the 3\.62 mm cylinder about the base axis"
    ) as info:
        tool_line(UZUNER, q, [-start[0], -start[1], start[2]], "free")
    place = info.value.place
    assert math.hypot(*place.point[:2]) == pytest.approx(3.62e-3, abs=1e-5)


def test_a_start_in_a_singularity() -> None:
    q = UZUNER.pose("zero")
    with pytest.raises(
        ToolPathRefusedError, match="stands in a singularity and cannot begin this line"
    ) as info:
        tool_line(UZUNER, q, UZUNER.forward(q)[:3, 3] - [0.05, 0.0, 0.0], "free")
    assert info.value.place.fraction == 0.0 and info.value.before is None


def test_a_start_on_a_limit_may_go_in_but_not_out() -> None:
    q = np.radians([0.0, 60.0, 95.07, -60.0, 0.0])
    tool = UZUNER.forward(q)[:3, 3]
    outcomes = []
    for way in (0.02, -0.02):
        try:
            tool_line(UZUNER, q, tool + np.array([way, 0.0, 0.0]))
            outcomes.append("goes")
        except ToolPathRefusedError as error:
            assert error.place.fraction < 1e-4 and error.place.joint == 2 and error.before is None
            outcomes.append("refused")
    assert sorted(outcomes) == ["goes", "refused"]


def test_another_branch_is_offered_where_one_follows_the_whole_curve() -> None:
    points, pitch = arc(), math.radians(-80.0)
    solutions = UZUNER.inverse(points[0], pitch)
    q = solutions.q[list(map(str, solutions.branch)).index("back elbow-up")]
    with pytest.raises(ToolPathRefusedError, match="Base would need") as info:
        tool_arc(UZUNER, q, points[29], points[-1])
    assert "start on another branch (front elbow-up follows the whole arc) or move the arc" in str(info.value)
    other = solutions.q[list(map(str, solutions.branch)).index("front elbow-up")]
    assert strays(UZUNER, tool_arc(UZUNER, other, points[29], points[-1]))[0] < 1e-5
