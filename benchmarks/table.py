"""The rows as markdown."""

from __future__ import annotations

from collections.abc import Iterable

from benchmarks.row import Row

_HEAD = ("work", "reference", "reference µs", "armctl µs", "ratio", "goal", "met", "spread")


def table(rows: Iterable[Row]) -> str:
    lines = [_line(_HEAD), _line(["---", "---", *["--:"] * 3, "---", "---", "--:"])]
    return "\n".join([*lines, *(_line(_cells(row)) for row in rows)])


def _cells(row: Row) -> list[str]:
    return [
        row.work,
        row.reference,
        _number(row.reference_us),
        _number(row.armctl_us),
        row.said,
        "–" if row.goal is None else str(row.goal),
        row.missing or {None: "–", True: "yes", False: "**no**"}[row.met],
        "–" if row.spread is None else f"{100 * row.spread:.0f} %",
    ]


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def with_table(text: str, table: str, maker: str = "make bench") -> str:
    """``text`` with what stands between the two marks of ``maker`` replaced as a whole.

    Raises:
        ValueError: the marks are not there.
    """
    first, last = (f"<!-- {maker}: {which} -->" for which in ("begin", "end"))
    before, begin, rest = text.partition(first)
    _, end, after = rest.partition(last)
    if not (begin and end):
        raise ValueError(f"the text needs a line {first} and, below it, a line {last}")
    return f"{before}{begin}\n{table}\n{end}{after}"
