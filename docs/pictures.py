"""Records the pictures of README and docs from the running product: ``make pictures``.

``armctl serve`` runs on its simulated board, and a browser is driven as a person would. Each picture carries,
inside its file, the outline of the tabs that it shows: their widgets and words. ``tests/ui/test_pictures.py``
compares them with the tabs of today.

``make pictures ARGS="inverse branches"`` records some of them.
"""

from __future__ import annotations

import argparse
import io
import re
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo
from playwright.sync_api import FloatRect, Locator, expect, sync_playwright
from playwright.sync_api import TimeoutError as NotInTime
from tests.browser.drawing import DRAW_ONCE
from tests.browser.kit import PATIENCE_MS, Screen, Screens, launch
from tests.browser.serving import serving
from tests.ui.page_outline import outlines

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "pictures"
WIDTH, HEIGHT = 1280, 800
FRAME = "#armctl-top", "#armctl-under"
"""the bar above the scene, and the line below it"""
FARTHER = 1500
"""how far the wheel is turned, until the whole workspace is seen"""
COLORS = 256
OUTLINE = "outline"
BUS_ARM = "so101"
"""an arm on a servo bus"""
FEW_WAYS, POINT = "mico", ("350", "-100", "250")
"""an arm whose ways to a point [mm] are few, so that they can be told apart"""


@dataclass(frozen=True)
class Picture:
    """One picture: the tabs that it shows, how the page comes to it, and what part of the page it is."""

    tabs: tuple[str, ...]
    arrange: Callable[[Screen], Locator | FloatRect | None]
    """None: the whole page"""
    enabled: bool = True
    robot: str = "uzuner"
    tabs_of: str = "uzuner"
    """the arm with which its outline is taken"""

    @property
    def shows(self) -> tuple[str, ...]:
        return ("Control", "Serial motion", *self.tabs)


_TOUCHED = {
    "Origin": ("190", "30", "30"),
    "To the right": ("190", "-70", "30"),
    "Upwards": ("260", "30", "30"),
}
"""where the pen touches the plane of a drawing [mm]"""
_CORNERS = {
    "Origin": ("180", "-60", "60"),
    "On +x": ("180", "40", "60"),
    "On the +y side": ("110", "0", "60"),
}
"""where the tool touches a table [mm]"""

# How each screen is brought to what it should show.


def scene(screen: Screen) -> FloatRect:
    """The 3D view."""
    right, bar, line = (box(one) for one in (screen.panel("Main"), *map(screen.page.locator, FRAME)))
    top = bar["y"] + bar["height"]
    return {"x": 0, "y": top, "width": right["x"], "height": line["y"] - top}


def box(target: Locator) -> FloatRect:
    """Where something lies in the page [px]."""
    return target.evaluate("element => element.getBoundingClientRect().toJSON()")


def control(screen: Screen) -> Locator:
    return screen.page.locator("#armctl-top")


def main_tab(screen: Screen) -> None:
    screen.open_tab("Main")


def manual(screen: Screen) -> None:
    screen.open_tab("Manual")
    screen.slide("Base °", 0.62)
    screen.slide("Shoulder °", 0.45)


def program(screen: Screen) -> None:
    screen.open_tab("Serial motion")
    screen.unfold("Files", "Load")
    screen.upload("Upload", ROOT / "examples" / "pick_and_place.toml")
    screen.wait_for_text(re.compile("above the part"))
    screen.press(screen.page.get_by_text("Files", exact=True))
    screen.press(screen.page.get_by_role("row", name="above the part").first)
    screen.wait_for_text(re.compile("step 2 ·"))
    screen.tab("Serial motion").scroll_into_view_if_needed()


def frames(screen: Screen) -> None:
    touch(screen, "Frames", _CORNERS)
    screen.wait_for_notification("Frame taught")
    screen.click("Add as step")
    screen.click("Point")
    screen.wait_for_text(re.compile("2 steps"))


def touch(screen: Screen, tab: str, touches: dict[str, tuple[str, str, str]]) -> None:
    """Bring the tool to a point, and press the button of an inner tab of *Manual*; one after the other."""
    for label, place in touches.items():
        screen.open_tab("Inverse")
        screen.type_xyz(*place)
        screen.click("Solve")
        screen.click("Go by least energy")
        screen.wait_for_text("No next pose")
        screen.open_tab("Manual", tab)
        screen.click(label)


def drawing(screen: Screen) -> None:
    touch(screen, "Drawing", _TOUCHED)
    screen.upload("Choose a drawing (SVG, G-code)", ROOT / "examples" / "name.svg")
    screen.wait_for_text(re.compile(r"\d+ mm in \d+ s"))


