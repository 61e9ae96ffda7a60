"""The tool's whole orientation along lines and arcs, measured by plain products of 4 x 4 matrices."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation, Slerp
from tests.kinematics.kit import plain_forward, plain_jacobian, random_q
from tests.kinematics.test_numeric import PANDA, UR5
from tests.motion.paths.tool_kit import ABAAS, MICO, SCORBOT, UZUNER, FloatArray, robot_of
from tests.robot.panda_kit import panda
from tests.sticks import of_sticks

from armctl.errors import InputError, MotionRefusedError, UnreachableError
from armctl.kinematics import Chain, rotation_from_rpy
from armctl.motion import ToolPathRefusedError, ToolPathUnreachableError, plan_arc, plan_line
from armctl.motion.paths.tool_curve import ToolArc, ToolCurve, ToolLine
from armctl.motion.paths.tool_orientation import ToolRotation
from armctl.motion.paths.tool_path import TurnMode, follow
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot, load_robot

LINES = 200 if os.environ.get("ARMCTL_LONG") else 8
HELD, NEAR_M = 1e-6, 0.011e-3
SIX, SEVEN = robot_of(*UR5), robot_of(*PANDA)
FIVE = replace(SCORBOT, name="five")
TURNING = {"ur5": SIX, "panda": SEVEN}


def measured(robot: Robot, curve: ToolCurve, path: PiecewisePolynomial, wanted: Rotation | Slerp) -> None:
    """The tool is on the curve, turned as asked for, and no joint leaves its limits."""
    assert (path.low, path.high) == (0.0, curve.length)
    s = np.linspace(0.0, curve.length, 161)
    poses = np.array([plain_forward(robot.chain, q) for q in path(s)])
    assert np.linalg.norm(poses[:, :3, 3] - curve.positions(s), axis=1).max() <= NEAR_M
    asked = wanted(s / curve.length) if isinstance(wanted, Slerp) else wanted
    assert (Rotation.from_matrix(poses[:, :3, :3]) * asked.inv()).magnitude().max() <= HELD
    low, high = path.extremes()
    assert (low >= robot.limits[:, 0] - 1e-8).all() and (high <= robot.limits[:, 1] + 1e-8).all()


def bent(rng: np.random.Generator, robot: Robot) -> FloatArray:
    """A start well inside the limits, no turn beyond a half: most are no singular ones."""
    low, high = np.clip(robot.limits, -math.pi, math.pi).T
    return 0.5 * (low + high) + 0.3 * (high - low) * rng.uniform(-1, 1, robot.n)


def placed(curve: ToolCurve, error: Exception) -> None:
    """A refusal knows where: share of the way and point, in the words, too."""
    assert isinstance(error, ToolPathRefusedError | ToolPathUnreachableError)
    assert 0.0 <= error.place.fraction <= 1.0
    np.testing.assert_allclose(error.place.point, curve.positions(error.place.s), atol=1e-12)
    x, y, z = 1000.0 * error.place.point
    where = f"{100 * error.place.fraction:.0f} % of the {curve.kind} (x {x:.1f}, y {y:.1f}, z {z:.1f} mm): "
    assert where in str(error)


def turned(robot: Robot, q: FloatArray) -> Rotation:
    return Rotation.from_matrix(plain_forward(robot.chain, q)[:3, :3])


@pytest.mark.parametrize("robot", [SIX, SEVEN], ids=lambda robot: str(robot.n))
def test_rows_are_derivatives(robot: Robot) -> None:
    rng, h = np.random.default_rng(4), 1e-6
    rows = ToolRotation(rotation_from_rpy(0.3, -0.5, 1.1), np.array([0.4, -0.9, 0.7]))
    for q in (random_q(rng, robot.limits) for _ in range(10)):
        rates, s = rng.uniform(-1, 1, robot.n), 0.3
        pose, J = robot.forward(q), robot.jacobian(q)
        ahead, behind = (Rotation.from_matrix(robot.forward(q + way * h * rates)[:3, :3]) for way in (1, -1))
        spin = (ahead * behind.inv()).as_rotvec() / (2 * h)
        np.testing.assert_allclose(rows.rows(pose, J) @ rates, spin, atol=1e-8)
        slopes = [rows.rows(pose, robot.jacobian(q + way * h * rates)) for way in (1.0, -1.0)]
        np.testing.assert_allclose(rows.turned(pose, J, rates), (slopes[0] - slopes[1]) / (2 * h), atol=1e-8)
        off = Rotation.from_matrix(rows.at(s)) * Rotation.from_matrix(pose[:3, :3]).inv()
        missing = off.as_rotvec() * np.sinc(off.magnitude() / np.pi)
        np.testing.assert_allclose(rows.missing(q, pose, s), missing, atol=1e-12)
    spin = Rotation.from_matrix(rows.at(0.3 + h)) * Rotation.from_matrix(rows.at(0.3 - h)).inv()
    np.testing.assert_allclose(rows.rates(0.3), [spin.as_rotvec() / (2 * h), np.zeros(3)], atol=1e-8)


@pytest.mark.parametrize("mode", ["kept", "interpolated"])
@pytest.mark.parametrize("name", TURNING)
def test_random_lines_keep_the_orientation_or_say_where_they_cannot(name: str, mode: TurnMode) -> None:
    robot, rng, done = TURNING[name], np.random.default_rng(7), 0
    for _ in range(LINES):
        q = bent(rng, robot)
        there = np.clip(q + rng.uniform(-0.5, 0.5, robot.n), *robot.limits.T)
        start, end = plain_forward(robot.chain, q), plain_forward(robot.chain, there)
        curve = ToolLine(start[:3, 3], end[:3, 3])
        rotation = end[:3, :3] if mode == "interpolated" else None
        ends = Rotation.from_matrix([start[:3, :3], end[:3, :3]])
        try:
            path = follow(robot, q, curve, orientation=mode, end_rotation=rotation)
        except (MotionRefusedError, UnreachableError) as error:
            placed(curve, error)
            continue
        assert path is not None
        measured(robot, curve, path, ends[0] if rotation is None else Slerp([0.0, 1.0], ends))
        done += 1
    assert done >= 0.5 * LINES


@pytest.mark.parametrize("name", TURNING)
def test_an_arc_keeps_it_too_and_nothing_said_means_kept(name: str) -> None:
    robot, rng, done = TURNING[name], np.random.default_rng(3), 0
    for _ in range(5):
        q = bent(rng, robot)
        tool = plain_forward(robot.chain, q)[:3, 3]
        curve = ToolArc(tool, tool + np.array([0.03, 0.02, 0.01]), tool + np.array([0.05, -0.02, 0.03]))
        try:
            path = follow(robot, q, curve)
        except (MotionRefusedError, UnreachableError) as error:
            placed(curve, error)
            continue
        assert path is not None
        measured(robot, curve, path, turned(robot, q))
        done += 1
    assert done >= 3


def test_the_seventh_joint_moves_as_little_as_serves() -> None:
    speeds = np.array([1.0, 2.0, 3.0, 1.5, 2.5, 0.5, 4.0])
    joints = tuple(replace(joint, speed=v) for joint, v in zip(SEVEN.joints, speeds.tolist(), strict=True))
    robot = replace(SEVEN, joints=joints)
    q = np.array([0.2, 0.3, -0.4, -1.6, 0.5, 1.9, 0.3])
    curve = ToolLine(robot.forward(q)[:3, 3], robot.forward(q)[:3, 3] + [0.02, -0.05, 0.04])
    path = follow(robot, q, curve, orientation="kept")
    assert path is not None
    for s in np.linspace(0.0, curve.length, 7):
        value, slope = path.derivatives(s, 1)
        J = plain_jacobian(robot.chain, value)
        twist = np.append(curve.derivatives(s)[1], np.zeros(3))
        least = speeds * (np.linalg.pinv(J * speeds) @ twist)
        np.testing.assert_allclose(slope, least, atol=2e-3 * np.abs(least).max())


@pytest.mark.parametrize(
    ("q", "end"),
    [
        ((2.53, 1.06, -0.13, -1.5, -0.6, 1.24, -2.66), (-0.29, 0.49, 0.37)),
        ((-2.06, -0.12, -2.61, -0.66, 1.27, 2.52, 1.51), (0.15, 0.3, 1.05)),
    ],
)
def test_the_seventh_joint_leads_around_limits_that_the_least_motion_runs_into(
    q: tuple[float, ...], end: tuple[float, ...]
) -> None:
    start, wide = np.array(q), np.array([[-20.0, 20.0]] * 7)
    curve = ToolLine(SEVEN.forward(start)[:3, 3], end)
    least = follow(robot_of(SEVEN.chain, wide), start, curve, orientation="kept")
    assert least is not None
    low, high = least.extremes()
    assert (low < SEVEN.limits[:, 0]).any() or (high > SEVEN.limits[:, 1]).any()
    path = follow(SEVEN, start, curve, orientation="kept")
    assert path is not None
    measured(SEVEN, curve, path, turned(SEVEN, start))


# Five joints: yaw, three pitch joints, roll.


def slowest_turn(robot: Robot, q: FloatArray, way: FloatArray) -> float:
    """The least rate at which the tool turns while its point moves along a unit vector (3,) [rad/m]."""
    J = plain_jacobian(robot.chain, q)
    weight = 1e6  # the point counts far more than the turn
    found = lsq_linear(np.vstack([weight * J[:3], J[3:]]), np.append(weight * way, np.zeros(3)), tol=1e-14)
    return float(np.linalg.norm(J[3:] @ found.x))


@pytest.mark.parametrize("robot", [FIVE, UZUNER, ABAAS], ids=lambda robot: robot.name)
def test_five_joints_keep_it_in_their_own_vertical_plane(robot: Robot) -> None:
    rng, done = np.random.default_rng(5), 0
    for _ in range(30):
        q = random_q(rng, 0.7 * robot.limits)
        there = np.clip(q + np.append(0.0, rng.uniform(-0.3, 0.3, robot.n - 1)), *robot.limits.T)
        curve = ToolLine(robot.forward(q)[:3, 3], robot.forward(there)[:3, 3])
        try:
            path = follow(robot, q, curve, orientation="kept")
        except (MotionRefusedError, UnreachableError) as error:
            placed(curve, error)
            assert "joints cannot keep" not in str(error)
            continue
        assert path is not None
        measured(robot, curve, path, turned(robot, q))
        done += 1
    assert done >= 6


@pytest.mark.parametrize("pitch_deg", [-90.0, 90.0])
def test_five_joints_keep_it_with_the_tool_upright_by_turning_the_roll_against_the_base(
    pitch_deg: float,
) -> None:
    points = {-90.0: ([0.3, -0.05, 0.1], [0.32, 0.12, 0.15]), 90.0: ([0.33, -0.1, 0.51], [0.35, 0.1, 0.53])}
    start, end = map(np.array, points[pitch_deg])
    q = FIVE.inverse(start, math.radians(pitch_deg), 0.2).best("least-rotation")
    curve = ToolLine(FIVE.forward(q)[:3, 3], end)
    path = follow(FIVE, q, curve, orientation="kept")
    assert path is not None
    measured(FIVE, curve, path, turned(FIVE, q))
    turns = path(curve.length) - q
    assert abs(turns[0]) > 0.4 and abs(turns[4]) == pytest.approx(abs(turns[0]), abs=1e-6)


@pytest.mark.parametrize("robot", [FIVE, UZUNER, MICO], ids=lambda robot: robot.name)
def test_too_few_joints_refuse_with_where_and_how_fast_the_tool_would_turn(robot: Robot) -> None:
    rng = np.random.default_rng(6)
    for _ in range(10):
        q = random_q(rng, 0.6 * robot.limits)
        tool = robot.forward(q)[:3, 3]
        curve = ToolLine(tool, tool + rng.uniform(-0.05, 0.05, 3))
        with pytest.raises(ToolPathRefusedError, match="joints cannot keep the tool's orientation") as info:
            follow(robot, q, curve, orientation="kept")
        placed(curve, info.value)
        assert info.value.place.fraction == 0.0 and info.value.before is None
        rate = math.degrees(slowest_turn(robot, q, curve.direction)) / 1000
        assert f"here, it would also turn by {rate:.3g}° a mm" in str(info.value)


def test_a_way_that_leaves_the_plane_is_refused_where_it_leaves_it() -> None:
    q = FIVE.inverse([0.3, 0.0, 0.3], math.radians(-30.0), 0.1).best("least-rotation")
    tool = FIVE.forward(q)[:3, 3]
    outward = tool * [1.0, 1.0, 0.0] / np.hypot(*tool[:2])
    left = np.array([-outward[1], outward[0], 0.0])
    # begins outward in the plane, and bends to the left
    curve = ToolArc(tool, *(tool + 0.1 * (np.sin(a) * outward + (1 - np.cos(a)) * left) for a in (0.5, 1.0)))
    with pytest.raises(ToolPathRefusedError, match="cannot keep the tool's orientation") as info:
        follow(FIVE, q, curve, orientation="kept")
    placed(curve, info.value)
    assert info.value.place.fraction < 0.01


# What is asked for.


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ({"orientation": "level"}, "tool orientation 'level': allowed are 'kept', 'interpolated', 'free'"),
        ({"orientation": "interpolated"}, "orientation 'interpolated' needs the rotation at the end"),
        ({"orientation": "kept", "end_rotation": np.eye(3)}, "does not go with orientation 'kept'"),
        ({"end_rotation": np.eye(3)}, "does not go with orientation 'kept'"),
        ({"end_pitch": 0.1}, "does not go with pitch 'kept'"),
        ({"orientation": "kept", "pitch": "free"}, "the pitch of the tool on its way, or its orientation"),
        ({"orientation": "interpolated", "end_rotation": 2 * np.eye(3)}, "orthonormal"),
        ({"orientation": "interpolated", "end_rotation": "up"}, "must be numbers"),
    ],
)
def test_contradictory_wishes(wish: dict[str, object], said: str) -> None:
    q = np.array([0.1, -1.2, 1.3, -0.4, 0.6, 0.2])
    with pytest.raises(InputError, match=said):
        plan_line(SIX, q, SIX.forward(q)[:3, 3] + [0.0, 0.02, 0.0], **wish)  # type: ignore[arg-type]


def test_a_turn_on_the_spot_is_no_line() -> None:
    q = np.array([0.1, -1.2, 1.3, -0.4, 0.6, 0.2])
    pose = SIX.forward(q)
    still = ToolLine(pose[:3, 3], pose[:3, 3])
    assert follow(SIX, q, still, orientation="interpolated", end_rotation=pose[:3, :3]) is None
    with pytest.raises(InputError, match="no way to turn the tool on; go to a point with that orientation"):
        follow(SIX, q, still, orientation="interpolated", end_rotation=np.eye(3))


def test_a_planned_motion_ends_where_it_was_sent() -> None:
    q = np.array([0.1, -1.2, 1.3, -0.4, 0.6, 0.2])
    pose, six = SIX.forward(q), of_sticks(replace(SIX, poses={"home": q, "rest": q}))
    end = rotation_from_rpy(0.2, 0.1, -0.4) @ pose[:3, :3]
    for motion in (
        plan_line(six, q, pose[:3, 3] + [0.05, 0.05, 0.1], orientation="interpolated", end_rotation=end),
        plan_arc(
            six, q, pose[:3, 3] + [0.02, 0.05, 0.05], pose[:3, 3] + [0.05, 0.05, 0.1],
            orientation="interpolated", end_rotation=end,
        ),
    ):  # fmt: skip
        there = plain_forward(SIX.chain, motion.end)
        np.testing.assert_allclose(there[:3, 3], pose[:3, 3] + [0.05, 0.05, 0.1], atol=1e-9)
        assert (Rotation.from_matrix(there[:3, :3]) * Rotation.from_matrix(end).inv()).magnitude() < HELD


def test_a_refusal_says_what_would_do() -> None:
    q = FIVE.pose("home")
    tool = FIVE.forward(q)[:3, 3]
    end = tool + np.array([0.0, 0.08, 0.0])
    with pytest.raises(ToolPathRefusedError, match=r"; with only the tool pitch kept the arm can follow it$"):
        plan_line(FIVE, q, end, orientation="kept")
    plan_line(FIVE, q, end, pitch="kept")


def test_a_refusal_says_only_what_is_known_of_an_orientation_and_of_a_rate() -> None:
    robot = load_robot("ur5")
    q = np.radians([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
    with pytest.raises(
        ToolPathUnreachableError, match=r"leaves what the arm reaches with that rotation"
    ) as at:
        plan_line(robot, q, [0.1, 0.1, 0.85])
    assert str(at.value).endswith("; with the tool orientation free the arm can follow it")
    # the wrist comes within 0.005° of straight, but goes on: joint 4 turns fast, not without bound
    robot = load_robot("ar4")
    q = [-1.932244819567, 0.384791396963, -0.62730764786, 0.773421097269, -0.005645924568, -2.909368022154]
    with pytest.raises(ToolPathRefusedError, match=r"Joint 4 would have to turn by \d\d+° a mm") as refused:
        plan_line(robot, q, [-0.452877483296, -0.182400395745, 0.724544229990])
    said = re.search(r"turn by (\d+)°", str(refused.value))
    path = refused.value.before
    assert said is not None and path is not None
    _, slope = path.derivatives(path.high, 1)
    assert abs(float(np.degrees(np.abs(slope)).max()) / 1000 - int(said[1])) <= 0.5


_MOST_POSES = 2500
"""forward kinematics and Jacobians, those of one array as one; a plan takes some 200"""


@pytest.mark.parametrize("name", ["ur5", "ar4", "seven"])
def test_a_refusal_and_its_explanation_take_little_work(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = panda() if name == "seven" else load_robot(name)
    counts: Counter[str] = Counter()

    def counted(name: str) -> None:
        function = getattr(Chain, name)

        def wrapper(*arguments: object) -> object:
            counts[name] += 1
            return function(*arguments)

        monkeypatch.setattr(Chain, name, wrapper)

    counted("forward")
    counted("jacobian")
    rng, refused = np.random.default_rng(7), 0
    while refused < 4:
        q, way = rng.uniform(*robot.limits.T), rng.normal(size=3)
        counts.clear()
        try:
            plan_line(robot, q, robot.forward(q)[:3, 3] + 0.4 * way / np.linalg.norm(way), orientation=None)
        except (ToolPathRefusedError, ToolPathUnreachableError):
            refused += 1
            assert counts.total() < _MOST_POSES, counts
        except MotionRefusedError:
            pass
