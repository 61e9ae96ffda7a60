"""``make bench``: every goal of speed in one run, as a table and as JSON."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks import machine
from benchmarks.measure import FULL, QUICK, Effort
from benchmarks.row import Row
from benchmarks.table import table, with_table
from benchmarks.works import forward, least_rotation, off_manifold, path_speed, pose, sweep, whole_pose

PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
RESULTS = Path(__file__).parent / "results"
WORKS = {
    "forward": forward,
    "sweep": sweep,
    "least_rotation": least_rotation,
    "pose": pose,
    "whole_pose": whole_pose,
    "off_manifold": off_manifold,
    "path_speed": path_speed,
}


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="a tenth of the poses and of the time: for a first look"
    )
    parser.add_argument("--docs", action="store_true", help="put the table into docs/speed.md")
    parser.add_argument("--only", choices=WORKS, help="one piece of work")
    options = parser.parse_args()
    names = [options.only] if options.only else list(WORKS)
    rows = list(measured(names, QUICK if options.quick else FULL))
    facts: dict[str, str | int] = machine.facts() | {"run": "quick" if options.quick else "full"}
    print(table(rows), "", machine.sentence(facts), sep="\n")
    if not options.only:
        write(rows, facts)
    if options.docs:
        PAGE.write_text(with_table(PAGE.read_text(), f"{machine.sentence(facts)}\n\n{table(rows)}"))
    missed = [row for row in rows if row.met is False]
    for row in missed:
        print(f"missed: {row.verdict}", file=sys.stderr)
    return 1 if missed else 0


def measured(names: list[str], effort: Effort) -> Iterator[Row]:
    """Row after row, with a word on the terminal while it goes."""
    for name in names:
        start = time.perf_counter()
        print(f"{name} …", end=" ", flush=True, file=sys.stderr)
        yield from WORKS[name].rows(effort)
        print(f"{time.perf_counter() - start:.0f} s", file=sys.stderr)


def write(rows: list[Row], facts: dict[str, str | int]) -> None:
    """Keep the table beside the JSON."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "latest.md").write_text(f"{table(rows)}\n\n{machine.sentence(facts)}\n")
    content = {"machine": facts, "rows": [row.as_json() for row in rows]}
    (RESULTS / "latest.json").write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n")
    print(f"written to {RESULTS / 'latest.md'} and latest.json")


if __name__ == "__main__":
    sys.exit(main())
