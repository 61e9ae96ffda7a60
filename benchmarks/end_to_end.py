"""``make bench-live``: what a user waits for, with the product running. See docs/speed.md.

A console is served as a user starts it, on a simulated Maestro in a process of its own that stamps every
setpoint. Pages without a browser press its buttons; the same is measured with the arm in the page server's
own process, as it was once. What is seen, is seen on the line to the board.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import math
import os
import random
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from benchmarks import machine
from benchmarks.live.load import BOUT_S
from benchmarks.live.page import Page
from benchmarks.live.wire import ROBOT, US_PER_QUARTER, Frame, Wire
from benchmarks.table import with_table

from armctl import Arm, load_robot
from armctl.program import MoveStep, Program, encode_program, write_csv

PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
MARK = "make bench-live"
START, OPEN = "`armctl serve` → the page answers", "page opened → all of it is there"
STOP_BY, GO = "STOP by {}, {} → first slower setpoint", "Go, {} → first setpoint"
GO_LONG = f"the same, a blended program of {10_000:,} steps, checked before"
QUIET, LOADED = "quiet", "under load"
GOALS = {
    "^STOP .* quiet": {"p99": 30.0},
    "^STOP by (the page|a program), .* load": {"p99": 50.0, "worst": 100.0},
    "^(Go|the same)": {"p99": 60.0},
    "^`armctl": {"median": 1500.0},
    "^page": {"p99": 3000.0},
}
_PSS = re.compile(r"^Pss: +([0-9]+)", re.MULTILINE)
_TROUBLE = re.compile(r"Traceback|ERROR|WARNING (?!STOP)")
_GAP_S = 0.06
_POLL_S = 0.01
_SETTLED_S = 1.0
"""a page that has just come knows by then that it operates: until then its buttons are disabled"""
_PREPARED_S = 3.0
"""what is done once, beside the first page, is done by then"""
_STILL_S = 0.15
"""no setpoint for so long: the arm stands"""
_PATIENCE_S, _CHECK_S = 30.0, 300.0
_PRESSES = 10
"""of a button that is refused, in that time"""
_BASE = 0
"""the channel, and the joint, that swings"""
_SWING_DEG = 95.0
_LONG = 10_000


class _Arm:
    """The joint that swings, in the words of the line."""

    robot = load_robot(ROBOT)
    outputs = robot.outputs
    quarters_per_rad = outputs.per_rad[_BASE] / US_PER_QUARTER
    speed = float(robot.speed_limits[_BASE])
    way_to_stand = speed**2 / (2 * float(robot.acceleration_limits[_BASE])) * quarters_per_rad
    """[quarter µs] from full speed"""
    swing = quarters_per_rad * math.radians(_SWING_DEG)
    middle = outputs.zero[_BASE] / US_PER_QUARTER


def _program(name: str, poses: Sequence[tuple[float, ...]], *, blend_mm: float = 0.0) -> Program:
    law = "cubic" if blend_mm else "trapezoid"
    return Program(
        robot=ROBOT,
        name=name,
        steps=tuple(MoveStep(joints_deg=pose, profile=law, blend_mm=blend_mm) for pose in poses),
    )


_ROUND = [(0.0, 60.0, -60.0, 20.0, 0.0), (30.0, 75.0, -45.0, 0.0, 20.0), (-20.0, 80.0, -70.0, 30.0, -20.0)]
SWING = _program("swing", [(side * _SWING_DEG, 90.0, 0.0, 0.0, 0.0) for side in (1, -1)])
BLENDED = _program("blended", _ROUND, blend_mm=15.0)
LONG = _program("long", list(itertools.islice(itertools.cycle(_ROUND), _LONG)), blend_mm=15.0)
LARGEST = write_csv(_program("largest", [*itertools.islice(itertools.cycle(_ROUND), 19_000)]), _Arm.robot)
REFUSED = LARGEST.encode() + b"this,is,no,step\n"
"""as large as a file may be, and refused in its last line: the list stays as it is"""


@dataclass
class Times:
    """Seconds of many tries."""

    what: str
    seconds: list[float] = field(default_factory=list[float])
    halted: int = 0
    """stops that the machine itself made: no tick came for so long that the arm stood already"""

    def figures(self) -> dict[str, float]:
        """Median, p99 and worst [ms]."""
        ms = sorted(1000 * one for one in self.seconds)
        rank = max(0, math.ceil(0.99 * len(ms)) - 1)
        return {"median": statistics.median(ms), "p99": ms[rank], "worst": ms[-1]}

    @property
    def said(self) -> str:
        """In words."""
        if not self.seconds:
            return "–"
        halted = f", {self.halted} halted before" if self.halted else ""
        return " / ".join(f"{one:.0f}" for one in self.figures().values()) + halted


@dataclass(frozen=True)
class Row:
    """A line of the table."""

    what: str
    said: str
    before: str = "–"
    """the same with the arm in the page server's process"""
    goal: str = "–"
    met: bool | None = None


