from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, sync_playwright
from tests.browser.kit import Screen, Screens, launch


@pytest.hookimpl(tryfirst=True)  # before the groups are read
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Where tests are shared out among workers, one of them drives the browser, test by test."""
    for item in items:
        if item.get_closest_marker("browser") is not None:
            item.add_marker(pytest.mark.xdist_group("browser"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser a module: while playwright runs, its event loop occupies the thread of the tests."""
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()


@pytest.fixture
def screens(browser: Browser) -> Iterator[Screens]:
    """Opens browser windows: ``screens(url, width=…, height=…)``; they are closed after the test."""
    screens = Screens(browser)
    yield screens
    screens.close()


@pytest.fixture
def screen(screens: Screens) -> Screen:
    """One empty browser window of 1280×800."""
    return screens()
