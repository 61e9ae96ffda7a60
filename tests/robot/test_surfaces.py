"""Triangles of links where their hulls overlap: forks, random solids, what travels and what is counted."""

from __future__ import annotations

import itertools
import math
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog
from tests.robot.test_meshes import binary_stl, posed
from tests.robot.urdf_kit import Step, written

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.kinematics import rotation_from_rpy
from armctl.kinematics.frames import LinkFrames
from armctl.motion import PointToPoint, preflight
from armctl.robot import Robot
from armctl.robot.body import arm_body
from armctl.robot.body import meshes as mesh_cache
from armctl.robot.body.arm_body import CLEAR_M, Surface, SurfacePairs
from armctl.robot.record import robot_of, robot_record
from armctl.robot.solids import Solid, block, drum

STEPS = (
    Step("pan", "revolute", "base", "body", "0 0 0.1"),
    Step("lift", "revolute", "body", "upper", "0 0 0.05", axis="0 1 0"),
    Step("bend", "revolute", "upper", "lower", "0 0 0.2", axis="0 1 0", limits=(-3.0, 3.0)),
    Step("swing", "revolute", "lower", "hand", "0 0 0.2", axis="1 0 0", limits=(-1.5, 1.5)),
    Step("end", "fixed", "hand", "tool0", "0 0 0.05"),
)
FOLDED = 2.8
"""bend at which the hand is between the prongs [rad]"""


def joined(*solids: Solid) -> Solid:
    counts = np.cumsum([0, *(len(one.vertices) for one in solids)])
    faces = [one.faces + begin for one, begin in zip(solids, counts.tolist(), strict=False)]
    return Solid(np.vstack([one.vertices for one in solids]), np.vstack(faces))


@pytest.fixture
def forked(tmp_path: Path) -> Robot:
    """The upper arm carries a ring, and the hand is folded into it: 33 mm of hand in a ring of 36 mm."""
    ahead = np.array([math.sin(FOLDED), 0.0, math.cos(FOLDED)])
    plates = [
        posed(block((0.02, 0.011, 0.004)), (0.0, -0.038 * math.sin(a), 0.038 * math.cos(a)), (a, 0.0, 0.0))
        for a in np.linspace(0.0, math.tau, 24, endpoint=False).tolist()
    ]
    x, y, z = (0.22 * ahead + [0.0, 0.0, 0.2]).tolist()
    meshes = {
        "upper": posed(joined(*plates), (x, y, z), (0.0, FOLDED, 0.0)),
        "hand": posed(drum(0.033, 0.02), (0.0, 0.0, 0.02), (0.0, math.pi / 2, 0.0)),
    }
    path = written(tmp_path / "arm.urdf", STEPS)
    text = path.read_text()
    for name, solid in meshes.items():
        (tmp_path / f"{name}.stl").write_bytes(binary_stl(solid))
        shape = f'<visual><geometry><mesh filename="{name}.stl"/></geometry></visual>'
        text = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{shape}</link>')
    path.write_text(text)
    return load_robot(path).with_body()


def told(robot: Robot, start: list[float], end: list[float]) -> list[str]:
    found = preflight(robot, PointToPoint.plan(robot, start, end))
    return [str(one) for one in found if one.kind == "self-collision"]


def test_a_hand_inside_a_ring_is_clear_until_it_swings_into_it(forked: Robot) -> None:
    inside, beside = [0.0, 0.0, FOLDED, 0.0], [0.0, 0.3, FOLDED, 0.05]
    links = LinkFrames.at(forked.chain, np.array([inside]))
    bare = replace(forked, capsules=tuple(replace(one, surface=None) for one in forked.body.capsules))
    assert bare.collision.gaps(links).min() < -0.001  # the hulls overlap
    assert told(forked, inside, beside) == []
    (said,) = told(forked, inside, [0.0, 0.3, FOLDED, 0.3])
    assert "the link behind swing" in said and "touches the link behind lift" in said
    (said,) = told(forked, inside, [0.0, 0.3, FOLDED, 0.13])  # 20 mm from its axis, 3 mm of room
    assert re.search(r"0\.[1-4] mm from the link behind lift", said)