def trajectory(screen: Screen, to: str = "home") -> None:
    screen.open_tab("Trajectory")
    screen.choose("To", to)
    screen.click("Show")
    screen.wait_for_text("Tool position (mm)")


def graphs(screen: Screen) -> FloatRect:
    trajectory(screen, "zero")
    screen.choose("Graph of", "Joints")
    screen.choose("Quantity", "Velocity")
    screen.wait_for_text("Joint velocity (°/s)")
    plot = screen.page.locator("[name=graph]").locator("visible=true").first
    plot.evaluate("element => element.scrollIntoView({block: 'center'})")
    return box(plot.locator("xpath=ancestor::*[contains(@class, 'mantine-Paper-root')][1]"))


def forward(screen: Screen) -> None:
    screen.open_tab("Forward")


def inverse(screen: Screen) -> None:
    screen.open_tab("Inverse")
    screen.type_xyz("220", "-60", "100")
    screen.click("Solve")
    screen.wait_for_text(re.compile("solutions inside the limits"))


def branches(screen: Screen) -> FloatRect:
    screen.open_tab("Inverse")
    screen.type_xyz(*POINT)
    screen.click("Solve")
    screen.unfold("Branches", "Solve")
    screen.tick("Show as ghosts")
    return scene(screen)


def workspace(screen: Screen) -> FloatRect:
    simulation(screen)
    screen.click("Side")
    screen.page.mouse.move(WIDTH / 2, HEIGHT / 2)
    screen.page.mouse.wheel(0, FARTHER)
    return scene(screen)


def simulation(screen: Screen) -> None:
    screen.open_tab("Simulation")
    screen.tick("Workspace cloud")
    screen.wait_for_text(re.compile("from the base axis"))
    screen.tick("Section")
    screen.wait_for_text(re.compile("The blue line"))


def calibration(screen: Screen) -> None:
    screen.open_tab("Calibration")


def log(screen: Screen) -> None:
    screen.open_tab("Log")


def exact_point(screen: Screen) -> None:
    screen.open_tab("Inverse")
    screen.type_xyz("230", "60", "120")
    screen.click("Go by least energy")
    screen.wait_for_text("MOVING")
    screen.wait_for_text("HOLDING")


def by_hand(screen: Screen) -> None:
    screen.open_tab("Manual", "Joints")
    screen.unfold("Lead by hand", "Let ticked joints go limp")
    screen.press(
        screen.page.get_by_label("Shoulder pan", exact=True).and_(screen.page.get_by_role("checkbox"))
    )
    screen.click("Let ticked joints go limp")
    screen.wait_for_text(re.compile("Limp: Shoulder pan"))
    for _ in range(2):
        screen.click("Record pose")
    screen.wait_for_text(re.compile("2 steps"))
    screen.button("Let ticked joints go limp").scroll_into_view_if_needed()


def disconnected(screen: Screen) -> None:
    """The tab of the servos, whoever let go of the arm before."""
    screen.open_tab("Main", "Servos")
    on, off = screen.button("Disconnect the arm"), screen.button("Connect the arm")
    expect(on.or_(off).locator("visible=true")).to_have_count(1, timeout=PATIENCE_MS)
    if on.is_visible():
        screen.press(on)
    expect(off).to_be_visible(timeout=PATIENCE_MS)


def new_servo(screen: Screen) -> FloatRect:
    disconnected(screen)
    screen.unfold("A new servo", "Give it this id")
    screen.button("Give it this id").scroll_into_view_if_needed()
    return box(screen.panel("Main"))


def servos(screen: Screen) -> FloatRect:
    disconnected(screen)
    screen.click("Look for the servos")
    screen.wait_for_text(re.compile("as the arm needs them"))
    screen.press(screen.page.get_by_role("button", name="Change id").last)
    screen.type_into("New id", "9")
    screen.click("Write it")
    screen.wait_for_text(re.compile("Servo 9 is not one of this arm"))
    return box(screen.panel("Main"))


