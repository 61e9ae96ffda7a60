"""Convex hulls: their gaps against scipy's, and what the pre-flight makes of them."""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.robot.urdf_kit import Step, written

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.kinematics.frames import LinkFrames
from armctl.motion.clearance import FLOOR_TOLERANCE_M, Floor, stands_clear
from armctl.motion.preflight import preflight
from armctl.motion.profiles import PointToPoint
from armctl.robot import Robot
from armctl.robot.body import hulls
from armctl.robot.body.collision import NEAR_M
from armctl.robot.body.fitting import hull_of
from armctl.robot.body.hulls import Hull, HullPairs, hull_of_few
from armctl.robot.parts import Obstacle

FAR = math.inf
SOME = Rotation.random(4000, random_state=1).as_matrix()[:, 0]
"""directions"""


def cloud(rng: np.random.Generator, most: int = 60) -> Hull:
    return hull_of(rng.normal(size=(int(rng.integers(4, most)), 3)) * rng.uniform(0.02, 0.1, 3))


def gaps(one: Hull, other: Hull, R: FloatArray, origin: FloatArray, enough: float = FAR) -> FloatArray:
    first = np.zeros(len(origin), dtype=np.intp)
    return HullPairs([one, other]).gaps(first, first + 1, R, origin, enough)


def nearest(one: FloatArray, other: FloatArray) -> float:
    """The distance of the hulls of points (k, 3) and (m, 3) [m], by non-negative least squares."""
    heavy = 1e4  # of the two sums of weights that are to be 1
    ones = np.zeros((2, len(one) + len(other)))
    ones[0, : len(one)] = ones[1, len(one) :] = heavy
    A = np.vstack([np.hstack([one.T, -other.T]), ones])
    solved: Any = import_module("scipy.optimize").nnls(A, [0, 0, 0, heavy, heavy], maxiter=10_000)
    return float(np.linalg.norm(A[:3] @ solved[0]))


def way_out(one: FloatArray, other: FloatArray) -> float:
    """By how much hulls overlap, or minus a bound of the distance: faces of the hull of all differences."""
    differences = (one[:, None] - other[None]).reshape(-1, 3)
    return -float(import_module("scipy.spatial").ConvexHull(differences).equations[:, 3].max())


@pytest.mark.parametrize("seed", range(12))
def test_gaps_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = cloud(rng), cloud(rng)
    R = Rotation.random(40, random_state=seed).as_matrix()
    origin = rng.normal(size=(40, 3)) * rng.uniform(0.02, 0.3, (40, 1))
    found = gaps(one, other, R, origin)
    margins = one.margin + other.margin
    for gap, turned, moved in zip(found + margins, R, origin, strict=True):
        there = other.corners @ turned.T + moved
        depth = way_out(one.corners, there)
        exact = hulls.depth(one, other, turned, moved)
        if depth > 0:
            assert -1.25 * depth - 1e-4 <= gap <= -depth + 1e-9
            assert exact == pytest.approx(depth + margins)
            ways = (one.corners @ SOME.T).max(axis=0) - (there @ SOME.T).min(axis=0)
            assert depth <= ways.min() + 1e-12  # no way that was tried is shorter
        else:
            assert exact is None
            distance = nearest(one.corners, there)
            assert distance - 1.01e-4 <= gap <= distance + 1e-6
    some = gaps(one, other, R, origin, NEAR_M)
    assert (some <= found + 1.01e-4).all() and (some[found > NEAR_M + 1e-4] > NEAR_M - 1e-4).all()


def test_pairs_of_all_sizes_at_once_have_the_gaps_that_each_has_alone() -> None:
    rng = np.random.default_rng(3)
    some = [cloud(rng, most) for most in (5, 6, 8, 12, 20, 60, 120)]
    i, j = rng.integers(0, len(some), (2, 600))
    R = Rotation.random(len(i), random_state=3).as_matrix()
    origin = rng.normal(size=(len(i), 3)) * rng.uniform(0.02, 0.3, (len(i), 1))
    found = HullPairs(some).gaps(i, j, R, origin, FAR)
    for k in range(0, len(i), 7):
        alone = gaps(some[i[k]], some[j[k]], R[k : k + 1], origin[k : k + 1])[0]
        assert found[k] == pytest.approx(alone, abs=1.01e-4, rel=0.25 if alone < 0.0 else 0.0)
    assert 50 < np.count_nonzero(found < 0.0) < 550


