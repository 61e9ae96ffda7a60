"""The line through a joint's marks: sign, offset, scale, and how far each mark is off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import CalibrationError

LEAST_MARKS = 3
LEAST_SPREAD = math.radians(10.0)
"""half a degree of reading error over less than this is more than 5 % of scale"""
_SAME_PLACE = 0.01
"""outputs nearer to each other than this fraction of their spread are one place"""


@dataclass(frozen=True, slots=True)
class Mark:
    """One reading."""

    output: float
    """what the board was told, or what its encoder said [µs or counts]"""
    angle: float
    """the joint's angle as somebody read it [rad]"""


def checked_marks(marks: Sequence[Mark], unit: str) -> tuple[FloatArray, FloatArray]:
    """Outputs (n,) and angles (n,) [rad] of marks that a line can be laid through.

    Raises:
        CalibrationError: fewer than three, not finite, or not spread over enough places and degrees.
    """
    if len(marks) < LEAST_MARKS:
        raise CalibrationError(
            f"{len(marks)} marks are too few: {LEAST_MARKS} are needed, far apart; with 4 or more a wrong "
            "one is named"
        )
    outputs = np.array([mark.output for mark in marks], dtype=np.float64)
    angles = np.array([mark.angle for mark in marks], dtype=np.float64)
    for number, (output, angle) in enumerate(zip(outputs.tolist(), angles.tolist(), strict=True), 1):
        if not (math.isfinite(output) and math.isfinite(angle)):
            raise CalibrationError(
                f"mark {number} is no pair of finite numbers: {output:g} {unit}, {math.degrees(angle):g}°"
            )
    spread = float(np.ptp(outputs))
    if spread <= 0:
        raise CalibrationError(
            f"all marks are at one place, {outputs[0]:.1f} {unit}: move the joint between the marks"
        )
    found = 1 + int(np.sum(np.diff(np.sort(outputs)) > _SAME_PLACE * spread))
    if found < LEAST_MARKS:
        raise CalibrationError(
            f"the marks are at {found} places only: take them at {LEAST_MARKS} or more, spread over the "
            "joint's range"
        )
    require_spread(angles)
    return outputs, angles


def require_spread(angles: FloatArray) -> None:
    """Refuse angles (n,) [rad] that lie too close together to say anything of the scale.

    Raises:
        CalibrationError: with how far they spread and how far they must.
    """
    spread = math.degrees(float(np.ptp(angles)))
    least = math.degrees(LEAST_SPREAD)
    if spread < least:
        raise CalibrationError(
            f"the angles of the marks spread over {spread:.1f}° only: take them further apart, over "
            f"{least:.0f}° at least, better over the whole range of the joint"
        )


READING = math.radians(0.5)
"""standard deviation of a reading off a protractor before anything is measured [rad]"""
_READING_WEIGHT = 5.0
"""how many readings ``READING`` is worth: with few marks it decides, with many the marks do"""
_WRONG = 4.5
"""a mark that is off by more of its standard deviations than this does not fit the others"""
_CLEARLY = 3.0
"""leaving out another mark instead must fit worse by so many standard deviations, or none is named"""
_TURNS_BACK = 3 * math.sqrt(2) * READING
"""two readings of one angle differ by less than this [rad]"""
_SCATTER = math.radians(2.0)
"""marks that scatter more about their line than this are worth a warning [rad]"""


@dataclass(frozen=True, slots=True)
class JointFit:
    """output = zero + per_rad · angle, laid through the marks in ``used``."""

    zero: float
    """output at 0 rad"""
    per_rad: float
    """signed"""
    residuals_rad: tuple[float, ...]
    """of each mark: what was read less what the line says [rad]"""
    rms_rad: float
    """of the marks that were used [rad]"""
    used: tuple[int, ...]
    """the marks that the line goes through, by index"""
    suspect: int | None
    """the mark that does not fit the others, by index"""
    advice: str | None
    """what is wrong with the marks and what to do, in words"""
    centre: float
    """mean output of the marks that were used"""

    def angle(self, output: float) -> float:
        """Angle at an output [rad]."""
        return (output - self.zero) / self.per_rad

    def output(self, angle: float) -> float:
        """Output at an angle [rad]."""
        return self.zero + self.per_rad * angle


