"""Small pieces of HTML: numbers, headings, notes and refusals; everything is escaped here."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from html import escape

_LINE_EM = 1.5
"""height of a line in a block of HTML"""
WARNING = "#a65b00"
"""colour of what is not as it should be; dark enough to be read on white"""
_MINUS = re.compile(r"(?<![\w.)-])-(?=\d)")
"""a hyphen before a number that is no part of a word, a range or a date"""


def fixed(value: float, digits: int) -> str:
    """A number with a real minus sign and no negative zero; a dash where it is not finite."""
    if not math.isfinite(value):
        return "–"
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def numbers(values: Iterable[float], digits: int, between: str = ", ") -> str:
    """Several numbers in a row."""
    return between.join(fixed(value, digits) for value in values)


def heading(text: str) -> str:
    """A heading inside a block."""
    return f"<div style='font-weight:600;margin-top:6px'>{escape(text)}</div>"


def muted(text: str) -> str:
    """An explanation that may be overlooked."""
    return f"<div style='font-size:11.5px;opacity:.75'>{escape(with_minus(text))}</div>"


def folded(title: str, texts: Iterable[str]) -> str:
    """A list under a title, shown once the title is clicked."""
    rows = "".join(f"<li>{escape(with_minus(text))}</li>" for text in texts)
    return (
        "<details style='font-size:11.5px;opacity:.75'>"
        f"<summary style='cursor:pointer'>{escape(title)}</summary>"
        f"<ul style='margin:2px 0;padding-left:16px'>{rows}</ul></details>"
    )


def with_minus(text: str) -> str:
    """Words with real minus signs before their numbers, as ``fixed`` writes them."""
    return _MINUS.sub("−", text)


def sentence(text: str) -> str:
    """A message as a sentence of its own."""
    text = with_minus(text)
    return text if text.endswith(".") else f"{text[:1].upper()}{text[1:]}."


def refused(text: str) -> str:
    """Why something cannot be done."""
    return f"<div style='color:#c92a2a'>{escape(with_minus(text))}</div>"


def warned(text: str) -> str:
    """What to know before a button is pressed."""
    return f"<b style='color:{WARNING}'>{escape(with_minus(text))}</b>"


def limited(text: str, lines: int, style: str = "") -> str:
    """A text that takes no more than so many lines; what is longer scrolls, and is shown under the mouse."""
    told = escape(text)
    return f"<div style='max-height:{_LINE_EM * lines}em;overflow-y:auto;{style}' title='{told}'>{told}</div>"


def strong(text: str) -> str:
    """A result, in bold."""
    return f"<div><b>{escape(text)}</b></div>"
