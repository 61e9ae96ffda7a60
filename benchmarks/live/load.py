"""The load, in a process of its own: ``python -m benchmarks.live.load PORT`` until it is terminated.

Five pages stay open. In every bout of ``BOUT_S`` one of them uploads a file that is too large, twenty more
pages load and go, six figures are exported and 200 buttons pressed, and a solver is at work all the time.
What needs the operator's page, the upload of the largest file that is allowed, is the caller's.
"""

from __future__ import annotations

import asyncio
import sys
import urllib.request
from collections.abc import Awaitable, Callable
from contextlib import suppress
from itertools import cycle

from benchmarks.live.page import Page

BOUT_S = 30.0
_PAGES = 5
_LOADS, _FIGURES, _PRESSES = 20, 6, 200
_SOLVES_S = 0.1
_TOO_LARGE = bytes(7 << 20)


async def _every(seconds: float, action: Callable[[], Awaitable[object]]) -> None:
    loop = asyncio.get_running_loop()
    due = loop.time()
    while True:
        await action()
        due = max(due + seconds, loop.time())
        await asyncio.sleep(due - loop.time())


def _fetch(port: int) -> None:
    request = urllib.request.Request(f"http://127.0.0.1:{port}/", headers={"Accept-Encoding": "gzip"})
    with urllib.request.urlopen(request) as answer:
        answer.read()


async def load(port: int) -> None:
    """Load the console on a port of this computer until cancelled."""
    pages = [await Page.open(port) for _ in range(_PAGES)]
    solver, uploader, exporter, *pressers = pages
    targets, forms, turns = (
        cycle(range(120, 200, 5)),
        cycle(("Figure (SVG)", "Figure (PNG)")),
        cycle(pressers),
    )

    async def solve() -> None:
        await solver.type_target("X mm", str(next(targets)))
        await solver.press("Solve")

    async def load_page() -> None:
        await asyncio.to_thread(_fetch, port)
        await (await Page.open(port)).close()

    async def export() -> None:
        await exporter.press("Show")
        await exporter.press("Export", next(forms))

    async def press() -> None:
        await next(turns).press("Fill with", "present pose")

    await exporter.press("Show")
    print("ready", flush=True)
    await asyncio.gather(
        _every(_SOLVES_S, solve),
        _every(BOUT_S, lambda: uploader.upload("large.toml", _TOO_LARGE)),
        _every(BOUT_S / _LOADS, load_page),
        _every(BOUT_S / _FIGURES, export),
        _every(BOUT_S / _PRESSES, press),
    )


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        asyncio.run(load(int(sys.argv[1])))
