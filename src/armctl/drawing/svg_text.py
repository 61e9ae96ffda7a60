"""The text of an SVG file as the outlines of its letters.

It is written in DejaVu, which matplotlib brings, whatever font the file names: a program draws the same on
every computer. Of the font the file chooses the size, serif, mono or neither, bold and slanted. Letters stand
one after the other from left to right; those of scripts that join their letters are not joined.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import msgspec
import numpy as np

from armctl.drawing.letters import Face, FaceLetters, Glyph, letters_of
from armctl.drawing.svg_elements import SvgElement
from armctl.drawing.svg_path import NUMBER, Outline, OutlinePiece, bezier, finite, length_px
from armctl.errors import DrawingError
from armctl.lazy_dataclass import dataclass

_MOST_LETTERS = 2000
"""of one text"""
_SIZES = {
    **{"xx-small": 9.0, "x-small": 10.0, "small": 13.0, "medium": 16.0},
    **{"large": 18.0, "x-large": 24.0, "xx-large": 32.0},
}
"""[px], as browsers have them (CSS Fonts 4, absolute sizes)"""
_LARGER = {"larger": 1.2, "smaller": 1 / 1.2}
_X_HEIGHT = 0.55
_RAISED = {"middle": -0.27, "central": -0.35, "hanging": -0.73, "mathematical": -0.36}
"""how far letters are raised so that this line of theirs lies where they are put, negative: lowered [size]"""
_ANCHORS = {"start": 0.0, "middle": 0.5, "end": 1.0}
_RELATIVE = re.compile(rf"\s*({NUMBER})(em|ex|rem)\s*")
_SPACES = re.compile(r"[\t\n\r]")
_BOLD = 600


@dataclass(frozen=True, slots=True)
class TextStyle:
    """How letters look, which elements have from those around them."""

    size: float = 16.0
    """[user units]"""
    face: Face = Face()
    spacing: float = 0.0
    """between letters, besides [user units]"""
    anchor: str = "start"
    baseline: str = "auto"
    keeps_spaces: bool = False

    def inside(self, node: SvgElement) -> TextStyle:
        """What an element changes of it. DrawingError: which property, and its value."""
        said = {name: value for name in _PROPERTIES if (value := node.get(name)) not in (None, "inherit")}
        if not said:
            return self
        style, face = self, self.face
        if (size := said.get("font-size")) is not None:
            style = replace(style, size=self._size(size))
        if (weight := said.get("font-weight")) is not None:
            bold = weight in ("bold", "bolder") or (weight.isdecimal() and int(weight) >= _BOLD)
            face = msgspec.structs.replace(face, bold=bold)
        if (slant := said.get("font-style")) is not None:
            face = msgspec.structs.replace(face, slanted=slant != "normal")
        if (family := said.get("font-family")) is not None:
            face = msgspec.structs.replace(face, family=_family(family))
        if (spacing := said.get("letter-spacing")) is not None:
            style = replace(
                style, spacing=0.0 if spacing == "normal" else style.length(spacing, "letter-spacing")
            )
        spaces = said.get("white-space", said.get(_XML_SPACE, ""))
        if spaces:
            style = replace(style, keeps_spaces=spaces.startswith(("pre", "break")) and spaces != "pre-line")
        return replace(
            style,
            face=face,
            anchor=said.get("text-anchor", style.anchor),
            baseline=said.get("dominant-baseline", style.baseline),
        )

    def length(self, text: str, name: str, whole: float = 0.0) -> float:
        """A length of the letters [user units]; ``whole``: of which percentages are."""
        try:
            if (relative := _RELATIVE.fullmatch(text)) is not None:
                units = {"em": self.size, "ex": _X_HEIGHT * self.size, "rem": TextStyle().size}
                return finite(relative[1]) * units[relative[2]]
            return length_px(text, whole)
        except DrawingError as cause:
            raise cause.about(name) from cause

    def _size(self, text: str) -> float:
        if text in _SIZES:
            return _SIZES[text]
        size = self.size * _LARGER[text] if text in _LARGER else self.length(text, "font-size", self.size)
        if size < 0.0:
            raise DrawingError(f"font-size is {text}; it cannot be negative")
        return size


_XML_SPACE = "http://www.w3.org/XML/1998/namespace space"
_PROPERTIES = (
    *("font-size", "font-weight", "font-style", "font-family", "letter-spacing", "white-space"),
    *(_XML_SPACE, "text-anchor", "dominant-baseline"),
)


def _family(names: str) -> str:
    """Of DejaVu's three, that which is most like the first font that is named."""
    first = names.split(",")[0].strip(" '\"").lower()
    if any(word in first for word in ("mono", "courier", "consol", "code")):
        return "Sans Mono"
    if any(word in first for word in ("times", "georgia", "garamond", "roman", "palatino")):
        return "Serif"
    return "Serif" if "serif" in first and "sans" not in first else "Sans"