class Console:
    """A console that is served, and its operator's page."""

    def __init__(self, wire: Wire, server: subprocess.Popen[str], port: int, page: Page) -> None:
        self.wire, self.port, self.page, self.server = wire, port, page, server
        self.arrived: list[Frame] = []

    async def frames(self) -> list[Frame]:
        """All setpoints since ``forget``."""
        self.arrived += self.wire.frames()
        return self.arrived

    def forget(self) -> None:
        """Look at what comes from now on."""
        self.wire.frames()
        self.arrived.clear()

    async def until(
        self, condition: Callable[[list[Frame]], bool], what: str, patience_s: float = _PATIENCE_S
    ) -> list[Frame]:
        """Look every few milliseconds whether something has come to pass on the line."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            if condition(frames := await self.frames()):
                return frames
            await asyncio.sleep(_POLL_S)
        told = self.page.notices()
        raise TimeoutError(f"{what} did not come within {patience_s:g} s; the page says {told}")

    async def put(self, program: Program, text: bytes | None = None) -> None:
        """Upload a program."""
        if text is None:
            await self.page.upload(f"{program.name}.toml", encode_program(program).encode())
        else:
            await self.page.upload(f"{program.name}.csv", text)
        await self.page.wait_for_notice("Uploaded")

    async def checked(self) -> None:
        """Check the program from where the arm stands."""
        await self.page.press("Before it runs", "Check")
        async with asyncio.timeout(_CHECK_S):
            for checks in (True, False):  # the page is written ten times a second
                while self.page.shows("Checking") != checks:
                    await asyncio.sleep(0.02)

    async def go(self) -> float:
        """Press Loop once it can be pressed; seconds until the first setpoint.

        What the page shows is older than what the arm does: a press may be refused, and is then done again.
        """
        await self.page.enabled("Run", "Loop")
        self.forget()
        pressed, again = time.monotonic(), 0
        while True:
            await self.page.enabled("Run", "Loop")
            await self.page.press("Run", "Loop")
            try:
                frames = await self.until(bool, "the first setpoint", _PATIENCE_S / _PRESSES)
            except TimeoutError as nothing:
                again += 1
                _say(f"Loop again: {nothing}")
                if again == _PRESSES:
                    raise
            else:
                return frames[0].at_s - pressed

    async def cruises(self) -> None:
        """Wait until the joint swings at full speed, with room left to stop."""
        await self.until(_cruises, "full speed")

    async def stands(self) -> list[Frame]:
        """Wait until no setpoint comes any more."""
        return await self.until(
            lambda frames: not frames or time.monotonic() - frames[-1].at_s > _STILL_S, "a standstill"
        )


def _cruises(frames: list[Frame]) -> bool:
    if len(frames) < 12:
        return False
    last, before = frames[-1], frames[-6]
    at = last.targets.get(_BASE, 0) - _Arm.middle
    moved = last.targets.get(_BASE, 0) - before.targets.get(_BASE, 0)
    speed = moved / max(last.at_s - before.at_s, 1e-3) / _Arm.quarters_per_rad
    left = _Arm.swing - math.copysign(at, at * moved)
    return abs(speed) > 0.9 * _Arm.speed and left > 0.25 * _Arm.swing


def braking(frames: list[Frame], pressed: float) -> float | None:
    """When [s] the first setpoint came that slows down; None where there is none.

    From full speed the joint stands after a known way: all that comes behind the place where it began to
    slow down is slower. This needs no time stamp but the one that is asked for.
    """
    ends = frames[-1].targets[_BASE]
    moving = [frame for frame in frames if frame.at_s <= pressed][-8:]
    direction = math.copysign(1.0, moving[-1].targets[_BASE] - moving[0].targets[_BASE])
    for frame in frames:
        left = direction * (ends - frame.targets[_BASE])
        if frame.at_s > pressed and left < _Arm.way_to_stand - 2:
            stops_short = direction * (ends - moving[-1].targets[_BASE]) < 0.8 * _Arm.way_to_stand
            return None if stops_short else frame.at_s
    return None


async def stops(console: Console, press: Callable[[], object], times: Times, count: int) -> Times:
    """Let the arm swing, press STOP at some moment; and Go again: its times come back."""
    goes = Times("Go → first setpoint")
    dice = random.Random(1)
    for _ in range(count):
        goes.seconds.append(await console.go())
        await console.cruises()
        await asyncio.sleep(dice.uniform(0.0, 0.1))
        pressed = time.monotonic()
        done = press()
        if asyncio.iscoroutine(done):
            await done
        await asyncio.sleep(_STILL_S)
        slower = braking(await console.stands(), pressed)
        if slower is None:
            times.halted += 1
        else:
            times.seconds.append(slower - pressed)
    return goes


@asynccontextmanager
async def served(wire: Wire, *, split: bool, started: Times, opened: Times) -> AsyncGenerator[Console]:
    """A console on the board, its first page open and the arm enabled."""
    with tempfile.TemporaryDirectory() as folder, socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        module = "armctl" if split else "benchmarks.live.in_process"
        words = ["serve", "--robot", ROBOT, "--port", wire.port, "--no-browser", "--no-token"]
        log = Path(folder) / "log"
        begin = time.monotonic()
        with log.open("w") as file:
            server = subprocess.Popen(
                [sys.executable, "-m", module, *words, "--http-port", str(port)],
                stdout=file, stderr=file, text=True,
                env=os.environ | {"XDG_DATA_HOME": folder, "XDG_STATE_HOME": folder},
            )  # fmt: skip
        try:
            while not _answers(port):
                if server.poll() is not None:
                    raise RuntimeError(log.read_text())
                await asyncio.sleep(0.005)
            started.seconds.append(time.monotonic() - begin)
            begin = time.monotonic()
            page = await Page.open(port)
            opened.seconds.append(time.monotonic() - begin)
            console = Console(wire, server, port, page)
            while "connected to" not in log.read_text():
                await asyncio.sleep(0.05)
            await asyncio.sleep(_SETTLED_S)
            await page.do("enable")
            await console.until(bool, "Enable")
            yield console
            await page.close()
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(30)
            trouble = [line for line in log.read_text().splitlines() if _TROUBLE.search(line)]
            print(*trouble, sep="\n", end="\n" * bool(trouble), file=sys.stderr)


def _answers(port: int) -> bool:
    with suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=1) as answer:
        return answer.status == 200
    return False


@asynccontextmanager
async def loaded(console: Console) -> AsyncGenerator[None]:
    """Five more pages and all that they do; the operator's page uploads the largest file now and then.

    A page server that hangs for long loses these pages; then others come.
    """
    command = [sys.executable, "-m", "benchmarks.live.load", str(console.port)]

    async def begun() -> asyncio.subprocess.Process:
        process = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
        if process.stdout is None or await process.stdout.readline() != b"ready\n":
            raise RuntimeError("the load could not begin")
        return process

    process = await begun()

    async def go_on() -> None:
        nonlocal process
        while True:
            await process.wait()
            with suppress(RuntimeError):
                process = await begun()

    async def upload() -> None:
        while True:
            await console.page.upload("largest.csv", REFUSED)
            await asyncio.sleep(BOUT_S / 2)

    tasks = [asyncio.create_task(upload()), asyncio.create_task(go_on())]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        with suppress(ProcessLookupError):
            process.terminate()
        await process.wait()


# What the operating system says of the processes.


def family(pid: int) -> list[int]:
    """A process and those that it started."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *(int(child) for child in children)]


