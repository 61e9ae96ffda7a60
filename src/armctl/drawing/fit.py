"""The largest size, no larger than asked for, and the nearest place at which all of a drawing is in reach."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armctl.apart import require_wanted
from armctl.arrays import FloatArray
from armctl.drawing.pen import pen_holds
from armctl.drawing.plane import DrawingPlane
from armctl.drawing.strokes import PenDrawing
from armctl.errors import DrawingError
from armctl.facts.causes import PlaneOutOfReach
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot

_GRID = 15
"""places a side of what is looked at: half as much again as the drawing, round it"""
_AROUND = 0.75
_SHARES = (1.0, 0.5, 0.25, 0.125)
"""of the drawing's size, with each of which it is looked afresh"""
_SCALES = 0.9 ** np.arange(10)
_SHIFTS = 15
"""to either side, in steps of the grid"""
_POINTS = 100
_HOLDS = 5
_TRIES = 2


@dataclass(frozen=True, slots=True)
class Fit:
    """A size and a place of a drawing on its plane."""

    width: float
    """[mm]"""
    corner: tuple[float, float]
    """its lower left [mm]"""


def fit_drawing(
    robot: Robot,
    drawing: PenDrawing,
    plane: DrawingPlane,
    lift: float,
    pitch: float | None,
    leaves_out: Callable[[Fit], bool],
) -> Fit:
    """Where a placed drawing is wholly in reach; ``lift`` of the pen [m], its ``pitch`` [rad].

    ``leaves_out`` plans it and says whether anything is left out. DrawingError: no size of it is in reach.
    """
    low, high = drawing.box
    size = high - low
    points = np.concatenate([stroke.points for stroke in drawing.strokes]) - (low + high) / 2
    points = points[:: max(len(points) // _POINTS, 1)]
    middle = (low + high) / 2
    for share in _SHARES:
        ticks = np.linspace(-_AROUND, _AROUND, _GRID) * share * max(float(size.max()), 1.0)
        grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2) + middle
        reached = _reached(robot, plane, grid / 1000, lift, pitch)
        tried = 0
        for scale in (share * _SCALES).tolist():
            shift = _nearest_shift(reached.reshape(_GRID, _GRID), ticks, scale * points)
            if shift is None:
                continue
            x, y = (middle + shift - scale * size / 2).tolist()
            fit = Fit(round(float(scale * size[0]), 2), (round(x, 2), round(y, 2)))
            if not leaves_out(fit):
                return fit
            tried += 1
            if tried == _TRIES:
                break
        if reached.any():  # a finer look, round the middle of what is in reach
            middle = grid[reached].mean(axis=0)
    raise DrawingError(PlaneOutOfReach())


def _reached(
    robot: Robot, plane: DrawingPlane, places: FloatArray, lift: float, pitch: float | None
) -> NDArray[np.bool_]:
    """(k,) which places (k, 2) on the plane [m] the pen reaches, held so that it reaches most."""
    best = np.zeros(len(places), dtype=np.bool_)
    for hold in pen_holds(robot, plane, pitch)[:_HOLDS]:
        require_wanted()
        found = hold.reaches(plane.points(places))
        found[found] = hold.reaches(plane.points(places[found], lift))
        if np.count_nonzero(found) > np.count_nonzero(best):
            best = found
    return best


def _nearest_shift(reached: NDArray[np.bool_], ticks: FloatArray, points: FloatArray) -> FloatArray | None:
    """(2,) by which points (k, 2) are to be shifted so that all are in reach; None: by nothing."""
    step = float(ticks[1] - ticks[0])
    best, least = None, np.inf
    places = (points - ticks[0]) / step
    for i in range(-_SHIFTS, _SHIFTS + 1):
        for j in range(-_SHIFTS, _SHIFTS + 1):
            far = float(np.hypot(i, j))
            if far >= least:
                continue
            at = np.floor(places + (i, j) + 1e-9).astype(int)
            if at.min() < 0 or at.max() + 1 >= len(ticks):
                continue
            a, b = at.T
            if (reached[a, b] & reached[a + 1, b] & reached[a, b + 1] & reached[a + 1, b + 1]).all():
                best, least = step * np.array([i, j], dtype=np.float64), far
    return best
