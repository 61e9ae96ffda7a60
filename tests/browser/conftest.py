from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, sync_playwright
from tests.browser.kit import Screen, Screens, launch


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser a module: while playwright runs, its event loop occupies the thread of the tests."""
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
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
