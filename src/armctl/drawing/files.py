"""Drawing files: which kinds there are, and how they are read."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path, PurePath
from xml.sax.saxutils import escape

from armctl.documents import DocumentKind
from armctl.drawing.gcode import read_gcode
from armctl.drawing.strokes import PenDrawing
from armctl.drawing.svg import read_svg
from armctl.errors import DrawingError

DRAWING_FILES = DocumentKind(DrawingError, most_bytes=4 * 1024 * 1024)
_READERS: dict[str, Callable[[str], PenDrawing]] = {
    ".svg": read_svg,
    **dict.fromkeys((".gcode", ".nc", ".ngc", ".tap", ".gc"), read_gcode),
}
DRAWING_SUFFIXES = tuple(_READERS)


def require_drawing_name(name: str) -> None:
    """DrawingError: no file of this name is read as a drawing."""
    if PurePath(name).suffix.lower() not in _READERS:
        raise DrawingError(f"{name}: a drawing is a file {', '.join(DRAWING_SUFFIXES)}")


def parse_drawing(name: str, content: bytes) -> PenDrawing:
    """The drawing of a file's content. DrawingError: says the file, and the line or the element."""
    require_drawing_name(name)
    try:
        return _READERS[PurePath(name).suffix.lower()](DRAWING_FILES.text(content))
    except DrawingError as cause:
        raise cause.about(name) from cause


def read_drawing(path: str | Path) -> PenDrawing:
    """The drawing of a regular file of bounded size. DrawingError: as ``parse_drawing``."""
    path = Path(path)
    require_drawing_name(path.name)
    try:
        content = DRAWING_FILES.read(path)
    except DrawingError as cause:
        raise cause.about(str(path)) from cause
    return _known(path.name, content)


@lru_cache(maxsize=8)
def _known(name: str, content: bytes) -> PenDrawing:
    """What a program draws is asked for again and again: by the list, the check and the arm."""
    return parse_drawing(name, content)


_WRITTEN_MM, _LONGEST_NAME = 20, 40


def written_drawing(text: str) -> tuple[str, bytes]:
    """An SVG file, its name and content, that writes a line of text 20 mm high. DrawingError: no text."""
    said = " ".join(text.split())
    if not said:
        raise DrawingError("there is nothing to write; type a name or a line of text first")
    name = re.sub(r"\W+", "_", said).strip("_")[:_LONGEST_NAME] or "text"
    size = f'width="200mm" height="{2 * _WRITTEN_MM}mm" viewBox="0 0 200 {2 * _WRITTEN_MM}"'
    line = f'<text y="{1.5 * _WRITTEN_MM:g}" font-size="{_WRITTEN_MM}">{escape(said)}</text>'
    return f"{name}.svg", f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{line}\n</svg>\n'.encode()