def memory_mb(pids: Sequence[int]) -> float:
    """What they take together; what several share counts once."""
    text = [Path(f"/proc/{pid}/smaps_rollup").read_text() for pid in pids]
    return sum(int(found[1]) for one in text if (found := _PSS.search(one))) / 1024


def processor_s(pids: Sequence[int]) -> list[float]:
    """Processor time of each since it began."""
    fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in pids]
    return [(int(one[11]) + int(one[12])) / os.sysconf("SC_CLK_TCK") for one in fields]


async def processor_shares(pids: Sequence[int], seconds: float) -> list[float]:
    """Share of one core that each takes from now on."""
    before, begin = processor_s(pids), time.monotonic()
    await asyncio.sleep(seconds)
    lasted = time.monotonic() - begin
    return [(after - one) / lasted for after, one in zip(processor_s(pids), before, strict=True)]


# One way of running, from start to end.


@dataclass
class Run:
    """What was measured of one way."""

    times: dict[str, Times] = field(default_factory=dict[str, Times])
    holding: float = 0.0
    """share of a core [%]"""
    moving: float = 0.0
    memory_mb: float = 0.0
    minutes: float = 0.0
    gaps_s: list[tuple[float, bool]] = field(default_factory=list[tuple[float, bool]])
    """each, and whether the board's own process, which has precedence, stood still meanwhile, too"""
    """all that are longer than ``_GAP_S``"""

    def of(self, what: str) -> Times:
        """The times of a kind."""
        return self.times.setdefault(what, Times(what))


