"""Load, current, heat and supply of every motor, over the scene: small bars with their limits, and numbers.

Rows and columns are those of what the board measures, from the first reading until it is disconnected:
nothing comes or goes while a hand is on its way. A row is sent only where what it shows has changed.
"""

from __future__ import annotations

from collections.abc import Callable
from html import escape

from armctl.facts import Quantities, QuantityLimits
from armctl.facts.quantities import NAMES
from armctl.hardware import BoardIdentity
from armctl.protocol import Snapshot
from armctl.ui.session import Session
from armctl.ui.widgets.html import button, fixed
from armctl.ui.widgets.motors import COLUMNS

_PART = _ROWS = "telemetry"
_PERIOD_S = 0.2
"""from one look to the next: five times a second"""
_OPEN, _FOLDED = "open", "folded"
_LIMIT_AT = 0.9
"""where a bar has its limit, of its length"""
_WAVERS = 1.5
"""steps of the last digit by which a value has to change to be shown anew: sensors waver"""


class TelemetryTable:
    """One page's; folded, it says the worst of each. The browser remembers which."""

    def __init__(self, session: Session, roomy: Callable[[], bool]) -> None:
        """Begin open where the scene is ``roomy``: else the table would hide the arm."""
        self._session, self._roomy = session, roomy
        self._open = roomy()
        self._worst = ""
        """what stands beside the button while it is folded"""
        self._board: BoardIdentity | None = None
        self._titles: tuple[str, ...] = ()
        self._columns: tuple[str, ...] = ()
        self._looked_at = -_PERIOD_S
        self._shown: dict[tuple[str, str], float] = {}
        """values as they are shown, by title and quantity"""
        session.on_part(_PART, self._on_fold)
        session.parts.show(_PART, "")
        session.parts.rows(_ROWS, ())
        session.spawn(self._recall())

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what the board measures now."""
        if snapshot.board != self._board and not snapshot.unreachable:
            self._board, self._titles, self._columns = snapshot.board, (), ()
            self._shown.clear()
            self._draw()
        if 0 <= snapshot.stamp - self._looked_at < _PERIOD_S:
            return
        self._looked_at = snapshot.stamp
        there = snapshot.quantities
        titles = (*self._titles, *(title for title in there if title not in self._titles))
        known = {name for one in there.values() for name in NAMES if getattr(one, name) is not None}
        columns = tuple(name for name in COLUMNS if name in known or name in self._columns)
        if (titles, columns) != (self._titles, self._columns):
            self._titles, self._columns = titles, columns
            self._draw()
        if self._open and titles:
            self._session.parts.rows(_ROWS, [(title, self._row(title, snapshot)) for title in titles])
        elif titles and (worst := self._worst_of(snapshot)) != self._worst:
            self._worst = worst
            self._draw()

    async def _recall(self) -> None:
        kept = await self._session.recall(_PART)
        self._open = self._roomy() if kept is None else kept == _OPEN
        self._looked_at = -_PERIOD_S
        self._draw()

    def _on_fold(self, _: str) -> None:
        self._open = not self._open
        self._session.remember(_PART, _OPEN if self._open else _FOLDED)
        self._looked_at = -_PERIOD_S
        self._draw()

    def _draw(self) -> None:
        self._session.parts.show(_PART, self._html())

    def _html(self) -> str:
        if not self._titles:
            return ""
        label = "Hide motors" if self._open else "Motors"
        fold = button(_PART, label, title="Load, current, heat and supply of the motors", kind="link")
        if not self._open:
            return f"<p>{fold}{self._worst}</p>"
        heads = "".join(f"<th>{COLUMNS[name].head}</th>" for name in self._columns)
        return (
            "<table aria-label='What the motors measure'>"
            f"<thead><tr><th>{fold}</th>{heads}</tr></thead><tbody data-rows='{_ROWS}'></tbody></table>"
        )

    def _row(self, title: str, snapshot: Snapshot) -> str:
        now = snapshot.quantities.get(title, Quantities())
        limits = snapshot.limits.get(title, QuantityLimits())
        cells = "".join(
            self._cell(title, name, getattr(now, name), limits, snapshot) for name in self._columns
        )
        return f"<tr data-key='{escape(title)}'><th>{escape(title)}</th>{cells}</tr>"

    def _worst_of(self, snapshot: Snapshot) -> str:
        """The largest load, current and heat, the lowest supply; what is past its limit first, marked."""
        told: list[str] = []
        for name in self._columns:
            values = {title: getattr(one, name) for title, one in snapshot.quantities.items()}
            known = {title: value for title, value in values.items() if value is not None}
            if not known:
                continue
            sign, none = (-1 if name == "voltage_v" else 1), QuantityLimits()
            numbers = {
                title: self._number(title, name, value, snapshot.limits.get(title, none), snapshot)
                for title, value in known.items()
            }
            worst = max(known, key=lambda title: (numbers[title][0], sign * abs(known[title])))
            over, number = numbers[worst]
            told.append(f"<span class=warn>{number}</span>" if over else f"<span>{number}</span>")
        return "".join(told)

    def _cell(
        self, title: str, name: str, value: float | None, limits: QuantityLimits, snapshot: Snapshot
    ) -> str:
        if value is None:
            return "<td>–</td>"
        over, number = self._number(title, name, value, limits, snapshot)
        mark, end = bar_scale(name, limits)
        length = round(100 * min(1.0, abs(self._shown[title, name]) / end))
        limit = "" if mark is None else f";--l:{round(100 * mark / end)}"
        return f"<td{' class=warn' if over else ''} style='--v:{length}{limit}'>{number}</td>"

    def _number(
        self, title: str, name: str, value: float, limits: QuantityLimits, snapshot: Snapshot
    ) -> tuple[bool, str]:
        """Whether it is past its limit, and how it is shown."""
        column, (mark, _) = COLUMNS[name], bar_scale(name, limits)
        value = self._steady(title, name, value)
        passed = any((level.part, level.quantity) == (title, column.level) for level in snapshot.levels)
        over = passed or (name == "current_a" and mark is not None and abs(value) > mark)
        return over, f"{'⚠ ' if over else ''}{fixed(column.scale * value, column.digits)} {column.unit}"

    def _steady(self, title: str, name: str, value: float) -> float:
        """The value, or the one that is shown where it only wavers about that."""
        column, key = COLUMNS[name], (title, name)
        before = self._shown.get(key)
        step = _WAVERS * 10.0**-column.digits / column.scale
        if before is None or abs(value - before) >= step or (value == 0.0) is not (before == 0.0):
            self._shown[key] = value
        return self._shown[key]


def bar_scale(name: str, limits: QuantityLimits) -> tuple[float | None, float]:
    """Where the bar of a quantity has its mark, None: no limit is known; and what its end stands for."""
    match name:
        case "load":
            return limits.load, 1.0
        case "voltage_v":
            supply = limits.supply_v
            return limits.voltage_level_v, COLUMNS[name].full if supply is None else supply / _LIMIT_AT
        case _:
            limit: float | None = getattr(limits, name)
            return limit, COLUMNS[name].full if limit is None else limit / _LIMIT_AT
