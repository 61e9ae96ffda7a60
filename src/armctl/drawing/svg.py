"""SVG files read to strokes: shapes, paths, text, groups, transforms, units, ``viewBox`` and ``use``.

Pictures and what is hidden are not drawn; what is left out is named. Time and memory are bounded: by the size
of the file, the number of elements, how often ``use`` draws them again, and the number of points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.drawing.strokes import LARGEST_MM, MOST_POINTS, PenDrawing
from armctl.drawing.svg_elements import LETTERS, LONGEST_TITLE, SvgElement, parsed
from armctl.drawing.svg_path import (
    MM_PER_PX,
    Outline,
    ellipse,
    length_px,
    numbers_of,
    path_outlines,
    polygon,
    rectangle,
    transform_of,
)
from armctl.drawing.svg_text import TextLine, TextStyle
from armctl.errors import DrawingError
from armctl.lazy_dataclass import dataclass

_MOST_USES = 30
_MOST_DRAWN = 100_000
"""elements that are drawn, each as often as ``use`` says"""
_GROUPS = ("svg", "g", "a", "switch")
_NOT_SEEN = ("defs", "symbol", "clipPath", "mask", "pattern", "marker", "linearGradient", "radialGradient")
_NO_DRAWING = ("", "title", "desc", "metadata", "style")
_NO_LINES = {"image": "a picture", "foreignObject": "a foreign object"}
_NO_TEXT = ("textLength", "rotate", "writing-mode")
"""attributes of text that would put its letters elsewhere"""


def read_svg(text: str) -> PenDrawing:
    """The strokes of an SVG file, y upwards [mm]. DrawingError: says the line and the element."""
    root = parsed(text)
    if root.tag != "svg":
        raise DrawingError(f"line {root.line}: the root element is <{root.tag}>, not <svg>")
    walk = _SvgWalk(root)
    walk.run()
    return PenDrawing.of(walk.lines, walk.left_out)


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where an element is drawn, and what it has from those around it."""

    matrix: FloatArray
    """(3, 3) from its units to mm, y upwards"""
    width: float
    height: float
    """of the viewport, of which percentages are"""
    hidden: bool = False
    painted: tuple[bool, bool] = (True, False)
    """inside, and along its line"""
    text: TextStyle | DrawingError = TextStyle()
    """what is wrong with it matters only where something is written"""
    uses: tuple[int, ...] = ()
    """the ``use`` elements around it, each by its ``id()``"""

    def moved(self, matrix: FloatArray) -> _Place:
        return replace(self, matrix=self.matrix @ matrix)


