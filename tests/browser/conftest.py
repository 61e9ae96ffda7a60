from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, sync_playwright
from tests.browser.kit import Screen, Screens, launch
from tests.browser.served_arm import ServedArm, served_arm


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """One browser for this folder: while playwright runs, its event loop occupies the thread of the tests."""
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()


@pytest.fixture(scope="package")
def windows(browser: Browser) -> Screens:
    return Screens(browser)


@pytest.fixture
def screens(windows: Screens) -> Iterator[Screens]:
    """Opens browser windows: ``screens(url, width=…, height=…)``; their pages are left after the test."""
    yield windows
    windows.close()


@pytest.fixture
def screen(screens: Screens) -> Screen:
    """One empty browser window of 1280×800."""
    return screens()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    """An enabled arm at its home pose, and its console."""
    with served_arm(tmp_path / "files") as served:
        yield served


@pytest.fixture
def page(screen: Screen, served: ServedArm, request: pytest.FixtureRequest) -> Screen:
    """The console's page in ``screen``, with the tab open that the test's module names as ``TAB``."""
    screen.open(served.url, until="Enable")
    if (tab := getattr(request.module, "TAB", None)) is not None:
        screen.open_tab(tab)
    return screen