PICTURES = {
    "main": Picture(("Main",), main_tab, enabled=False),
    "control": Picture((), control),
    "log": Picture(("Log",), log),
    "manual": Picture(("Manual",), manual),
    "program": Picture((), program),
    "drawing": Picture(("Manual",), drawing),
    "frames": Picture(("Manual",), frames),
    "trajectory": Picture(("Trajectory",), trajectory),
    "graphs": Picture(("Trajectory",), graphs),
    "forward": Picture(("Forward",), forward),
    "inverse": Picture(("Inverse",), inverse),
    "branches": Picture(("Inverse",), branches, robot=FEW_WAYS),
    "simulation": Picture(("Simulation",), simulation),
    "workspace": Picture(("Simulation",), workspace),
    "calibration": Picture(("Calibration",), calibration),
    # Ids are written while the servos are limp, so before an arm is enabled.
    "new-servo": Picture(("Main",), new_servo, enabled=False, robot=BUS_ARM, tabs_of=BUS_ARM),
    "servos": Picture(("Main",), servos, enabled=False, robot=BUS_ARM, tabs_of=BUS_ARM),
    "exact-point": Picture(("Inverse",), exact_point, robot=BUS_ARM, tabs_of=BUS_ARM),
    "by-hand": Picture(("Manual",), by_hand, robot=BUS_ARM, tabs_of=BUS_ARM),
}
FILM = "armctl"
FILM_TABS = ("Control", "Serial motion", "Inverse")


# The moving picture.

_FILM_SIZE = (1280, 800)
_FILM_WIDTH = 960
_TYPED_MS, _STEP_MS, _READ_MS = 110, 50, 1800
_DURATION_S, _FASTER = 8, 3
"""so long takes the motion that is recorded, and so many times faster it is shown"""
_POINTER = """() => {
  const pointer = document.createElement("div");
  pointer.style.cssText = "position:fixed;left:0;top:0;z-index:99999;pointer-events:none;line-height:0";
  pointer.innerHTML = '<svg width="22" height="26"><path d="M2 1v20l5-5 4 9 3.5-1.5-4-9h7z" stroke="white" \
stroke-width="1.5"/></svg>';
  document.body.append(pointer);
  addEventListener("mousemove", (event) => {
    pointer.style.transform = `translate(${event.clientX}px,${event.clientY}px)`;
  }, true);
}"""


class Film:
    """Frames of one page, each with how long it is shown [ms]."""

    def __init__(self, screen: Screen) -> None:
        self.screen = screen
        self.frames: list[tuple[Image.Image, int]] = []
        self._at = (0.62 * _FILM_SIZE[0], 0.8 * _FILM_SIZE[1])
        screen.page.evaluate(_POINTER)
        screen.page.mouse.move(*self._at)

    def shoot(self, milliseconds: int) -> None:
        """Take a frame; one that shows the same as the one before makes that longer."""
        self.screen.page.evaluate(DRAW_ONCE)
        frame = Image.open(io.BytesIO(self.screen.page.screenshot())).convert("RGB")
        height = round(frame.height * _FILM_WIDTH / frame.width)
        frame = frame.resize((_FILM_WIDTH, height), Image.Resampling.LANCZOS)
        if self.frames and self.frames[-1][0].tobytes() == frame.tobytes():
            milliseconds += self.frames.pop()[1]
        self.frames.append((frame, milliseconds))

    def point(self, target: Locator, steps: int = 6) -> None:
        """Move the pointer to a widget."""
        target.scroll_into_view_if_needed()
        at, (x, y) = box(target), self._at
        to = at["x"] + min(0.5 * at["width"], 120), at["y"] + 0.6 * at["height"]
        for i in range(1, steps + 1):
            part = i / steps * (2 - i / steps)  # it slows down
            self._at = x + part * (to[0] - x), y + part * (to[1] - y)
            self.screen.page.mouse.move(*self._at)
            self.shoot(_STEP_MS)

    def press(self, target: Locator, milliseconds: int = 300) -> None:
        self.point(target)
        self.screen.page.mouse.click(*self._at)
        self.screen.pause(250)
        self.shoot(milliseconds)

    def type(self, label: str, text: str) -> None:
        entry = self.screen.entry(label)
        self.press(entry, 100)
        entry.press("Control+A")
        for key in text:
            self.screen.pause()
            entry.press_sequentially(key)
            self.shoot(_TYPED_MS)
        self.screen.leave(label)

    def save(self, path: Path, outline: str) -> None:
        (first, _), *_ = self.frames
        rest = [frame for frame, _ in self.frames[1:]]
        lengths = [length for _, length in self.frames]
        first.save(
            path, save_all=True, append_images=rest, duration=lengths, loop=0, quality=70, method=6,
            xmp=outline.encode(),
        )  # fmt: skip


