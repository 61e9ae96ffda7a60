"""Letters of a font: their outlines, how wide they are, and which pairs stand closer together.

They are read from the fonts that matplotlib brings, in a process of its own (``font_files``): to load it
holds the interpreter for a tenth of a second and more, and the arm's process has ticks to make.
"""

from __future__ import annotations

from functools import lru_cache

import msgspec

from armctl.apart import apart

_LONGEST_S = 20.0
Corners = list[tuple[float, float]]
"""of one piece of an outline, behind where it begins; two or three: a Bézier curve"""


class Face(msgspec.Struct, frozen=True):
    """Which font of DejaVu's."""

    family: str = "Sans"
    """Sans, Serif, or Sans Mono"""
    bold: bool = False
    slanted: bool = False

    @property
    def file(self) -> str:
        """The name of its file."""
        slant = ("Italic" if self.family == "Serif" else "Oblique") * self.slanted
        look = f"-{'Bold' * self.bold}{slant}" if self.bold or self.slanted else ""
        return f"DejaVu{self.family.replace(' ', '')}{look}.ttf"


class Glyph(msgspec.Struct, frozen=True, array_like=True):
    """A letter, in units of the font's size, y upwards."""

    advance: float = 0.0
    """to where the next letter begins"""
    outlines: tuple[tuple[Corners, ...], ...] = ()
    """closed lines: where each starts, as one corner, then its pieces"""


class FaceLetters(msgspec.Struct, frozen=True):
    """Some letters of a face."""

    glyphs: dict[str, Glyph]
    """without those that it does not have"""
    kerning: dict[str, float]
    """of two letters: how much farther apart they stand than usual, where they do"""


class LettersWanted(msgspec.Struct, frozen=True):
    """What is asked of a font file."""

    face: Face
    letters: str


@lru_cache(maxsize=64)
def letters_of(face: Face, letters: str) -> FaceLetters:
    """What a face knows of ``letters``, each once. Takes half a second; ``LimitError``: it takes too long."""
    wanted = msgspec.msgpack.encode(LettersWanted(face, letters))
    found = apart("armctl.drawing.font_files:read_letters", wanted, seconds=_LONGEST_S)
    return msgspec.msgpack.decode(found, type=FaceLetters)
