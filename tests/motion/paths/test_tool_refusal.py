"""What cannot be followed is refused before the arm moves, at the right place and in words."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.motion.paths.tool_kit import (
    MICO,
    SCORBOT,
    UZUNER,
    FloatArray,
    brute_force,
    random_robot,
    random_start,
    tool_arc,
    tool_line,
)

from armctl.errors import MotionRefusedError, UnreachableError
from armctl.motion.error_report import arc, line
from armctl.motion.paths.tool_curve import ToolArc, ToolCurve, ToolLine
from armctl.motion.paths.tool_path import (
    PathPlace,
    ToolPathRefusedError,
    ToolPathUnreachableError,
    follow,
)
from armctl.robot import Robot

FINE = 4001
Refusal = ToolPathRefusedError | ToolPathUnreachableError


def refused(robot: Robot, q: FloatArray, curve: ToolCurve) -> Refusal | None:
    try:
        follow(robot, q, curve, "kept")
    except (ToolPathRefusedError, ToolPathUnreachableError) as error:
        return error
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
    assert str(error).endswith("or move the line")


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
    place: PathPlace = info.value.place
    assert math.hypot(*place.point[:2]) == pytest.approx(3.62e-3, abs=1e-5)


def test_a_stretched_elbow_in_the_middle() -> None:
    q = MICO.pose("home")
    centre, reach = np.array([0.0, 0.0, 0.2755]), 0.29 + 0.1233 + 0.16
    tool = MICO.forward(q)[:3, 3]
    end = tool + 2.0 * (0.45 - tool[0]) * np.array([1.0, 0.0, 0.0]) + [0.0, 0.0, 0.25]
    curve = ToolLine(tool, end)
    shares = np.linspace(0.0, 1.0, 100_001)
    beyond = np.linalg.norm(curve.positions(shares * curve.length) - centre, axis=1) > reach
    assert beyond.any()
    with pytest.raises(ToolPathUnreachableError, match="too far by") as info:
        tool_line(MICO, q, end, "free")
    assert info.value.place.fraction == pytest.approx(shares[beyond.argmax()], abs=1e-4)


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


def test_another_branch_is_offered_where_one_can_be_there() -> None:
    points, pitch = arc(), math.radians(-80.0)
    solutions = UZUNER.inverse(points[0], pitch)
    q = solutions.q[list(map(str, solutions.branch)).index("back elbow-up")]
    with pytest.raises(ToolPathRefusedError, match="Base would need") as info:
        tool_arc(UZUNER, q, points[29], points[-1])
    assert "start on another branch (front elbow-up can be here) or move the arc" in str(info.value)
    there = UZUNER.inverse(info.value.place.point + np.array([1e-5, 0.0, 0.0]), pitch)
    assert "front elbow-up" in set(map(str, there.branch))
