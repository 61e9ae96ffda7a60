"""What an arm costs the browser that draws it: ``python -m benchmarks.page_pictures [ARM …]``.

The 3D view of the console, 1280×800, in a headless Chromium, which draws by software, while the arm moves.
The arm as it looks and as an arm without a look is drawn take turns, so that both
meet the same load. *Pictures* are drawn a second; *processor* is what the browser takes for one, all of its
processes and threads together; *server* is what a new pose takes there.
"""

from __future__ import annotations

import argparse
import os
import socket
import statistics
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import viser
from playwright.sync_api import Page, sync_playwright
from tests.browser.kit import launch

from armctl.robot import Robot, load_robot
from armctl.ui.scene.arm_model import ARM, ArmFigure, arm_model
from armctl.ui.scene.camera import look_at_arm
from armctl.ui.scene.stage import Stage, set_lights

ARMS = "so101", "mearm", "ur5", "uzuner"
ROUNDS, SECONDS = 4, 6.0
PERIOD_S = 1 / 30
COUNT = """
  window.armctlPictures = 0;
  const clear = WebGL2RenderingContext.prototype.clear;
  WebGL2RenderingContext.prototype.clear = function (bits) {
    if (bits & this.COLOR_BUFFER_BIT) window.armctlPictures++;
    clear.call(this, bits);
  };
"""


def processor_s(parent: int) -> float:
    """Processor time of all processes that one has started, and they, so far [s]."""
    children: dict[int, list[tuple[int, float]]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        used = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        children.setdefault(int(fields[1]), []).append((int(stat.parent.name), used))
    total, left = 0.0, [parent]
    while left:
        for child, used in children.get(left.pop(), []):
            total += used
            left.append(child)
    return total


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Moving:
    """An arm that swings in a scene."""

    def __init__(self, server: viser.ViserServer, robot: Robot) -> None:
        self._server, self._robot = server, robot
        self.pose_ms: list[float] = []
        set_lights(server.scene)
        self._stage, self._figure = Stage(server.scene, robot), ArmFigure(server.scene, robot, ARM)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._swing)
        self._thread.start()

    def _swing(self) -> None:
        home, limits = self._robot.pose("home"), self._robot.limits
        begin = time.monotonic()
        while not self._end.wait(PERIOD_S):
            phase = time.monotonic() - begin
            q = np.clip(home + 0.4 * np.sin(phase + np.arange(len(home))), *limits.T)
            begun = time.thread_time()
            with self._server.atomic():
                self._figure.pose(q, 0.5 + 0.5 * np.sin(phase))
            self.pose_ms.append(1000 * (time.thread_time() - begun))

    def end(self) -> None:
        self._end.set()
        self._thread.join()
        self._stage.remove()
        self._figure.root.remove()


def measured(page: Page, server: viser.ViserServer, robot: Robot) -> tuple[float, float, float]:
    """Pictures a second, processor time of the browser for one, and of the server for a pose [ms]."""
    moving = Moving(server, robot)
    for client in server.get_clients().values():
        look_at_arm(client, robot)
    page.wait_for_timeout(1500)
    before, used = page.evaluate("armctlPictures"), processor_s(os.getpid())
    begun = time.monotonic()
    page.wait_for_timeout(1000 * SECONDS)
    pictures = page.evaluate("armctlPictures") - before
    used, lasted = processor_s(os.getpid()) - used, time.monotonic() - begun
    moving.end()
    return pictures / lasted, 1000 * used / max(pictures, 1), statistics.median(moving.pose_ms)


@contextmanager
def view() -> Generator[tuple[Page, viser.ViserServer]]:
    """A page of a server that shows nothing but a scene."""
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    with sync_playwright() as playwright:
        page = launch(playwright).new_page(viewport={"width": 1280, "height": 800})
        page.add_init_script(COUNT)
        page.goto(f"http://127.0.0.1:{server.get_port()}/?fixedDpr=1")
        page.wait_for_function("window.__viserMutable?.nodeRefFromName['/WorldAxes'] !== undefined")
        yield page, server
    server.stop()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("arms", nargs="*", default=ARMS)
    arms = parser.parse_args().arms
    print("| arm | drawn | nodes | vertices | pictures / s | processor ms / picture | server ms / pose |")
    print("|---|---|--:|--:|--:|--:|--:|")
    with view() as (page, server):
        for name in arms:
            robot = load_robot(name)
            ways = {"guess": replace(robot, look=replace(robot.look, rows=())), "look": robot}
            rounds = {how: [measured(page, server, one)] for how, one in ways.items()}
            for _ in range(ROUNDS - 1):
                for how, one in ways.items():
                    rounds[how].append(measured(page, server, one))
            for how, one in ways.items():
                model = arm_model(one)
                vertices = sum(len(mesh.solid.vertices) for mesh in model.meshes)
                figures = [f"{statistics.median(column):.2f}" for column in zip(*rounds[how], strict=True)]
                nodes = len(model.frames) + len(model.meshes)
                print(
                    "|",
                    " | ".join([robot.title, how, str(nodes), f"{vertices:,}", *figures]),
                    "|",
                    flush=True,
                )


if __name__ == "__main__":
    main()
