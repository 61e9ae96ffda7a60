"""Planned motions: of the joints, to a target, along a line or an arc, through points."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from armctl import load_robot
from armctl.errors import ArmctlError, InputError, MotionRefusedError, UnreachableError
from armctl.kinematics import Target
from armctl.motion import (
    PROFILES,
    JoinedTrajectory,
    PiecewisePolynomial,
    PointToPoint,
    ProfileName,
    SlowedTrajectory,
    ToolPathRefusedError,
    Trajectory,
    arc,
    line,
    plan_arc,
    plan_choice,
    plan_joints,
    plan_line,
    plan_spline,
    plan_target,
    preflight,
    solve,
)
from armctl.motion.plan import plan_blended, plan_through
from armctl.motion.profiles import shortest_words
from armctl.motion.timing import PathTrajectory
from armctl.motion.trajectory import peaks_of
from armctl.program import MoveStep, PointStep, open_program

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")
ARC, LINE = arc(), line()
TICK = 0.02
LONG = bool(os.environ.get("ARMCTL_LONG"))


def at(point: np.ndarray) -> np.ndarray:
    return ROBOT.inverse(point).best("least-rotation")


def tool_at_ticks(motion: Trajectory) -> np.ndarray:
    """(k, 3) [mm] at every tick of a 50 Hz run."""
    ticks = np.append(np.arange(0.0, motion.duration, TICK), motion.duration)
    return 1000 * ROBOT.forward(motion.sample(ticks).q)[:, :3, 3]


@pytest.mark.parametrize("profile", PROFILES)
def test_the_published_arc_is_an_arc_at_every_tick(profile: ProfileName) -> None:
    motion = plan_arc(ROBOT, at(ARC[0]), ARC[28], ARC[-1], profile=profile)
    tool = tool_at_ticks(motion)
    assert np.abs(np.hypot(tool[:, 0], tool[:, 1]) - 200).max() < 0.05
    assert np.abs(tool[:, 2] - 85).max() < 0.05
    np.testing.assert_allclose(tool[[0, -1]], 1000 * ARC[[0, -1]], atol=1e-3)
    assert not [f for f in preflight(ROBOT, motion) if f.severity == "error"]


@pytest.mark.parametrize("profile", PROFILES)
def test_the_tool_is_never_faster_than_asked_for(profile: ProfileName) -> None:
    motion = plan_arc(ROBOT, at(ARC[0]), ARC[28], ARC[-1], speed=0.08, profile=profile)
    steps = np.linalg.norm(np.diff(tool_at_ticks(motion)[:-1], axis=0), axis=1) / TICK
    assert steps.max() <= 80 * (1 + 1e-6)
    if profile == "trapezoid":
        assert np.median(steps) == pytest.approx(80, rel=1e-3)


def test_a_duration_is_kept_and_one_too_short_is_refused_with_the_shortest() -> None:
    start = at(ARC[0])
    shortest = plan_arc(ROBOT, start, ARC[28], ARC[-1]).duration
    assert plan_arc(ROBOT, start, ARC[28], ARC[-1], duration_s=9.5).duration == pytest.approx(9.5)
    with pytest.raises(MotionRefusedError, match=re.escape(shortest_words(shortest, exact=False))):
        plan_arc(ROBOT, start, ARC[28], ARC[-1], duration_s=0.9 * shortest)
    with pytest.raises(InputError, match="leave it open"):
        plan_arc(ROBOT, start, ARC[28], ARC[-1], duration_s=-1.0)
    with pytest.raises(InputError, match="finite number, got nan"):
        plan_arc(ROBOT, start, ARC[28], ARC[-1], duration_s=float("nan"))


def test_what_cannot_be_followed_says_when_where_and_which_joint() -> None:
    start = at(LINE[0])
    with pytest.raises(ToolPathRefusedError) as refused:
        plan_line(ROBOT, start, LINE[-1], pitch="kept", speed=0.1)
    found = re.match(
        r"at ([\d.]+) s, (\d+) % of the line \(x 220.0, y (-?[\d.]+), z 85.0 mm\): Elbow is at its "
        r"limit of -84.36°; at 50 % Elbow would need (-?[\d.]+)°, its limits are -84.36° … 95.07°; ",
        str(refused.value),
    )
    assert found is not None, str(refused.value)
    seconds, percent, y, _ = (float(text) for text in found.groups())
    place = refused.value.place
    assert place.fraction == pytest.approx(percent / 100, abs=0.005)
    assert y == pytest.approx(1000 * place.point[1], abs=0.05)
    # the tool cannot be there earlier than at the speed asked for
    assert seconds >= place.s / 0.1
    # it is where a finer look finds the limit passed: the same line ends well just before
    before = LINE[0] + (place.fraction - 1e-3) * (LINE[-1] - LINE[0])
    plan_line(ROBOT, start, before, pitch="kept")
    with pytest.raises(MotionRefusedError, match="Elbow"):
        plan_line(ROBOT, start, LINE[0] + (place.fraction + 1e-3) * (LINE[-1] - LINE[0]), pitch="kept")


def test_out_of_reach_is_said_with_the_time() -> None:
    with pytest.raises((UnreachableError, MotionRefusedError), match=r"^at [\d.]+ s, \d+ % of the line"):
        plan_line(ROBOT, at(ARC[28]), [0.5, 0.0, 0.085], pitch="free")


def test_a_line_to_where_the_tool_is_takes_no_time() -> None:
    start = at(ARC[0])
    motion = plan_line(ROBOT, start, ROBOT.forward(start)[:3, 3])
    assert motion.duration == 0 == plan_spline(ROBOT, [HOME, HOME]).duration
    np.testing.assert_array_equal(motion.sample(0.0).q, start)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_spline_meets_its_points_without_a_stop(profile: ProfileName) -> None:
    points = ROBOT.least_rotation(ARC)
    motion = plan_spline(ROBOT, points, profile=profile)
    q = motion.sample(np.linspace(0.0, motion.duration, 20_001))
    nearest = np.abs(q.q[:, None] - points[::6]).max(axis=2).min(axis=0)
    assert nearest.max() < 1e-3
    moving = np.abs(q.velocity[200:-200]).max(axis=1)
    assert moving.min() > 1e-3  # a hundredth of the duration after the start, a quintic has hardly begun
    assert not [f for f in preflight(ROBOT, motion) if f.severity == "error"]


@pytest.mark.parametrize(
    ("points", "text"),
    [
        (np.zeros((3, 4)), r"needs configurations \(k, 5\)"),
        (np.zeros((0, 5)), "needs configurations"),
        ([[0.0] * 5, [np.nan] * 5], "finite"),
    ],
)
def test_what_gives_no_spline_is_refused(points: object, text: str) -> None:
    with pytest.raises(ArmctlError, match=text):
        plan_spline(ROBOT, points)  # pyright: ignore[reportArgumentType]


def test_planned_is_cubic_and_normal_is_each_joint_for_itself() -> None:
    end = ROBOT.pose("rest")
    assert isinstance(plan_joints(ROBOT, HOME, end), PointToPoint)
    normal, cubic = plan_joints(ROBOT, HOME, end, profile="normal"), plan_joints(ROBOT, HOME, end)
    middle = 0.5 * cubic.duration
    assert np.abs(normal.sample(middle).q - cubic.sample(middle).q).max() > 0.01
    timed = plan_joints(ROBOT, HOME, end, 5.0, profile="normal")
    assert isinstance(timed, PointToPoint)
    assert timed.duration == 5.0


def test_a_target_is_met() -> None:
    point = np.array([0.2, 0.05, 0.085])
    trajectory = plan_target(ROBOT, HOME, Target.of(point))
    np.testing.assert_allclose(ROBOT.forward(trajectory.end)[:3, 3], point, atol=1e-9)
    assert np.array_equal(trajectory.start, HOME)


def test_what_cannot_be_is_refused_in_words() -> None:
    with pytest.raises(UnreachableError, match="the nearest reachable point is"):
        plan_target(ROBOT, HOME, Target.of([0.6, 0.0, 0.1]))
    with pytest.raises(InputError, match="criterion 'cheapest'"):
        plan_target(ROBOT, HOME, Target.of([0.2, 0.0, 0.1]), "cheapest")
    for plan in (
        partial(plan_line, ROBOT, HOME, [0.2, 0.0, 0.1]),
        partial(plan_line, ROBOT, HOME, [9, 9, 9]),
    ):
        with pytest.raises(InputError, match="the speed of the tool must be numbers, got 'a'"):
            plan(speed="a")
    with pytest.raises(MotionRefusedError, match="Base: 170"):
        plan_joints(ROBOT, HOME, np.radians([170, 90, 0, 0, 0]))


def test_steps_are_in_degrees_and_millimetres() -> None:
    move = MoveStep(joints_deg=(10, 80, -70, -30, 5), duration_s=4).plan(ROBOT, HOME)
    np.testing.assert_allclose(np.degrees(move.end), [10, 80, -70, -30, 5])
    assert move.duration == 4
    point = PointStep(x_mm=250, y_mm=-50, z_mm=85, pitch_deg=-45, roll_deg=5).plan(ROBOT, HOME)
    tool = ROBOT.forward(point.end)
    np.testing.assert_allclose(1000 * tool[:3, 3], [250, -50, 85], atol=1e-6)
    assert np.degrees(np.arcsin(tool[2, 2])) == pytest.approx(-45)


JUNK = ["a", None, float("nan"), float("inf"), -1.0, [1, 2], {}, object(), True, 1j, np.zeros((1, 1)), b"x"]
CALLS: dict[str, Callable[[Any], object]] = {
    "the speed of a line": lambda x: plan_line(ROBOT, HOME, [0.2, 0.05, 0.15], pitch="free", speed=x),
    "the end of a line": lambda x: plan_line(ROBOT, HOME, x),
    "the start of a line": lambda x: plan_line(ROBOT, x, [0.2, 0.05, 0.15]),
    "the duration of a line": lambda x: plan_line(ROBOT, HOME, [0.2, 0.0, 0.15], pitch="free", duration_s=x),
    "the pitch of a line": lambda x: plan_line(ROBOT, HOME, [0.2, 0.05, 0.15], pitch=x),
    "the profile of a line": lambda x: plan_line(ROBOT, HOME, [0.2, 0.05, 0.15], pitch="free", profile=x),
    "the via of an arc": lambda x: plan_arc(ROBOT, HOME, x, [0.2, 0.05, 0.15]),
    "the end of a motion": lambda x: plan_joints(ROBOT, HOME, x),
    "the duration of a motion": lambda x: plan_joints(ROBOT, HOME, ROBOT.pose("rest"), x),
    "the profile of a motion": lambda x: plan_joints(ROBOT, HOME, ROBOT.pose("rest"), None, x),
    "a target": lambda x: plan_target(ROBOT, HOME, x),
    "a criterion": lambda x: plan_target(ROBOT, HOME, Target.of([0.2, 0.0, 0.1]), x),
    "the points of a spline": lambda x: plan_spline(ROBOT, x),
    "a payload": lambda x: preflight(ROBOT, PointToPoint.plan(ROBOT, HOME, ROBOT.pose("rest")), x),
    "a trajectory": lambda x: preflight(ROBOT, x),
    "parts": JoinedTrajectory,
    "a factor": lambda x: SlowedTrajectory(PointToPoint.plan(ROBOT, HOME, ROBOT.pose("rest")), x),
    "a polynomial": lambda x: PiecewisePolynomial(x, x),
    "a robot": load_robot,
    "a pose": ROBOT.pose,
    "a named point": ROBOT.point,
    "a tool point": ROBOT.inverse,
    "a rotation": lambda x: ROBOT.inverse([0.2, 0.0, 0.1], rotation=x),
    "a step": lambda x: ROBOT.inverse([0.2, 0.0, 0.1], step=x),
    "a program": open_program,
}


@pytest.mark.parametrize("what", CALLS)
def test_junk_is_refused_in_words(what: str) -> None:
    """Or taken, where it is what is asked for, such as no payload; nothing of numpy or Python comes out."""
    refused = 0
    for junk in JUNK:
        try:
            CALLS[what](junk)
        except ArmctlError as error:
            assert "\n" not in str(error) and len(str(error)) > 10
            refused += 1
    assert refused >= len(JUNK) - 4


def test_what_is_ragged_equal_or_no_time_is_refused_in_words_or_stands() -> None:
    ragged: Any = [[1.0, 2.0], 3.0]
    calls: list[Callable[[], object]] = [
        lambda: plan_line(ROBOT, HOME, ragged),
        lambda: plan_arc(ROBOT, HOME, ragged, [0.2, 0.0, 0.1]),
        lambda: plan_spline(ROBOT, ragged),
        lambda: plan_through(ROBOT, ragged),
        lambda: plan_blended(ROBOT, ragged, 0.01),
        lambda: plan_blended(ROBOT, [HOME, HOME], "a"),  # pyright: ignore[reportArgumentType]
    ]
    for call in calls:
        with pytest.raises(InputError):
            call()
    for motion in (
        plan_through(ROBOT, [HOME, HOME, HOME], 3.0),
        plan_through(ROBOT, [HOME], 3.0),
        plan_blended(ROBOT, [HOME, HOME], 0.01, 3.0),
    ):
        assert motion.duration == pytest.approx(3.0)
        np.testing.assert_array_equal(motion.sample(np.linspace(0.0, 3.0, 7)).q, np.tile(HOME, (7, 1)))
    there = HOME + np.radians(20)
    for motion in (
        plan_joints(ROBOT, HOME, there),
        plan_through(ROBOT, [HOME, there]),
        SlowedTrajectory(plan_spline(ROBOT, [HOME, there, HOME]), 2.0),
    ):
        for time in ("a", [0.0, [1.0]], float("nan")):
            with pytest.raises(InputError, match="the times of a trajectory must be numbers"):
                motion.sample(time)  # pyright: ignore[reportArgumentType]


def test_nearly_equal_points_of_a_spline_are_one() -> None:
    rng = np.random.default_rng(8)
    points = ROBOT.limits.mean(axis=1) + rng.uniform(-0.1, 0.1, (6, ROBOT.n))
    plain = plan_spline(ROBOT, points, checked=False).duration
    for apart in (1e-11, 1e-9, 1e-7):
        doubled = np.repeat(points, 3, axis=0)
        doubled += apart * rng.uniform(-1, 1, doubled.shape)
        for profile in ("trapezoid", "s-curve"):
            motion = plan_spline(ROBOT, doubled, profile=profile, checked=False)
            assert motion.duration < 3 * plain
            np.testing.assert_allclose(motion.sample(motion.duration).q, doubled[-1], rtol=0, atol=1e-12)
            assert profile == "trapezoid" or peaks_of(motion).jerk is not None
    assert plan_spline(ROBOT, [HOME, HOME + 1e-8]).end == pytest.approx(HOME + 1e-8, abs=1e-15)


def test_a_jump_of_the_speed_between_two_parts_is_refused() -> None:
    there = HOME + 0.2
    away, home = plan_joints(ROBOT, HOME, there), plan_joints(ROBOT, there, HOME)
    assert not [f for f in preflight(ROBOT, JoinedTrajectory([away, home])) if f.severity == "error"]
    at_speed = PathTrajectory(
        PiecewisePolynomial([0.0, 1.0], np.stack([HOME, there - HOME])[None]),
        PiecewisePolynomial([0.0, 2.0], [[[0.0], [0.5]]]),
    )
    (found,) = [
        f for f in preflight(ROBOT, JoinedTrajectory([at_speed, home]), at_rest=False) if f.time == 2.0
    ]
    assert (found.kind, found.severity) == ("acceleration", "error")
    assert "its speed jumps by 5.73 °/s between two parts" in found.what


def test_a_refused_line_of_an_arm_without_a_pitch_is_refused_in_words() -> None:
    arm = load_robot("mearm")
    start = arm.pose("home")
    tool = arm.forward(start)[:3, 3]
    with pytest.raises((MotionRefusedError, UnreachableError)):
        plan_line(arm, start, 3 * tool, orientation="kept")


def test_the_arm_goes_to_the_best_solution_to_which_it_may_go() -> None:
    rng, others = np.random.default_rng(3), 0
    for name, count, few in (("ur5", 74, [24, 57, 67]), ("so101", 34, [0, 1, 2])):
        robot = load_robot(name)
        start = robot.pose("home")
        goals = rng.uniform(*np.clip(robot.limits, -np.pi, np.pi).T, (count, robot.n))
        for q in goals if LONG else goals[few]:
            try:
                plan_joints(robot, start, q)
            except MotionRefusedError:
                continue
            # it can be reached, and gone to
            T = robot.forward(q)
            target = Target.of(T) if robot.orients_tool else Target.of(T[:3, 3])
            trajectory, refusal = plan_choice(robot, start, target)
            np.testing.assert_allclose(robot.forward(trajectory.end)[:3, 3], T[:3, 3], atol=1e-7)
            plan_joints(robot, start, trajectory.end)  # raises where the arm may not go there
            best = solve(robot, start, target, "least-rotation")
            if refusal is None:
                np.testing.assert_allclose(trajectory.end, best, atol=1e-12)
            else:
                with pytest.raises(MotionRefusedError, match=re.escape(str(refusal))):
                    plan_joints(robot, start, best)
                others += 1
    assert others >= 3


def test_where_every_solution_is_refused_the_best_one_says_why() -> None:
    robot = load_robot("ur5")
    T = robot.forward(np.array([0.3, -1.2, 1.2, -1.0, -1.0, 0.3]))
    with pytest.raises(MotionRefusedError, match="shortest possible duration"):
        plan_target(robot, robot.pose("home"), Target.of(T), duration_s=0.001)
