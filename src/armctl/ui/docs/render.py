"""One page of the documentation as HTML: CommonMark with tables, as the pages are written.

No style and no script stands in the HTML, so that the console can forbid both. Raw HTML in a page is shown
as text, but for line breaks; comments are left out.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from html import escape
from itertools import pairwise

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token
from markdown_it.utils import EnvType, OptionsDict

from armctl.lazy_dataclass import dataclass

_TITLE = re.compile(r'title="([^"]*)"')
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


@dataclass(frozen=True)
class PageSection:
    """A heading with the text below it, up to the next one."""

    level: int
    anchor: str
    """empty: what stands ahead of all headings"""
    heading: str
    text: str


@dataclass(frozen=True)
class Rendered:
    """A page: its HTML, and its sections for the search."""

    html: str
    sections: tuple[PageSection, ...]

    @property
    def title(self) -> str:
        """The first heading."""
        return next((one.heading for one in self.sections if one.anchor), "armctl")


def rendered(text: str, led: Callable[[str], str], shown: Callable[[str], bool]) -> Rendered:
    """A page as HTML.

    Args:
        text: Markdown.
        led: where a link of the page leads.
        shown: whether the picture at an address can be shown; a link takes the place of another one.
    """
    markdown = MarkdownIt("commonmark", {"html": True}).enable("table")
    tokens = markdown.parse(text)
    _name_headings(tokens)
    _mend_heads(tokens)
    for token in _all(tokens):
        _lead(token, led, shown)
        _without_style(token)
    html = _Drawn().render(tokens, markdown.options, {})
    return Rendered(html, tuple(_sections(tokens)))


def anchor_of(heading: str) -> str:
    """The anchor of a heading, as the published site makes it."""
    plain = heading.encode("ascii", "ignore").decode().lower()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip())


def _other_anchor(heading: str) -> str:
    """… and as GitHub makes it: some links of the pages use that."""
    return re.sub(r"[^\w\- ]", "", heading.lower().strip()).replace(" ", "-")


def _name_headings(tokens: Sequence[Token]) -> None:
    """Give each heading its anchor, and one more where GitHub names it otherwise."""
    used: set[str] = set()
    for token, inner in pairwise(tokens):
        if token.type == "heading_open":
            heading = _text(inner)
            name = first = anchor_of(heading) or "section"
            count = 0
            while name in used:
                count += 1
                name = f"{first}_{count}"
            used.add(name)
            token.attrSet("id", name)
            if (other := _other_anchor(heading)) not in used and inner.children is not None:
                used.add(other)
                mark = Token("anchor", "", 0, content=other)
                inner.children.insert(0, mark)


def _mend_heads(tokens: Sequence[Token]) -> None:
    """The empty corner of a table is the head of no column."""
    for opened, inner, closed in zip(tokens, tokens[1:], tokens[2:], strict=False):
        if opened.type == "th_open" and not inner.content:
            opened.tag = closed.tag = "td"


def _all(tokens: Sequence[Token]) -> Iterator[Token]:
    for token in tokens:
        yield token
        yield from _all(token.children or ())


def _lead(token: Token, led: Callable[[str], str], shown: Callable[[str], bool]) -> None:
    """Lead a link or a picture to where it is; what is on other servers opens beside the page."""
    if token.type == "link_open":
        address = led(str(token.attrs["href"]))
        token.attrSet("href", address)
        if ":" in address:
            token.attrSet("target", "_blank")
            token.attrSet("rel", "noreferrer")
    elif token.type == "image":
        address = led(str(token.attrs["src"]))
        token.attrSet("src", address)
        token.attrSet("loading", "lazy")
        if not shown(address):
            token.type = "film"


def _without_style(token: Token) -> None:
    """A column of a table says where its text stands by a class."""
    style = str(token.attrs.pop("style", ""))
    if style.startswith("text-align:"):
        token.attrJoin("class", style.removeprefix("text-align:"))


class _Drawn(RendererHTML):
    """Draws tokens: a method for each type that is drawn in a way of our own."""

    def html_inline(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        """Raw HTML as text, but for line breaks, without comments."""
        return escape(_COMMENT.sub("", tokens[idx].content)).replace("&lt;br&gt;", "<br>")

    html_block = html_inline

    def anchor(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        """One more name of a heading."""
        return f'<a id="{escape(tokens[idx].content)}"></a>'

    def film(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        """A link to a picture that is not shown here."""
        token = tokens[idx]
        link = f'<a href="{escape(str(token.attrs["src"]))}" target="_blank" rel="noreferrer">'
        return f"{link}Film: {escape(token.content)}</a>"

    def fence(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        """A block of code, with its title above it."""
        token = tokens[idx]
        title = _TITLE.search(token.info)
        head = f"<figcaption>{escape(title[1])}</figcaption>" if title else ""
        return f"<figure>{head}<pre><code>{escape(token.content)}</code></pre></figure>\n"

    code_block = fence

    def table_open(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        """A table, in something that scrolls."""
        return '<div class="wide"><table>\n'

    def table_close(self, tokens: Sequence[Token], idx: int, options: OptionsDict, env: EnvType) -> str:
        """Its end."""
        return "</table></div>\n"


def _sections(tokens: Sequence[Token]) -> Iterator[PageSection]:
    level, anchor, heading, words = 0, "", "", list[str]()
    for at, token in enumerate(tokens):
        if token.type == "heading_open":
            if anchor or words:
                yield PageSection(level, anchor, heading, " ".join(words))
            level, anchor, heading = int(token.tag[1:]), str(token.attrs["id"]), _text(tokens[at + 1])
            words = []
        elif token.type == "inline" and tokens[at - 1].type != "heading_open":
            words.append(_text(token))
        elif token.type in ("fence", "code_block"):
            words.append(" ".join(token.content.split()))
    yield PageSection(level, anchor, heading, " ".join(words))


def _text(token: Token) -> str:
    """What a reader reads of it."""
    parts: list[str] = []
    for child in token.children or ():
        if child.type in ("softbreak", "hardbreak", "html_inline"):
            parts.append(" ")
        elif child.type in ("text", "code_inline"):
            parts.append(child.content)
    return " ".join("".join(parts).split())
