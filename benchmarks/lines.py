"""Random lines of the tool: ``python -m benchmarks.lines [FILE_OR_NAME…]`` plans them on robot files.

Without an argument: all shipped arms, and four of seven joints. Each line is 100 mm long and begins at a
random configuration that stands clear. The table gives the processor time of those that can be planned and of
those that are refused, the sentence included.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.errors import MotionRefusedError, UnreachableError
from armctl.motion import plan_line
from armctl.motion.clearance import stands_clear
from armctl.robot import Robot, shipped_robots

_LENGTH_M = 0.1
_MOST_TRIES = 10_000
"""random configurations that are looked at for one that stands clear"""

# a [mm], alpha [°], d [mm], lower and upper limit [°] of each joint, as the makers give them;
# a first row without a range has no joint
Row = tuple[float, float, float, float, float]
SEVEN: dict[str, tuple[str, tuple[Row, ...]]] = {
    "panda": (
        "modified",
        (
            (0, 0, 333, -166, 166), (0, -90, 0, -101, 101), (0, 90, 316, -166, 166), (82.5, 90, 0, -176, -4),
            (-82.5, -90, 384, -166, 166), (0, 90, 0, -1, 215), (88, 90, 107, -166, 166),
        ),
    ),
    "iiwa": (
        "standard",
        (
            (0, -90, 340, -170, 170), (0, 90, 0, -120, 120), (0, 90, 400, -170, 170), (0, -90, 0, -120, 120),
            (0, -90, 400, -170, 170), (0, 90, 0, -120, 120), (0, 0, 126, -175, 175),
        ),
    ),
    "xarm7": (
        "modified",
        (
            (0, 0, 267, -360, 360), (0, -90, 0, -118, 120), (0, 90, 293, -360, 360), (52.5, 90, 0, -11, 225),
            (77.5, 90, 342.5, -360, 360), (0, 90, 0, -97, 180), (76, -90, 97, -360, 360),
        ),
    ),
    "gen3": (
        "standard",
        (
            (0, 180, 0, 0, 0),
            (0, 90, -284.8, -179, 179), (0, 90, -11.8, -128, 128), (0, 90, -420.8, -179, 179),
            (0, 90, -12.8, -147, 147), (0, 90, -314.3, -179, 179), (0, 90, 0, -120, 120),
            (0, 180, -167.4, -179, 179),
        ),
    ),
}  # fmt: skip


def seven_joints(name: str) -> Robot:
    """One of ``SEVEN``."""
    convention, rows = SEVEN[name]
    joined = [(low, high) for *_, low, high in rows if low < high]
    lines = [
        f"{{ a_mm = {a}, alpha_deg = {alpha}, d_mm = {d}" + (f', joint = "j{i}" }}' if i else " }")
        for i, (a, alpha, d, *_) in enumerate(rows, 1 + len(joined) - len(rows))
    ]
    joints = [
        f'[[joints]]\nname = "j{i}"\ntitle = "Joint {i}"\nlimit_deg = [{low}, {high}]\n'
        "speed_deg_s = 150\nacceleration_deg_s2 = 600\n"
        for i, (low, high) in enumerate(joined, 1)
    ]
    middle = [round(0.4 * high + 0.6 * low) for low, high in joined]
    poses = "".join(f"{pose} = {middle}\n" for pose in ("home", "rest", "zero"))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.toml"
        file.write_text(
            f'format = 1\nname = "{name}"\ntitle = "{name}"\n\n[dh]\nconvention = "{convention}"\n'
            f"rows = [{', '.join(lines)}]\n\n" + "\n".join(joints) + f"\n[poses]\n{poses}"
        )
        return load_robot(file)


def lines(robot: Robot, count: int, seed: int = 1) -> list[tuple[FloatArray, FloatArray]]:
    """Starts (n,) [rad] that stand clear, and ends (3,) of lines in all directions [m]."""
    rng, found = np.random.default_rng(seed), list[tuple[FloatArray, FloatArray]]()
    for _ in range(_MOST_TRIES):
        q, way = rng.uniform(*robot.limits.T), rng.normal(size=3)
        if stands_clear(robot, q):
            found.append((q, robot.forward(q)[:3, 3] + _LENGTH_M * way / np.linalg.norm(way)))
        if len(found) == count:
            break
    return found


def timed_lines(robot: Robot, count: int) -> tuple[list[float], list[tuple[float, str]]]:
    """Processor time [s] of each line that is planned; of each that is refused, with the sentence."""
    planned, refused = list[float](), list[tuple[float, str]]()
    for k, (q, end) in enumerate(lines(robot, count)):
        if k == 0:  # what is worked out once for an arm
            _tried(robot, q, end)
        began = time.process_time()
        said = _tried(robot, q, end)
        took = time.process_time() - began
        if said:
            refused.append((took, said))
        else:
            planned.append(took)
    return planned, refused


def _tried(robot: Robot, q: FloatArray, end: FloatArray) -> str:
    try:
        plan_line(robot, q, end)
    except (MotionRefusedError, UnreachableError) as refusal:
        return str(refusal)
    return ""


def _row(name: str, planned: list[float], refused: list[float]) -> str:
    def figures(times: list[float]) -> str:
        if not times:
            return "0 | – | – | –"
        half, nearly, most = 1000 * np.quantile(times, [0.5, 0.99, 1.0])
        return f"{len(times)} | {half:.0f} | {nearly:.0f} | {most:.0f}"

    return f"| {name} | {figures(planned)} | {figures(refused)} |"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lines", description=__doc__)
    parser.add_argument("names", nargs="*", help="robot files or names of shipped arms")
    parser.add_argument("--lines", type=int, default=300)
    parser.add_argument("--slowest", type=int, default=0, help="print so many of the slowest refusals, too")
    options = parser.parse_args()
    names: list[str] = options.names or [*shipped_robots(), *SEVEN]
    print("| arm | planned | median ms | p99 | most | refused | median ms | p99 | most |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    for name in names:
        robot = seven_joints(name) if name in SEVEN else load_robot(name).with_body()
        planned, refused = timed_lines(robot, options.lines)
        print(_row(robot.name, planned, [took for took, _ in refused]), flush=True)
        for took, said in sorted(refused, reverse=True)[: options.slowest]:
            print(f"  {1000 * took:.0f} ms: {said}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
