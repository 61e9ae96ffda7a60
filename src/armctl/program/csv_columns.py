"""Columns of CSV programs: what each head means, and the value of a cell below it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import product

from armctl.errors import ProgramError
from armctl.lazy_dataclass import dataclass
from armctl.program.steps import all_keys

Cell = tuple[str, int | None]
"""a step's key, and which joint it is of, if any"""
UNITS: tuple[dict[str, float], ...] = (
    {"mm_s": 1.0, "cm_s": 10.0, "m_s": 1000.0},
    {"mm": 1.0, "cm": 10.0, "m": 1000.0},
    {"deg": 1.0, "rad": 180 / math.pi},
    {"s": 1.0, "ms": 0.001},
    {"percent": 1.0},
)
"""units of one measure, the one of the steps first, and their factors to it"""
_AS_WRITTEN = (("note", None), ("file", None), ("text", None), ("program", None))
"""whose blanks at the ends count"""
NUMBER, DO, JOINTS, POINT = "step", "do", "joints_deg", ("x_mm", "y_mm", "z_mm")
"""the running number, which is for people, is not read"""
_POINTS_PLACE = 2
"""of the last key of a point among the keys of steps"""
_NOTES = ("comment", "comments", "remark", "remarks", "notes", "description", "label")
"""heads under which people write notes"""
_TIMES = ("t", "time", "time_from_start", "timestamp", "seconds", "secs")
"""heads of the time at which a row is reached, also with a unit; without one in seconds"""
_NUMBERED = ("j", "joint", "joint_", "q", "theta")
"""before the number of a joint, from 1, where a file does not call the joints by their names"""
TIME: Cell = ("time", None)
_NUMBER_TEXT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE_TEXT = re.compile(r"[0-9]{1,9}")
_BEGINS_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
_GUARD = "'"


@dataclass(frozen=True, slots=True)
class Column:
    """What one head means."""

    head: str
    place: Cell | None
    """None: the column is not read"""
    factor: float | None = None
    """to the step's unit; None: not a number with a unit"""
    integer: bool = False
    numbers: bool = False
    """several in one cell, with blanks between"""

    def value(self, text: str, *, comma: bool) -> float | int | str | list[float]:
        """The value of a cell that is not empty; with ``comma``, a number may have a decimal comma."""
        plain = text.strip()
        if self.numbers:
            one = Column(self.head, self.place, 1.0)
            return [float(one.value(part, comma=comma)) for part in unguarded(plain).split()]  # pyright: ignore[reportArgumentType]
        if self.factor is None and not self.integer:
            return text if self.place in _AS_WRITTEN else plain
        plain = plain.replace("−", "-")
        if self.integer:
            if _WHOLE_TEXT.fullmatch(plain) is None:
                raise ProgramError(f"{plain[:40]!r} is not a whole number")
            return int(plain)
        if comma and plain.count(",") == 1 and "." not in plain:
            plain = plain.replace(",", ".")
        if _NUMBER_TEXT.fullmatch(plain) is None:
            hint = "; write it without thousands separators and units" if plain[:1].isdigit() else ""
            if "," in plain and not comma:
                hint = "; with decimal commas, separate the columns by semicolons"
            raise ProgramError(f"{plain[:40]!r} is not a number{hint}")
        value = float(plain) * (self.factor or 1.0)
        if not math.isfinite(value):
            raise ProgramError(f"{plain[:40]!r} is too large")
        return value


class Columns:
    """All heads that are written or can be read for an arm."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        keys = [key for key in all_keys() if key.name != JOINTS]
        self._known = {NUMBER: Column(NUMBER, None), DO: Column(DO, (DO, None))}
        self._units: dict[str, list[str]] = {}
        """units of each noun"""
        for key in keys:
            if key.form == "number":
                self._add_number(key.head, (key.name, None))
            else:
                kind = {"integer": key.form == "integer", "numbers": key.form == "numbers"}
                self._known[key.head] = Column(key.head, (key.name, None), **kind)
        taken = {*self._units, *self._known}
        self._joints = [f"joint_{name}_deg" if name in taken else f"{name}_deg" for name in joint_names]
        for joint, head in enumerate(self._joints):
            self._add_number(head, (JOINTS, joint))
        for joint, begins in product(range(len(joint_names)), _NUMBERED):
            if f"{begins}{joint + 1}" not in self._units:
                self._add_number(f"{begins}{joint + 1}_deg", (JOINTS, joint))
        self._known["#"] = self._known[NUMBER]
        self._known = {head: Column(head, ("note", None)) for head in _NOTES} | self._known
        for noun in _TIMES:
            for head, unit in ((noun, 1.0), (f"{noun}_s", 1.0), (f"{noun}_ms", 0.001)):
                self._known.setdefault(head, Column(head, TIME, unit))
        self._folded = {head.casefold(): column for head, column in self._known.items()}
        heads = [DO, *self._joints, *(key.head for key in keys)]
        self.written = tuple(self._known[head] for head in heads)
        """in their order, without the running number"""
        self._others = [key.head for key in keys if key.field.place > _POINTS_PLACE]

    def find(self, head: str) -> Column | None:
        """The column of a head, whatever its capitals, also with the unit in brackets; None: not known."""
        return self._known.get(head) or self._folded.get(_plain(head))

    def why_not(self, head: str) -> str:
        """Why a head is not known: without a unit, with one that does not fit, or what is known instead."""
        plain = _plain(head)
        # The longest noun first: "via_x" before "x".
        for noun in sorted(self._units, key=len, reverse=True):
            allowed = " or ".join(f"{noun}_{unit}" for unit in self._units[noun])
            if plain == noun.casefold():
                return f"column {head!r} has no unit; write {allowed}"
            if plain.startswith(f"{noun.casefold()}_"):
                unit = plain[len(noun) + 1 :]
                return f"column {head!r}: the unit {unit!r} is not known here; write {allowed}"
        joints, others = ", ".join(self._joints), ", ".join(self._others)
        return f"column {head!r} is not known; known are {joints}, or x_mm, y_mm, z_mm, also {others}"

    def _add_number(self, head: str, place: Cell) -> None:
        """A column for each unit that a number may have."""
        self._known[head] = Column(head, place, 1.0)
        for units in UNITS:
            own = f"_{next(iter(units))}"
            if head.endswith(own):
                noun = head.removesuffix(own)
                for unit, factor in units.items():
                    self._known[f"{noun}_{unit}"] = Column(f"{noun}_{unit}", place, factor)
                self._units.setdefault(noun, []).extend(units)
                return


def _plain(head: str) -> str:
    """A head in small letters, with the unit as in our own: of "X (mm)" x_mm, of "base [°]" base_deg."""
    plain = re.sub(r"[\s/(\[]+", "_", head.strip().casefold()).rstrip(")]_")
    return re.sub("_?°$", "_deg", plain)


def guarded(text: str) -> str:
    """``text`` with an apostrophe before what a spreadsheet would take for a formula."""
    return _GUARD + text if text.startswith((*_BEGINS_FORMULA, _GUARD)) else text


def unguarded(text: str) -> str:
    """The text of a cell; an apostrophe that guards nothing stays."""
    rest = text.removeprefix(_GUARD)
    return rest if text != rest and rest.startswith((*_BEGINS_FORMULA, _GUARD)) else text
