"""The served documentation as a reader uses it: search, keys, a phone, both themes; and the way there."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, Route, expect
from tests.browser.kit import PATIENCE_MS, Screen
from tests.browser.served_arm import ServedArm
from tests.browser.serving import page_port

from armctl.ui.docs import ServedDocs, page_of
from armctl.ui.guard import guarded_server

pytestmark = pytest.mark.browser
PAGES = (page_of("inverse"), "/docs/", "/docs/safety/", "/docs/reference/cli/", "/docs/install/")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    server = guarded_server(port=page_port(), docs=ServedDocs())
    yield server.links[0]
    server.stop()


@pytest.fixture
def errors() -> list[str]:
    """What the console of a page says: what its policy forbids is there."""
    return []


@pytest.fixture
def page(browser: Browser, address: str, errors: list[str]) -> Iterator[Page]:
    context = browser.new_context(base_url=address, viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.on("console", lambda message: errors.append(message.text))
    page.on("pageerror", lambda error: errors.append(str(error)))
    yield page
    context.close()


def is_wider(page: Page) -> bool:
    """Whether the page moves sideways."""
    return bool(page.evaluate("document.documentElement.scrollWidth > innerWidth"))


EVERY_RULE = ("wcag2a", "wcag2aa", "wcag21aa", "best-practice")


def violations(page: Page, *rules: str) -> list[str]:
    options = {"resultTypes": ["violations"], "runOnly": rules or EVERY_RULE}
    found = Axe().run(page, options=options).response["violations"]
    return [f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in found]


def test_the_search_works_by_the_keyboard_alone(page: Page, errors: list[str]) -> None:
    page.goto("/docs/")
    page.keyboard.press("/")
    field = page.get_by_role("searchbox", name="Search")
    expect(field).to_be_focused()
    page.keyboard.type("out of REACH target")
    rows = page.locator("#found a")
    best = rows.filter(has_text="Troubleshooting: The target is out of reach")
    expect(best).to_have_count(1, timeout=PATIENCE_MS)  # every page is read for the first search
    expect(page.get_by_role("status")).to_contain_text("Found: ")
    assert rows.locator("mark").first.inner_text().lower() in ("out", "of", "reach", "target")
    assert violations(page) == []
    page.keyboard.press("ArrowDown")
    expect(rows.first).to_be_focused()
    page.keyboard.press("ArrowUp")
    expect(field).to_be_focused()
    page.keyboard.type(" xyzzy")
    expect(page.get_by_role("status")).to_have_text("Nothing is found.")
    expect(rows).to_have_count(0)
    page.keyboard.press("Escape")
    expect(page.locator("#results")).to_be_hidden()
    page.keyboard.type("the target is out of reach")
    expect(rows.first).to_contain_text("The target is out of reach")
    page.keyboard.press("Enter")
    page.wait_for_url("**/docs/troubleshooting/#the-target-is-out-of-reach")
    expect(page.locator("#the-target-is-out-of-reach")).to_be_in_viewport()
    assert errors == []


def test_axe_finds_nothing_and_no_page_is_wider_than_its_window(page: Page, errors: list[str]) -> None:
    for path in PAGES:
        page.goto(path)
        for width, height in ((390, 844), (1280, 800)):
            page.set_viewport_size({"width": width, "height": height})
            assert not is_wider(page), path
            assert violations(page) == [], path
        page.emulate_media(color_scheme="dark")
        assert violations(page, "color-contrast") == [], path
        page.emulate_media(color_scheme="light")
    assert errors == []


def test_on_a_phone_the_list_of_pages_is_folded_and_opens(page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(page_of("Inverse"))
    pages = page.get_by_role("navigation", name="Pages")
    link = pages.get_by_role("link", name="Forward", exact=True)
    expect(link).to_be_hidden()
    expect(page.get_by_role("heading", name="Inverse", level=1)).to_be_in_viewport()
    pages.get_by_text("Pages", exact=True).click()
    link.click()
    page.wait_for_url(f"**{page_of('Forward')}")
    page.set_viewport_size({"width": 1280, "height": 800})
    expect(link).to_be_visible()
    expect(link).to_have_attribute("aria-current", "page")


def test_the_search_says_when_the_console_is_gone(page: Page) -> None:
    page.route("**/search.json", lambda route: route.abort())
    page.goto("/docs/")
    page.get_by_role("searchbox").fill("reach")
    expect(page.get_by_role("status")).to_have_text("The search needs the console: see that armctl runs.")


def test_who_waits_for_the_first_search_is_told_so(page: Page) -> None:
    held: list[Route] = []
    page.route("**/search.json", lambda route: held.append(route))
    page.goto("/docs/")
    page.get_by_role("searchbox").fill("reach")
    expect(page.get_by_role("status")).to_have_text("Searching all pages …")
    held[0].fulfill(json=[["/docs/#a", "A page", "A heading", "what is in reach"]])
    expect(page.get_by_role("status")).to_have_text("Found: 1")


def test_a_refusal_leads_to_its_section_in_a_tab_of_its_own(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="Enable")
    screen.open_tab("Inverse")
    screen.type_xyz("900", "0", "0")
    screen.click("Go by least energy")
    toast = screen.page.get_by_role("alert").filter(has_text="too far by")
    link = toast.get_by_role("link", name="What to do")
    link.focus()
    with screen.page.context.expect_page() as opened:
        screen.page.keyboard.press("Enter")
    other = opened.value
    other.wait_for_url("**/docs/troubleshooting/#the-target-is-out-of-reach")
    expect(other.get_by_role("heading", name="The target is out of reach")).to_be_in_viewport()
    other.close()
    expect(screen.page.get_by_role("tab", name="Inverse")).to_be_visible()  # the console is where it was
