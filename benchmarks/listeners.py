"""How late the arm's ticks come while many listen: ``python -m benchmarks.listeners [--listeners 30]``.

While the arm moves, its process sends 50 snapshots a second to each listener; here they are connections of
one other process, which reads them and throws them away, but for one that reads the times of the ticks. Late
is what lies between two ticks in a row beyond the period. Beside it, in the same run: with that one listener
alone.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import os
import selectors
import socket
from typing import cast

import numpy as np

import armctl
from armctl.process import Link, start_arm
from armctl.process.lines import LocalLine
from armctl.process.records import Codec, Hello, Seen
from armctl.program import MoveStep, Program
from armctl.protocol import Connect, Enable, RunProgram

PERIOD_S = 0.02
SIDES = itertools.chain.from_iterable(itertools.repeat((45.0, -45.0), 50))
SWING = Program(robot="uzuner", steps=[MoveStep(joints_deg=(side, 90.0, 0.0, 0.0, 0.0)) for side in SIDES])


def listening(address: object, secret: str, count: int, ready: object) -> None:
    """Connections of a process of their own."""
    lines = [LocalLine(address, secret) for _ in range(count)]  # type: ignore[arg-type]
    with selectors.DefaultSelector() as selector:
        for line in lines:
            line.send(Codec().encode(Hello("listener", watch=True)))
            wire = cast(socket.socket, vars(line)["_socket"])
            wire.setblocking(False)
            selector.register(wire, selectors.EVENT_READ)
        ready.set()  # type: ignore[attr-defined]
        while True:
            for key, _ in selector.select():
                if not cast(socket.socket, key.fileobj).recv(1 << 20):
                    return


def lateness_ms(link: Link, line: LocalLine, seconds: float) -> np.ndarray:
    """How late each tick came (k,) [ms], read from its own stamp."""
    codec = Codec()
    stamps: list[tuple[int, float]] = []
    while not stamps or stamps[-1][1] - stamps[0][1] < seconds:
        record = codec.from_arm(line.receive())
        if isinstance(record, Seen):
            stamps.append((record.snapshot.tick, record.snapshot.stamp))
    pairs = itertools.pairwise(stamps)
    return np.array([1000 * (b[1] - a[1] - PERIOD_S) for a, b in pairs if b[0] == a[0] + 1])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.listeners", description=__doc__)
    parser.add_argument("--listeners", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    link = start_arm(armctl.load_robot("uzuner"))
    try:
        link.submit(Connect("sim")).result()
        link.submit(Enable()).result()
        link.submit(RunProgram(SWING)).accepted.result()  # an arm that stands is shown less often
        local = cast(LocalLine, vars(link)["_line"])
        own = LocalLine(local.address, local.secret)
        own.send(Codec().encode(Hello("measure", watch=True)))
        show("one listener", lateness_ms(link, own, options.seconds))
        context = multiprocessing.get_context("spawn")
        ready = context.Event()
        others = context.Process(
            target=listening, args=(local.address, local.secret, options.listeners, ready), daemon=True
        )
        others.start()
        ready.wait()
        show(f"{options.listeners} listeners", lateness_ms(link, own, options.seconds))
        others.terminate()
    finally:
        link.close()


def show(what: str, late: np.ndarray) -> None:
    p50, p99, worst = np.percentile(np.maximum(late, 0), [50, 99, 100])
    load = os.getloadavg()[0]
    late_by = f"late p50 {p50:.2f} ms, p99 {p99:.2f} ms, worst {worst:.2f} ms"
    print(f"{what}: {len(late)} ticks, {late_by} (load {load:.1f})")


if __name__ == "__main__":
    main()