class _SvgWalk:
    """From element to element, in the order in which they are drawn."""

    def __init__(self, root: SvgElement) -> None:
        self._root = root
        self._named: dict[str, SvgElement] = {}
        self._drawn = self._points = 0
        self._styled = False
        """a style sheet may paint what its attributes do not"""
        self._letters = ""
        """all that is written anywhere, each once"""
        self.lines: list[tuple[FloatArray, int]] = []
        self.left_out: list[str] = []

    def run(self) -> None:
        """Draw all of it."""
        nodes, letters = [self._root], set[str]()
        while nodes:
            node = nodes.pop()
            self._styled |= node.tag == "style"
            letters.update(node.text)
            if name := node.attributes.get("id"):
                self._named.setdefault(name, node)
            nodes += node.children
        self._letters = "".join(sorted(letters))
        try:
            place = self._page()
        except DrawingError as cause:
            raise cause.about(self._root.title) from cause
        for child in self._root.children:
            self._draw(child, place)

    def _page(self) -> _Place:
        """The units of the root: its width and height are lengths, its ``viewBox`` says what they show."""
        box = _view_box(self._root)
        whole = (100.0, 100.0) if box is None else (float(box[2]), float(box[3]))
        width, height = (
            length_px(self._root.attributes.get(key, "100%"), side)
            for key, side in zip(("width", "height"), whole, strict=True)
        )
        upwards = np.diag([MM_PER_PX, -MM_PER_PX, 1.0])
        upwards[1, 2] = height * MM_PER_PX
        return _viewport(self._root, _Place(upwards, *whole), 0.0, 0.0, width, height)

    def _draw(self, node: SvgElement, place: _Place) -> None:
        """An element and what is in it; a DrawingError says which one."""
        self._drawn += 1
        if self._drawn > _MOST_DRAWN:
            raise DrawingError(
                f"{node.title}: more than {_MOST_DRAWN} elements to draw; simplify the drawing"
            )
        if not node.tag or node.tag in _NOT_SEEN or node.get("display") == "none":
            return
        if node.tag in _NO_LINES:
            if not place.hidden:
                self.left_out.append(f"{_NO_LINES[node.tag]} (line {node.line})")
            return
        try:
            place = self._inside(node, place)
            found = self._children(node, place)
        except DrawingError as cause:
            raise cause.about(node.title) from cause
        for child, inner in found:
            self._draw(child, inner)

    def _inside(self, node: SvgElement, place: _Place) -> _Place:
        """What an element changes for itself and what is in it."""
        if transform := node.get("transform"):
            place = place.moved(_square(transform_of(transform)))
        if (seen := node.get("visibility")) is not None:
            place = replace(place, hidden=seen in ("hidden", "collapse"))
        paints = (node.get("fill"), node.get("stroke"))
        painted = tuple(
            was if paint in (None, "inherit") else paint not in ("none", "transparent")
            for was, paint in zip(place.painted, paints, strict=True)
        )
        for name in ("clip-path", "mask"):
            if node.get(name) not in (None, "none"):
                self.left_out.append(f"the {name} of <{node.tag}> (line {node.line})")
        text = place.text
        if isinstance(text, TextStyle):
            try:
                text = text.inside(node)
            except DrawingError as cause:
                text = cause if node.tag in ("text", "tspan") else cause.about(node.title)
        return replace(place, painted=painted, text=text)

    def _children(self, node: SvgElement, place: _Place) -> Sequence[tuple[SvgElement, _Place]]:
        """Draw an element's own lines; what else is to be drawn for it."""
        if node.tag == "use":
            return self._used(node, place)
        if node.tag == "svg":
            place = _nested(node, place)
        if node.tag in _GROUPS:
            # of a switch the first one that is understood
            several = node.children[:1] if node.tag == "switch" else node.children
            return [(child, place) for child in several]
        if node.tag == "text":
            self._write_text(node, place)
        make = _SHAPES.get(node.tag)
        if make is not None and self._is_seen(node, place):
            for outline in make(_Sizes(node, place.width, place.height)):
                self._add(outline.points(place.matrix[:2]), node.line)
        return ()

    def _is_seen(self, node: SvgElement, place: _Place) -> bool:
        painted = any(place.painted) or (self._styled and "class" in node.attributes)
        return painted and not place.hidden

    def _write_text(self, node: SvgElement, place: _Place) -> None:
        """The letters of a ``text`` element."""
        text = TextLine(self._letters)
        self._put_in(text, node, place)
        if unknown := text.unknown:
            self.left_out.append(f"the letters {unknown[:LONGEST_TITLE]!r} (line {node.line})")
        for outline, line in text.outlines():
            self._add(outline.points(place.matrix[:2]), line)

    def _put_in(self, text: TextLine, node: SvgElement, place: _Place) -> None:
        """What stands in an element, and where it puts that."""
        begin, style = text.count, place.text
        if isinstance(style, DrawingError):
            raise style
        for child in node.children:
            if child.tag == LETTERS:
                text.add(child.text, style, child.line, seen=self._is_seen(node, place))
            elif child.tag in ("tspan", "a"):
                if child.get("display") != "none":
                    self._put_in(text, child, self._inside(child, place))
            elif child.tag not in _NO_DRAWING:
                self.left_out.append(f"<{child.tag}> in a text (line {child.line})")
        for name in _NO_TEXT:
            if node.get(name) not in (None, "0", "lr", "lr-tb", "horizontal-tb"):
                self.left_out.append(f"the {name} of <{node.tag}> (line {node.line})")
        for axis, name in enumerate(("x", "y", "dx", "dy")):
            said = node.attributes.get(name, "").replace(",", " ").split()
            whole = (place.width, place.height)[axis % 2]
            text.place(begin, name, [style.length(value, name, whole) for value in said])

    def _add(self, points: FloatArray, line: int) -> None:
        if not (np.isfinite(points).all() and np.abs(points).max() < LARGEST_MM):
            raise DrawingError(f"it lies more than {LARGEST_MM / 1000:g} m away from the page")
        self._points += len(points)
        if self._points > MOST_POINTS:
            raise DrawingError(f"more than {MOST_POINTS} points up to here; simplify the drawing")
        self.lines.append((points, line))

    def _used(self, node: SvgElement, place: _Place) -> Sequence[tuple[SvgElement, _Place]]:
        """What a ``use`` element draws once more."""
        link = node.attributes.get("href", "")
        if not link.startswith("#"):
            self.left_out.append(f"what <use> takes from {link[:LONGEST_TITLE]!r} (line {node.line})")
            return ()
        target = self._named.get(link[1:])
        if target is None:
            raise DrawingError(f"no element has the id {link[1 : 1 + LONGEST_TITLE]!r}")
        if id(node) in place.uses or len(place.uses) >= _MOST_USES:
            raise DrawingError(f"it draws itself again, or lies in more than {_MOST_USES} others")
        sizes = _Sizes(node, place.width, place.height)
        moved = np.eye(3)
        moved[:2, 2] = sizes.of("x", 0), sizes.of("y", 1)
        place = replace(place.moved(moved), uses=(*place.uses, id(node)))
        if target.tag != "symbol":
            return [(target, place)]
        width, height = sizes.of("width", 0, "100%"), sizes.of("height", 1, "100%")
        place = _viewport(target, self._inside(target, place), 0.0, 0.0, width, height)
        return [(child, place) for child in target.children]


