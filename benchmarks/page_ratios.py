"""What the page costs beside an earlier one: ``python -m benchmarks.page_ratios CHECKOUT [--rounds 3]``.

``armctl serve`` of this checkout and of another one (``git worktree add ../old COMMIT``) take turns, with the
same Python and packages, the simulated board and a headless Chromium, which draws by software. The table has
the medians of the rounds, and the median of their ratios: only that says something of another computer.
*Frames* are those in which the browser lets the page do something (requestAnimationFrame), *pictures* those
in which it has drawn the scene. *Bytes* are all that the server sends to one page, as Linux counts them
(``ss``). Ten pages are ten programs that read what a browser reads (``live/page.py``): ten browsers would
take all of the computer.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks import machine
from benchmarks.live.page import Page
from benchmarks.page_pictures import COUNT, free_port
from playwright.sync_api import Playwright, sync_playwright
from tests.browser.kit import Screen, launch

from armctl.program import MoveStep, Program, save_program

OURS = Path(__file__).parents[1]
ROBOT, MANY = "uzuner", 10
SETTLED_S, SECONDS = 3.0, 5.0
_PATIENCE_S = 120.0
_SERVE = (
    "from armctl.cli.main import main; from armctl.ui import App; App.__init__.__defaults__ = (60.0,); main()"
)
"""A page that draws by software on a busy computer may be silent for longer than the arm moves without it."""
_TRIES = 5
_TOO_SLOW = "no page lives so well on this computer now that the arm goes on; do nothing else on it"
CLICKS = 12
STANDS, ORBITS, RUNS = "the arm stands", "orbiting", "a program runs"
_SWING = [(40.0, 90.0, -40.0, -40.0, 20.0), (-40.0, 60.0, -60.0, 20.0, -20.0)]
_BYTES_SENT = re.compile(r"\bbytes_sent:(\d+)")

_COUNT_FRAMES = """
  window.armctlFrames = 0;
  (function count() { window.armctlFrames++; requestAnimationFrame(count); })();
"""
_WATCH_GHOST = """() => {
  const nodes = () => Object.entries(window.__viserMutable.nodeRefFromName)
    .filter(([name, node]) => node && (name === "/ghost" || name.startsWith("/ghost/")))
    .map(([name, node]) => `${name} ${node.visible} ${node.position.toArray()} ${node.quaternion.toArray()}`)
    .join();
  window.armctlDrawn = new Promise((drawn) => addEventListener("keydown", () => {
    const begun = performance.now(), before = nodes();
    (function look() {
      if (nodes() === before) requestAnimationFrame(look);
      else requestAnimationFrame(() => drawn(performance.now() - begun));
    })();
  }, { capture: true, once: true }));
}"""
"""the time from the next key that is pressed to the first frame after the ghost has changed [ms]"""

ROWS = {
    "page opened → Enable is there": "ms",
    **{f"frames, {what}": "/ s" for what in (STANDS, ORBITS, RUNS)},
    **{f"pictures, {what}": "/ s" for what in (ORBITS, RUNS)},
    "first press on a joint's slider → ghost drawn": "ms",
    "press on a joint's slider → ghost drawn": "ms",
    **{f"bytes to a page, {what}": "kB / s" for what in (STANDS, RUNS)},
    **{f"page server, one page, {what}": "% of a core" for what in (STANDS, RUNS)},
    **{f"page server, {MANY} pages, {what}": "% of a core" for what in (STANDS, RUNS)},
}


@dataclass
class Served:
    """A console that is served from a checkout."""

    pid: int
    port: int
    found: dict[str, float] = field(default_factory=dict[str, float])

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def sent(self) -> dict[str, int]:
        """Bytes so far that it has sent on each line that is open, by the browser's end of it."""
        command = ["ss", "-tinHO", "state", "established", "sport", "=", f":{self.port}"]
        lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
        return {line.split()[3]: int(found[1]) for line in lines if (found := _BYTES_SENT.search(line))}

    def processor_s(self) -> float:
        """Processor time of the page server so far; the arm is another process."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def served(checkout: Path, robot: str = ROBOT) -> Generator[Served]:
    """``armctl serve`` of a checkout, with a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        served = Served(0, free_port())
        words = ["serve", "--robot", robot, "--port", "sim", "--no-browser", "--no-token"]
        log = Path(folder) / "log"
        with log.open("w") as file:
            server = subprocess.Popen(
                [sys.executable, "-c", _SERVE, *words, "--http-port", str(served.port)],
                stdout=file, stderr=file, cwd=folder,
                env=os.environ | {"PYTHONPATH": str(checkout / "src"), "PYTHONUNBUFFERED": "1"}
                | dict.fromkeys(("XDG_DATA_HOME", "XDG_STATE_HOME"), folder),
            )  # fmt: skip
        try:
            end = time.monotonic() + _PATIENCE_S
            while "Ctrl-C ends" not in log.read_text():
                if server.poll() is not None or time.monotonic() > end:
                    raise RuntimeError(f"{checkout} does not serve: {log.read_text()}")
                time.sleep(0.05)
            served.pid = server.pid
            yield served
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(30)


