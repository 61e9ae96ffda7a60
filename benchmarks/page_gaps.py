"""How long the page server keeps its pages waiting: ``python -m benchmarks.page_gaps [--as-before]``.

The console runs as ``armctl serve`` runs it: the arm in a process of its own, with the simulated board. Four
pages are open in another process. One of them uploads the largest files that are allowed, checks them, turns
the list of 20,000 rows, edits, saves, exports figures; another one loads anew. Meanwhile a coroutine on
viser's event loop sleeps 1 ms again and again. What it is late by is what a click, STOP above all, waits
for. *Busy* is the part of it in which the page server itself was computing; the rest is other work on the
computer. ``--as-before`` leaves Python's garbage collector and switch interval as they are by default.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import socket
import statistics
import tempfile
import threading
import time
import uuid
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgspec
import viser
from websockets.sync.client import ClientConnection, connect

from armctl.boards import SIMULATED
from armctl.calibration import CalibrationStore
from armctl.process import start_arm
from armctl.program import MoveStep, Program, encode_program, write_csv
from armctl.protocol import Connect, Enable, Origin
from armctl.robot import load_robot
from armctl.ui import (
    App,
    CalibrationInForce,
    Console,
    PortChoice,
    RobotChoice,
    RobotSwitch,
    settle_interpreter,
)
from armctl.ui.guard import guarded_server
from armctl.ui.page import Page
from armctl.ui.tabs.manual.shared_program import SharedProgram

TOML_STEPS, CSV_STEPS = 10_000, 20_000
"""of the programs: as many as 1 MiB of TOML holds, and as many as a program may have"""
PART_BYTES = 512 << 10
PATIENCE_S = 40.0
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (1, 2.5, 3), "fov": 1.3,
    "near": 0.01, "far": 1000, "image_height": 800, "image_width": 1280, "look_at": (0, 0, 0),
    "up_direction": (0, 0, 1),
}  # fmt: skip


def browse(port: int, orders: Connection) -> None:
    """The browsers' process: opens a page, says what it is told to, reads and forgets what comes."""
    pages: list[ClientConnection] = []
    while True:
        match orders.recv():
            case "open":
                page = connect(
                    f"ws://127.0.0.1:{port}/",
                    sock=socket.create_connection(("127.0.0.1", port)),
                    origin=f"http://127.0.0.1:{port}",  # pyright: ignore[reportArgumentType]
                    subprotocols=[f"viser-v{viser.__version__}"],  # pyright: ignore[reportArgumentType]
                    compression=None,
                    max_size=None,
                )
                page.send(msgspec.msgpack.encode(CAMERA))
                threading.Thread(target=lambda page=page: [None for _ in page], daemon=True).start()
                pages.append(page)
            case "close":
                pages.pop().close()
            case bytes() as frame:
                pages[0].send(frame)
            case _:
                return