async def measure(split: bool, options: argparse.Namespace) -> Run:
    run = Run()
    with Wire() as wire:
        for _ in range(options.starts - 1):
            async with served(wire, split=split, started=run.of(START), opened=run.of(OPEN)):
                pass
        async with AsyncExitStack() as stack:
            console = await stack.enter_async_context(
                served(wire, split=split, started=run.of(START), opened=run.of(OPEN))
            )
            pids = family(console.server.pid)
            await asyncio.sleep(_PREPARED_S)
            run.holding = 100 * sum(await processor_shares(pids, options.cpu_s))
            run.memory_mb = memory_mb(pids)
            await console.put(SWING)
            ways: dict[str, Callable[[], object]] = {
                "the page": console.page.stop,
                "the bar's line": partial(console.page.do, "stop"),
            }
            if split:
                arm = stack.enter_context(Arm.connect(f"http://127.0.0.1:{console.port}", watch=True))
                ways["a program"] = arm.link.stop
            _say("quiet")
            for name, press in ways.items():
                goes = await stops(console, press, run.of(STOP_BY.format(name, QUIET)), options.stops)
                run.of(GO.format(QUIET)).seconds += goes.seconds
            await console.go()
            run.moving = 100 * sum(await processor_shares(pids, options.cpu_s))
            await console.page.stop()
            await long_program(console, run)
            await console.put(SWING)
            async with loaded(console):
                _say("loaded")
                for name, press in ways.items():
                    goes = await stops(console, press, run.of(STOP_BY.format(name, LOADED)), options.stops)
                    run.of(GO.format(LOADED)).seconds += goes.seconds
                await console.put(BLENDED)
                run.gaps_s, run.minutes = await gaps(console, 60 * options.minutes), options.minutes
    return run


async def long_program(console: Console, run: Run) -> None:
    """Check a long program, then press Run: until the first setpoint."""
    await console.stands()
    await console.put(LONG, write_csv(LONG, _Arm.robot).encode())
    for _ in range(3):
        await console.checked()
        run.of(GO_LONG).seconds.append(await console.go())
        await console.page.stop()
        await console.stands()


async def gaps(console: Console, seconds: float) -> list[tuple[float, bool]]:
    """Let a program loop; the gaps between its setpoints that are too long, and whether all stood still."""
    await console.go()
    found: list[tuple[float, bool]] = []
    stood = console.wire.stood
    last, end = 0.0, time.monotonic() + seconds
    while time.monotonic() < end:
        await asyncio.sleep(0.1)
        for frame in await console.frames():
            if last and (gap := frame.at_s - last) > _GAP_S:
                still = sum(max(0.0, min(end, frame.at_s) - max(start, last)) for start, end in stood)
                found.append((gap, gap - still <= _GAP_S))
            last = frame.at_s
        console.arrived.clear()
    await console.page.stop()
    await console.stands()
    return found


