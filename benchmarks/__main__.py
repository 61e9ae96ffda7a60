"""``make bench``: every ratio in one run, as a table and as JSON."""

from __future__ import annotations

import json
import platform
import sys
from pathlib import Path

import numpy as np
from benchmarks.forward import forward_ratios
from benchmarks.measure import Ratio
from benchmarks.sweep import sweep_ratios

from armctl import load_robot

RESULTS = Path(__file__).parent / "results"


def main() -> int:
    robot = load_robot("uzuner")
    ratios = [*sweep_ratios(robot), *forward_ratios(robot)]
    print(table(ratios))
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "kinematics.json"
    facts = {"python": platform.python_version(), "numpy": np.__version__, "machine": platform.machine()}
    path.write_text(json.dumps(facts | {"ratios": [ratio.as_json() for ratio in ratios]}, indent=2) + "\n")
    print(f"written to {path}")
    missed = [ratio.work for ratio in ratios if ratio.goal is not None and ratio.ratio < ratio.goal]
    if missed:
        print(f"below the goal: {', '.join(missed)}", file=sys.stderr)
    return 1 if missed else 0


def table(ratios: list[Ratio]) -> str:
    lines = [f"{'work':46} {'plain µs':>12} {'armctl µs':>12} {'ratio':>8} {'goal':>6}"]
    for r in ratios:
        goal = "–" if r.goal is None else f"{r.goal:g}"
        lines.append(f"{r.work:46} {r.plain_us:12.3f} {r.armctl_us:12.3f} {r.ratio:8.1f} {goal:>6}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
