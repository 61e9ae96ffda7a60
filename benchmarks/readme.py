"""README's table of speed, replaced as a whole: figures copied by hand go stale one by one."""

from __future__ import annotations

from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
_BEGIN, _END = "<!-- make bench: begin -->", "<!-- make bench: end -->"


def with_table(text: str, table: str) -> str:
    """``text`` with what stands between the two marks replaced.

    Raises:
        ValueError: the marks are not there.
    """
    before, begin, rest = text.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    if not (begin and end):
        raise ValueError(f"the text needs a line {_BEGIN} and, below it, a line {_END}")
    return f"{before}{begin}\n{table}\n{end}{after}"
