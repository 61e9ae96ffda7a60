"""What a board measures of each motor, a column for each quantity; the bars over the scene have the same."""

from __future__ import annotations

from collections.abc import Mapping

from armctl.facts import Quantities
from armctl.lazy_dataclass import dataclass
from armctl.ui.widgets.html import fixed, table


@dataclass(frozen=True, slots=True)
class MotorColumn:
    """How a quantity is shown."""

    head: str
    unit: str
    scale: float
    """what one of its unit is, of the unit that it is shown in"""
    digits: int
    full: float
    """the end of the bar where no limit is known"""
    level: str
    """what a passed level of it is called"""


COLUMNS = {
    "load": MotorColumn("Load", "%", 100.0, 0, 1.0, "load"),
    "current_a": MotorColumn("Current", "A", 1.0, 2, 3.0, ""),
    "temperature_c": MotorColumn("Heat", "°C", 1.0, 0, 80.0, "temperature"),
    "voltage_v": MotorColumn("Supply", "V", 1.0, 1, 16.0, "voltage"),
}
"""by the name of the quantity"""


def motors_html(measured: Mapping[str, Quantities]) -> str:
    """A row for each motor; a column for each number that the board measures of any."""
    columns = {
        name: column
        for name, column in COLUMNS.items()
        if any(getattr(one, name) is not None for one in measured.values())
    }
    if not columns:
        return ""

    def cell(one: Quantities, name: str) -> str:
        value, column = getattr(one, name), columns[name]
        return "–" if value is None else fixed(column.scale * value, column.digits)

    rows = [[title, *(cell(one, name) for name in columns)] for title, one in measured.items()]
    return table(["Motor", *(f"{one.head} {one.unit}" for one in columns.values())], rows)
