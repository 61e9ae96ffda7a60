"""Self-collisions against the triangles: ``python -m benchmarks.self_collisions FILE…`` tries robot files.

Random motions of the joints begin where no links cut each other. Each is judged by the pre-flight, and by
FCL (python-fcl) on the whole meshes of the links at many places. Neighbours do not count, nor do links that
cut each other in the home or the rest pose. The table counts motions that are missed (the meshes cut each
other, and the pre-flight finds nothing) and false ones (the meshes are apart everywhere, and it refuses).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from copy import copy
from importlib import import_module
from itertools import combinations
from typing import Any, Self

import numpy as np

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.kinematics.frames import LinkFrames
from armctl.motion import PointToPoint, preflight
from armctl.robot import Robot
from armctl.robot.body.meshes import ArmSolids

_TURN = np.radians(0.5)
"""no joint turns farther from one place that is looked at to the next"""
_EXAMPLES = 3


class Meshes:
    """The whole meshes of an arm's links."""

    def __init__(self, robot: Robot, triangles: Mapping[int, FloatArray]) -> None:
        """``triangles`` (t, 3, 3) [m] of each link (-1: the base), in its frame."""
        self.robot, self._fcl = robot, import_module("fcl")
        self.models: dict[int, Any] = {}
        self.balls: dict[int, tuple[FloatArray, float]] = {}
        """round each link: middle (3,) in its frame, and radius [m]"""
        self.take(triangles)

    def take(self, triangles: Mapping[int, FloatArray]) -> None:
        """Put these in the place of what the links had, and find the pairs anew."""
        for link, one in triangles.items():
            corners = one.reshape(-1, 3)
            middle = corners.mean(axis=0)
            self.models[link] = self._model(one)
            self.balls[link] = middle, float(np.linalg.norm(corners - middle, axis=1).max())
        self.pairs = [(a, b) for a, b in combinations(sorted(self.models), 2) if b - a > 1]
        resting = {pair for name in ("home", "rest") for pair in self.cut(self.robot.pose(name)[None])}
        self.pairs = [pair for pair in self.pairs if pair not in resting]

    def changed(self, triangles: Mapping[int, FloatArray]) -> Self:
        """The same with other triangles of some links."""
        other = copy(self)
        other.models, other.balls = self.models.copy(), self.balls.copy()
        other.take(triangles)
        return other

    @classmethod
    def of_shapes(cls, robot: Robot) -> Self:
        """Those of the arm's own file."""
        arm, corners = ArmSolids(), dict[int, list[FloatArray]]()
        for shape in robot.shapes:
            solid = arm.solid_of(shape)
            corners.setdefault(shape.link, []).append(solid.vertices[solid.faces])
        return cls(robot, {link: np.concatenate(found) for link, found in corners.items()})

    def _model(self, triangles: FloatArray) -> Any:
        model = self._fcl.BVHModel()
        model.beginModel(len(triangles), 3 * len(triangles))
        model.addSubModel(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
        model.endModel()
        return model

    def cut(self, q: FloatArray) -> set[tuple[int, int]]:
        """Pairs of links that cut each other at any of the configurations (m, n) [rad]."""
        links, found = LinkFrames.at(self.robot.chain, q), set[tuple[int, int]]()
        middles = {link: links.place(link, one[None])[:, 0] for link, (one, _) in self.balls.items()}
        for a, b in self.pairs:
            apart = np.linalg.norm(middles[a] - middles[b], axis=0)
            near = np.flatnonzero(apart <= self.balls[a][1] + self.balls[b][1])
            R, origin = links.relative(np.full(len(near), a), np.full(len(near), b), near)
            if any(self._cuts(a, b, *pose) for pose in zip(R, origin, strict=True)):
                found.add((a, b))
        return found

    def _cuts(self, a: int, b: int, R: FloatArray, origin: FloatArray) -> bool:
        fcl = self._fcl
        one = fcl.CollisionObject(self.models[a], fcl.Transform())
        other = fcl.CollisionObject(self.models[b], fcl.Transform(R, origin))
        return bool(fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()))


def random_ends(robot: Robot, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Where a motion of the joints begins and ends (n,) [rad]."""
    a, b = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (2, robot.n))
    return a, a + rng.choice([0.2, 1.0]) * (b - a)  # short ones, too


def places_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Places (m, n) [rad] on the way, so near to each other that nothing is missed."""
    places = int(np.ceil(np.abs(b - a).max() / _TURN)) + 1
    return a + np.linspace(0.0, 1.0, places)[:, None] * (b - a)


def tried(name: str, motions: int, seed: int) -> str:
    """A line of the table."""
    robot = load_robot(name).with_body()
    meshes, rng = Meshes.of_shapes(robot), np.random.default_rng(seed)
    cut = clear = missed = false = 0
    examples: list[str] = []
    spent = 0.0
    while cut + clear < motions:
        a, b = random_ends(robot, rng)
        if meshes.cut(a[None]):
            continue
        motion = PointToPoint.plan(robot, a, b)
        began = time.process_time()
        said = [one for one in preflight(robot, motion) if one.kind == "self-collision"]
        spent += time.process_time() - began
        truly = meshes.cut(places_between(a, b))
        cut, clear = cut + bool(truly), clear + (not truly)
        missed, false = missed + (bool(truly) and not said), false + (not truly and bool(said))
        if bool(truly) != bool(said) and len(examples) < _EXAMPLES:
            what = str(said[0]) if said else f"links {sorted(truly)}"
            examples.append(f"  {a.round(4).tolist()} → {b.round(4).tolist()}: {what}")
    row = (
        f"| {robot.name} | {clear} | {false} ({100 * false / max(clear, 1):.1f} %) | {cut} | {missed} | "
        f"{1000 * spent / motions:.0f} |"
    )
    return "\n".join([row, *examples])


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.self_collisions", description=__doc__)
    parser.add_argument("names", nargs="+", help="robot files with meshes")
    parser.add_argument("--motions", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print("| arm | clear motions | refused all the same | motions that cut | missed | pre-flight ms |")
    print("|---|--:|--:|--:|--:|--:|")
    for name in options.names:
        print(tried(name, options.motions, options.seed), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
