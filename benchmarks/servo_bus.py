"""Full telemetry of a servo bus: ``python -m benchmarks.servo_bus [ROBOT] [--rate HZ] [--seconds S]``.

The arm moves between its poses on a simulated bus, which runs in a process of its own, as a real one costs
the computer nothing. At each tick the arm process writes the goals that differ; 50 times a second at most,
so at every other tick of 100 Hz, it reads position, load, heat, voltage and, where they are told, currents
of all servos. Told are its share of a processor, how late its ticks come, and how often the bus heard
nothing for how long: what a bus watchdog waits for. Linux only.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from armctl import load_robot
from armctl.boards import board_name
from armctl.errors import EnableError, StateError
from armctl.process import start_arm
from armctl.protocol import ArmLink, Command, Connect, Enable, MoveJoints, Recording

_PATIENCE_S, _AGAIN_S = 60.0, 0.3
_LOOK_S = 40.0
"""from one look at the black box, which keeps a minute, to the next"""
_SILENCES_MS = (60, 100, 200, 500)
_BUSY = "while True: pass"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.servo_bus", description=__doc__)
    parser.add_argument("robot", nargs="?", default="so101")
    parser.add_argument("--rate", type=float, default=100.0, help="ticks a second")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--busy", type=int, default=0, help="loops beside it that take all that they get")
    options = parser.parse_args()
    kind = load_robot(options.robot).board
    with tempfile.TemporaryDirectory() as folder:
        line = Path(folder) / "bus"
        command = [sys.executable, "-m", "armctl", "simulate", kind, "--robot", options.robot, "--link", line]
        board = subprocess.Popen(command, stdout=subprocess.PIPE)
        loops = [subprocess.Popen([sys.executable, "-c", _BUSY]) for _ in range(options.busy)]
        try:
            if board.stdout is None or not board.stdout.readline():  # it is served from here on
                return 1
            told(options.robot, line, options.rate, options.seconds)
        finally:
            for one in (*loops, board):
                one.terminate()
                one.wait()
    return 0


def told(name: str, line: Path, rate_hz: float, seconds: float) -> None:
    """Move to and fro for so long, and print the figures."""
    robot, before = load_robot(name), children()
    link = start_arm(robot, board_name(str(line), robot), rate_hz, port=str(line))
    try:
        (process,) = children() - before
        link.submit(Connect(str(line))).finished.result()
        carry_out(link, Enable())
        began, used, moves, looked = time.monotonic(), processor_s(process), 0, 0.0
        ticks = Ticks(link.black_box())
        while (took := time.monotonic() - began) < seconds:
            pose = robot.pose("home" if moves % 2 == 0 else "rest")
            carry_out(link, MoveJoints(pose, duration_s=2.0))
            moves += 1
            if took - looked > _LOOK_S:
                ticks.take(link.black_box())
                looked = took
        took = time.monotonic() - began
        share = (processor_s(process) - used) / took
        ticks.take(link.black_box())
        load = os.getloadavg()[0]
        print(
            f"{robot.title}: {took:.1f} s at {rate_hz:g} Hz, {moves} moves, {load:.1f} programs want to run"
        )
        print(ticks)
        print(f"the arm process took {100 * share:.1f} % of a processor")
    finally:
        link.close()


def carry_out(link: ArmLink, command: Command) -> None:
    """On a busy computer the board seems not to answer in time, or a motion ends: it is asked for again."""
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        try:
            link.submit(command).finished.result()
            return
        except (EnableError, StateError):
            if time.monotonic() > deadline:
                raise
            time.sleep(_AGAIN_S)


class Ticks:
    """The ticks since a first look at the black box."""

    def __init__(self, first: Recording) -> None:
        self._seen_s = float(first.time_s[-1])
        self._parts: list[np.ndarray] = []

    def take(self, recording: Recording) -> None:
        """Those since the last look: when they came, how late, and how long they took [s], (n, 3)."""
        new = recording.time_s > self._seen_s
        columns = recording.time_s, recording.column("late_s"), recording.column("took_s")
        self._parts.append(np.stack([column[new] for column in columns], axis=1))
        self._seen_s = float(recording.time_s[-1])

    def __str__(self) -> str:
        at, late, took = 1000 * np.concatenate(self._parts).T
        p50, p99 = np.percentile(late, (50, 99))
        silent = np.concatenate([1000 * np.diff(part[:, 0]) for part in self._parts])
        longer = ", ".join(f"{int((silent > one).sum())} over {one} ms" for one in _SILENCES_MS)
        return (
            f"{len(at)} ticks, late by {p50:.2f} ms (median), {p99:.2f} (p99), {late.max():.2f} (worst); "
            f"a tick took {np.median(took):.2f} ms (median), {np.percentile(took, 99):.2f} (p99)\n"
            f"from tick to tick {silent.max():.0f} ms at most; {longer}"
        )


def children() -> set[int]:
    """The processes that this one has started."""
    tasks = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    return {int(number) for task in tasks for number in task.read_text().split()}


def processor_s(process: int) -> float:
    """How much time of a processor a process has taken so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    sys.exit(main())