class Lateness:
    """What a coroutine that sleeps 1 ms is late by [s], on the event loop of the pages."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._late: list[tuple[float, float]] = []
        asyncio.run_coroutine_threadsafe(self._watch(), loop)

    async def _watch(self) -> None:
        while True:
            begun, computed = time.perf_counter(), time.process_time()
            await asyncio.sleep(0.001)
            late = time.perf_counter() - begun - 0.001
            self._late.append((late, min(late, time.process_time() - computed)))

    def taken(self) -> list[tuple[float, float]]:
        """All since the last call, and for how long of each the process was busy."""
        late, self._late = self._late, []
        return late


class Bench:
    """The console, and the pages that use it."""

    def __init__(self, folder: Path) -> None:
        robot = load_robot("uzuner")
        link = start_arm(robot, name="console")
        link.submit(Connect(SIMULATED)).result()
        link.submit(Enable(robot.pose("home")), Origin("benchmark")).result()
        console = Console(
            calibration=CalibrationInForce.of(robot, SIMULATED, CalibrationStore(folder / "calibrations")),
            controller=link,
            list_ports=lambda: [PortChoice(SIMULATED, "Simulated board")],
            files=folder,
            close=link.close,
        )
        choice = RobotChoice("uzuner", robot.title)
        self.console = console
        self.app = App(
            RobotSwitch(console, choice, [choice], lambda name, port: console), guarded_server(port=0)
        )
        self.late = Lateness(self.app.server.get_event_loop())
        self.orders, theirs = multiprocessing.get_context("spawn").Pipe()
        port = self.app.server.get_port()
        self.browsers = multiprocessing.get_context("spawn").Process(target=browse, args=(port, theirs))
        self.browsers.start()
        self.program = console.shared(SharedProgram)

    def close(self) -> None:
        self.orders.send("end")
        self.browsers.join()
        self.app.close()
        self.console.close()

    def wait(self, what: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not what():
            if time.monotonic() > end:
                raise TimeoutError("a page has not done what it was told")
            time.sleep(0.05)

    def open(self) -> None:
        count = len(self._pages())
        self.orders.send("open")
        self.wait(lambda: len(self._pages()) == count + 1)
        self.wait(lambda: all(page.built for page in self._pages().values()))

    def _pages(self) -> dict[int, Page]:
        return dict(self.app._pages)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]

    def handle(self, label: str, option: str = "") -> Any:
        """A control of the first page: a button by its label, a group by one of its options."""
        client = self._pages()[min(self._pages())].client
        table: dict[str, Any] = client.gui._gui_input_handle_from_uuid  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        for handle in table.values():
            if getattr(handle, "label", None) == label and (
                not option or option in getattr(handle, "options", ())
            ):
                return handle
        raise LookupError(label)

    def set(self, label: str, value: Any, option: str = "") -> None:
        one = self.handle(label, option)
        frame = {"type": "GuiUpdateMessage", "uuid": one._impl.uuid, "updates": {"value": value}}  # noqa: SLF001
        self.orders.send(msgspec.msgpack.encode(frame))

    def press(self, label: str, option: str) -> None:
        self.set(label, option, option)

    def upload(self, name: str, content: bytes) -> None:
        ids = {"source_component_uuid": self.handle("Upload")._impl.uuid, "transfer_uuid": str(uuid.uuid4())}  # noqa: SLF001
        parts = [content[i : i + PART_BYTES] for i in range(0, len(content), PART_BYTES)]
        start = {"filename": name, "mime_type": "", "part_count": len(parts), "size_bytes": len(content)}
        self.orders.send(msgspec.msgpack.encode({"type": "FileTransferStartUpload", **ids, **start}))
        for index, part in enumerate(parts):
            frame = {"type": "FileTransferPart", **ids, "part_index": index, "content": part}
            self.orders.send(msgspec.msgpack.encode(frame))

    # What is measured, one after the other.

    def quiet(self) -> None:
        time.sleep(2.0)

    def pages(self) -> None:
        for _ in range(3):
            self.open()

    def reloads(self) -> None:
        for _ in range(10):
            count = len(self._pages())
            self.orders.send("close")
            self.wait(lambda count=count: len(self._pages()) == count - 1)
            self.open()

    def taken(self, name: str, content: bytes) -> None:
        """A program is uploaded, parsed, listed, and checked for some seconds."""
        version = self.program.version
        self.upload(name, content)
        self.wait(lambda: self.program.version > version)
        cancel = self.handle("Cancel check")
        self.wait(lambda: cancel.visible)
        time.sleep(6.0)
        self.set("Cancel check", True)
        self.wait(lambda: not cancel.visible)

    def refused(self, name: str, content: bytes) -> None:
        self.upload(name, content)
        time.sleep(3.0)

    def scroll(self) -> None:
        for _ in range(60):
            self.press("Page", "Next ▶")
            time.sleep(0.05)

    def edit(self) -> None:
        for _ in range(20):
            version = self.program.version
            self.press("Edit", "Duplicate")
            self.wait(lambda version=version: self.program.version > version)

    def save(self) -> None:
        version = self.program.version
        self.press("This program", "Save")
        self.wait(lambda: self.program.version > version)
        for group, button in (
            ("Download as", "Download"),
            ("Download as", "CSV"),
            ("Download as", "Python"),
        ):
            self.press(group, button)
            time.sleep(2.0)

    def figures(self) -> None:
        self.set("Show", True)
        time.sleep(3.0)
        for _ in range(3):
            for form in self.handle("Export", "Figure (SVG)").options:
                self.press("Export", form)
                time.sleep(2.5)


def measured(folder: Path, *, as_before: bool) -> None:
    robot = load_robot("uzuner")
    moves = [MoveStep(joints_deg=(i % 90 + 0.25, 90.0, -80.0 + i % 7, -40.0, 0.0)) for i in range(CSV_STEPS)]
    toml, table = (
        Program(robot="uzuner", name="long", steps=tuple(moves[:count])) for count in (TOML_STEPS, CSV_STEPS)
    )
    toml, table = encode_program(toml).encode(), write_csv(table, robot).encode()
    hostile = b"x = [" + b"[[[1], {a = 1}], 'b'],\n" * 40_000
    bench = Bench(folder)
    if not as_before:
        settle_interpreter()
    print(f"{'ms':32}{'longest':>10}{'busy longest':>14}{'busy 99.9 %':>14}{'busy > 50':>12}")
    try:
        bench.open()
        for name, act in (
            ("quiet, one page", bench.quiet),
            ("three more pages", bench.pages),
            (f"TOML of {len(toml) >> 10} KiB, {TOML_STEPS:,} steps", lambda: bench.taken("long.toml", toml)),
            ("saved, three downloads", bench.save),
            (f"CSV of {len(table) >> 10} KiB, {CSV_STEPS:,} steps", lambda: bench.taken("long.csv", table)),
            (f"not valid, {len(hostile) >> 10} KiB", lambda: bench.refused("bad.toml", hostile)),
            ("60 pages of the list turned", bench.scroll),
            ("20 edits of the list", bench.edit),
            ("six figures", bench.figures),
            ("ten pages loaded anew", bench.reloads),
        ):
            bench.late.taken()
            act()
            late = bench.late.taken()
            waits, busy = ([1e3 * gap for gap in side] for side in zip(*late, strict=True))
            high, many = statistics.quantiles(busy, n=1000)[-1], sum(gap > 50 for gap in busy)
            print(f"{name:32}{max(waits):10.0f}{max(busy):14.0f}{high:14.0f}{many:12}", flush=True)
    finally:
        bench.close()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page_gaps", description=__doc__)
    parser.add_argument("--as-before", action="store_true", help="with Python's own settings")
    with tempfile.TemporaryDirectory() as folder:
        measured(Path(folder), as_before=parser.parse_args().as_before)


if __name__ == "__main__":
    main()
