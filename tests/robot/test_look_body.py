"""The body of an arm with a look: solids where plain matrices put them, rods, jaws, levers."""

from __future__ import annotations

import subprocess
import sys
from itertools import product

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.kinematics.samples import joint_samples
from armctl.motion.clearance import Floor, SelfCollision
from armctl.robot import Robot, load_robot, shipped_robots
from armctl.robot.body.collision import NEAR_M, CollisionModel
from armctl.robot.body.fitting import hull_as_it_is
from armctl.robot.body.hulls import nearing
from armctl.robot.body.of_look import _inside
from armctl.robot.look.pieces import Piece

_STEP = 0.05
"""[rad]"""
_EXACT_M = 2.2e-4
"""two gaps are known to this"""


def placed(robot: Robot, piece: Piece, q: FloatArray, opening: float) -> list[FloatArray]:
    """Corners (k, 3) [m] of a piece's convex solids, base frame; link by link, with 4 x 4 matrices."""
    frames = robot.frames(q)
    links = {-1: np.eye(4)}
    for (link, T), frame in zip(robot.chain.places, frames, strict=True):
        links.setdefault(link, frame @ np.linalg.inv(T))
    mount = piece.mount
    T = links[mount.turns].copy()
    T[:3, 3] = links[mount.hangs][:3, 3]
    if mount.pins is not None:
        here = (T @ [*mount.pins.near, 1.0])[:3]
        there = (links[mount.pins.link] @ [*mount.pins.far, 1.0])[:3]
        x = (there - here) / np.linalg.norm(there - here)
        y = T[:3, :3] @ mount.pins.beside
        y -= (x @ y) * x
        y /= np.linalg.norm(y)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.column_stack([x, y, np.cross(x, y)]), here
    found: list[FloatArray] = []
    for corners in (corners for part in piece.parts for corners in part.corners):
        if piece.jaw is not None:
            R, way = piece.jaw.at(opening)
            corners = corners @ R.T + way
        found.append(corners @ T[:3, :3].T + T[:3, 3])
    return found


@pytest.mark.parametrize("name", shipped_robots())
def test_the_body_is_where_the_solids_are(name: str) -> None:
    """Each corner of a body is one of a solid, and the lowest of the arm is the lowest of all of them."""
    robot, rng = load_robot(name), np.random.default_rng(5)
    for q in joint_samples(robot.limits, 6):
        opening = round(float(rng.uniform()), 2)
        arm = robot.gripping(opening)
        model, below = arm.collision, arm.undersides
        links = model.frames(q[None])
        solids = [one for piece in robot.pieces if piece.body for one in placed(robot, piece, q, opening)]
        every = np.concatenate(solids)
        for capsule in model.capsules:
            corners = links.place(capsule.link, capsule.corners)[:, :, 0].T
            away = np.linalg.norm(corners[:, None] - every, axis=2).min(axis=1)
            assert away.max() < 1e-9

        def lowest(first: int, q: FloatArray = q, opening: float = opening) -> float:
            moved = (piece for piece in robot.pieces if piece.body and max(piece.mount.links) >= first)
            return min(float(one[:, 2].min()) for piece in moved for one in placed(robot, piece, q, opening))

        # what no joint lifts is left out, and what lies inside another up to a millimetre
        low = min(float(links.place(one.link, one.points)[2].min()) for one in below)
        tool = float(robot.forward(q)[2, 3])
        assert min(lowest(0), tool) - 1e-9 <= low <= min(lowest(1), tool) + 1.1e-3


@pytest.mark.parametrize("name", ["mearm", "so101", "uarm", "ur5", "braccio"])
def test_gaps_are_distances_of_solids(name: str) -> None:
    robot = load_robot(name).gripping(0.4)
    source = SelfCollision(robot)
    model = robot.collision
    q = joint_samples(robot.limits, 12)
    links = robot.body_frames(q)
    gaps = source.gaps(links)
    compared = 0
    for k in np.argsort(gaps.min(axis=1))[:40]:
        i, j = model.pairs[k]
        for at in range(len(q)):
            one, other = (
                links.place(model.capsules[c].link, model.capsules[c].corners)[:, :, at].T[None]
                for c in (i, j)
            )
            low, high = nearing(one, other, np.array([np.inf]))
            if high[0] > 2e-4:
                assert gaps[k, at] <= high[0] + 1e-9
                compared += 1
                if gaps[k, at] < 0.02:
                    assert gaps[k, at] >= low[0] - 2e-4
            else:
                assert gaps[k, at] < 3e-4
    assert compared > 50


