"""The line through a joint's marks: sign, offset, scale, and how far each mark is off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from armctl.errors import CalibrationError

# A mark: one reading of a joint's angle, and what the board was told when it was taken.

FloatArray = NDArray[np.float64]
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


# Which marks do not lie on the line of the others.

READING = math.radians(0.5)
"""standard deviation that a reading off a protractor is taken to have before anything is measured [rad]"""
READING_WEIGHT = 5.0
"""how many readings that is worth: with few marks it decides, with many they do"""
_FALSE_ALARM = 0.01
_TWO_FROM = 7
"""so many marks can tell two wrong ones"""


@dataclass(frozen=True, slots=True)
class Line:
    """angle = angle_at_centre + slope · (output - centre), by least squares."""

    slope: float
    """[rad a unit]"""
    centre: float
    angle_at_centre: float
    """[rad]"""
    spread: float
    """root of the summed squares of the outputs about their centre"""
    squares: float
    """summed squares of the residuals [rad²]"""
    count: int

    def angle(self, output: FloatArray | float) -> FloatArray | float:
        """Angle [rad] at an output, or at each of several."""
        return self.angle_at_centre + self.slope * (output - self.centre)

    @property
    def variance(self) -> float:
        """Of one reading, from the residuals and from what a protractor is known for [rad²]."""
        return (READING_WEIGHT * READING**2 + self.squares) / self.freedom

    @property
    def freedom(self) -> float:
        """Degrees of freedom of ``variance``."""
        return READING_WEIGHT + max(self.count - 2, 0)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is wrong with some marks; all by index."""

    wrong: tuple[int, ...] = ()
    """these do not fit the others"""
    doubtful: tuple[int, ...] = ()
    """something does not fit, and it may be any of these"""


def line_through(outputs: FloatArray, angles: FloatArray) -> Line:
    """The line of least squares through two marks or more.

    Raises:
        CalibrationError: all outputs are the same.
    """
    centre, middle = float(outputs.mean()), float(angles.mean())
    away, turned = outputs - centre, angles - middle
    spread = math.sqrt(float(away @ away))
    if spread <= 0:
        raise CalibrationError(f"the marks are all at {centre:.1f}: no line goes through one place")
    slope = float(away @ turned) / spread**2
    left = turned - slope * away
    return Line(slope, centre, middle, spread, float(left @ left), len(outputs))


def judge(outputs: FloatArray, angles: FloatArray) -> Verdict:
    """Find the fewest marks without which the others lie on a line.

    Leaving marks out always fits better; they are called wrong only where it fits so much better that
    readings of the usual scatter would do so once in a hundred times (Bonferroni over the choices), and only
    where leaving others out instead fits clearly worse. The scatter is pooled from the marks that stay and
    from what a protractor is known for, since two or three marks alone cannot tell it.

    Args:
        outputs: (n,) n ≥ 3.
        angles: (n,) [rad].
    """
    n = len(outputs)
    most = 2 if n >= _TWO_FROM else 1
    left_out: list[list[tuple[float, tuple[int, ...]]]] = [
        sorted(_each_without(outputs, angles, count)) for count in range(most + 1)
    ]
    count = next(
        few
        for few in range(most + 1)
        if not any(_gains(left_out[few], left_out[more], n, more - few) for more in range(few + 1, most + 1))
    )
    if count == 0:
        return Verdict()
    (least, wrong), *others = left_out[count]
    doubt = _variance(least, n - count) * _quantile(1 - _FALSE_ALARM / 2, n - count) ** 2
    like = {index for squares, one in others if squares - least <= doubt for index in one}
    return Verdict(doubtful=tuple(sorted({*wrong, *like}))) if like else Verdict(wrong=wrong)


def _each_without(outputs: FloatArray, angles: FloatArray, count: int) -> list[tuple[float, tuple[int, ...]]]:
    """Summed squares without each choice of ``count`` marks, where the rest still makes a line."""
    found: list[tuple[float, tuple[int, ...]]] = []
    for without in combinations(range(len(outputs)), count):
        rest = np.delete(outputs, without)
        if np.ptp(rest) > 0:
            found.append((line_through(rest, np.delete(angles, without)).squares, without))
    return found


def _gains(
    now: Sequence[tuple[float, tuple[int, ...]]],
    then: Sequence[tuple[float, tuple[int, ...]]],
    n: int,
    more: int,
) -> bool:
    """Whether leaving ``more`` marks out is worth it."""
    if not then:
        return False
    rest, choices = n - len(then[0][1]), math.comb(n, len(then[0][1]))
    limit = _quantile(1 - _FALSE_ALARM / (2 * choices), rest) ** 2
    return now[0][0] - then[0][0] > more * limit * _variance(then[0][0], rest)


def _variance(squares: float, count: int) -> float:
    return Line(0.0, 0.0, 0.0, 1.0, squares, count).variance


def _quantile(probability: float, count: int) -> float:
    """Of Student's distribution, with the freedom that a line through ``count`` marks leaves."""
    from scipy.special import stdtrit  # slow to import, and only a fit needs it

    return float(stdtrit(Line(0.0, 0.0, 0.0, 1.0, 0.0, count).freedom, probability))


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
