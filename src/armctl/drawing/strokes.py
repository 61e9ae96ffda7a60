"""Strokes: what a pen draws without being lifted, as points in mm; and the order in which they are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import DrawingError
from armctl.lazy_dataclass import dataclass

TOLERANCE_MM = 0.01
"""how far a curve may lie from the points that stand for it"""
MOST_TURN = 0.15
"""by how much a curve may turn from one point to the next [rad]: what turns by more is a corner"""
NO_WAY_MM = 1e-3
"""points nearer to each other than this count as one"""
MOST_STROKES, MOST_POINTS = 2000, 100_000
"""of a drawing"""
LARGEST_MM = 1e6
"""no place of a drawing is farther away from its origin"""


@dataclass(frozen=True, eq=False)
class Stroke:
    """One line of the pen."""

    points: FloatArray
    """(k, 2) x to the right and y up [mm], k at least 2, each apart from the one before it"""
    line: int
    """of the file, where it is written"""
    number: int = 0
    """in the drawing as its file has it, from 1"""

    @cached_property
    def length(self) -> float:
        """[mm]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def turned(self) -> Stroke:
        """The same line, drawn from its other end."""
        return replace(self, points=self.points[::-1])


@dataclass(frozen=True, eq=False)
class PenDrawing:
    """What a file draws."""

    strokes: tuple[Stroke, ...]
    """at least one, in the order of the file"""
    left_out: tuple[str, ...] = ()
    """what the file has and a pen does not draw, in words"""

    @classmethod
    def of(cls, lines: Sequence[tuple[FloatArray, int]], left_out: Sequence[str] = ()) -> PenDrawing:
        """From points (k, 2) [mm] and the line of each in the file. DrawingError: nothing, or too much."""
        strokes: list[Stroke] = []
        for points, line in lines:
            apart = points_apart(points)
            if len(apart) > 1:
                strokes.append(Stroke(apart, line, len(strokes) + 1))
        if not strokes:
            only = f"; left out: {', '.join(left_out)}" if left_out else ""
            raise DrawingError(f"it draws nothing{only}")
        if len(strokes) > MOST_STROKES:
            raise DrawingError(f"it has {len(strokes)} strokes; a drawing has {MOST_STROKES} at most")
        return cls(tuple(strokes), tuple(left_out))

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """The corners (2,) and (2,) of what is drawn, lower left and upper right [mm]."""
        points = np.concatenate([stroke.points for stroke in self.strokes])
        return points.min(axis=0), points.max(axis=0)

    @property
    def length(self) -> float:
        """Of all strokes [mm]."""
        return sum(stroke.length for stroke in self.strokes)

    def placed(self, width: float | None, corner: tuple[float, float] = (0.0, 0.0)) -> PenDrawing:
        """The same ``width`` wide [mm] (None: as large as the file says), its lower left at ``corner``.

        DrawingError: a drawing that has no width cannot be made one as wide.
        """
        low, high = self.box
        scale = 1.0
        if width is not None:
            if high[0] - low[0] < NO_WAY_MM:
                raise DrawingError("it is a line straight up, which has no width; leave its size as it is")
            scale = width / float(high[0] - low[0])
        strokes = (
            replace(stroke, points=(stroke.points - low) * scale + np.array(corner))
            for stroke in self.strokes
        )
        return PenDrawing(tuple(strokes), self.left_out)


def points_apart(points: FloatArray) -> FloatArray:
    """(m, 2) of points (k, 2) [mm] those that are apart from the one before; the last one stays."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if len(points) == 0 or not (steps < NO_WAY_MM).any():
        return points
    kept = [0]
    for k in range(1, len(points)):
        if np.linalg.norm(points[k] - points[kept[-1]]) >= NO_WAY_MM:
            kept.append(k)
        elif k == len(points) - 1 and len(kept) > 1:
            kept[-1] = k
    return points[kept]


# The order in which strokes are drawn, and from which end, so that the lifted pen has a short way.

_MOST_ROUNDS = 20


def ordered(strokes: Sequence[Stroke]) -> tuple[Stroke, ...]:
    """The strokes in another order, some turned: the nearest end first, then 2-opt, bounded."""
    count = len(strokes)
    ends = np.array([[stroke.points[0], stroke.points[-1]] for stroke in strokes])
    left = np.ones(count, dtype=np.bool_)
    order, turned = np.empty(count, dtype=np.intp), np.zeros(count, dtype=np.bool_)
    here = np.zeros(2)
    for at in range(count):
        far = np.linalg.norm(ends - here, axis=2)
        far[~left] = np.inf
        stroke, end = divmod(int(far.argmin()), 2)
        order[at], turned[at], left[stroke] = stroke, end == 1, False
        here = ends[stroke, 1 - end]
    rank = np.arange(count)
    begins: FloatArray = ends[order][rank, turned.astype(np.intp)]
    finishes: FloatArray = ends[order][rank, 1 - turned.astype(np.intp)]
    for _ in range(_MOST_ROUNDS):
        if not _improved(order, turned, begins, finishes):
            break
    return tuple(
        strokes[k].turned if turns else strokes[k]
        for k, turns in zip(order.tolist(), turned.tolist(), strict=True)
    )


def _improved(
    order: NDArray[np.intp], turned: NDArray[np.bool_], begins: FloatArray, finishes: FloatArray
) -> bool:
    """One round of 2-opt in place: a run of strokes drawn backwards, wherever that makes the way shorter."""
    count, better = len(order), False
    for first in range(count):
        before = finishes[first - 1] if first else np.zeros(2)
        entered = float(np.linalg.norm(begins[first] - before))
        left = np.linalg.norm(begins[first + 1 :] - finishes[first:-1], axis=1)
        left = np.append(left, 0.0)
        now = entered + left
        after = np.linalg.norm(finishes[first:] - before, axis=1)
        onward = np.append(np.linalg.norm(begins[first + 1 :] - begins[first], axis=1), 0.0)
        gain = now - after - onward
        last = int(gain.argmax())
        if gain[last] > NO_WAY_MM:
            run = slice(first, first + last + 1)
            order[run], turned[run] = order[run][::-1].copy(), ~turned[run][::-1]
            begins[run], finishes[run] = finishes[run][::-1].copy(), begins[run][::-1].copy()
            better = True
    return better
