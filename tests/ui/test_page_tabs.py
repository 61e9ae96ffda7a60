"""The tabs of a page: their order, and that they outlive what is in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

import viser

from armctl.ui.tabs import SCREENS, PageTabs, Screen


@dataclass
class Container:
    """A tab or a folder of the page; what is added while it is open goes into it."""

    page: Page
    label: str
    content: list[Container] = field(default_factory=list["Container"])

    def __enter__(self) -> None:
        self.page.open.append(self)

    def __exit__(self, *_: object) -> None:
        assert self.page.open.pop() is self

    def remove(self) -> None:
        self.page.removed.append(self)


@dataclass
class Page:
    """Remembers what is added, as far as the tabs need it."""

    tabs: list[Container] = field(default_factory=list[Container])
    open: list[Container] = field(default_factory=list[Container])
    removed: list[Container] = field(default_factory=list[Container])

    def add_html(self, content: str) -> None:
        assert content.startswith("<style>")

    def add_tab_group(self) -> Page:
        return self

    def add_tab(self, label: str, icon: viser.IconName | None) -> Container:
        self.tabs.append(Container(self, label))
        return self.tabs[-1]

    def add_folder(self, label: str | None) -> Container:
        assert label is None  # a folder that cannot be seen
        folder = Container(self, "")
        self.open[-1].content.append(folder)
        return folder

    @property
    def shown(self) -> list[str]:
        """The labels of what is in the tabs now, each with its tab's."""
        return [
            f"{tab.label}: {built.label}"
            for tab in self.tabs
            for folder in tab.content
            if folder not in self.removed
            for built in folder.content
        ]


def fill(tabs: PageTabs, page: Page, word: str) -> list[Screen]:
    def build(screen: type[Screen]) -> Screen:
        page.open[-1].content.append(Container(page, f"{word} {screen.label}"))
        return cast(Screen, screen.label)

    return tabs.fill(build)


def test_every_screen_is_built_in_the_tab_with_its_label_in_order() -> None:
    page = Page()
    tabs = PageTabs(cast(viser.GuiApi, page))
    assert [tab.label for tab in page.tabs] == [screen.label for screen in SCREENS]
    assert page.shown == []
    assert fill(tabs, page, "first") == [screen.label for screen in SCREENS]
    assert page.shown == [f"{screen.label}: first {screen.label}" for screen in SCREENS]
    assert page.open == []


def test_the_tabs_stay_while_their_screens_are_built_anew() -> None:
    page = Page()
    tabs = PageTabs(cast(viser.GuiApi, page))
    for word in ("first", "second", "third"):
        fill(tabs, page, word)
        assert page.shown == [f"{screen.label}: {word} {screen.label}" for screen in SCREENS]
        tabs.clear()
        assert page.shown == []
    assert len(page.tabs) == len(SCREENS)
    assert len(page.removed) == 3 * len(SCREENS)  # each content once: viser warns of a second time
