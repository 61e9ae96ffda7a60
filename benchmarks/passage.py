"""How much of armctl one warm ``Arm.go`` passes through: ``python -m benchmarks.passage [--list]``.

Counted are the distinct functions and methods of the package, with the files that hold them, that are called
on any thread between the call of ``Arm.go`` and its return: its own way, and what the controller does at each
tick meanwhile. The board is the simulated one, behind its own pty in this process; its code counts, too.
Lambdas, comprehensions and generator expressions are told apart: Python 3.12 has most of them inside their
function. Generated methods (dataclasses) do not count, nor does what was called before and still runs (the
threads' loops). The first go has filled every cache. What happens at a tick may differ by some functions
from run to run: take the least of a few.
"""

from __future__ import annotations

import argparse
import sys
import threading
from collections import defaultdict
from pathlib import Path
from types import CodeType, FrameType

import armctl
from armctl.process.host import Host
from armctl.protocol import Connect

PACKAGE = Path(armctl.__file__).parent
FIRST, SECOND = (200.0, 0.0, 100.0), (180.0, 60.0, 140.0)
"""tool points of uzuner [mm]"""


class Passage:
    """A profiling function that keeps the code that is called while ``on``."""

    def __init__(self) -> None:
        self.on = False
        self.codes: dict[int, CodeType] = {}

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        if self.on and event == "call":
            self.codes[id(frame.f_code)] = frame.f_code

    def functions(self) -> dict[str, list[str]]:
        """By file, relative to the package: the qualified names of what was called."""
        by_file: dict[str, list[str]] = defaultdict(list)
        codes = self.codes.values()
        for file, _, name in {(one.co_filename, one.co_firstlineno, one.co_qualname) for one in codes}:
            if Path(file).is_relative_to(PACKAGE):
                by_file[Path(file).relative_to(PACKAGE).as_posix()].append(name)
        return {name: sorted(by_file[name]) for name in sorted(by_file)}


def measured() -> dict[str, list[str]]:
    """What the second of two goes passes through."""
    passage = Passage()
    threading.setprofile(passage)
    sys.setprofile(passage)
    try:
        with armctl.Arm(Host(armctl.load_robot("uzuner"))) as arm:  # here, not in a process of its own
            arm.link.submit(Connect("sim")).result()
            arm.enable()
            arm.go(*FIRST, choose="least-rotation")
            passage.on = True
            arm.go(*SECOND, choose="least-rotation")
            passage.on = False
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return passage.functions()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.passage", description=__doc__)
    parser.add_argument("--list", action="store_true", help="name the functions, file by file")
    options = parser.parse_args()
    found = measured()
    named = {name: [one for one in names if not one.endswith(">")] for name, names in found.items()}
    if options.list:
        for name, functions in named.items():
            print(f"{name} ({len(functions)})", *(f"    {one}" for one in functions), sep="\n")
    print(f"functions {_total(named)}, files {len(found)}")
    print(f"with lambdas and comprehensions: {_total(found)}")


def _total(by_file: dict[str, list[str]]) -> int:
    return sum(map(len, by_file.values()))


if __name__ == "__main__":
    main()
