"""How often a person presses something for the usual jobs: ``python -m benchmarks.page_clicks [JOB …]``.

Each job is done in a headless Chromium (1280×800) on ``armctl serve`` and its simulated board, as somebody
with a mouse does it who knows the page. An *action* is a click, a double click, a drag, or a field that is
filled: clicked, typed into, and left by Enter. *Presses* are those of mouse button and keys in them. Turning
the wheel is not counted. The seconds are those until the last one has done what it is for; the arm moves
meanwhile, and a browser without a graphics card draws by software: compare them on one machine only.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

from benchmarks import machine
from benchmarks.page_ratios import OURS, SETTLED_S, served
from playwright.sync_api import Browser, Locator, sync_playwright
from tests.browser.ghost_view import drag_tool
from tests.browser.kit import Screen, launch

from armctl.ui.widgets.html import fixed

POINT = {"uzuner": ("220", "-60", "100"), "ur5": ("-400", "-150", "350")}
"""where the tool is sent [mm]"""
RISES_PX = -25, -30, -25, -30
"""how far the tool is dragged downwards for each pose that is recorded: its arrow stays above the pins"""


@dataclass
class Person:
    """Who does something with a page, and how often so far."""

    screen: Screen
    actions: int = 0
    presses: int = 0

    def _act(self, presses: int) -> None:
        self.actions += 1
        self.presses += presses

    def press(self, target: str | Locator) -> None:
        """Click a button by its label, or something else."""
        self._act(1)
        self.screen.press(self.screen.button(target) if isinstance(target, str) else target)
        self.screen.pause()

    def open_tab(self, label: str) -> None:
        self.press(self.screen.tab(label))

    def press_twice(self, target: Locator) -> None:
        self._act(2)
        target.dblclick(position={"x": 80, "y": 12})
        self.screen.pause()

    def drag_tool(self, down_px: float) -> None:
        """Drag the tool in the scene."""
        self._act(1)
        drag_tool(self.screen, 0, down_px)
        self.screen.wait_until(lambda: self.screen.is_enabled("Go"), "there is a next pose")

    def slide(self, label: str, share: float) -> None:
        """Drag a slider to a share of its way."""
        self._act(1)
        self.screen.slide(label, share)
        self.screen.wait_until(lambda: self.screen.is_enabled("Go"), "there is a next pose")

    def fill(self, label: str, text: str) -> None:
        """Click into a field, type over what is there, and leave it."""
        self._act(3 + len(text) + 1)  # the click three times, which selects what is there; at last Enter
        self.screen.entry(label).click(click_count=3)
        self.screen.page.keyboard.type(text)
        self.screen.pause()  # the page sends the first letter alone for 50 ms
        self.screen.page.keyboard.press("Enter")
        self.screen.pause()

    def arrive(self) -> None:
        """Wait until the arm has come to the next pose."""
        self.screen.wait_for_text("No next pose")
        self.screen.wait_for_text("HOLDING")


def enable(person: Person) -> None:
    person.press("Enable")
    person.screen.wait_for_text("HOLDING")


def first_motion(person: Person) -> None:
    """From a page that is just open."""
    enable(person)
    person.drag_tool(RISES_PX[0])
    person.press("Go")
    person.arrive()


def solved(person: Person) -> None:
    """A point is typed, and the best way to it shown."""
    enable(person)
    person.open_tab("Inverse")
    for axis, value in zip("XYZ", POINT["ur5"], strict=True):
        person.fill(f"{axis} mm", value)  # at whose end Enter solves
        # until then there are cards of what was solved before
        person.screen.wait_for_text(f"{axis} {fixed(float(value), 1)}")


def another_way(person: Person) -> None:
    """Of a point that is solved, not by the best one of its ways."""
    cards = person.screen.page.locator(".armctl-card:not([aria-disabled=true], [aria-selected=true])")
    person.press(cards.first)
    person.screen.wait_until(lambda: person.screen.is_enabled("Go"), "it is the next pose")
    person.press("Go")
    person.arrive()


def recorded(person: Person) -> None:
    """Two poses are on the list."""
    enable(person)
    for down in RISES_PX[:2]:
        person.drag_tool(down)
        person.press("Record")


def edit_step(person: Person) -> None:
    """Change a number of a step that is on the list."""
    rows = person.screen.page.locator(".armctl-steps > [role=row]")
    person.press_twice(rows.first)
    person.fill("Duration s", "2.5")
    person.screen.wait_until(lambda: "2.5 s" in rows.first.inner_text(), "the row shows it")


def record_and_run(person: Person) -> None:
    """Four poses and the gripper; checked, looped, stopped and saved; from a page that is just open."""
    screen = person.screen
    enable(person)
    for down in RISES_PX:
        person.drag_tool(down)
        person.press("Go")
        person.arrive()
        person.press("Record")
    person.press("Add step ▾")
    person.press(screen.button("Record gripper", within=screen.page.locator(".armctl-add")))
    person.fill("Open %", "20")
    screen.wait_for_text("20 % open")
    person.press("Check")
    screen.wait_for_text("clear")
    person.press("Loop")
    screen.wait_for_text("MOVING")
    person.press("STOP")
    screen.wait_for_text("HOLDING")
    person.press(screen.page.get_by_text("Files", exact=True))
    person.press("Save")
    screen.wait_for_notification("Saved")


def own_arm(person: Person) -> None:
    """From *Main*: an arm with a length of its own is described, saved, opened, enabled and moved."""
    screen = person.screen
    person.open_tab("Your own arm")
    person.press("New arm")
    screen.wait_for_text("every solution in closed form")
    person.fill("Upper arm mm", "140")
    person.open_tab("3 Save")
    person.press("Save and open")
    screen.wait_until(lambda: "My arm" in screen.text("armctl-part[name=bar]"), "it is open")
    enable(person)
    person.open_tab("Manual")  # it stands stretched out: its tool can be dragged nowhere
    person.slide("Base °", 0.6)
    person.press("Go")
    person.arrive()


@dataclass(frozen=True)
class Job:
    """What is to be done, from where."""

    title: str
    goal: int
    do: Callable[[Person], None]
    robot: str = "uzuner"
    before: Callable[[Person], None] = lambda _: None
    """what is there already, and not counted"""


JOBS = {
    "first-motion": Job("first motion: Enable, drag the tool, Go", 4, first_motion),
    "another-way": Job("another way of a UR5 to a point that is solved", 2, another_way, "ur5", solved),
    "edit-step": Job("edit a number of a step", 2, edit_step, before=recorded),
    "record": Job("record 4 poses and the gripper, check, loop, stop, save", 22, record_and_run),
    "own-arm": Job("an arm of one's own, from Main until it moves", 9, own_arm),
}


@contextmanager
def page_of(browser: Browser, robot: str) -> Generator[Screen]:
    """A page that is just open, and shows what it shows at first."""
    with served(OURS, robot) as console:
        screen = Screen(browser.new_page(viewport={"width": 1280, "height": 800}))
        screen.open(console.url, until="Enable")
        screen.dismiss_graphics_warning()
        screen.wait_until(lambda: "Operator: you" in screen.text("armctl-part[name=bar]"), "it operates")
        screen.page.wait_for_timeout(1000 * SETTLED_S)
        yield screen
        screen.page.close()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page_clicks", description=__doc__)
    parser.add_argument("jobs", nargs="*", metavar="JOB", help=", ".join(JOBS))
    names = parser.parse_args().jobs or JOBS
    print("", machine.sentence(machine.facts()), "", sep="\n")
    print("| job | actions | goal | presses | seconds |", "|---|--:|--:|--:|--:|", sep="\n")
    with sync_playwright() as playwright:
        browser = launch(playwright)
        for job in (JOBS[name] for name in names):
            with page_of(browser, job.robot) as screen:
                job.before(Person(screen))
                person, begun = Person(screen), time.monotonic()
                job.do(person)
                seconds = time.monotonic() - begun
            figures = f"{person.actions} | {job.goal} | {person.presses} | {seconds:.1f}"
            print(f"| {job.title} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
