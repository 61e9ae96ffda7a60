"""The columns of a program's CSV file: what their heads mean, and in which unit."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from armctl.errors import ProgramError

_LENGTH = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_ANGLE = {"deg": 1.0, "rad": 180 / math.pi}
_TIME = {"s": 1.0, "ms": 0.001}
_SPEED = {"mm_s": 1.0, "cm_s": 10.0, "m_s": 1000.0, "percent": 1.0}
_SHARE = {"percent": 1.0}
_MEASURES: dict[str, dict[str, float]] = {
    **dict.fromkeys(("x", "y", "z", "via_x", "via_y", "via_z", "blend"), _LENGTH),
    **dict.fromkeys(("pitch", "roll"), _ANGLE),
    **dict.fromkeys(("duration", "wait"), _TIME),
    "speed": _SPEED,
    "gripper": _SHARE,
}
_KEYS = {"wait_s": "seconds", "gripper_percent": "open_percent", "speed_percent": "percent"}
"""key of the step where the column is named otherwise"""
_TEXTS = {"pitch_mode": "pitch", "choose": "choose", "profile": "profile", "note": "note", "do": "do"}
_INTEGERS = ("times",)
NUMBER = "step"
"""head of the running number: for people, not read"""
JOINTS = "joints_deg"
ORDER = (
    *("do", "x_mm", "y_mm", "z_mm", "via_x_mm", "via_y_mm", "via_z_mm", "pitch", "pitch_deg", "roll_deg"),
    *("choose", "profile", "speed_mm_s", "duration_s", "blend_mm", "seconds", "open_percent", "percent"),
    *("times", "note"),
)
"""keys of the steps in the order of their columns; the joints stand behind ``do``"""
_JOINTS_FROM = 1
_OTHERS_FROM = 7
_NUMBER_TEXT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE_TEXT = re.compile(r"[0-9]{1,9}")


@dataclass(frozen=True, slots=True)
class Column:
    """What one head means."""

    head: str
    key: str
    """of the step; ``joints_deg`` for a joint; empty where the column is not read"""
    factor: float | None = None
    """to the step's unit; None: not a number with a unit"""
    joint: int | None = None
    integer: bool = False


def joint_noun(name: str) -> str:
    """A joint's name as in its column's head; told apart from the other columns where it has to be."""
    taken = name in _MEASURES or name in _TEXTS or name in _INTEGERS or name == NUMBER
    return f"joint_{name}" if taken else name


def head_of(key: str) -> str:
    """The head under which a step's key is written."""
    for head, of in (*_KEYS.items(), *_TEXTS.items()):
        if of == key:
            return head
    return key


def heads_in_order(joint_names: Sequence[str]) -> list[tuple[str, str, int | None]]:
    """(head, key, joint) of every column that is written, in order."""
    columns: list[tuple[str, str, int | None]] = [(head_of(key), key, None) for key in ORDER]
    joints = [(f"{joint_noun(name)}_deg", JOINTS, i) for i, name in enumerate(joint_names)]
    return [*columns[:_JOINTS_FROM], *joints, *columns[_JOINTS_FROM:]]


class Columns:
    """All heads that can be read for an arm."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        self._names = list(joint_names)
        self._known: dict[str, Column] = {NUMBER: Column(NUMBER, "")}
        for noun, units in _MEASURES.items():
            for unit, factor in units.items():
                head = f"{noun}_{unit}"
                first = next(iter(units))
                key = _KEYS.get(head) or _KEYS.get(f"{noun}_{first}") or f"{noun}_{first}"
                self._known[head] = Column(head, key, factor)
        for head, key in _TEXTS.items():
            self._known[head] = Column(head, key)
        for head in _INTEGERS:
            self._known[head] = Column(head, head, integer=True)
        for i, name in enumerate(joint_names):
            for unit, factor in _ANGLE.items():
                head = f"{joint_noun(name)}_{unit}"
                self._known[head] = Column(head, JOINTS, factor, joint=i)
        self._folded = {head.casefold(): column for head, column in self._known.items()}

    def find(self, head: str) -> Column | None:
        """The column of a head, whatever its capitals; None: not known."""
        return self._known.get(head) or self._folded.get(head.strip().casefold())

    def known(self, head: str) -> Column:
        """The column of a head.

        Raises:
            ProgramError: unknown, without a unit, or with one that does not fit; says what is known.
        """
        column = self.find(head)
        if column is None:
            raise ProgramError(self._why_not(head.strip()))
        return column

    def _why_not(self, head: str) -> str:
        units = {**_MEASURES, **{joint_noun(name): _ANGLE for name in self._names}}
        plain = re.sub(r"[\s(\[]+", "_", head.casefold()).rstrip(")]_°")
        # The longest noun first: "via_x" before "x".
        for noun in sorted(units, key=len, reverse=True):
            allowed = " or ".join(f"{noun}_{unit}" for unit in units[noun])
            if plain == noun.casefold():
                return f"column {head!r} has no unit; write {allowed}"
            if plain.startswith(f"{noun.casefold()}_"):
                unit = plain[len(noun) + 1 :]
                return f"column {head!r}: the unit {unit!r} is not known here; write {allowed}"
        others = ", ".join(head_of(key) for key in ORDER[_OTHERS_FROM:])
        joints = ", ".join(f"{joint_noun(name)}_deg" for name in self._names)
        return f"column {head!r} is not known; known are {joints}, or x_mm, y_mm, z_mm, also {others}"


def parse_cell(text: str, column: Column, *, comma: bool) -> float | int | str:
    """The value of a cell that is not empty.

    Args:
        text: what it holds.
        column: which says the unit.
        comma: the decimal point may be written as a comma.

    Raises:
        ProgramError: not a number, or not finite.
    """
    if column.factor is None and not column.integer:
        return text if column.key == "note" else text.strip()
    plain = text.strip().replace("−", "-")
    if column.integer:
        if _WHOLE_TEXT.fullmatch(plain) is None:
            raise ProgramError(f"{plain[:40]!r} is not a whole number")
        return int(plain)
    if comma and plain.count(",") == 1 and "." not in plain:
        plain = plain.replace(",", ".")
    if _NUMBER_TEXT.fullmatch(plain) is None:
        raise ProgramError(f"{plain[:40]!r} is not a number{_hint(plain, comma)}")
    value = float(plain) * (1.0 if column.factor is None else column.factor)
    if not math.isfinite(value):
        raise ProgramError(f"{plain[:40]!r} is too large")
    return value


def _hint(plain: str, comma: bool) -> str:
    if "," in plain and not comma:
        return "; with decimal commas, separate the columns by semicolons"
    return "; write it without thousands separators and units" if plain[:1].isdigit() else ""