@dataclass(slots=True, eq=False)
class Letter:
    """One letter, and what the file says of its place."""

    letter: str
    style: TextStyle
    seen: bool
    line: int
    """of the file"""
    x: float | None = None
    y: float | None = None
    """where the file puts it; None: behind the one before"""
    dx: float = 0.0
    dy: float = 0.0


class TextLine:
    """The letters of one ``text`` element, put in as they stand in the file."""

    def __init__(self, letters: str) -> None:
        """``letters``: all that the file writes anywhere, which are asked for together."""
        self._all = letters
        self._letters: list[Letter] = []

    @property
    def count(self) -> int:
        """Of the letters so far."""
        return len(self._letters)

    def add(self, said: str, style: TextStyle, line: int, *, seen: bool) -> None:
        """Write more; spaces count once, but where they are kept. DrawingError: too much."""
        for letter in _SPACES.sub(" ", said if style.keeps_spaces else said.replace("\r", "")):
            last = self._letters[-1] if self._letters else None
            doubled = last is None or (last.letter == " " and not last.style.keeps_spaces)
            if letter == " " and doubled and not style.keeps_spaces:
                continue
            if len(self._letters) == _MOST_LETTERS:
                raise DrawingError(f"more than {_MOST_LETTERS} letters; divide the text")
            self._letters.append(Letter(letter, style, seen, line))

    def place(self, begin: int, name: str, values: Sequence[float]) -> None:
        """Put the letters from ``begin`` on at an element's ``x``, ``y``, ``dx`` or ``dy`` [user units].

        An element inside another says so first, and counts more.
        """
        for letter, value in zip(self._letters[begin:], values, strict=False):
            if getattr(letter, name) in (None, 0.0):
                setattr(letter, name, value)

    @property
    def unknown(self) -> str:
        """The letters that the font does not have, each once."""
        lacks = {
            one.letter: None
            for one in self._letters
            if one.seen and not one.letter.isspace() and one.letter not in self._face(one).glyphs
        }
        return "".join(lacks)

    def outlines(self) -> Iterator[tuple[Outline, int]]:
        """What is drawn of the letters, and the line of each in the file."""
        for one, x, y in self.places():
            if one.seen:
                for outline in _placed(self._glyph(one), one.style.size, x, y):
                    yield outline, one.line

    def places(self) -> Iterator[tuple[Letter, float, float]]:
        """The letters, and where the origin of each comes to lie [user units, y downwards]."""
        while self._letters and self._letters[-1].letter == " " and not self._letters[-1].style.keeps_spaces:
            self._letters.pop()
        x = y = 0.0
        chunk: list[tuple[Letter, float, float]] = []
        before = None
        for one in self._letters:
            if one.x is not None or one.y is not None:  # each such place is anchored by itself
                yield from _anchored(chunk, x)
                chunk, before = [], None
                x, y = x if one.x is None else one.x, y if one.y is None else one.y
            size = one.style.size
            if before is not None and before.style == one.style:
                x += self._face(one).kerning.get(before.letter + one.letter, 0.0) * size
            x, y = x + one.dx, y + one.dy
            chunk.append((one, x, y - _RAISED.get(one.style.baseline, 0.0) * size))
            x += self._glyph(one).advance * size + one.style.spacing
            before = one
        yield from _anchored(chunk, x)

    def _face(self, one: Letter) -> FaceLetters:
        return letters_of(one.style.face, self._all)

    def _glyph(self, one: Letter) -> Glyph:
        return self._face(one).glyphs.get(one.letter, Glyph())


def _anchored(
    chunk: Sequence[tuple[Letter, float, float]], end: float
) -> Iterator[tuple[Letter, float, float]]:
    """Letters shifted so that their begin, middle or end comes to lie where the first one stands."""
    if chunk:
        first, begin, _ = chunk[0]
        shift = _ANCHORS.get(first.style.anchor, 0.0) * (end - begin)
        yield from ((one, x - shift, y) for one, x, y in chunk)


def _placed(glyph: Glyph, size: float, x: float, y: float) -> Iterator[Outline]:
    """The outlines of a letter with its origin at a place [user units, y downwards]."""
    scale, origin = np.array([size, -size]), np.array([x, y])
    for line in glyph.outlines:
        start, *pieces = (np.array(corners) * scale + origin for corners in line)
        here, found = start[0], list[OutlinePiece]()
        for corners in pieces:
            found.append(OutlinePiece(corners[-1], bezier(here, *corners) if len(corners) > 1 else None))
            here = corners[-1]
        yield Outline(start[0], found)
