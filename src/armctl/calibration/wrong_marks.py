"""Which marks do not lie on the line of the others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from armctl.errors import CalibrationError

FloatArray = NDArray[np.float64]
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
