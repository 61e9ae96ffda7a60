"""The line through a joint's marks: sign, offset, scale, and how far each mark is off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.calibration.mark import Mark, checked_marks, require_spread
from armctl.calibration.wrong_marks import READING, Line, Verdict, judge, line_through
from armctl.errors import CalibrationError

FloatArray = NDArray[np.float64]
_TURNS_BACK = 3 * math.sqrt(2) * READING
"""two readings of one angle differ by less than this [rad]"""
_SCATTER = math.radians(2.0)
"""marks that scatter more about their line than this are worth a word [rad]"""


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
    suspects: tuple[int, ...]
    """the marks that do not fit the others, by index"""
    doubtful: tuple[int, ...]
    """a mark does not fit, and these marks cannot tell which of them it is; all are used"""
    advice: str | None
    """what is wrong with the marks and what to do, in words"""
    centre: float
    """mean output of the marks that were used"""
    reading_rad: float
    """standard deviation of one reading, from the marks and from what a protractor is known for [rad]"""
    spread: float
    """root of the summed squares of the outputs about ``centre``"""

    @property
    def suspect(self) -> int | None:
        """The mark that does not fit, by index; the first one where there are two."""
        return self.suspects[0] if self.suspects else None

    @property
    def scale_error(self) -> float:
        """Standard error of ``per_rad``, as a fraction of it."""
        return self.reading_rad * abs(self.per_rad) / self.spread

    def angle(self, output: float) -> float:
        """Angle at an output [rad]."""
        return (output - self.zero) / self.per_rad

    def output(self, angle: float) -> float:
        """Output at an angle [rad]."""
        return self.zero + self.per_rad * angle

    def error(self, output: float) -> float:
        """Standard error of the angle at an output [rad]: smallest amid the marks, growing outward."""
        lever = (output - self.centre) / self.spread
        return self.reading_rad * math.sqrt(1 / len(self.used) + lever**2)


def fit_joint(marks: Sequence[Mark], unit: str = "µs") -> JointFit:
    """Lay a line through marks, leaving out one that does not fit, where the others can tell which it is.

    Three marks can tell that something is wrong, not which of them; four name a wrong one, seven two.

    Args:
        marks: three or more, in any order.
        unit: of the outputs, for the messages.

    Raises:
        CalibrationError: fewer than three marks, not finite, all at one place, spread over less than 10°,
            or an angle that does not go one way with the output.
    """
    outputs, angles = checked_marks(marks, unit)
    verdict = judge(outputs, angles)
    used = np.setdiff1d(np.arange(len(marks)), verdict.wrong)
    require_spread(angles[used])
    line = line_through(outputs[used], angles[used])
    _require_one_way(outputs, angles, used, line.slope, unit)
    residuals = angles - line.angle(outputs)
    per_rad = 1 / line.slope
    return JointFit(
        zero=line.centre - per_rad * line.angle_at_centre,
        per_rad=per_rad,
        residuals_rad=tuple(residuals.tolist()),
        rms_rad=math.sqrt(line.squares / line.count),
        used=tuple(used.tolist()),
        suspects=verdict.wrong,
        doubtful=verdict.doubtful,
        advice=_advice(marks, verdict, line, unit),
        centre=line.centre,
        reading_rad=math.sqrt(line.variance),
        spread=line.spread,
    )


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


def _advice(marks: Sequence[Mark], verdict: Verdict, line: Line, unit: str) -> str | None:
    if verdict.wrong:
        told = "; ".join(_wrong(i, marks[i], line, unit) for i in verdict.wrong)
        return f"{told}. Read it again or delete it; the line is laid without it"
    if verdict.doubtful:
        numbers = [str(i + 1) for i in verdict.doubtful]
        listed = f"{', '.join(numbers[:-1])} and {numbers[-1]}"
        return (
            f"one of the marks {listed} does not fit, and {len(marks)} marks cannot tell which: read them "
            "again, or add a mark elsewhere"
        )
    scatter = math.sqrt(line.squares / max(line.count - 2, 1))
    if scatter > _SCATTER:
        return (
            f"the marks scatter by {math.degrees(scatter):.1f}° about their line: is the protractor fast, "
            "the horn tight, the joint free of load?"
        )
    return None


def _wrong(index: int, mark: Mark, line: Line, unit: str) -> str:
    expected = float(line.angle(mark.output))
    sign = " (is its sign wrong?)" if abs(mark.angle + expected) < _TURNS_BACK else ""
    return (
        f"mark {index + 1} does not fit: at {mark.output:.1f} {unit} it says "
        f"{math.degrees(mark.angle):.1f}°, and by the others it should be {math.degrees(expected):.1f}°{sign}"
    )
