"""The outline of scattered points of a plane: that of the square cells they fall into."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Corner = tuple[int, int]
_PASSES = 2
_NEIGHBOURS = 2
"""corners to either side that a smoothed one is the mean of"""


def cell_outline(points: FloatArray, cell_m: float) -> tuple[FloatArray, ...]:
    """Closed lines around all cells that hold a point.

    Args:
        points: (k, 2) [m].
        cell_m: length of a cell's side [m].

    Returns:
        Lines (j, 2) [m] from corner to corner, the first point repeated at the end. A point lies in a
        full cell if, and only if, it is inside an odd number of them.
    """
    if len(points) == 0:
        return ()
    cells = np.floor(points / cell_m).astype(np.intp)
    low = cells.min(axis=0) - 1
    full = np.zeros(cells.max(axis=0) - low + 2, dtype=np.bool_)
    full[tuple((cells - low).T)] = True
    return tuple((np.array(line) + low) * cell_m for line in _lines(_sides(full)))


def smoothed(line: FloatArray) -> FloatArray:
    """A closed line (j, 2) without the steps of its cells: each point the mean of its neighbourhood.

    Where it is straight it stays; a corner loses less than a cell's side.
    """
    corners = line[:-1]
    for _ in range(_PASSES):
        around = [np.roll(corners, shift, axis=0) for shift in range(-_NEIGHBOURS, _NEIGHBOURS + 1)]
        corners = np.mean(around, axis=0)
    return np.concatenate([corners, corners[:1]])


def enclosed_area(line: FloatArray) -> float:
    """Area inside a closed line (j, 2) [m²]; negative for a hole, which runs clockwise."""
    (x, y), (x_next, y_next) = line[:-1].T, line[1:].T
    return 0.5 * float((x * y_next - x_next * y).sum())


def _sides(full: NDArray[np.bool_]) -> dict[Corner, list[Corner]]:
    """From corner to corner along every side between a full and an empty cell, the full one on the left."""
    onward: dict[Corner, list[Corner]] = {}
    for (dx, dy), start, end in (
        ((0, -1), (0, 0), (1, 0)),
        ((1, 0), (1, 0), (1, 1)),
        ((0, 1), (1, 1), (0, 1)),
        ((-1, 0), (0, 1), (0, 0)),
    ):
        bare = full & ~np.roll(full, (-dx, -dy), (0, 1))
        for x, y in np.argwhere(bare).tolist():
            onward.setdefault((x + start[0], y + start[1]), []).append((x + end[0], y + end[1]))
    return onward


def _lines(onward: dict[Corner, list[Corner]]) -> list[list[Corner]]:
    """Sides strung together; as many lead to a corner as away from it, so every line closes."""
    lines: list[list[Corner]] = []
    while onward:
        first = next(iter(onward))
        line, at = [first], first
        while True:
            ways = onward[at]
            step = ways.pop()
            if not ways:
                del onward[at]
            line.append(step)
            at = step
            if at == first:
                break
        lines.append(line)
    return lines
