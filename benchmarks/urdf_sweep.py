"""Robot files as others publish them: ``python -m benchmarks.urdf_sweep FOLDER…`` loads every one there.

Each URDF and xacro file below the folders is loaded once, within ``--seconds``. The tables say how many load,
as what, how long that takes, and why the others are refused. ``--each`` lists every file with its joints, its
tool link, and what is doubted or left out.
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import statistics
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.pool import Pool
from pathlib import Path

from armctl import load_robot
from armctl.errors import ArmctlError, UnclearArmError

_ENDINGS = (".urdf", ".xacro")
_LONG = 100
"""characters of a reason"""


@dataclass(frozen=True, slots=True)
class Result:
    """One file."""

    name: str
    outcome: str
    """``loaded``, ``asked``, ``refused``, ``too long`` or ``crashed``"""
    seconds: float
    said: str = ""
    """the tool link and what was left out; or the refusal"""
    joints: int = 0
    doubted: bool = False
    linkage: bool = False

    @property
    def row(self) -> str:
        """As a line of a markdown table."""
        said = self.said.replace("|", "/").replace("\n", " ")
        return f"| {self.name} | {self.outcome} | {self.joints or '–'} | {said} | {1000 * self.seconds:.0f} |"

    @property
    def reason(self) -> str:
        """The refusal without its names and numbers."""
        text = re.sub(
            r"^\S*/\S*: |\b\S+\.(?i:xacro|urdf|yaml|yml|xml)\b(, line \d+)?: |line \d+: ", "", self.said
        )
        text = re.sub(r"\"[^\"]*\"|'[^']*'|\$\([^)]*\)|\$\{[^}]*\}", "…", text)
        text = re.sub(r"-?\d+(\.\d+)?(e[-+]?\d+)?|\S*/\S*", "…", text)
        text = re.split("the tool: |between |it has |; ", text)[0]
        text = re.sub(r"\b(macros?) .*", r"\1 …", text)
        return text[:_LONG]


def files(folders: Iterable[Path]) -> Iterator[tuple[str, Path]]:
    """The robot files below folders, with the names by which they are listed."""
    for folder in folders:
        if folder.is_file():
            yield folder.name, folder
            continue
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in _ENDINGS and path.is_file():
                yield str(path.relative_to(folder)), path


def loaded(name: str, path: Path) -> Result:
    """Load one file."""
    start = time.perf_counter()
    try:
        robot = load_robot(path)
    except ArmctlError as refusal:
        asked = isinstance(refusal, UnclearArmError)
        said = str(refusal).replace(f"{path.parent}/", "")
        return Result(name, "asked" if asked else "refused", time.perf_counter() - start, said)
    except Exception as crash:
        said = f"{type(crash).__name__}: {crash}"
        return Result(name, "crashed", time.perf_counter() - start, said)
    seconds = time.perf_counter() - start
    doubted = any("may be a jaw" in text for text in robot.assumed)
    said = robot.source.rpartition(" to ")[2]
    if robot.left_out:
        said += f"; left out: {', '.join(robot.left_out)}"
    linkage = robot.chain.coupling is not None
    return Result(name, "loaded", seconds, said + "; doubted" * doubted, robot.n, doubted, linkage)


def results(found: Iterable[tuple[str, Path]], limit: float) -> Iterator[Result]:
    """Load files one after another in a process of their own, which ends where one takes too long."""
    pool: Pool | None = None
    for name, path in found:
        pool = pool or multiprocessing.get_context("spawn").Pool(1)
        try:
            yield pool.apply_async(loaded, (name, path)).get(limit)
        except multiprocessing.TimeoutError:
            pool.terminate()
            pool = None
            yield Result(name, "too long", limit, f"more than {limit:g} s")
    if pool is not None:
        pool.terminate()


def summary(all_of: list[Result]) -> Iterator[str]:
    """The tables, line by line."""
    yield "| outcome | files | median ms | longest ms |\n|---|--:|--:|--:|"
    by_outcome: defaultdict[str, list[Result]] = defaultdict(list)
    for one in all_of:
        by_outcome[one.outcome].append(one)
    for outcome, some in sorted(by_outcome.items(), key=lambda item: -len(item[1])):
        times = [1000 * one.seconds for one in some]
        yield f"| {outcome} | {len(some)} | {statistics.median(times):.0f} | {max(times):.0f} |"
    arms = by_outcome["loaded"]
    yield "\n| joints | files | rods keep the hand level | last joint doubted |\n|--:|--:|--:|--:|"
    for joints, count in sorted(Counter(one.joints for one in arms).items()):
        some = [one for one in arms if one.joints == joints]
        linkages, doubted = sum(one.linkage for one in some), sum(one.doubted for one in some)
        yield f"| {joints} | {count} | {linkages or ''} | {doubted or ''} |"
    yield "\n| not loaded, because | files | one of them |\n|---|--:|---|"
    others = [one for one in all_of if one.outcome != "loaded"]
    for reason, count in Counter(one.reason for one in others).most_common():
        one = next(other for other in others if other.reason == reason)
        yield f"| {one.outcome}: {reason.replace('|', '/')} | {count} | {one.name} |"


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.urdf_sweep", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--seconds", type=float, default=30.0, help="for one file, at most")
    parser.add_argument("--each", action="store_true", help="a line for each file, too")
    options = parser.parse_args()
    all_of: list[Result] = []
    if options.each:
        print("| file | outcome | joints | tool | ms |\n|---|---|--:|---|--:|")
    for one in results(files(options.folders), options.seconds):
        all_of.append(one)
        if options.each:
            print(one.row, flush=True)
    print(*summary(all_of), sep="\n")
    return 1 if any(one.outcome == "crashed" for one in all_of) else 0


if __name__ == "__main__":
    sys.exit(main())