def film(screen: Screen) -> Film:
    """Type a point, look at the ways to it, choose one, press Go: the arm follows."""
    screen.open_tab("Inverse")
    screen.type_into("Duration s", str(_DURATION_S))
    film = Film(screen)
    film.shoot(800)
    for axis, value in zip("XYZ", POINT, strict=True):
        film.type(f"{axis} mm", value)
    film.press(screen.button("Solve"), _READ_MS)
    ways = screen.page.get_by_role("option").locator("visible=true")
    film.point(ways.nth(1))
    film.screen.pause(400)
    film.shoot(_READ_MS)  # it is looked at
    film.press(ways.nth(1), _READ_MS)
    film.press(screen.button("Go"), 0)
    begin = before = time.perf_counter()
    while before < begin + _DURATION_S:
        film.shoot(0)
        now = time.perf_counter()
        frame, _ = film.frames[-1]
        film.frames[-1] = (frame, round(1000 * (now - before) / _FASTER))
        before = now
        if "motion halted" in screen.text("#armctl-top").replace("\n", " "):
            raise SystemExit(f"{FILM}: the arm halted, because this computer is too busy: record it again")
    screen.wait_for_text("HOLDING")
    film.shoot(_READ_MS)
    return film


# The outlines.


def outline_of(shows: tuple[str, ...], tabs: dict[str, str]) -> str:
    """What a picture carries that shows these tabs."""
    return "\n".join(f"{tab}:\n{tabs[tab]}" for tab in shows)


def carried(path: Path) -> str:
    """The outline that a picture carries."""
    with Image.open(path) as image:
        text = image.info.get(OUTLINE, image.info.get("xmp", ""))
    return text.decode() if isinstance(text, bytes) else text


# Recording.


def save(screen: Screen, name: str, picture: Picture, outline: str) -> None:
    part = picture.arrange(screen)
    screen.page.mouse.move(WIDTH / 2, HEIGHT - 10)  # no hint is shown
    expect(screen.page.locator(".mantine-Notification-root")).to_have_count(0, timeout=PATIENCE_MS)
    screen.pause(1500)
    screen.page.evaluate(DRAW_ONCE)
    taken = part.screenshot() if isinstance(part, Locator) else screen.page.screenshot(clip=part)
    info = PngInfo()
    info.add_text(OUTLINE, outline, zip=True)
    image = Image.open(io.BytesIO(taken)).convert("RGB").quantize(COLORS, dither=Image.Dither.NONE)
    image.save(FOLDER / f"{name}.png", optimize=True, pnginfo=info)


def opened(screen: Screen, url: str, enabled: bool) -> None:
    """A page that has just been opened, with the arm on if that is asked for."""
    screen.open(url, until="STOP")
    screen.dismiss_graphics_warning()
    holds = screen.page.locator("#armctl-top .state.holding")
    for _ in range(5 if enabled else 0):
        if holds.is_visible():
            return
        screen.click("Enable")  # a server that still builds the page on a busy computer refuses it
        with suppress(NotInTime):
            holds.wait_for(timeout=PATIENCE_MS / 4)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="make pictures", description="Record the pictures of README and docs."
    )
    parser.add_argument(
        "names", nargs="*", choices=[[], *PICTURES, FILM], help="all of them, if none is named"
    )
    names = parser.parse_args().names or [*PICTURES, FILM]
    FOLDER.mkdir(exist_ok=True)
    tabs = {robot: outlines(robot) for robot in ("uzuner", BUS_ARM)}
    with sync_playwright() as playwright:
        browser = launch(playwright)
        # An arm whose servos got other ids without being enabled cannot be enabled afterwards.
        wanted = {(PICTURES[name].robot, PICTURES[name].enabled) for name in names if name in PICTURES}
        for robot, enabled in sorted(wanted | ({(FEW_WAYS, True)} if FILM in names else set())):
            with tempfile.TemporaryDirectory() as folder, serving(Path(folder), "--robot", robot) as url:
                screen = Screens(browser)(width=WIDTH, height=HEIGHT)
                for name, picture in PICTURES.items():
                    if name in names and (picture.robot, picture.enabled) == (robot, enabled):
                        opened(screen, url, enabled)
                        save(screen, name, picture, outline_of(picture.shows, tabs[picture.tabs_of]))
                        print(name, file=sys.stderr)
                if FILM in names and robot == FEW_WAYS:
                    width, height = _FILM_SIZE
                    screen.page.set_viewport_size({"width": width, "height": height})
                    opened(screen, url, enabled=True)
                    film(screen).save(FOLDER / f"{FILM}.webp", outline_of(FILM_TABS, tabs["uzuner"]))
                    print(FILM, file=sys.stderr)
                screen.page.context.close()
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