def fit_joint(marks: Sequence[Mark], unit: str = "µs") -> JointFit:
    """Lay a line through marks; one that does not fit is left out where the others can tell which it is.

    Three marks can tell that something is wrong, but not which of them; four name the wrong one.

    Args:
        marks: three or more, in any order.
        unit: of the outputs, for the messages.

    Raises:
        CalibrationError: fewer than three marks, not finite, all at one place, spread over less than 10°,
            or an angle that does not go one way with the output.
    """
    outputs, angles = checked_marks(marks, unit)
    suspect, doubt = _wrong_mark(outputs, angles)
    used = np.delete(np.arange(len(marks)), [] if suspect is None else suspect)
    require_spread(angles[used])
    line = _line(outputs[used], angles[used])
    _require_one_way(outputs, angles, used, line.slope, unit)
    per_rad = 1 / line.slope
    return JointFit(
        zero=line.centre - per_rad * line.middle,
        per_rad=per_rad,
        residuals_rad=tuple((angles - line.angle(outputs)).tolist()),
        rms_rad=math.sqrt(line.squares / len(used)),
        used=tuple(used.tolist()),
        suspect=suspect,
        advice=_advice(marks, suspect, doubt, line, unit),
        centre=line.centre,
    )


@dataclass(frozen=True, slots=True)
class _Line:
    """angle = middle + slope · (output - centre), by least squares."""

    slope: float
    """[rad a unit]"""
    centre: float
    middle: float
    """[rad]"""
    squares: float
    """summed squares of the residuals [rad²]"""

    def angle(self, output: FloatArray) -> FloatArray:
        return self.middle + self.slope * (output - self.centre)


def _line(outputs: FloatArray, angles: FloatArray) -> _Line:
    centre, middle = float(outputs.mean()), float(angles.mean())
    away, turned = outputs - centre, angles - middle
    slope = float(away @ turned) / float(away @ away)
    left = turned - slope * away
    return _Line(slope, centre, middle, float(left @ left))


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
    weight, freedom = _READING_WEIGHT * READING**2, _READING_WEIGHT + n - 3
    variance = (weight + float(without[wrong])) / freedom
    if _line(outputs, angles).squares - without[wrong] <= _WRONG**2 * variance:
        return None, False
    if without[second] - without[wrong] <= _CLEARLY**2 * variance:
        return None, True
    return wrong, False


def _require_one_way(
    outputs: FloatArray, angles: FloatArray, used: NDArray[np.intp], slope: float, unit: str
) -> None:
    order = used[np.argsort(outputs[used], kind="stable")]
    steps = np.diff(angles[order]) * math.copysign(1.0, slope)
    back = int(np.argmin(steps))
    if slope != 0 and steps[back] >= -_TURNS_BACK:
        return
    first, second = (
        f"mark {i + 1} ({outputs[i]:.1f} {unit}, {math.degrees(angles[i]):.1f}°)"
        for i in order[back : back + 2]
    )
    raise CalibrationError(
        f"the angle does not go one way with the output: between {first} and {second} it turns back; "
        "read both again, with their signs"
    )


def _advice(marks: Sequence[Mark], suspect: int | None, doubt: bool, line: _Line, unit: str) -> str | None:
    if suspect is not None:
        mark = marks[suspect]
        expected = line.middle + line.slope * (mark.output - line.centre)
        sign = " (is its sign wrong?)" if abs(mark.angle + expected) < _TURNS_BACK else ""
        return (
            f"mark {suspect + 1} does not fit: at {mark.output:.1f} {unit} it says "
            f"{math.degrees(mark.angle):.1f}°, and by the others it should be {math.degrees(expected):.1f}°"
            f"{sign}. Read it again or delete it; the line is laid without it"
        )
    if doubt:
        return (
            f"one of the marks does not fit, and {len(marks)} marks cannot tell which: read them again, or "
            "add a mark elsewhere"
        )
    scatter = math.sqrt(line.squares / max(len(marks) - 2, 1))
    if scatter > _SCATTER:
        return (
            f"the marks scatter by {math.degrees(scatter):.1f}° about their line: is the protractor fast, "
            "the horn tight, the joint free of load?"
        )
    return None
