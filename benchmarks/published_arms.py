"""Arms as others publish them: ``python -m benchmarks.published_arms FILE_OR_FOLDER…`` tries robot files.

Each file is loaded as it is, and poses of random configurations are solved. The table says how each arm
is solved, whether the configuration that made the pose is listed, and how exact the solutions are. The files
come out of packages (example-robot-data, rtb-data, robot_descriptions …); names of armctl's own arms do, too.

``--special SHARE``: so many of the configurations have some joints at a limit or at a multiple of 90°, where
most singular poses are. Where a joint may turn there without moving the tool, no list can hold all: such an
answer is good if it says so (``complete`` is false).
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from armctl import Robot, load_robot
from armctl.arrays import FloatArray
from armctl.errors import ArmctlError

_ENDINGS = (".urdf", ".xacro", ".toml")
_SAME = 1e-6
"""how far the listed solution may be from the configuration that made the pose (of exp(iθ))"""
_TWICE = 0.5e-6
"""how near to each other two solutions are one [rad]; steps of 1e-6 are the finest that a sweep lists"""
_STEP = math.radians(1.0)
"""of a free joint, where there is one: the configuration lies between two steps"""


@dataclass(frozen=True, slots=True)
class Result:
    """One file."""

    name: str
    joints: int = 0
    family: str = ""
    complete: bool = False
    listed: int = 0
    told: int = 0
    """not listed, and the answer says that it is not complete"""
    faulty: int = 0
    """answers with a solution twice, or one outside the limits"""
    poses: int = 0
    residual_m: float = 0.0
    residual_rad: float = 0.0
    median_ms: float = 0.0
    refusal: str = ""

    @property
    def row(self) -> str:
        """As a line of a markdown table."""
        if self.refusal:
            return f"| {self.name} | – | refused: {self.refusal} | – | – | – |"
        share = f"{100 * self.listed / self.poses:.1f} %" + (f", {self.told} told" if self.told else "")
        share += f", **{self.faulty} faulty**" if self.faulty else ""
        closed = "closed form" if self.complete else "search"
        exact = f"{self.residual_m:.0e} m, {self.residual_rad:.0e} rad"
        return (
            f"| {self.name} | {self.joints} | {self.family}: {closed} | {share} | {exact} | "
            f"{self.median_ms:.2g} |"
        )


def files(paths: Iterable[str]) -> Iterator[str]:
    """Robot files, and those in folders; a tool link behind a ``#`` stays."""
    for text in paths:
        path = Path(text)
        if path.is_dir():
            yield from sorted(str(one) for one in path.rglob("*") if one.suffix in _ENDINGS)
        else:
            yield text


def configurations(robot: Robot, poses: int, special: float, rng: np.random.Generator) -> FloatArray:
    """Random joint angles (poses, n) [rad], a share of them at limits and at multiples of 90°.

    A palletiser limits angles between its arms, too: what breaks such a limit is drawn again.
    """
    low, high = robot.limits.T
    q = rng.uniform(low, high, (poses, robot.n))
    quarter = np.clip(np.round(q / (math.pi / 2)) * (math.pi / 2), low, high)
    edge = np.where(rng.random(q.shape) < 0.5, low, high)
    bent = np.where(rng.random(q.shape) < 0.5, quarter, edge)
    chosen = (rng.random((poses, 1)) < special) & (rng.random(q.shape) < 0.5)
    q = np.where(chosen, bent, q)
    inside = q[robot.chain.keeps_turns(q)]
    missing = poses - len(inside)
    return inside if not missing else np.vstack([inside, configurations(robot, missing, special, rng)])


def tried(name: str, poses: int, special: float = 0.0) -> Result:
    """Load a file and solve poses of random configurations."""
    short = Path(name.split("#")[0]).name + ("#" + name.split("#")[1] if "#" in name else "")
    try:
        robot = load_robot(name)
        solver = robot.inverse_kinematics
    except ArmctlError as refusal:
        return Result(short, refusal=str(refusal).replace("|", "/")[-160:])
    rng = np.random.default_rng(1)
    listed = told = faulty = 0
    residual_m = residual_rad = 0.0
    times: list[float] = []
    for q in configurations(robot, poses, special, rng):
        T = robot.forward(q)
        began = time.perf_counter()
        found = robot.inverse(T[:3, 3], rotation=T[:3, :3], step=_STEP)
        times.append(time.perf_counter() - began)
        is_listed = _is_listed(robot, found.q, q, found.free_joint)
        listed += is_listed
        told += not is_listed and not found.complete
        faulty += _is_faulty(robot, found.q)
        residual_m = max(residual_m, float(found.residual_m.max(initial=0.0)))
        residual_rad = max(residual_rad, float(found.residual_rad.max(initial=0.0)))
    return Result(
        short, robot.n, solver.family, solver.complete, listed, told, faulty, poses, residual_m, residual_rad,
        1000.0 * float(np.median(times)),
    )  # fmt: skip


def _is_listed(robot: Robot, found: FloatArray, q: FloatArray, free: int | None) -> bool:
    if not len(found):
        return False
    away = np.abs(np.exp(1j * found) - np.exp(1j * q)).max(axis=1)
    if free is None:
        return bool(away.min() < _SAME)
    near = np.abs(np.remainder(found[:, free] - q[free] + math.pi, math.tau) - math.pi) <= _STEP
    return bool(near.any() and away[near].min() < 20.0 * _STEP)


def _is_faulty(robot: Robot, found: FloatArray) -> bool:
    low, high = robot.limits.T
    if ((found < low - _SAME) | (found > high + _SAME)).any() or not robot.chain.keeps_turns(found).all():
        return True
    return len(found) > 1 and bool(cKDTree(found).query_pairs(_TWICE, p=np.inf))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.published_arms", description=__doc__)
    parser.add_argument("paths", nargs="+")
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--special", type=float, default=0.0, help="share at limits and quarter turns")
    options = parser.parse_args()
    print("| file | joints | solved as | listed | residual | median ms |\n|---|--:|---|--:|---|--:|")
    good = 0
    for name in files(options.paths):
        result = tried(name, options.poses, options.special)
        good += result.complete and not result.faulty and result.listed + result.told == result.poses
        print(result.row, flush=True)
    print(f"\n{good} files: closed form, every configuration listed, or told why not")
    return 0


if __name__ == "__main__":
    sys.exit(main())