def _say(what: str) -> None:
    print(f"{what} …", end=" ", flush=True, file=sys.stderr)


# The table.


def rows(split: Run, before: Run | None) -> list[Row]:
    """Both ways beside each other."""
    found = [
        Row(what, times.said, _before(before, lambda run, what=what: run.of(what).said), *_judged(times))
        for what, times in split.times.items()
    ]
    what = f"gaps above {1000 * _GAP_S:.0f} ms between setpoints, {split.minutes:g} minutes under load"
    met = all(still for _, still in split.gaps_s)
    found.append(Row(what, _gaps(split), _before(before, _gaps), "0", met))
    for what, most, figure in (
        ("memory of both processes [MB]", 150, lambda run: run.memory_mb),
        ("processor, holding, one page [% of a core]", 4, lambda run: run.holding),
        ("processor, moving, one page [% of a core]", 15, lambda run: run.moving),
    ):
        value = figure(split)
        other = _before(before, lambda run, figure=figure: f"{figure(run):.0f}")
        found.append(Row(what, f"{value:.0f}", other, f"≤ {most}", value <= most))
    return found


def _before(run: Run | None, said: Callable[[Run], str]) -> str:
    return "–" if run is None else said(run)


def _judged(times: Times) -> tuple[str, bool | None]:
    goals = next((goals for words, goals in GOALS.items() if re.search(words, times.what)), {})
    goal = ", ".join(f"{name} ≤ {most:g}" for name, most in goals.items())
    figures = times.figures()
    return goal or "–", all(figures[name] <= most for name, most in goals.items()) if goals else None


def _gaps(run: Run) -> str:
    shorter = f" in {run.minutes:g} minutes" if run.minutes <= _BEFORE_MINUTES else ""
    if not run.gaps_s:
        return "0"
    stood = sum(still for _, still in run.gaps_s)
    with_machine = f"; in {stood} the machine stood still" if stood else ""
    return f"{len(run.gaps_s)}{shorter} (worst {1000 * max(run.gaps_s)[0]:.0f} ms{with_machine})"


def table(rows: Sequence[Row]) -> str:
    """As markdown."""
    head = ("what [ms: median / p99 / worst]", "armctl", "arm in the page server's process", "goal", "met")
    lines = [head, ("---",) * 5]
    for row in rows:
        met = {None: "–", True: "yes", False: "**no**"}[row.met]
        lines.append((row.what, row.said, row.before, row.goal, met))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


_BEFORE_MINUTES, _BEFORE_STOPS = 3.0, 30
"""how long the old way is watched: more shows nothing new"""


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench-live", description=__doc__)
    parser.add_argument("--minutes", type=float, default=15.0, help="watching for gaps under load")
    parser.add_argument("--stops", type=int, default=100, help="STOPs of each kind, quiet and loaded")
    parser.add_argument("--starts", type=int, default=3, help="how often the console is started")
    parser.add_argument(
        "--cpu", type=float, default=10.0, dest="cpu_s", help="seconds for each share of a core"
    )
    parser.add_argument("--alone", action="store_true", help="without the old way beside it")
    parser.add_argument("--docs", action="store_true", help="put the table into docs/speed.md")
    options = parser.parse_args()
    load_before, stops = os.getloadavg()[0], options.stops
    split = asyncio.run(measure(True, options))
    print("", table(rows(split, None)), sep="\n", flush=True)
    options.minutes, options.stops = min(options.minutes, _BEFORE_MINUTES), min(options.stops, _BEFORE_STOPS)
    before = None if options.alone else asyncio.run(measure(False, options))
    found = rows(split, before)
    caption = (
        f"{machine.sentence(machine.facts())}; {stops} STOPs of each kind; load average "
        f"{load_before:.1f} before and {os.getloadavg()[0]:.1f} after"
    )
    print("", table(found), "", caption, sep="\n")
    if options.docs:
        PAGE.write_text(with_table(PAGE.read_text(), f"{caption}\n\n{table(found)}", MARK))
    missed = [row for row in found if row.met is False]
    for row in missed:
        print(f"missed: {row.what}: {row.said}, goal {row.goal}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