@dataclass(frozen=True, slots=True, eq=False)
class _Sizes:
    """The lengths of an element, of which those in percent are of its viewport."""

    node: SvgElement
    width: float
    height: float

    def of(self, name: str, axis: int | None, default: str = "0") -> float:
        """A length along x (0), y (1), or neither (None) [user units]."""
        diagonal = float(np.hypot(self.width, self.height) / np.sqrt(2.0))
        whole = diagonal if axis is None else (self.width, self.height)[axis]
        try:
            return length_px(self.node.attributes.get(name, default), whole)
        except DrawingError as cause:
            raise cause.about(name) from cause

    def size(self, name: str, axis: int | None, default: str = "0") -> float:
        """The same of what cannot be negative."""
        value = self.of(name, axis, default)
        if value < 0.0:
            raise DrawingError(f"{name} is {value:g}; it cannot be negative")
        return value


def _circle(sizes: _Sizes) -> list[Outline]:
    r = sizes.size("r", None)
    return ellipse(sizes.of("cx", 0), sizes.of("cy", 1), r, r)


def _ellipse(sizes: _Sizes) -> list[Outline]:
    return ellipse(sizes.of("cx", 0), sizes.of("cy", 1), *_radii(sizes))


def _rectangle(sizes: _Sizes) -> list[Outline]:
    width, height = sizes.size("width", 0), sizes.size("height", 1)
    return rectangle(sizes.of("x", 0), sizes.of("y", 1), width, height, *_radii(sizes))


def _radii(sizes: _Sizes) -> tuple[float, float]:
    """Of an ellipse or of corners; one that is not given is the other."""
    given = sizes.node.attributes
    rx, ry = (given.get(name, "auto") for name in ("rx", "ry"))
    if rx == "auto":
        rx, axis = ry, 1
    else:
        axis = 0
    x = 0.0 if rx == "auto" else replace(sizes, node=SvgElement("", {"rx": rx}, 0)).size("rx", axis)
    return x, x if ry == "auto" else sizes.size("ry", 1)


def _line(sizes: _Sizes) -> list[Outline]:
    (x1, x2), (y1, y2) = ([sizes.of(f"{name}{k}", axis) for k in (1, 2)] for axis, name in enumerate("xy"))
    return polygon(f"{x1!r},{y1!r} {x2!r},{y2!r}", closed=False)


_SHAPES: dict[str, Callable[[_Sizes], list[Outline]]] = {
    "path": lambda sizes: path_outlines(sizes.node.attributes.get("d", "")),
    "line": _line,
    "polyline": lambda sizes: polygon(sizes.node.attributes.get("points", ""), closed=False),
    "polygon": lambda sizes: polygon(sizes.node.attributes.get("points", ""), closed=True),
    "rect": _rectangle,
    "circle": _circle,
    "ellipse": _ellipse,
}


def _nested(node: SvgElement, place: _Place) -> _Place:
    sizes = _Sizes(node, place.width, place.height)
    x, y = sizes.of("x", 0), sizes.of("y", 1)
    width, height = sizes.size("width", 0, "100%"), sizes.size("height", 1, "100%")
    return _viewport(node, place, x, y, width, height)


def _viewport(node: SvgElement, place: _Place, x: float, y: float, width: float, height: float) -> _Place:
    """Inside an element with a viewport of its own: its ``viewBox`` fitted into a rectangle [user units]."""
    box, inner = _view_box(node), np.eye(3)
    inner[:2, 2] = x, y
    if box is None:
        return replace(place.moved(inner), width=width, height=height)
    if width <= 0.0 or height <= 0.0:
        raise DrawingError(f"width {width:g} and height {height:g} must be positive")
    scales = np.array([width, height]) / box[2:]
    aligned, *rest = (node.attributes.get("preserveAspectRatio", "").split() or ["xMidYMid"])[:2]
    if aligned != "none":
        scales[:] = scales.max() if rest == ["slice"] else scales.min()
        names = (aligned[1:4], aligned[5:8])
        shares = np.array([{"Min": 0.0, "Mid": 0.5, "Max": 1.0}.get(name, 0.5) for name in names])
        inner[:2, 2] += shares * (np.array([width, height]) - scales * box[2:])
    inner[0, 0], inner[1, 1] = scales
    inner[:2, 2] -= scales * box[:2]
    return replace(place.moved(inner), width=float(box[2]), height=float(box[3]))


def _view_box(node: SvgElement) -> FloatArray | None:
    text = node.attributes.get("viewBox")
    if text is None:
        return None
    values = numbers_of(text)
    if len(values) != 4 or not (values[2] > 0.0 and values[3] > 0.0):
        raise DrawingError(f"viewBox {text[:40]!r}: it needs x, y, and a positive width and height")
    return np.array(values)


def _square(matrix: FloatArray) -> FloatArray:
    return np.vstack([matrix, [0.0, 0.0, 1.0]])