def test_points_lines_faces_and_hulls_in_one_place() -> None:
    point = Hull(np.zeros((1, 3)), np.empty((0, 3)), 0.01)
    line = Hull(np.array([[0.0, 0.0, -0.1], [0.0, 0.0, 0.1]]), np.empty((0, 3)), 0.0)
    face = hull_of(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]))
    box = hull_of(np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.05)
    still = np.eye(3)[None]

    def gap(one: Hull, other: Hull, x: float, y: float, z: float) -> float:
        return float(gaps(one, other, still, np.array([[x, y, z]]))[0])

    assert gap(point, point, 0.03, 0.0, 0.0) == pytest.approx(0.01, abs=1e-4)
    assert gap(line, line, 0.03, 0.04, 0.05) == pytest.approx(0.05, abs=1e-4)
    assert gap(line, point, 0.0, 0.0, 0.2) == pytest.approx(0.09, abs=1e-4)
    assert gap(face, point, 0.02, 0.02, 0.3) == pytest.approx(0.29, abs=1e-4)
    assert gap(face, point, 0.02, 0.02, 0.0) == pytest.approx(-0.01, abs=1e-4)
    assert gap(box, point, 0.0, 0.0, 0.0) == pytest.approx(-0.06, abs=1e-4)
    assert gap(box, box, 0.0, 0.0, 0.0) == pytest.approx(-0.1, abs=1e-4)
    assert gap(box, box, 0.1, 0.0, 0.0) == pytest.approx(0.0, abs=1e-4)
    assert gap(box, box, 0.2, 0.2, 0.0) == pytest.approx(0.1 * math.sqrt(2), abs=1e-4)


def few_points(rng: np.random.Generator, kind: str) -> FloatArray:
    count = int(rng.integers(5, 50))
    points = rng.normal(size=(count, 3)) * 10 ** rng.uniform(-3, 1)
    turned = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    round_ = np.arange(14) * (math.tau / 14)
    up = np.array([0.0, 0.0, 1.0])
    disc = np.stack([np.cos(round_), np.sin(round_), 0 * round_], axis=1)
    return {
        "cloud": points,
        "doubled": np.concatenate([points, points[:3], points.mean(axis=0)[None]]),
        "swept": np.concatenate([points, points + rng.normal(size=3) * np.ptp(points)]),
        "grid": rng.integers(-2, 3, size=(count + 10, 3)) @ turned.T + rng.normal(size=3),
        "box": np.concatenate([np.indices((2, 2, 2)).reshape(3, -1).T] * 2)
        * rng.uniform(0.01, 1, 3)
        @ turned,
        "drum": np.concatenate([disc, 0.5 * disc + up, disc + 2 * up]) * 0.02 @ turned,
    }[kind]


