"""The line through a joint's marks: sign, offset, scale, and how far each mark is off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import CalibrationError
from armctl.facts.causes import MarksNarrow, MarksTogether, TooFew
from armctl.facts.servos import ServoSeam
from armctl.lazy_dataclass import dataclass

LEAST_MARKS = 3
_LEAST_SPREAD = math.radians(10.0)
"""half a degree of reading error over less than this is more than 5 % of scale"""
_SAME_PLACE = 0.01
"""outputs nearer to each other than this fraction of their spread are one place"""
_READING = math.radians(0.5)
"""standard deviation of a reading off a protractor before anything is measured [rad]"""
_READING_WEIGHT = 5.0
"""how many readings ``_READING`` is worth: with few marks it decides, with many the marks do"""
_WRONG = 4.5
"""a mark that is off by more of its standard deviations than this does not fit the others"""
_CLEARLY = 3.0
"""leaving out another mark instead must fit worse by so many standard deviations, or none is named"""
_TURNS_BACK = 3 * math.sqrt(2) * _READING
"""two readings of one angle differ by less than this [rad]"""
_SEAM = 0.1
"""share of the squares at most that is left where marks over the end of a turn are put behind the others"""
_SCATTER = math.radians(2.0)
"""marks that scatter more about their line than this are worth a warning [rad]"""


@dataclass(frozen=True, slots=True)
class Mark:
    """One reading."""

    output: float
    """what the board was told, or what its encoder said [board's unit]"""
    angle: float
    """the joint's angle as it was read [rad]"""

    def text(self, unit: str) -> str:
        """For a message."""
        return f"{self.output:.1f} {unit}, {math.degrees(self.angle):.1f}°"


@dataclass(frozen=True, slots=True)
class JointFit:
    """output = zero + per_rad · angle, laid through all marks but the suspect."""

    zero: float
    """output at 0 rad"""
    per_rad: float
    """signed"""
    residuals_rad: tuple[float, ...]
    """of each mark: what was read less what the line says [rad]"""
    rms_rad: float
    """of the marks that were used [rad]"""
    suspect: int | None
    """the mark that does not fit the others, by index"""
    advice: str | None
    """what is wrong with the marks and what to do, in words"""
    centre: float
    """mean output of the marks that were used"""

    def angle(self, output: float) -> float:
        """Angle at an output [rad]."""
        return (output - self.zero) / self.per_rad


def fit_joint(marks: Sequence[Mark], unit: str = "µs", turn: float | None = None) -> JointFit:
    """Lay a line through marks; one that does not fit is left out where the others can tell which it is.

    Three marks can tell that something is wrong, but not which of them; four name the wrong one. Refuses
    fewer than three, all at one place or within 10°, and angles that do not go one way with the output; and,
    where outputs begin anew after ``turn``, a joint that crosses that place.
    """
    _require_places(marks, unit)
    outputs = np.array([mark.output for mark in marks], dtype=np.float64)
    angles = np.array([mark.angle for mark in marks], dtype=np.float64)
    if turn is not None:
        _require_within_a_turn(outputs, angles, turn)
    suspect, doubt = _wrong_mark(outputs, angles)
    used = [i for i in range(len(marks)) if i != suspect]
    _require_spread(angles[used])
    line = _line(outputs[used], angles[used])
    _require_one_way([marks[i] for i in used], marks, line.slope, unit)
    expected = line.middle + line.slope * (outputs - line.centre)
    scatter = math.sqrt(line.squares / max(len(marks) - 2, 1))
    advice = None
    if suspect is not None:
        mark, angle = marks[suspect], float(expected[suspect])
        sign = " (is its sign wrong?)" if abs(mark.angle + angle) < _TURNS_BACK else ""
        advice = (
            f"mark {suspect + 1} does not fit: at {mark.output:.1f} {unit} it says "
            f"{math.degrees(mark.angle):.1f}°, and by the others it should be {math.degrees(angle):.1f}°"
            f"{sign}. Read it again or delete it; the line is laid without it"
        )
    elif doubt:
        advice = (
            f"one of the marks does not fit, and {len(marks)} marks cannot tell which: read them again, or "
            "add a mark elsewhere"
        )
    elif scatter > _SCATTER:
        advice = (
            f"the marks scatter by {math.degrees(scatter):.1f}° about their line: is the protractor fast, "
            "the horn tight, the joint free of load?"
        )
    per_rad = 1 / line.slope
    return JointFit(
        zero=line.centre - per_rad * line.middle,
        per_rad=per_rad,
        residuals_rad=tuple((angles - expected).tolist()),
        rms_rad=math.sqrt(line.squares / len(used)),
        suspect=suspect,
        advice=advice,
        centre=line.centre,
    )


class _FittedLine(NamedTuple):
    """angle = middle + slope · (output - centre), by least squares."""

    slope: float
    """[rad a unit]"""
    centre: float
    middle: float
    """[rad]"""
    squares: float
    """summed squares of the residuals [rad²]"""


def _line(outputs: FloatArray, angles: FloatArray) -> _FittedLine:
    centre, middle = float(outputs.mean()), float(angles.mean())
    away, turned = outputs - centre, angles - middle
    slope = float(away @ turned) / float(away @ away)
    left = turned - slope * away
    return _FittedLine(slope, centre, middle, float(left @ left))


def _wrong_mark(outputs: FloatArray, angles: FloatArray) -> tuple[int | None, bool]:
    """The mark without which the others lie on a line; and whether there is one that cannot be told.

    The line without a mark always fits better. A mark is wrong where it fits better by so much that
    readings of the usual scatter would hardly do so, and where leaving out no other mark helps as much.
    """
    n = len(outputs)
    without = np.full(n, np.inf)
    for i in range(n):
        rest = np.delete(outputs, i)
        if np.ptp(rest) > 0:
            without[i] = _line(rest, np.delete(angles, i)).squares
    wrong, second = (int(i) for i in np.argsort(without)[:2])
    variance = (_READING_WEIGHT * _READING**2 + float(without[wrong])) / (_READING_WEIGHT + n - 3)
    if _line(outputs, angles).squares - without[wrong] <= _WRONG**2 * variance:
        return None, False
    if without[second] - without[wrong] <= _CLEARLY**2 * variance:
        return None, True
    return wrong, False


def _require_places(marks: Sequence[Mark], unit: str) -> None:
    """Refuse marks that no line can be laid through."""
    if len(marks) < LEAST_MARKS:
        raise CalibrationError(TooFew("marks", len(marks), LEAST_MARKS))
    for number, mark in enumerate(marks, 1):
        if not (math.isfinite(mark.output) and math.isfinite(mark.angle)):
            raise CalibrationError(f"mark {number} is no pair of finite numbers: {mark.text(unit)}")
    outputs = np.sort([mark.output for mark in marks])
    spread = float(np.ptp(outputs))
    if spread <= 0:
        raise CalibrationError(MarksTogether(1, LEAST_MARKS, float(outputs[0]), unit))
    found = 1 + int(np.sum(np.diff(outputs) > _SAME_PLACE * spread))
    if found < LEAST_MARKS:
        raise CalibrationError(MarksTogether(found, LEAST_MARKS))
    _require_spread(np.array([mark.angle for mark in marks]))


def _require_spread(angles: FloatArray) -> None:
    """Refuse angles (n,) [rad] that lie too close together to say anything of the scale."""
    spread = float(np.ptp(angles))
    if spread < _LEAST_SPREAD:
        raise CalibrationError(MarksNarrow(spread, _LEAST_SPREAD))


def _require_within_a_turn(outputs: FloatArray, angles: FloatArray, turn: float) -> None:
    """Refuse marks that lie on a line only where those below one of them are a turn farther on."""
    places = np.unique(outputs)
    farther = [np.where(outputs <= low, outputs + turn, outputs) for low in places[:-1]]
    squares = [_line(one, angles).squares for one in farther]
    best = int(np.argmin(squares))
    if squares[best] < _SEAM * _line(outputs, angles).squares:
        raise CalibrationError(ServoSeam(float(places[best]), float(places[best + 1]), turn))


def _require_one_way(used: list[Mark], marks: Sequence[Mark], slope: float, unit: str) -> None:
    """Refuse used marks whose angle does not go one way with the output."""
    used = sorted(used, key=lambda mark: mark.output)
    steps = np.diff([mark.angle for mark in used]) * math.copysign(1.0, slope)
    back = int(np.argmin(steps))
    if slope == 0 or steps[back] < -_TURNS_BACK:
        first, second = (f"mark {marks.index(one) + 1} ({one.text(unit)})" for one in used[back : back + 2])
        raise CalibrationError(
            f"the angle does not go one way with the output: between {first} and {second} it turns back; "
            "read both again, with their signs"
        )
