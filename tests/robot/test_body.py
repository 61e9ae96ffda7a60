"""The body of an arm as capsules, pairs that are kept apart, distances of segments, length of an arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.arms import FIVE
from tests.motion.arm_kit import axis_points, brute_gap, random_arm
from tests.motion.sentence_kit import apart, tools
from tests.robot.test_urdf_tool import JAW, PROP
from tests.robot.urdf_kit import Step, written
from tests.sticks import FINGER, TIP_LENGTH, bars, of_sticks, tool_length

from armctl.arrays import FloatArray
from armctl.errors import MotionRefusedError, RobotFileError, UnreachableError
from armctl.kinematics.frames import LinkFrames
from armctl.motion import plan_line
from armctl.robot import Robot, load_robot, robots_folder, shipped_robots
from armctl.robot.body.arm_body import width
from armctl.robot.body.bodies import undersides
from armctl.robot.body.collision import NEAR_M
from armctl.robot.body.hulls import box_distance, segment_box_distance, segment_distance

ARMS = [*map(of_sticks, FIVE), *map(random_arm, range(4))]


def gaps(robot: Robot, q: FloatArray) -> FloatArray:
    return robot.collision.gaps(LinkFrames.at(robot.chain, np.atleast_2d(q)))


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: robot.name)
def test_gaps_are_those_of_points_on_the_axes(robot: Robot) -> None:
    rng = np.random.default_rng(5)
    model = robot.collision
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (12, robot.n))
    for gap, (i, j) in zip(gaps(robot, q), model.pairs, strict=True):
        one, other = model.capsules[i], model.capsules[j]
        assert other.link - one.link > 1
        for value, row in zip(gap, q, strict=True):
            brute = brute_gap(robot, one, other, row, 80)
            assert value <= brute + 1e-9
            if value < NEAR_M:  # beyond it is a lower bound only
                assert value == pytest.approx(brute, abs=0.01)


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: robot.name)
def test_no_point_moves_farther_than_its_lever_says(robot: Robot) -> None:
    rng = np.random.default_rng(6)
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (20, robot.n))
    for j in range(robot.n):
        step = np.zeros(robot.n)
        step[j] = 1e-4
        for capsule, lever in zip(robot.collision.capsules, robot.collision.levers, strict=True):
            for row in q:
                moved = axis_points(robot, capsule, row + step) - axis_points(robot, capsule, row)
                assert np.linalg.norm(moved, axis=1).max() <= lever[j] * 1e-4 * (1 + 1e-6) + 1e-12
        lifts = np.abs(heights(robot, q + step) - heights(robot, q)).max(axis=1)
        for corner, lift in zip(robot.undersides, lifts, strict=True):
            assert lift <= corner.levers[j] * 1e-4 * (1 + 1e-6) + 1e-12


def heights(robot: Robot, q: FloatArray) -> FloatArray:
    links = LinkFrames.at(robot.chain, q)
    return np.array([links.place(c.link, c.points)[2].min(axis=0) for c in robot.undersides])


@pytest.mark.parametrize("name", FIVE)
def test_named_poses_do_not_touch(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    for q in robot.poses.values():
        assert (gaps(robot, q) > 0.01).all()


@pytest.mark.parametrize(
    ("name", "q_deg", "parts"),
    [
        ("uzuner", (0, 20, -120, -80, 0), ("the link behind base", "the gripper")),  # beyond its limits
        ("scorbot", (0, 30, 130, -30, 0), ("the base", "the gripper")),
        ("mico", (0, 40, 50, 0), ("the base", "the link behind elbow")),
        ("abaas", (0, 180, 90, 180, 0), ("the base", "the link behind wrist pitch")),
    ],
)
def test_a_folded_arm_touches(name: str, q_deg: tuple[float, ...], parts: tuple[str, str]) -> None:
    robot = of_sticks(name)
    model = robot.collision
    touching = {
        (model.capsules[i].part, model.capsules[j].part)
        for (i, j), gap in zip(model.pairs, gaps(robot, np.radians(q_deg))[:, 0], strict=True)
        if gap < 0
    }
    assert parts in touching


def test_pairs_that_meet_in_a_joint_are_left_out_and_always_the_same_ones() -> None:
    one, other = of_sticks("scorbot").collision, of_sticks("scorbot").collision
    assert one.pairs == other.pairs
    links = {(one.capsules[i].link, one.capsules[j].link) for i, j in one.pairs}
    assert (-1, 1) not in links  # the upper arm turns in the head of the column
    assert (-1, 2) in links


def test_the_body_follows_the_look_and_the_gripper() -> None:
    robot = of_sticks("uzuner")
    thick = of_sticks(robot, replace(robot.look, width=2 * robot.look.width))
    slim, wide = robot.collision.capsules[0], thick.collision.capsules[0]
    assert wide.radius == pytest.approx(2 * slim.radius)
    tool = robot.forward(robot.pose("home"))[:3, 3]
    bare = of_sticks(replace(robot, gripper=None), robot.look)
    for arm in (robot, bare):
        last = arm.collision.capsules[-1]
        end = axis_points(arm, last, arm.pose("home"))[-1]
        assert np.linalg.norm(end - tool) == pytest.approx(last.radius)  # the round end is the tool point
    assert {c.part for c in bare.collision.capsules} >= {"the tool"}


def test_a_robot_file_may_give_its_own_capsules_and_obstacles(tmp_path: Path) -> None:
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.toml"
    mine.write_text(
        text
        + "\n[[capsules]]\nfrom_mm = [0, 0, 0]\nto_mm = [0, 0, 160]\nradius_mm = 30\n"
        + '\n[[capsules]]\njoint = "elbow"\nfrom_mm = [0, 0, 0]\nto_mm = [104, 0, 0]\nradius_mm = 12\n'
        + '\n[[obstacles]]\ntitle = "the table"\nfrom_mm = [400, 300, -20]\nto_mm = [150, -300, 0]\n',
        encoding="utf-8",
    )
    robot = load_robot(mine)
    base, elbow = robot.collision.capsules
    assert (base.part, base.link, base.radius) == ("the base", -1, pytest.approx(0.03))
    assert elbow.part == "the link behind elbow"
    q = np.radians([10, 50, -40, 5, 0])
    frames = robot.frames(q)
    ends = axis_points(robot, elbow, q)[[0, -1]]
    wrist = frames[6, :3, 3] + 0.0145 * frames[5, :3, 2]  # without the wrist's own offset
    np.testing.assert_allclose(ends, [frames[5, :3, 3], wrist], atol=1e-12)
    (table,) = robot.obstacles
    np.testing.assert_allclose([table.low, table.high], [[0.15, -0.3, -0.02], [0.4, 0.3, 0.0]])


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (
            '[[capsules]]\njoint = "knee"\nfrom_mm = [0,0,0]\nto_mm = [0,0,1]\nradius_mm = 1',
            "no joint 'knee'",
        ),
        (
            "[[capsules]]\nfrom_mm = [0,0,0]\nto_mm = [0,0,1]\nradius_mm = 0",
            "radius_mm: must be at least 1e-06",
        ),
        ('[[obstacles]]\ntitle = "wall"\nfrom_mm = [0,0,0]\nto_mm = [1,0,1]', "wall: .* the same y"),
        ('[[obstacles]]\ntitle = ""\nfrom_mm = [0,0,0]\nto_mm = [1,1,1]', r"obstacles\[0\]\.title"),
    ],
)
def test_what_a_robot_file_may_not_say(tmp_path: Path, lines: str, says: str) -> None:
    mine = tmp_path / "mine.toml"
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    mine.write_text(f"{text}\n{lines}\n", encoding="utf-8")
    with pytest.raises(RobotFileError, match=says):
        load_robot(mine)


def test_undersides_that_no_joint_lifts_are_left_out() -> None:
    robot = load_robot("uzuner")
    held = robot.limits.copy()
    held[1:] = held[1:, :1]  # only the base turns
    assert undersides(robot.collision, [j.title for j in robot.joints], held, held.T) == ()


# Distances of segments against points sampled on them.

Triple = tuple[float, float, float]
SHARE = np.linspace(0.0, 1.0, 201)
COORDINATE = st.floats(-1, 1).map(lambda value: round(value, 3))
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE).map(np.array)


def brute(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray) -> float:
    one, other = p + SHARE[:, None] * u, q + SHARE[:, None] * v
    return float(np.linalg.norm(one[:, None] - other[None], axis=2).min())


@given(POINT, POINT, POINT, POINT)
def test_as_near_as_the_nearest_of_many_points(
    p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray
) -> None:
    exact, sampled = float(segment_distance(p, u, q, v)), brute(p, u, q, v)
    step = (np.linalg.norm(u) + np.linalg.norm(v)) / 400
    assert sampled - step - 1e-9 <= exact <= sampled + 1e-9
    assert float(segment_distance(q, v, p, u)) == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize(
    ("p", "u", "q", "v", "distance"),
    [
        ((0, 0, 0), (1, 0, 0), (0.5, -1, 0.3), (0, 2, 0), 0.3),  # crossing
        ((0, 0, 0), (1, 0, 0), (0.4, 0.2, 0), (1, 0, 0), 0.2),  # side by side
        ((0, 0, 0), (1, 0, 0), (3, 0, 0), (-1, 0, 0), 1.0),  # in one line, apart
        ((0, 0, 0), (1, 0, 0), (0.2, 0, 0), (0.2, 0, 0), 0.0),  # in one line, one in the other
        ((0, 0, 0), (0, 0, 0), (0, 3, 0), (0, 0, 4), 3.0),  # a point
        ((1, 2, 3), (0, 0, 0), (1, 2, 5), (0, 0, 0), 2.0),  # two points
        ((0, 0, 0), (1, 0, 0), (2, 1, 0), (1, 0, 0), np.sqrt(2)),  # end to end
    ],
)
def test_special_places(p: Triple, u: Triple, q: Triple, v: Triple, distance: float) -> None:
    arrays = (np.array(x, dtype=np.float64) for x in (p, u, q, v))
    assert float(segment_distance(*arrays)) == pytest.approx(distance, abs=1e-12)


@given(POINT, POINT)
def test_to_a_box(p: FloatArray, u: FloatArray) -> None:
    low, high = np.array([-0.3, -0.2, -0.5]), np.array([0.4, 0.1, 0.2])
    exact = float(segment_box_distance(p, u, low, high))
    points = p + np.linspace(0, 1, 2001)[:, None] * u
    sampled = float(box_distance(points.T, low, high).min())
    assert sampled - np.linalg.norm(u) / 2000 - 1e-9 <= exact <= sampled + 1e-9


def test_inside_a_box_the_distance_is_minus_the_depth() -> None:
    low, high = np.array([0.0, 0, 0]), np.array([1.0, 1, 1])
    points = np.array([[0.5, 0.5, 0.9], [2.0, 2.0, 1.0], [0.5, 0.5, 0.5], [1.0, 0.5, 0.5]])
    np.testing.assert_allclose(box_distance(points.T, low, high), [-0.1, np.sqrt(2), -0.5, 0.0], atol=1e-15)


# How long an arm is, whatever stands between its base and its first joint, or behind its last one.


def farthest(robot: Robot) -> float:
    """Of the tool from the base, over many configurations, limits left aside [m]."""
    q = np.random.default_rng(7).uniform(-np.pi, np.pi, (20_000, robot.n))
    return float(np.linalg.norm(robot.forward(q)[:, :3, 3], axis=1).max())


RAISED = (Step("mount", "fixed", "world", "w/base", "0.3 0 0.8", "0.2 0.1 0"), *PROP)


@pytest.mark.parametrize("arm", [*FIVE, JAW, PROP, RAISED])
def test_no_tool_point_is_farther_away(tmp_path: Path, arm: str | tuple[Step, ...]) -> None:
    robot = load_robot(arm if isinstance(arm, str) else written(tmp_path / "arm.urdf", arm))
    assert farthest(robot) <= robot.chain.length <= 1.35 * farthest(robot)


def test_a_straight_arm_is_as_long_as_its_links(tmp_path: Path) -> None:
    steps = (
        Step("a", "revolute", "base", "one", "0 0 0.1", axis="0 1 0"),
        Step("b", "revolute", "one", "two", "0 0 0.2", axis="0 1 0"),
        Step("end", "fixed", "two", "tool0", "0 0 0.3"),
    )
    assert load_robot(written(tmp_path / "arm.urdf", steps)).chain.length == pytest.approx(0.6, abs=1e-12)


@pytest.mark.parametrize("name", shipped_robots())
def test_an_arm_is_drawn_in_one_piece(name: str) -> None:
    """From the base to where the hand begins, in any pose: each bar touches one of those before it."""
    robot = load_robot(name)
    gripper = robot.gripper is not None
    q = np.random.default_rng(3).uniform(*robot.limits.T)
    frames = robot.frames(q)

    def placed(frame: int, end: tuple[float, float, float]) -> FloatArray:
        return frames[frame][:3, :3] @ np.array(end) + frames[frame][:3, 3]

    found = [
        (placed(bar.frame, bar.start), placed(bar.frame, bar.end))
        for bar in bars(robot.chain, tool_length(robot.chain, robot.look, gripper=gripper))
        if bar.length > 1e-9
    ]
    T = tools(robot, q[None])[0]
    size = FINGER[2] * robot.chain.length if gripper else TIP_LENGTH * width(robot.chain, robot.look)
    found.append((T[:3, 3] - size * T[:3, 2], T[:3, 3]))
    touching = {0}
    for _ in found:
        touching |= {
            k for k, one in enumerate(found) if any(apart(one, found[other]) < 1e-9 for other in touching)
        }
    assert touching == set(range(len(found)))


@pytest.mark.parametrize("name", shipped_robots())
def test_a_line_can_begin_at_home(name: str) -> None:
    robot = load_robot(name)
    home, good = robot.pose("home"), 0
    for way in (*np.eye(3), *-np.eye(3)):
        try:
            plan_line(robot, home, robot.forward(home)[:3, 3] + 0.01 * way)
        except (MotionRefusedError, UnreachableError) as refusal:
            assert "stands in a singularity" not in str(refusal)
        else:
            good += 1
    assert good >= 3
