"""Reads letters from the fonts of matplotlib, in a process of its own (``apart``): nobody imports this."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib
import msgspec
import numpy as np
from matplotlib.ft2font import FT2Font, Kerning, LoadFlags

from armctl.apart import Tell
from armctl.arrays import FloatArray
from armctl.drawing.letters import Corners, FaceLetters, Glyph, LettersWanted


def read_letters(request: bytes, _: Tell) -> bytes:
    """The letters of a face that are wanted; a request and an answer of ``letters``."""
    wanted = msgspec.msgpack.decode(request, type=LettersWanted)
    font = FT2Font(str(Path(matplotlib.get_data_path(), "fonts", "ttf", wanted.face.file)))
    unit = 1.0 / font.units_per_EM
    index = {letter: font.get_char_index(ord(letter)) for letter in wanted.letters}
    glyphs: dict[str, Glyph] = {}
    for letter in (one for one in wanted.letters if index[one]):
        loaded = font.load_char(ord(letter), flags=LoadFlags.NO_SCALE | LoadFlags.NO_HINTING)
        corners, codes = font.get_path()
        outlines = _outlines(np.asarray(corners) * 64.0 * unit, codes.tolist())
        glyphs[letter] = Glyph(loaded.horiAdvance * unit, tuple(map(tuple, outlines)))
    closer = {
        one + other: font.get_kerning(index[one], index[other], Kerning.UNSCALED) * unit
        for one in glyphs
        for other in glyphs
    }
    return msgspec.msgpack.encode(FaceLetters(glyphs, {pair: by for pair, by in closer.items() if by}))


_MOVE, _LINE, _CURVE_OF_3, _CURVE_OF_4, _CLOSE = 1, 2, 3, 4, 79
"""what a point begins, as ``matplotlib.path.Path`` has it"""
_POINTS = {_MOVE: 1, _LINE: 1, _CURVE_OF_3: 2, _CURVE_OF_4: 3, _CLOSE: 1}


def _outlines(points: FloatArray, codes: list[int]) -> Iterator[list[Corners]]:
    """The closed lines of points (k, 2) with their codes (k,)."""
    at, line = 0, list[Corners]()
    while at < len(codes):
        code, count = codes[at], _POINTS[codes[at]]
        corners = [(float(x), float(y)) for x, y in points[at : at + count]]
        at += count
        if code == _CLOSE:
            yield [*line, line[0]]
        elif code == _MOVE:
            line = [corners]
        else:
            line.append(corners)
