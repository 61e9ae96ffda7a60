"""Text in a CSV cell that no spreadsheet may take for a formula."""

from __future__ import annotations

_BEGINS_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
_MARK = "'"


def guarded(text: str) -> str:
    """``text`` with an apostrophe before what would begin a formula; ``unguarded`` takes it off again."""
    return _MARK + text if text.startswith((*_BEGINS_FORMULA, _MARK)) else text


def unguarded(text: str) -> str:
    """The text of a cell; an apostrophe that guards nothing stays."""
    rest = text.removeprefix(_MARK)
    return rest if text != rest and rest.startswith((*_BEGINS_FORMULA, _MARK)) else text
