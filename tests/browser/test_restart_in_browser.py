"""`armctl serve` is killed and started again: open pages come back, and control to who had it."""

from __future__ import annotations

import os
import re
import signal
import stat
import subprocess
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Locator, expect
from tests.browser.kit import PATIENCE_MS, Screen, Screens
from tests.browser.served_arm import ServedArm
from tests.browser.serving import page_port

pytestmark = pytest.mark.browser
PAGES = 20 if os.environ.get("ARMCTL_LONG") else 2


class Console:
    """``armctl serve`` on one port and with one folder, killed and started again and again."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, page_port()
        self.environment = os.environ | {
            "PYTHONUNBUFFERED": "1",
            "XDG_DATA_HOME": str(folder),
            "XDG_STATE_HOME": str(folder),
            "XDG_RUNTIME_DIR": str(folder / "run"),
        }
        (folder / "run").mkdir()
        self.process: subprocess.Popen[str] | None = None

    def start(self, *words: str) -> str:
        """The link that it prints."""
        serve = [sys.executable, "-m", "armctl", "serve", "--no-browser", "--http-port", str(self.port)]
        with (self.folder / "stderr").open("a") as errors:
            self.process = subprocess.Popen(
                [*serve, *words], stdout=subprocess.PIPE, stderr=errors, text=True, env=self.environment
            )
        assert self.process.stdout is not None
        said = self.process.stdout.readline()
        address = re.search(r"https?://\S+", said)
        assert address is not None, said + (self.folder / "stderr").read_text()
        return address.group()

    def end(self, how: signal.Signals) -> None:
        if self.process is not None:
            self.process.send_signal(how)
            self.process.communicate(timeout=30)
            self.process = None


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Console]:
    console = Console(tmp_path)
    yield console
    console.end(signal.SIGINT)
    assert "Traceback" not in (tmp_path / "stderr").read_text()


def expect_operator(screen: Screen, name: str) -> None:
    expect(screen.page.get_by_text(f"Operator: {name}").locator("visible=true").first).to_be_visible(
        timeout=2 * PATIENCE_MS
    )


def next_pose(screen: Screen) -> Locator:
    return screen.page.locator("armctl-part[name=next] p")


def has_again(screen: Screen, tab: str, fields: dict[str, str]) -> None:
    """The tab is open, and its fields read so."""
    expect(screen.tab(tab)).to_have_attribute("aria-selected", "true", timeout=PATIENCE_MS)
    for label, text in fields.items():
        field = screen.page.get_by_label(label, exact=True).locator("visible=true").first
        expect(field).to_have_value(text, timeout=PATIENCE_MS)


@contextmanager
def loaded_anew(screens: list[Screen]) -> Generator[None]:
    """All pages are loaded again meanwhile, by themselves."""
    for screen in screens:
        screen.page.evaluate("window.armctlBefore = true")
    yield
    for screen in screens:
        screen.page.wait_for_function("!window.armctlBefore", timeout=2 * PATIENCE_MS)


def test_pages_come_back_and_control_returns_until_a_new_link_is_made(
    screens: Screens, console: Console
) -> None:
    link = console.start()
    pages = [screens(link) for _ in range(PAGES)]
    pages[1].click("Take control")
    pages[1].click("Take control")
    expect_operator(pages[1], "you")
    pages[0].open_tab("Forward")
    pages[0].type_into("Base °", "12.5")
    expect(next_pose(pages[0])).to_contain_text("angles in Forward")
    before = next_pose(pages[0]).inner_text()
    pages[1].open_tab("Inverse")
    pages[1].type_xyz("220", "-196", "85")
    pages[1].open_tab("Simulation")
    for page in pages:
        page.pause(600)  # a page notes what is open and typed five times a second
    with loaded_anew(pages):
        console.end(signal.SIGKILL)
        expect(pages[0].page.locator("#armctl-told p")).to_contain_text("comes back by itself")
        assert console.start() == link
    expect_operator(pages[1], "you")
    for page in (pages[0], *pages[2:]):
        expect_operator(page, "browser page")
        expect(page.page.locator("#armctl-told p")).to_be_hidden()
    has_again(pages[0], "Forward", {"Base °": "12.5"})
    expect(next_pose(pages[0])).to_contain_text(before.split(" mm")[0], timeout=PATIENCE_MS)
    expect(next_pose(pages[0])).to_contain_text("angles in Forward")
    has_again(pages[1], "Simulation", {})
    pages[1].open_tab("Inverse")
    has_again(pages[1], "Inverse", {"X mm": "220", "Y mm": "-196", "Z mm": "85"})
    (token,) = (console.folder / "armctl").glob("token-*")
    assert stat.S_IMODE(token.stat().st_mode) == 0o600
    assert link.endswith(f"?token={token.read_text()}")
    console.end(signal.SIGINT)
    assert console.start("--new-link") != link
    for page in pages:
        expect(page.page.locator("#armctl-told p")).to_contain_text("with a new link")
        assert page.page.url.startswith("http")  # it is not left for the words of a refusal


def test_a_page_that_is_loaded_anew_twice_has_its_tab_and_the_server_all_that_was_typed(
    screen: Screen, served: ServedArm
) -> None:
    screen.open(served.url, until="Enable")
    screen.open_tab("Inverse")
    screen.type_xyz("220", "-196", "85")
    screen.open_tab("Simulation")  # the tabs within Inverse are not in view again before it is opened
    for _ in range(2):
        screen.reload(until="Enable")
        has_again(screen, "Simulation", {})
    screen.open_tab("Inverse")
    has_again(screen, "Inverse", {"X mm": "220", "Y mm": "-196", "Z mm": "85"})
    screen.pause()
    screen.click("Solve")
    screen.wait_for_text("3520 solutions inside the limits")
