"""The elements of an SVG file, read from its XML."""

from __future__ import annotations

from dataclasses import field
from xml.parsers import expat

from armctl.errors import DrawingError
from armctl.lazy_dataclass import dataclass

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_BETWEEN = " "
"""of the address of a namespace and a name"""
_DEEPEST, _MOST_ELEMENTS = 100, 50_000
LONGEST_TITLE = 24
"""of what is cited of a file"""
LETTERS = "#text"
"""the tag of what stands between tags, in an element that writes text"""
_WRITING = ("text", "tspan", "a")


@dataclass(eq=False)
class SvgElement:
    """An element, or the letters between two of them."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[SvgElement] = field(default_factory=list["SvgElement"])
    text: str = ""
    """of ``LETTERS``"""

    def get(self, name: str) -> str | None:
        """A presentation attribute, or what the style says of it, which counts more."""
        for part in self.attributes.get("style", "").split(";"):
            key, colon, value = part.partition(":")
            if colon and key.strip() == name:
                return value.strip()
        return self.attributes.get(name)

    @property
    def title(self) -> str:
        """How an error calls it."""
        name = self.attributes.get("id", "")[:LONGEST_TITLE]
        return f"line {self.line}, <{self.tag}{f' id={name!r}' if name else ''}>"


def parsed(text: str) -> SvgElement:
    """The elements of the file in each other; only names of SVG count, those of editors are passed over."""
    parser = expat.ParserCreate("utf-8", _BETWEEN)
    parser.buffer_text = True
    top = SvgElement("", {}, 0)
    open_nodes, count = [top], 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        line = parser.CurrentLineNumber
        if count > _MOST_ELEMENTS:
            raise DrawingError(f"line {line}: more than {_MOST_ELEMENTS} elements; simplify the drawing")
        if len(open_nodes) > _DEEPEST:
            raise DrawingError(f"line {line}: more than {_DEEPEST} elements in each other")
        space, _, tag = name.rpartition(_BETWEEN)
        plain = {_attribute(key): value for key, value in attributes.items()}
        node = SvgElement(tag if space in ("", _SVG) else "", plain, line)
        open_nodes[-1].children.append(node)
        open_nodes.append(node)

    def end(_: str) -> None:
        open_nodes.pop()

    def data(said: str) -> None:
        node = open_nodes[-1]
        if node.tag in _WRITING:
            node.children.append(SvgElement(LETTERS, {}, parser.CurrentLineNumber, text=said))

    def entity(*_: object) -> None:
        raise DrawingError(f"line {parser.CurrentLineNumber}: it declares entities; save it as plain SVG")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = data, entity
    try:
        parser.Parse(text.encode(), True)
    except (expat.ExpatError, ValueError) as cause:
        raise DrawingError(f"is not XML: {cause}") from cause
    return top.children[0]


def _attribute(name: str) -> str:
    space, _, plain = name.rpartition(_BETWEEN)
    return plain if space in ("", _XLINK) else name