def test_what_is_sent_to_another_process_decides_alike(forked: Robot) -> None:
    for other in (robot_of(robot_record(forked)), pickle.loads(pickle.dumps(forked))):
        assert other == forked
        q = np.random.default_rng(2).uniform(*forked.limits.T, (50, 4))
        links = LinkFrames.at(forked.chain, q)
        np.testing.assert_array_equal(other.collision.gaps(links), forked.collision.gaps(links))


def cut_by_planes(one: FloatArray, other: FloatArray) -> bool:
    """Whether two triangles (3, 3) share a point: a linear programme over their weights."""
    A = np.vstack([np.hstack([one.T, -other.T]), [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]])
    return bool(linprog(np.zeros(6), A_eq=A, b_eq=[0, 0, 0, 1, 1]).success)


def nearest_mm(one: FloatArray, other: FloatArray) -> float:
    """Least distance of points on triangles (k, 3, 3) [mm], by many points."""
    steps = [(i / 8, j / 8) for i, j in itertools.product(range(9), repeat=2) if i + j <= 8]
    weights = np.array([(a, b, 1 - a - b) for a, b in steps])
    first, second = (np.einsum("pw,kwx->kpx", weights, t).reshape(-1, 3) for t in (one, other))
    return float(np.linalg.norm(first[:, None] - second, axis=2).min()) * 1000


def test_distances_are_those_of_brute_force() -> None:
    rng, cut = np.random.default_rng(5), 0
    for _ in range(25):
        one, other = rng.uniform(-0.1, 0.1, (2, 4, 3, 3))
        R = rotation_from_rpy(*rng.uniform(-3, 3, 3))
        origin = rng.uniform(-0.15, 0.15, 3)
        surfaces = [Surface.of(one), Surface.of(other)]
        pairs = SurfacePairs(surfaces)
        index = np.array([0]), np.array([1])
        (distance,) = pairs.distances(*index, R[None], origin[None])
        placed = other @ R.T + origin
        cuts = any(cut_by_planes(a, b) for a, b in itertools.product(one, placed))
        cut += cuts
        assert (distance < 2e-5) == cuts  # corners are rounded to 0.01 mm
        if not cuts:
            assert 1000 * distance <= nearest_mm(one, placed) + 1e-3
            assert 1000 * distance >= nearest_mm(one, placed) - 12  # as far apart as the points are
    assert 5 <= cut <= 20


def test_a_surface_of_too_many_triangles_is_a_coarser_one_that_says_by_how_much() -> None:
    rng = np.random.default_rng(3)
    near = rng.uniform(-0.05, 0.05, (25_000, 1, 3)) + rng.normal(scale=1e-3, size=(25_000, 3, 3))
    coarse = Surface.of(near)
    assert coarse is None  # a cloud does not become coarser
    x, y = np.meshgrid(np.linspace(0, 0.1, 200), np.linspace(0, 0.1, 200))
    points = np.stack([x, y, 0.01 * np.sin(40 * x)], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    sheet = np.concatenate([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)
    coarse = Surface.of(sheet)
    assert coarse is not None and 0.0 < coarse.off < 0.003
    exact = np.linalg.norm(np.array([0.05, 0.05, 0.05]) - points.reshape(-1, 3), axis=1).min()
    probe = Surface.of(np.array([[[0.05, 0.05, 0.05], [0.05, 0.05, 0.0501], [0.05, 0.0501, 0.0501]]]))
    found = SurfacePairs([coarse, probe]).distances(
        np.array([0]), np.array([1]), np.eye(3)[None], np.zeros((1, 3))
    )[0]
    assert exact - 2 * coarse.off - 1e-4 <= found <= exact  # a lower bound
    assert CLEAR_M > 0.0


def test_without_the_library_hulls_decide_and_the_arm_says_so(
    tmp_path: Path, forked: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not any("python-fcl" in text for text in forked.assumed)
    monkeypatch.setattr(arm_body, "find_spec", lambda _: None)
    monkeypatch.setattr(mesh_cache, "folder", lambda: tmp_path / "kept")
    robot = load_robot(tmp_path / "arm.urdf").with_body()
    assert any("pip install python-fcl" in text for text in robot.assumed)
    assert told(robot, [0.0, 0.0, FOLDED - 0.6, 0.0], [0.0, 0.0, FOLDED, 0.0])
