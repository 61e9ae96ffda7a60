"""The pages, pictures and the search index that the console serves, by their addresses.

What there is comes from ``nav`` in ``mkdocs.yml`` and is known before anybody asks: an address is looked up
in a table, and no path is made from it. Pages are rendered when they are first asked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from html import escape
from importlib import resources
from threading import Lock
from typing import Any, cast

import msgspec
import yaml

from armctl.documents import shipped_folder
from armctl.lazy_dataclass import dataclass
from armctl.ui.docs.render import Rendered, rendered
from armctl.ui.docs.tables import TABLES, with_docstrings
from armctl.ui.docs.where import DOCS_PATH, address_of, led, source_of

_LEFT_OUT = ("Extending", "Development")
"""parts of ``nav`` that are on the published site alone"""
_PICTURES = {".png": "image/png", ".svg": "image/svg+xml"}
_HTML = "text/html; charset=utf-8"
_GENERATED = re.compile(r"(?m)^.*<!-- generated: (?P<name>[\w-]+) -->$")


@dataclass(frozen=True)
class ServedFile:
    """What is served at an address: a body with its type, or another address to go to."""

    body: bytes = b""
    kind: str = _HTML
    moved_to: str = ""


@dataclass(frozen=True)
class _Entry:
    """A line of the list of pages: a page, or the head of those below it."""

    title: str
    place: str = ""
    below: tuple[_Entry, ...] = ()

    def places(self) -> Iterator[str]:
        """The pages of this entry."""
        if self.place:
            yield self.place
        for one in self.below:
            yield from one.places()


def _entries(nav: list[dict[str, Any]]) -> Iterator[_Entry]:
    for item in nav:
        for title, what in item.items():
            if isinstance(what, str):
                yield _Entry(title, what)
            elif title not in _LEFT_OUT:
                yield _Entry(title, below=tuple(_entries(what)))


class ServedDocs:
    """Answers requests below ``/docs``. May be asked from several threads."""

    def __init__(self, tables: Mapping[str, Callable[[], str]] = {}) -> None:
        """``tables``: generated parts of pages (``commands``) beside those that are made here.

        Raises:
            OSError: armctl was installed without its documentation.
        """
        self._root = shipped_folder("docs").parent
        text = (self._root / "mkdocs.yml").read_text(encoding="utf-8")
        nav = yaml.SafeLoader(text).get_single_data()["nav"]
        self._entries = tuple(_entries(cast("list[dict[str, Any]]", nav)))
        self.pages = tuple(place for entry in self._entries for place in entry.places())
        """places of all pages, in the order of the list"""
        docs = self._root / "docs"
        pictures = [path for path in docs.rglob("*") if path.suffix in _PICTURES and path.is_file()]
        self._pictures = {path.relative_to(docs).as_posix(): path for path in pictures}
        self._served = frozenset((*self.pages, *self._pictures))
        self._tables = {**TABLES, "docstrings": str, **tables}
        self._lock = Lock()
        self._rendered: dict[str, Rendered] = {}
        self._made: dict[str, Callable[[], ServedFile]] = {
            "docs.css": lambda: _own("docs.css", "text/css; charset=utf-8"),
            "docs.js": lambda: _own("docs.js", "text/javascript; charset=utf-8"),
            "search.json": cache(self._search),
        }

    def __call__(self, path: str) -> ServedFile | None:
        """What is at a path (``/docs/screens/log/``), which takes a while; None: there is nothing."""
        if path == DOCS_PATH:
            return ServedFile(moved_to=f"{DOCS_PATH}/")
        address = path.removeprefix(f"{DOCS_PATH}/")
        if (made := self._made.get(address)) is not None:
            return made()
        if (picture := self._pictures.get(address)) is not None:
            return ServedFile(picture.read_bytes(), _PICTURES[picture.suffix])
        by_address = {address_of(place): place for place in self.pages}
        if (place := by_address.get(address)) is not None:
            return ServedFile(self._html(place).encode())
        return ServedFile(moved_to=f"{path}/") if f"{address}/" in by_address else None

    def page(self, place: str) -> Rendered:
        """A page that is served, rendered once."""
        with self._lock:
            if place not in self._rendered:
                source = source_of(place)
                text = (self._root / source).read_text(encoding="utf-8")
                text = with_docstrings(_GENERATED.sub(self._table, text))
                self._rendered[place] = rendered(
                    text, lambda link: led(link, source, self._served), lambda at: at.startswith(DOCS_PATH)
                )
            return self._rendered[place]

    def _table(self, found: re.Match[str]) -> str:
        """A generated part; the line itself, where it is not made here, tells where to see it."""
        make = self._tables.get(found["name"])
        return found[0] if make is None else make()

    def _html(self, place: str) -> str:
        page = self.page(place)
        listed = "".join(self._listed(entry, place) for entry in self._entries)
        title = page.title if page.title == "armctl" else f"{page.title} – armctl"
        return _PAGE.format(title=escape(title), listed=listed, page=page.html)

    def _listed(self, entry: _Entry, place: str) -> str:
        if entry.below:
            below = "".join(self._listed(one, place) for one in entry.below)
            return f"<li><b>{escape(entry.title)}</b><ul>{below}</ul></li>"
        here = ' aria-current="page"' if entry.place == place else ""
        link = f'<a href="{DOCS_PATH}/{address_of(entry.place)}"{here}>{escape(entry.title)}</a>'
        heads = [one for one in self.page(place).sections if one.level == 2] if here else []
        below = "".join(
            f'<li><a href="#{escape(one.anchor)}">{escape(one.heading)}</a></li>' for one in heads
        )
        return f"<li>{link}{f'<ul>{below}</ul>' * bool(below)}</li>"

    def _search(self) -> ServedFile:
        """Every section of every page: its address, the page's title, its heading and its text."""
        titles = dict(_titles(self._entries))
        found = [
            (f"{DOCS_PATH}/{address_of(place)}#{one.anchor}", titles[place], one.heading, one.text)
            for place in self.pages
            for one in self.page(place).sections
        ]
        return ServedFile(msgspec.json.encode(found), "application/json")


def _titles(entries: tuple[_Entry, ...]) -> Iterator[tuple[str, str]]:
    for entry in entries:
        if entry.place:
            yield entry.place, entry.title
        yield from _titles(entry.below)


def _own(name: str, kind: str) -> ServedFile:
    return ServedFile(resources.files("armctl.ui.docs").joinpath(name).read_bytes(), kind)


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="/docs/docs.css">
<script src="/docs/docs.js" defer></script>
</head>
<body>
<a class="skip" href="#text">Skip to the text</a>
<header>
<a class="home" href="/docs/">armctl</a>
<form role="search" id="search" hidden>
<label for="find">Search</label>
<input id="find" type="search" autocomplete="off" spellcheck="false" aria-controls="found">
</form>
</header>
<section id="results" aria-label="Search results" hidden>
<p role="status"></p>
<ul id="found"></ul>
</section>
<div class="columns">
<nav aria-label="Pages"><details open><summary>Pages</summary><ul>{listed}</ul></details></nav>
<main id="text" tabindex="-1">
{page}</main>
</div>
</body>
</html>
"""