def watched(served: Served, screen: Screen, what: str, do: Callable[[], object]) -> None:
    """What a page and its server do for some seconds, while ``do`` goes on."""
    sent, used = served.sent(), served.processor_s()
    counts = "[performance.now(), armctlFrames, armctlPictures]"
    begun, frames, pictures = screen.page.evaluate(counts)
    do()
    after, more_frames, more_pictures = screen.page.evaluate(counts)
    lasted = (after - begun) / 1000
    served.found[f"frames, {what}"] = (more_frames - frames) / lasted
    served.found[f"pictures, {what}"] = (more_pictures - pictures) / lasted
    served.found[f"page server, one page, {what}"] = 100 * (served.processor_s() - used) / lasted
    more = sum(count - sent[line] for line, count in served.sent().items() if line in sent)
    served.found[f"bytes to a page, {what}"] = more / lasted / 1000


def orbit(screen: Screen) -> None:
    """Turn the camera round the arm for some seconds, as far as a hand does."""
    mouse, begun, at = screen.page.mouse, time.monotonic(), 0
    mouse.move(560, 600)
    mouse.down()
    while time.monotonic() - begun < SECONDS:
        at += 1
        mouse.move(560 + 120 * ((at // 40) % 2 * 2 - 1) * (at % 40) / 40, 600)
        screen.page.wait_for_timeout(12)
    mouse.up()


def ghost_ms(screen: Screen) -> list[float]:
    """How long it takes until the ghost is drawn, for each press of a key on a slider."""
    screen.open_tab("Manual")
    thumb = screen.row("Base °").get_by_role("slider").first
    found: list[float] = []
    for _ in range(CLICKS):
        screen.page.evaluate(_WATCH_GHOST)
        thumb.press("ArrowRight")
        found.append(screen.page.evaluate("armctlDrawn"))
        screen.pause(400)
    return found


def upload(screen: Screen, program: Path) -> None:
    """Put a program on the list."""
    if not screen.button("Loop").is_visible():
        screen.open_tab("Serial motion")
    screen.unfold("Files", "Upload")
    screen.upload("Upload", program)
    screen.wait_for_notification("Uploaded")


def runs(screen: Screen) -> bool:
    """Whether the arm moves, as the page says."""
    return screen.page.get_by_text("MOVING", exact=True).locator("visible=true").count() > 0


def in_a_browser(playwright: Playwright, console: Served, program: Path) -> None:
    """What one page shows, and what it takes."""
    browser = launch(playwright)
    screen = Screen(browser.new_page(viewport={"width": 1280, "height": 800}), drawn=True)
    screen.page.add_init_script(COUNT + _COUNT_FRAMES)
    begun = time.monotonic()
    screen.open(console.url, until="Enable")
    console.found["page opened → Enable is there"] = 1000 * (time.monotonic() - begun)
    screen.page.wait_for_timeout(1000 * SETTLED_S)
    screen.dismiss_graphics_warning()
    screen.click("Enable")
    screen.wait_for_text("HOLDING")
    screen.page.wait_for_timeout(1000 * SETTLED_S)
    watched(console, screen, STANDS, lambda: screen.page.wait_for_timeout(1000 * SECONDS))
    watched(console, screen, ORBITS, lambda: orbit(screen))
    first, *others = ghost_ms(screen)
    console.found["first press on a joint's slider → ghost drawn"] = first
    console.found["press on a joint's slider → ghost drawn"] = statistics.median(others)
    upload(screen, program)
    for _ in range(_TRIES):
        if not runs(screen):
            screen.click("Loop")
            screen.wait_until(lambda: runs(screen), "the program runs")
        watched(console, screen, RUNS, lambda: screen.page.wait_for_timeout(1000 * SECONDS))
        if runs(screen):
            break
    else:
        raise RuntimeError(_TOO_SLOW)
    screen.page.keyboard.press("Escape")
    screen.wait_for_text("HOLDING")
    browser.close()


async def share(console: Served) -> float:
    """What the server takes for some seconds [% of a core]."""
    used, begun = console.processor_s(), time.monotonic()
    await asyncio.sleep(SECONDS)
    return 100 * (console.processor_s() - used) / (time.monotonic() - begun)


async def with_many(console: Served) -> None:
    """What the server takes with many pages; who reads them is another process."""
    pages = [await Page.open(console.port) for _ in range(MANY)]
    await asyncio.sleep(SETTLED_S)
    console.found[f"page server, {MANY} pages, {STANDS}"] = await share(console)
    for _ in range(_TRIES):
        await pages[0].enabled("Run", "Loop")
        await pages[0].press("Run", "Loop")
        await asyncio.sleep(1)
        console.found[f"page server, {MANY} pages, {RUNS}"] = await share(console)
        if not pages[0].is_enabled("Run", "Loop"):  # it runs
            break
    else:
        raise RuntimeError(_TOO_SLOW)
    for page in pages:
        await page.close()


def measured(checkout: Path, program: Path) -> dict[str, float]:
    """One round with the console of a checkout."""
    with served(checkout) as console:
        with sync_playwright() as playwright:
            in_a_browser(playwright, console, program)
        asyncio.run(with_many(console))
        return console.found


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page_ratios", description=__doc__)
    parser.add_argument("checkout", type=Path, help="of the commit that this one is held against")
    parser.add_argument("--rounds", type=int, default=3, help="of each, in turn")
    options = parser.parse_args()
    sides: dict[Path, list[dict[str, float]]] = {options.checkout.resolve(): [], OURS: []}
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "swing.toml"
        save_program(Program(robot=ROBOT, steps=tuple(MoveStep(joints_deg=q) for q in _SWING)), program)
        for number in range(options.rounds):
            for checkout, rounds in sides.items():
                rounds.append(measured(checkout, program))
                figures = ", ".join(f"{value:.3g}" for value in rounds[-1].values())
                print(f"round {number + 1}, {checkout.name}: {figures}", flush=True, file=sys.stderr)
    before, after = sides.values()
    print("", machine.sentence(machine.facts()), "", sep="\n")
    print("| what | unit | before | now | now / before |", "|---|---|--:|--:|--:|", sep="\n")
    for what, unit in ROWS.items():
        old, new = ([one[what] for one in side] for side in (before, after))
        ratio = statistics.median(b / a if a else float("nan") for a, b in zip(old, new, strict=True))
        figures = f"{statistics.median(old):.3g} | {statistics.median(new):.3g} | {ratio:.2f} ×"
        print(f"| {what} | {unit} | {figures} |")


if __name__ == "__main__":
    main()