@pytest.mark.parametrize("kind", ["cloud", "doubled", "swept", "grid", "box", "drum"])
def test_the_hull_of_few_points_is_that_of_scipy(kind: str) -> None:
    """Its corners and its faces, with points that are doubled, in a line, in a face, or inside."""
    spatial: Any = import_module("scipy.spatial")
    rng = np.random.default_rng(5)
    for _ in range(40):
        points = few_points(rng, kind)
        true, (corners, normals) = spatial.ConvexHull(points), hull_of_few(points)
        assert len(corners) == len(true.vertices)
        apart = np.linalg.norm(points[corners][:, None] - points[true.vertices], axis=2)
        assert apart.min(axis=0).max() == apart.min(axis=1).max() == 0.0
        apart = np.abs(normals[:, None] - true.equations[:, :3]).max(axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 2e-9


def test_a_hull_of_few_corners_contains_all_points() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(4000, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1, keepdims=True)  # a ball needs corners without end
    hull = hull_of(points)
    assert len(hull.corners) < 100 and 0.001 < hull.margin < 0.02
    for point in points[::100]:
        assert nearest(hull.corners, point[None]) <= hull.margin + 1e-6


# A whole arm: a turntable with a shelf, and two links. The bracket at the elbow is a plate beside the arm.

STEPS = (
    Step("pan", "revolute", "base", "body", "0 0 0.1"),
    Step("lift", "revolute", "body", "upper", "0 0 0.05", axis="0 1 0", limits=(-2.6, 2.6)),
    Step("elbow", "revolute", "upper", "lower", "0 0 0.18", axis="0 1 0", limits=(-2.9, 2.9)),
    Step("end", "fixed", "lower", "tool0", "0 0 0.14"),
)
BOXES = {
    "base": ("0.16 0.16 0.01", "0 0 0.01"),
    "body": ("0.2 0.2 0.02", "0 0 0"),
    "upper": ("0.03 0.03 0.16", "0 0 0.09"),
    "lower": ("0.02 0.12 0.12", "0 0 0.09"),
}


def arm(
    tmp_path: Path, steps: tuple[Step, ...] = STEPS, shapes_of: dict[str, str] | None = None, **changed: Any
) -> Robot:
    path = written(tmp_path / "arm.urdf", steps)
    text = path.read_text()
    boxes = {
        name: f'<visual><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></visual>'
        for name, (size, xyz) in BOXES.items()
    }
    for name, shape in (shapes_of or boxes).items():
        text = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{shape}</link>')
    path.write_text(text)
    return replace(load_robot(path).with_body(), **changed)


def placed(robot: Robot, q: FloatArray) -> dict[str, FloatArray]:
    """The corners (8, 3) of each box at ``q`` (3,), base frame [m]."""
    links, found = LinkFrames.at(robot.chain, q[None]), dict[str, FloatArray]()
    for name, shape in zip(BOXES, robot.shapes, strict=True):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * shape.size / 2
        corners = corners @ shape.pose[:3, :3].T + shape.pose[:3, 3]
        link = shape.link
        if link >= 0:
            corners = corners @ links.rotation[link][:, :, 0].T + links.origin[link][:, 0]
        found[name] = corners
    return found


def test_what_only_capsules_touch_may_be_done(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    capsules = replace(robot, capsules=tuple(replace(one, hull=None) for one in robot.body.capsules))

    def touches(one: Robot, goal: FloatArray) -> list[str]:
        found = preflight(one, PointToPoint.plan(one, np.zeros(3), goal))
        return [finding.what for finding in found if finding.kind == "self-collision"]

    goals = np.random.default_rng(1).uniform(*robot.limits.T, (60, 3))
    both = [(touches(robot, goal), touches(capsules, goal)) for goal in goals]
    assert sum(bool(by_capsules) and not by_hulls for by_hulls, by_capsules in both) >= 5
    assert all(by_capsules for by_hulls, by_capsules in both if by_hulls)
    told = [what for by_hulls, _ in both for what in by_hulls]
    assert told and all(re.fullmatch(r"(touches|0\.\d mm from) the .*", what) for what in told)
    unknown = replace(robot, capsules=tuple(replace(one, surface=None) for one in robot.body.capsules))
    told = [what for goal in goals for what in touches(unknown, goal)]
    assert told and all(what.endswith(", by convex hulls") for what in told)
    assert not any("hulls" in what for _, by_capsules in both for what in by_capsules)


@pytest.mark.parametrize("seed", range(6))
def test_no_touch_of_meshes_is_missed_and_none_is_invented(tmp_path: Path, seed: int) -> None:
    """Along random motions, against scipy's hulls of the boxes themselves."""
    wall = Obstacle("the wall", np.array([0.22, -0.3, 0.0]), np.array([0.25, 0.3, 0.4]))
    robot = arm(tmp_path, obstacles=(wall,), poses={})
    rng = np.random.default_rng(seed)
    box = (
        np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (wall.high - wall.low)
        + wall.low
    )
    told = set[str]()
    for _ in range(12 if os.environ.get("ARMCTL_LONG") else 4):
        start, end = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (2, 3))
        motion = PointToPoint.plan(robot, start, end)
        found = {one.kind for one in preflight(robot, motion)}
        depths = dict.fromkeys(("self-collision", "obstacle", "floor"), 0.0)
        first = dict[str, float]()
        for q in motion.sample(np.linspace(0.0, motion.duration, 60)).q:
            at = placed(robot, q)
            here = {
                "self-collision": max(
                    way_out(at[a], at[b])
                    for a, b in (("base", "upper"), ("base", "lower"), ("body", "lower"))
                ),
                "obstacle": max(way_out(at[name], box) for name in ("body", "upper", "lower")),
                "floor": max(-at[name][:, 2].min() for name in ("upper", "lower")),
            }
            for kind, depth in here.items():  # what is closed at the start must not close further
                depths[kind] = max(depths[kind], depth - max(first.setdefault(kind, depth), 0.0))
        for kind, depth in depths.items():
            if depth > 2 * FLOOR_TOLERANCE_M:
                assert kind in found, (kind, depth)
            told |= {kind} & found
            if depth <= 0.0 and first[kind] < 0.0:
                assert kind not in found, kind
    assert told


def test_the_floor_is_as_far_as_the_lowest_corner(tmp_path: Path) -> None:
    robot = arm(tmp_path, poses={})
    for q in np.random.default_rng(2).uniform(robot.limits[:, 0], robot.limits[:, 1], (20, 3)):
        links = LinkFrames.at(robot.chain, q[None])
        lowest = {
            one.part: float(links.place(one.link, one.points)[2].min()) - one.radius
            for one in robot.undersides
            if len(one.points) > 1
        }
        at = placed(robot, q)
        expected = [float(at[name][:, 2].min()) for name in ("upper", "lower")]
        assert list(lowest.values()) == pytest.approx(expected, abs=1e-9)


def test_the_whole_hull_lies_in_its_capsule_and_its_corners_move_as_their_levers_say(tmp_path: Path) -> None:
    balls = {
        name: f'<visual><geometry><sphere radius="0.0{k}"/></geometry></visual>'
        for k, name in enumerate(BOXES, 3)
    }
    robot = arm(tmp_path, shapes_of=balls)
    model = robot.collision
    assert max(one.hull.margin for one in model.capsules if one.hull is not None) > 5e-4
    for piece in model.capsules:
        if piece.hull is not None:  # so that a gap of capsules is one of hulls, too
            away = max(nearest(np.array([piece.start, piece.end]), corner[None]) for corner in piece.corners)
            assert away + piece.hull.margin <= piece.radius + 1e-6
    for q in np.random.default_rng(5).uniform(robot.limits[:, 0], robot.limits[:, 1], (30, 3)):
        for j, step in enumerate(1e-4 * np.eye(3)):
            links, moved = (LinkFrames.at(robot.chain, one[None]) for one in (q, q + step))
            for piece, lever in zip(model.capsules, model.levers, strict=True):
                way = links.place(piece.link, piece.corners) - moved.place(piece.link, piece.corners)
                assert np.linalg.norm(way, axis=0).max() <= lever[j] * 1e-4 * (1 + 1e-6) + 1e-12


def test_a_tool_point_ahead_of_a_plate_is_kept_apart(tmp_path: Path) -> None:
    """It lies inside the capsule of the plate, but not inside its hull."""
    plate = '<visual><origin xyz="0 0 0.1"/><geometry><box size="0.2 0.2 0.01"/></geometry></visual>'
    wall = Obstacle("the wall", np.array([-0.5, -0.5, 0.45]), np.array([0.5, 0.5, 0.5]))
    robot = arm(tmp_path, shapes_of={"lower": plate}, obstacles=(wall,))  # upright, the tool is 0.47 m high
    assert [one.part for one in robot.body.capsules][-1] == "the tool"
    assert not stands_clear(robot, np.zeros(3))
    assert stands_clear(replace(robot, obstacles=()), np.zeros(3))


@pytest.mark.parametrize(("height", "closed"), [(0.2, 0.0), (-0.003, -0.003), (-0.09, -0.005)])
def test_a_plate_may_lie_on_the_floor_no_deeper_than_to_its_middle(
    tmp_path: Path, height: float, closed: float
) -> None:
    """``height``: of the underside of a plate of 10 mm in the home pose; ``closed``: how low it may go."""
    plate = '<visual><origin xyz="0 0 0.05"/><geometry><box size="0.2 0.2 0.01"/></geometry></visual>'
    robot = arm(tmp_path, shapes_of={"lower": plate}, poses={"home": np.zeros(3)})
    floor = Floor(replace(robot, floor_z=0.375 - height))
    (part,) = (k for k, one in enumerate(robot.undersides) if len(one.points) == 8)
    assert floor.clearance(np.zeros(3))[part] == pytest.approx(height, abs=1e-6)
    assert floor.closed[part] == pytest.approx(closed, abs=1e-6)
