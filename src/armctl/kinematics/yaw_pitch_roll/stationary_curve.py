"""Curves in the plane of (t3, t4) along which the sum of joint angles is stationary.

The condition ``a sin t3 + b sin t4 + c sin(t3 + t4) = 0`` (least_rotation.py derives it) is linear in
(sin t4, cos t4), so it has two roots t4 at each t3 where it has any.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_SAMPLES = 2001
_STEPS = 60
"""of a search for a root, at most"""


def coefficients(pattern: tuple[int, int, int], lengths: tuple[float, ...]) -> tuple[float, float, float]:
    """a, b, c of the condition for a pattern of senses and the three links."""
    e2, e3, e4 = pattern
    l2, l3, l4 = lengths
    return e4 * l2 * l3, (e2 - e3) * l3 * l4, (e4 - e3) * l2 * l4


class StationaryCurve:
    """A stretch of one root, tabulated over t3 by its squared distance from the first pitch axis."""

    squares: FloatArray
    """(m,) squared distances [m²], one a sample"""

    def __init__(
        self, pattern: tuple[int, int, int], lengths: tuple[float, ...], root: int, t3: FloatArray
    ) -> None:
        self._pattern, self._lengths, self._root, self.t3 = pattern, lengths, root, t3
        self._abc = coefficients(pattern, lengths)
        ratio, along, across = _ratios(self._abc, t3)
        angle = np.arcsin(np.clip(ratio, -1.0, 1.0))
        self.t4: FloatArray = (angle if root == 0 else math.pi - angle) - np.arctan2(across, along)
        l2, l3, l4 = lengths
        cosines = l2 * l3 * np.cos(t3) + l3 * l4 * np.cos(self.t4) + l2 * l4 * np.cos(t3 + self.t4)
        self._rounding = 1e-15 * sum(lengths) ** 2
        self.squares = l2 * l2 + l3 * l3 + l4 * l4 + 2 * cosines

    @classmethod
    def over(
        cls, pattern: tuple[int, int, int], lengths: tuple[float, ...], root: int, low: float, high: float
    ) -> list[StationaryCurve]:
        """The stretches of one root between two t3 [rad], each up to the very point where it ends."""
        t3 = np.linspace(low, high, _SAMPLES)
        abc = coefficients(pattern, lengths)
        real = np.abs(_ratios(abc, t3)[0]) <= 1.0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], real.astype(np.int8), [0]])))
        stretches: list[StationaryCurve] = []
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            inside = t3[start:stop]
            ends = [_end(abc, float(t3[i]), float(t3[o])) for i, o in ((start, start - 1), (stop - 1, stop))
                    if 0 <= o < _SAMPLES]  # fmt: skip
            inside = np.unique(np.concatenate([inside, ends]))
            if len(inside) > 1:
                stretches.append(cls(pattern, lengths, root, inside))
        return stretches

    def parts(self, alive: NDArray[np.bool_]) -> list[StationaryCurve]:
        """The stretches where a mask over the samples holds, and one sample more at each end.

        Each is cut where the distance turns, so that along each it only grows or only falls.
        """
        kept = alive[:-1] | alive[1:]  # the steps between samples
        grows = np.diff(self.squares) >= 0.0
        goes_on = kept[:-1] & kept[1:] & (grows[:-1] == grows[1:])
        starts = np.flatnonzero(kept & ~np.concatenate([[False], goes_on]))
        ends = np.flatnonzero(kept & ~np.concatenate([goes_on, [False]])) + 1
        return [
            StationaryCurve(self._pattern, self._lengths, self._root, self.t3[start : end + 1])
            for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
        ]

    def between(self, i: int, square: float) -> tuple[float, float]:
        """The point (t3, t4) at a squared distance [m²] that lies between those of sample i and the next.

        False position; an end that stays twice is taken for half as far off (the Illinois rule).
        """
        low, high = float(self.t3[i]), float(self.t3[i + 1])
        below, above = float(self.squares[i]) - square, float(self.squares[i + 1]) - square
        t3, t4, stayed = low, float(self.t4[i]), 0
        for _ in range(_STEPS):
            if below == above:
                break  # so short a step that rounding alone tells its ends apart
            t3 = (low * above - high * below) / (above - below)
            t4, reached = self._point(t3)
            off = reached - square
            if abs(off) <= self._rounding or not low < t3 < high:
                break
            if (off < 0.0) == (below < 0.0):
                low, below, above = t3, off, 0.5 * above if stayed > 0 else above
                stayed = 1
            else:
                high, above, below = t3, off, 0.5 * below if stayed < 0 else below
                stayed = -1
        return t3, t4

    def _point(self, t3: float) -> tuple[float, float]:
        """t4 and the squared distance at one t3, in plain floats: as the table, but forty times faster."""
        ratio, along, across = _ratio(self._abc, t3)
        angle = math.asin(ratio if -1.0 <= ratio <= 1.0 else math.copysign(1.0, ratio))
        t4 = (angle if self._root == 0 else math.pi - angle) - math.atan2(across, along)
        l2, l3, l4 = self._lengths
        square = l2 * l2 + l3 * l3 + l4 * l4 + 2 * (
            l2 * l3 * math.cos(t3) + l3 * l4 * math.cos(t4) + l2 * l4 * math.cos(t3 + t4)
        )  # fmt: skip
        return t4, square


def _ratios(abc: tuple[float, float, float], t3: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the sine of t4, turned, must be at t3 (m,); and the two factors that turn it."""
    a, b, c = abc
    along, across = b + c * np.cos(t3), c * np.sin(t3)  # along sin t4 + across cos t4 = -a sin t3
    size = np.hypot(along, across)
    return (
        np.divide(-a * np.sin(t3), size, out=np.full_like(t3, np.inf), where=size > 0.0),
        along,
        across,
    )


def _ratio(abc: tuple[float, float, float], t3: float) -> tuple[float, float, float]:
    """The same at one t3."""
    a, b, c = abc
    along, across = b + c * math.cos(t3), c * math.sin(t3)
    size = math.hypot(along, across)
    return (-a * math.sin(t3) / size if size > 0.0 else math.inf), along, across


def _end(abc: tuple[float, float, float], inside: float, outside: float) -> float:
    """The last t3 that has a root, between one that has and one that has none."""
    for _ in range(_STEPS):
        middle = 0.5 * (inside + outside)
        if abs(_ratio(abc, middle)[0]) <= 1.0:
            inside = middle
        else:
            outside = middle
    return inside
