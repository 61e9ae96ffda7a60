"""What a person does with the page: find a field by its label, type, press, read.

viser 1.1.1's page is made of Mantine widgets. A field is a row with a ``<label>`` at its left; a tab is
``[role=tab]`` with its label as ``title``; the tabs that are not shown stay in the document, invisible.
The page sends at most one message in 50 ms and forgets those in between: a person is slower than that, so
these helpers wait ``PAUSE_MS`` between two actions, by the page's own clock. A page that stood still for as
long as that would see both at once.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, Playwright, expect
from tests.browser.drawing import DRAW_ON_DEMAND, DRAW_ONCE

PAUSE_MS = 60
PATIENCE_MS = 20_000
_GLANCE_MS = 50
"""between two looks at something outside the page: each takes some milliseconds of three processes"""

WATCH_CLICKS = """
  window.armctlClicked = [];
  addEventListener("click", (event) => { window.armctlClicked.push(event.target); }, { capture: true });
"""
FORGET_CLICKS = "() => { window.armctlClicked = []; }"
WAS_CLICKED = """(element) =>
  !element.isConnected || window.armctlClicked.some((clicked) => element.contains(clicked))
"""

_PAUSE = "(milliseconds) => new Promise((go_on) => setTimeout(go_on, milliseconds))"

_NODE = """name => {
  const node = window.__viserMutable.nodeRefFromName[name];
  if (!node) return null;
  for (let at = node; at; at = at.parent) if (!at.visible) return null;
  return node.position.toArray();
}"""

_ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def find_chromium() -> str:
    """The browser to drive, without its own window if there is one: that saves a sixth of the processor.

    Without a browser the tests fail, they are never skipped.
    """
    for name in ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"):
        if path := shutil.which(name):
            return path
    raise FileNotFoundError("the browser tests need Chromium: `make packages` installs it")


def launch(playwright: Playwright) -> Browser:
    return playwright.chromium.launch(executable_path=find_chromium(), headless=True, args=list(_ARGUMENTS))


@dataclass
class Screen:
    """One browser page, looked at as the operator does."""

    page: Page
    """playwright's page, for what is not covered here"""
    drawn: bool = False
    """whether the scene's pixels are drawn all the time, or for screenshots only"""
    errors: list[str] = field(default_factory=list[str])
    """console errors and uncaught exceptions so far; Content-Security-Policy violations are there"""

    def __post_init__(self) -> None:
        def note(message: ConsoleMessage) -> None:
            if message.type == "error":
                self.errors.append(message.text)

        self.page.on("console", note)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.set_default_timeout(PATIENCE_MS)
        self.page.add_init_script(WATCH_CLICKS)
        if not self.drawn:
            self.page.add_init_script(DRAW_ON_DEMAND)

    def open(self, url: str, *, until: str | None = None) -> None:
        """Open a page and wait until it shows the button ``until``, or any control of the server.

        It is a new one: what a page has again that is loaded anew (``page.reload``) is none of this one's.
        """
        self._keep_nothing()
        self.page.goto(url)
        self._wait_until_shown(until)

    def reload(self, *, until: str) -> None:
        """Load the page anew, and wait until it shows the button ``until``."""
        self.page.reload()
        self._wait_until_shown(until)

    def _keep_nothing(self) -> None:
        if self.page.url.startswith("http"):
            self.page.evaluate("addEventListener('pagehide', () => sessionStorage.clear())")

    def _wait_until_shown(self, until: str | None) -> None:
        self.page.wait_for_selector("[data-dock-group]", state="attached")
        expect(self.page.get_by_text("Connecting...", exact=True)).to_have_count(0, timeout=PATIENCE_MS)
        if until is None:
            first = self.page.locator("[data-dock-tab], [data-dock-group] button[id]").first
        else:
            first = self.button(until)
        first.wait_for()
        self.pause()

    def leave_page(self) -> None:
        """Make the window as good as new: no page, no cookies, nothing stored, no errors, the mouse aside."""
        self._keep_nothing()
        if self.page.url.startswith("http"):
            self.page.evaluate("localStorage.clear()")
        self.page.goto("about:blank")
        self.page.context.clear_cookies()
        self.page.mouse.move(0, 0)
        self.errors.clear()

    def pause(self, milliseconds: int = PAUSE_MS) -> None:
        """Let the page send what it has to send (its throttle is 50 ms); it takes part in the wait."""
        self.page.evaluate(_PAUSE, milliseconds)

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for something outside the page, while the page goes on; fails with ``what``."""
        for _ in range(PATIENCE_MS // _GLANCE_MS):
            if condition():
                return
            self.page.wait_for_timeout(_GLANCE_MS)
        shown = self.page.locator("body").inner_text()
        raise AssertionError(f"waited {PATIENCE_MS / 1000:.0f} s in vain: {what}; the page shows:\n{shown}")

    def panel(self, tab: str) -> Locator:
        """The panel (or tab group) that has a tab with this label, for the ``within`` of the others."""
        strip = self.page.locator(f"[role=tab][title={_quoted(tab)}]")
        return self.page.locator("[data-dock-group]").filter(has=strip).last

    def button(self, label: str, *, within: Locator | None = None) -> Locator:
        return (
            (within or self.page).get_by_role("button", name=label, exact=True).locator("visible=true").first
        )

    def tab(self, label: str) -> Locator:
        return self.page.locator(f"[role=tab][title={_quoted(label)}]").locator("visible=true").first

    def row(self, label: str, *, within: Locator | None = None) -> Locator:
        """The row of a labelled field: its label and its inputs."""
        exactly = re.compile(rf"^{re.escape(label)}$")
        labels = (within or self.page).locator("label[for]").filter(has_text=exactly).locator("visible=true")
        return labels.first.locator("xpath=ancestor::div[.//input or .//textarea or .//button][1]")

    def entry(self, label: str, index: int = 0, *, within: Locator | None = None) -> Locator:
        """The box to type into: of a number, a text, a slider, or component ``index`` of a vector."""
        boxes = self.row(label, within=within).locator("input:not([type=hidden]), textarea")
        return boxes.nth(index)

    def press(self, target: Locator) -> None:
        """Click something, and again if it moved away between the mouse button's down and up.

        The page's answer to what was done before may move everything below it: a browser then makes no
        click of the two, and a person presses once more. What is gone from the page afterwards counts as
        pressed: options and menus go when they are.
        """
        for _ in range(5):
            element = target.element_handle()
            element.evaluate(FORGET_CLICKS)
            target.click()
            if element.evaluate(WAS_CLICKED):
                return
        raise AssertionError(f"{target} moves away from each click")

    def click(self, label: str, *, within: Locator | None = None) -> None:
        """Press the button with this label, also one of a button group."""
        self.press(self.button(label, within=within))
        self.pause()

    def open_tab(self, *labels: str) -> None:
        """Open a tab, a tab in it, and so on."""
        for label in labels:
            self.press(self.tab(label))
            expect(self.tab(label)).to_have_attribute("aria-selected", "true", timeout=PATIENCE_MS)
            self.pause()

    def add_step(self, group: str, label: str) -> None:
        """Choose a kind of step from the menu of the program; the step's fields are open then."""
        self.click("Add step ▾")
        self.click(label, within=self.page.get_by_role("group", name=group, exact=True))

    def unfold(self, folder: str, button: str) -> None:
        """Open a folder, and wait until its ``button`` has come to rest."""
        self.press(self.page.get_by_text(folder, exact=True))
        self.wait_until_at_rest(self.button(button))

    def wait_until_at_rest(self, target: Locator) -> None:
        """What unfolds moves what lies below it for a while."""
        lies_at: list[object] = []

        def rests() -> bool:
            lies_at.append(target.bounding_box())
            still = len(lies_at) > 5 and all(box == lies_at[-1] for box in lies_at[-5:])
            return still and lies_at[-1] is not None

        self.wait_until(rests, f"{target} is at rest")

    def type_into(
        self,
        label: str,
        text: str,
        index: int = 0,
        *,
        within: Locator | None = None,
        leave: bool = True,
        by_key: bool = False,
    ) -> None:
        """Replace what a field holds; when it is left, the page corrects it to its limits.

        The text comes at once, as one that is pasted; ``by_key``: a key at a time, and the page and the arm
        see each half of a number. That takes several times as long.
        """
        box = self.entry(label, index, within=within)
        self.press(box)
        box.press("Control+A")
        keyboard = self.page.keyboard
        for part in text if by_key else [text]:
            (keyboard.press if by_key else keyboard.insert_text)(part)
            self.pause()
        if leave:
            self.leave(label, index, within=within)

    def type_xyz(self, *values: str, by_key: bool = False) -> None:
        """Type into the fields X mm, Y mm and Z mm."""
        for axis, value in zip("XYZ", values, strict=True):
            self.type_into(f"{axis} mm", value, by_key=by_key)

    def leave(self, label: str, index: int = 0, *, within: Locator | None = None) -> None:
        """Take the focus from a field: hot keys do not work while it has it."""
        self.entry(label, index, within=within).blur()
        self.pause()

    def slide(self, label: str, fraction: float, *, within: Locator | None = None) -> None:
        """Drag a slider's thumb to a fraction (0 … 1) of its track."""
        row = self.row(label, within=within)
        row.scroll_into_view_if_needed()
        thumb = row.get_by_role("slider").first.bounding_box()
        track = row.locator(".mantine-Slider-track").first.bounding_box()
        if thumb is None or track is None:
            raise AssertionError(f"the slider {label!r} is not on the screen")
        mouse = self.page.mouse
        mouse.move(thumb["x"] + thumb["width"] / 2, thumb["y"] + thumb["height"] / 2)
        mouse.down()
        mouse.move(track["x"] + fraction * track["width"], track["y"] + track["height"] / 2, steps=5)
        self.pause()
        mouse.up()
        self.pause()

    def nudge(self, label: str, key: str = "ArrowRight", *, within: Locator | None = None) -> None:
        """Move a slider by one step with the keyboard."""
        self.row(label, within=within).get_by_role("slider").first.press(key)
        self.pause()

    def choose(self, label: str, option: str, *, within: Locator | None = None) -> None:
        """Choose from a dropdown."""
        self.press(self.entry(label, within=within))
        self.press(self.page.get_by_role("option", name=option, exact=True).locator("visible=true").first)
        self.pause()

    def tick(self, label: str, on: bool = True, *, within: Locator | None = None) -> None:
        self.entry(label, within=within).set_checked(on)
        self.pause()

    def hold(self, label: str, milliseconds: int, *, within: Locator | None = None) -> None:
        """Keep a button pressed."""
        box = self.button(label, within=within).bounding_box()
        if box is None:
            raise AssertionError(f"the button {label!r} is not on the screen")
        self.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        self.page.mouse.down()
        self.pause(milliseconds)
        self.page.mouse.up()
        self.pause()

    def upload(self, label: str, file: Path, *, within: Locator | None = None) -> None:
        """Hand a file to an upload button."""
        with self.page.expect_file_chooser() as chooser:
            self.press(self.button(label, within=within))
        chooser.value.set_files(file)
        self.pause()

    def value(self, label: str, index: int = 0, *, within: Locator | None = None) -> str:
        """What a field shows."""
        return self.entry(label, index, within=within).input_value()

    def number(self, label: str, index: int = 0, *, within: Locator | None = None) -> float:
        return float(self.value(label, index, within=within).replace(",", ""))

    def is_ticked(self, label: str, *, within: Locator | None = None) -> bool:
        return self.entry(label, within=within).is_checked()

    def is_enabled(self, label: str, *, within: Locator | None = None) -> bool:
        """Whether the button with this label can be pressed."""
        return self.button(label, within=within).is_enabled()

    def text(self, selector: str = "#root") -> str:
        """The visible text of an element: of an ``add_html`` block by its own id or class, or of all."""
        return self.page.locator(selector).locator("visible=true").first.inner_text()

    def wait_for_text(self, text: str | re.Pattern[str]) -> None:
        """Wait until a text can be seen anywhere: markdown, html, title or notification."""
        self.page.get_by_text(text).locator("visible=true").first.wait_for()

    def notifications(self) -> list[str]:
        """Title and body of the notifications that are shown, but for viser's about slow graphics."""
        shown = self.page.locator(".mantine-Notification-root:not(#webgl-software-rendering)")
        return [re.sub(r"\s*\n\s*", "\n", text).strip() for text in shown.all_inner_texts()]

    def wait_for_notification(self, text: str | re.Pattern[str]) -> None:
        self.page.locator(".mantine-Notification-root").filter(has_text=text).first.wait_for()

    def download(self, button: str) -> Path:
        """The file that a button offers, under the name that it suggests."""
        with self.page.expect_download() as download:
            self.click(button)
        path = Path(download.value.path())
        return path.rename(path.with_name(download.value.suggested_filename))

    def node(self, name: str) -> list[float] | None:
        """Where a node of the scene stands in its parent [m]; None: there is none, or it is hidden."""
        return self.page.evaluate(_NODE, name)

    def dismiss_graphics_warning(self) -> None:
        """Close the notification that a browser without graphics card shows, it hides the scene's corner."""
        warning = self.page.locator("#webgl-software-rendering")
        warning.wait_for()

        def gone() -> bool:  # a click while it slides in can miss it
            self.page.evaluate("document.querySelector('#webgl-software-rendering button')?.click()")
            return warning.count() == 0

        self.wait_until(gone, "the warning is closed")

    def screenshot(self, name: str) -> None:
        """Save what is seen as ``name.png`` in $ARMCTL_SCREENSHOTS, to be looked at; nothing without that.

        Without a graphics card each takes a second.
        """
        if (folder := os.environ.get("ARMCTL_SCREENSHOTS")) is None:
            return
        Path(folder).mkdir(parents=True, exist_ok=True)
        if not self.drawn:
            self.page.evaluate(DRAW_ONCE)
        self.page.screenshot(path=Path(folder) / f"{name}.png")


@dataclass
class Screens:
    """Opens screens in one browser; those that are open together have cookies and storage of their own.

    A window is used again by a later test, emptied: it still knows the page's script, and loading that into
    a new one takes half as long again.
    """

    browser: Browser
    opened: list[Screen] = field(default_factory=list[Screen])
    spare: list[Screen] = field(default_factory=list[Screen])

    def __call__(
        self, url: str | None = None, *, width: int = 1280, height: int = 800, drawn: bool = False
    ) -> Screen:
        """Open a browser window of an inner size [px], and ``url`` in it, if given."""
        screen = next((screen for screen in self.spare if screen.drawn == drawn), None)
        if screen is None:
            screen = Screen(self.browser.new_page(), drawn)
        else:
            self.spare.remove(screen)
        screen.page.set_viewport_size({"width": width, "height": height})
        self.opened.append(screen)
        if url is not None:
            screen.open(url)
        return screen

    def close(self) -> None:
        """Leave every page; the windows are spare then."""
        for screen in self.opened:
            if screen.page.is_closed():
                screen.page.context.close()
            else:
                screen.leave_page()
                self.spare.append(screen)
        self.opened.clear()


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
