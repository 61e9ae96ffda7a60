"""Arms as others publish them: ``python -m benchmarks.published_arms FILE_OR_FOLDER…`` tries robot files.

Each file is loaded as it is, and poses of random configurations are solved. The table says how each arm
is solved, whether the configuration that made the pose is listed, and how exact the solutions are. The files
come out of packages (example-robot-data, rtb-data, robot_descriptions …); none of them is armctl's.
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

from armctl import Robot, load_robot
from armctl.arrays import FloatArray
from armctl.errors import ArmctlError

_ENDINGS = (".urdf", ".xacro", ".toml")
_SAME = 1e-6
"""how far the listed solution may be from the configuration that made the pose (of exp(iθ))"""
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
        share = f"{100 * self.listed / self.poses:.1f} %"
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


def tried(name: str, poses: int) -> Result:
    """Load a file and solve poses of random configurations."""
    short = Path(name.split("#")[0]).name + ("#" + name.split("#")[1] if "#" in name else "")
    try:
        robot = load_robot(name)
        solver = robot.inverse_kinematics
    except ArmctlError as refusal:
        return Result(short, refusal=str(refusal).replace("|", "/")[-160:])
    rng = np.random.default_rng(1)
    listed, residual_m, residual_rad = 0, 0.0, 0.0
    times: list[float] = []
    for q in rng.uniform(*robot.limits.T, (poses, robot.n)):
        T = robot.forward(q)
        began = time.perf_counter()
        found = robot.inverse(T[:3, 3], rotation=T[:3, :3], step=_STEP)
        times.append(time.perf_counter() - began)
        listed += _is_listed(robot, found.q, q, found.free_joint)
        residual_m = max(residual_m, float(found.residual_m.max(initial=0.0)))
        residual_rad = max(residual_rad, float(found.residual_rad.max(initial=0.0)))
    return Result(
        short, robot.n, solver.family, solver.complete, listed, poses, residual_m, residual_rad,
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


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.published_arms", description=__doc__)
    parser.add_argument("paths", nargs="+")
    parser.add_argument("--poses", type=int, default=1000)
    options = parser.parse_args()
    print("| file | joints | solved as | listed | residual | median ms |\n|---|--:|---|--:|---|--:|")
    good = 0
    for name in files(options.paths):
        result = tried(name, options.poses)
        good += result.complete and result.listed == result.poses
        print(result.row, flush=True)
    print(f"\n{good} files: closed form, every configuration listed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