@pytest.mark.parametrize("name", ["mearm", "eezybotarm_mk2", "uarm", "so101", "ar4"])
def test_no_gap_closes_faster_than_its_lever_says(name: str) -> None:
    robot = load_robot(name).gripping(0.7)
    for source in (SelfCollision(robot), Floor(robot)):
        for q in joint_samples(robot.limits, 6):
            steps = q + _STEP * np.vstack([np.zeros(robot.n), np.eye(robot.n)])
            gaps = source.gaps(robot.body_frames(steps))
            near = slice(None) if isinstance(source, Floor) else (gaps < NEAR_M).all(axis=1)  # beyond: bounds
            change = np.abs(gaps[:, 1:] - gaps[:, :1])[near]
            assert (change <= _STEP * source.levers[near] + _EXACT_M).all()


def test_jaws_count_where_they_are() -> None:
    robot = load_robot("so101")
    q = robot.pose("home")
    closed, half, opened = (robot.gripping(one).collision for one in (0.0, 0.5, 1.0))
    assert [one.part for one in closed.capsules] == [one.part for one in opened.capsules]
    jaws = [k for k, one in enumerate(closed.capsules) if one.part == "the moving jaw"]
    assert jaws
    for k, one in enumerate(closed.capsules):
        moves = not np.allclose(one.corners, half.capsules[k].corners)
        assert moves == (k in jaws)
    swept = robot.gripping(None).collision
    jaw = [one for one in swept.capsules if one.part == "the moving jaw"]
    corners = np.concatenate([half.capsules[k].corners for k in jaws])
    link = robot.body_frames(q[None])
    assert link.origin  # the same frame for all of them
    for corner in corners:
        inside = [
            float((one.hull.normals @ corner - (one.hull.corners @ one.hull.normals.T).max(axis=0)).max())
            for one in jaw
            if one.hull is not None
        ]
        assert min(inside) < 5e-4


@pytest.mark.parametrize("name", ["mearm", "uzuner", "scorbot"])
def test_what_always_touches_does_with_the_gripper_closed_half_open_and_open(name: str) -> None:
    bodies = load_robot(name).bodies
    found = [
        CollisionModel.build(
            bodies.chain, body.capsules, bodies.limits, bodies.resting, mounts=body.mounts, solids=body.solids
        ).touching_solids
        for body in (bodies.at((opening, opening)) for opening in (0.0, 0.5, 1.0))
    ]
    assert bodies.opens
    assert bodies.collision((0.3, 0.3)).touching_solids <= frozenset.intersection(*found)
    assert bodies.collision((0.0, 0.0)).touching_solids == frozenset.intersection(*found)


def test_a_body_of_a_look_takes_no_scipy() -> None:
    """It would be most of what opening an arm takes."""
    code = "import sys, armctl; r = armctl.load_robot('mearm'); r.collision; r.undersides; "
    code += "sys.exit('scipy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "size", [(0.3, 0.3, 1.5e-7), (1.0, 1.0, 5e-7), (10.0, 10.0, 5e-6), (0.3, 1.5e-7, 1.5e-7)]
)
def test_nothing_is_inside_what_is_all_but_flat(size: tuple[float, float, float]) -> None:
    box = np.array(list(product((-0.5, 0.5), repeat=3)))
    thin, cube = hull_as_it_is(box * size), hull_as_it_is(0.03 * box)
    assert not _inside(cube, thin)
    assert np.ptp(thin.corners, axis=0) == pytest.approx(size)
    assert _inside(hull_as_it_is(0.01 * box), cube)
