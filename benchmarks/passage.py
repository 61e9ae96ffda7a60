"""How much of armctl one warm ``Arm.go`` passes through: ``python -m benchmarks.passage [--list]``.

Counted are the distinct functions and methods of the package, with the files that hold them, that are called
on any thread between the call of ``Arm.go`` and its return: its own way, and what the controller does at each
tick meanwhile. The board is the simulated one, behind its own pty in this process; its code counts, too.
Lambdas, comprehensions and generator expressions are told apart: Python 3.12 has most of them inside their
function. Generated methods (dataclasses) do not count, nor does what was called before and still runs (the
threads' loops). The first go has filled every cache. What happens at a tick may differ by some functions
from run to run: take the least of a few.

Two parts of it are told, too, without the simulated board: the arm's side, from where the command is handed
over to it, and what a tick in the middle of a motion passes through.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from collections import defaultdict
from pathlib import Path
from types import CodeType, FrameType

import armctl
from armctl.process.host import Host
from armctl.protocol import Connect

PACKAGE = Path(armctl.__file__).parent
FIRST, SECOND = (200.0, 0.0, 100.0), (180.0, 60.0, 140.0)
"""tool points of uzuner [mm]"""
_UNDER_WAY_S, _TICKS_S = 0.5, 0.5
"""after so long a motion is looked at, and for so long"""
_BOARD, _ARM = "the board", "the arm"


class Passage:
    """A profiling function that keeps the code that is called while ``on``, by who calls it."""

    def __init__(self) -> None:
        self.on = False
        self.codes: dict[str, dict[int, CodeType]] = defaultdict(dict)

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        if self.on and event == "call":
            self.codes[_side(frame)][id(frame.f_code)] = frame.f_code

    def functions(self, *sides: str) -> dict[str, list[str]]:
        """By file, relative to the package: the qualified names of what was called, by anybody or by some."""
        by_file: dict[str, list[str]] = defaultdict(list)
        codes = [one for side in sides or self.codes for one in self.codes[side].values()]
        for file, _, name in {(one.co_filename, one.co_firstlineno, one.co_qualname) for one in codes}:
            if Path(file).is_relative_to(PACKAGE):
                by_file[Path(file).relative_to(PACKAGE).as_posix()].append(name)
        return {name: sorted(by_file[name]) for name in sorted(by_file)}


def _side(frame: FrameType | None) -> str:
    """Whose a call is: the board's, the arm's or the client's."""
    thread = threading.current_thread()
    if thread.name.startswith("simulated board"):
        return _BOARD
    if thread is not threading.main_thread():
        return _ARM
    while frame is not None:
        if frame.f_code is Host.submit.__code__:
            return _ARM
        frame = frame.f_back
    return "the client"


def measured() -> tuple[Passage, Passage]:
    """What the second of two goes passes through, and a tick of the one after it."""
    go, tick = Passage(), Passage()

    def both(frame: FrameType, event: str, arg: object) -> None:
        go(frame, event, arg)
        tick(frame, event, arg)

    threading.setprofile(both)
    sys.setprofile(both)
    try:
        with armctl.Arm(Host(armctl.load_robot("uzuner"))) as arm:  # here, not in a process of its own
            arm.link.submit(Connect("sim")).result()
            arm.enable()
            arm.go(*FIRST, choose="least-rotation")
            go.on = True
            arm.go(*SECOND, choose="least-rotation")
            go.on = False
            motion = arm.go(*FIRST, choose="least-rotation", duration_s=3.0, wait=False)
            time.sleep(_UNDER_WAY_S)
            tick.on = True
            time.sleep(_TICKS_S)
            tick.on = False
            motion.result()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return go, tick


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.passage", description=__doc__)
    parser.add_argument("--list", action="store_true", help="name the functions, file by file")
    options = parser.parse_args()
    go, tick = measured()
    found = go.functions()
    if options.list:
        for name, functions in _named(found).items():
            print(f"{name} ({len(functions)})", *(f"    {one}" for one in functions), sep="\n")
    print(_counted(found))
    print(f"with lambdas and comprehensions: {_total(found)}")
    print(f"the arm's side: {_counted(go.functions(_ARM))}; a tick: {_counted(tick.functions(_ARM))}")


def _named(by_file: dict[str, list[str]]) -> dict[str, list[str]]:
    return {name: [one for one in names if not one.endswith(">")] for name, names in by_file.items()}


def _counted(by_file: dict[str, list[str]]) -> str:
    return f"functions {_total(_named(by_file))}, files {len(by_file)}"


def _total(by_file: dict[str, list[str]]) -> int:
    return sum(map(len, by_file.values()))


if __name__ == "__main__":
    main()
