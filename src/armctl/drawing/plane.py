"""The plane that is drawn on: touched at three points, and at further ones where it is not flat."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import DrawingError
from armctl.facts.causes import PlaneFromBelow, PlanePointOff, PlanePointsInLine, PlanePointsNear
from armctl.kinematics.target import as_numbers
from armctl.lazy_dataclass import dataclass

NEAREST_MM = 5.0
"""touched points that are nearer to each other tell no plane"""
_LEAST_SINE = 0.1
"""of the angle between the two directions"""
_FROM_BELOW = 0.2
"""how much the normal of a plane may point down"""
HIGHEST_MM = 30.0
"""how far a further point may lie off the plane of the first three"""
MOST_TOUCHED = 60
_STEP_M, _MOST_STEPS = 1e-3, 120
"""of the lattice on which the highest place is looked for: as fine as this, and at most so many a side"""
_DIRECTIONS = 32
"""in which it is seen how far places reach"""


@dataclass(frozen=True, eq=False)
class DrawingPlane:
    """A plane in the base frame, x to the right and y up on it, with a smooth surface over it.

    The surface goes through every touched point and bends as little as it can (a thin plate spline).
    """

    origin: FloatArray
    """(3,) base frame [m]"""
    axes: FloatArray
    """(3, 3) columns x, y and the normal, out of the plane towards the lifted pen"""
    knots: FloatArray
    """(m, 2) where the surface was touched, on the plane [m]; none: it is flat"""
    weights: FloatArray
    """(m + 3,) of the knots, then constant and slopes"""

    @classmethod
    def touched(cls, points_mm: ArrayLike) -> DrawingPlane:
        """From points (k, 3) or (3 k,) in the base frame [mm]: origin, along x, towards y, and others.

        DrawingError: fewer than three, too many, points too near to each other or in one line, or one that
        lies far off the plane of the first three.
        """
        flat: FloatArray = as_numbers(points_mm, "the points of a plane").ravel()
        count = len(flat) // 3
        if len(flat) % 3 or not 3 <= count <= MOST_TOUCHED or not np.isfinite(flat).all():
            raise DrawingError(
                f"a plane has three touched points, X, Y, Z each, and at most {MOST_TOUCHED - 3} more; there "
                f"are {len(flat)} numbers"
            )
        points = flat.reshape(-1, 3) / 1000
        for k in range(count):
            for j in range(k):
                if 1000 * (near := float(np.linalg.norm(points[k] - points[j]))) < NEAREST_MM:
                    raise DrawingError(PlanePointsNear(j + 1, k + 1, near, NEAREST_MM / 1000))
        towards = points[2] - points[0]
        along: FloatArray = points[1] - points[0]
        x = along / float(np.linalg.norm(along))
        over = np.asarray(np.cross(x, towards), dtype=np.float64)
        size = float(np.linalg.norm(over))
        if size < _LEAST_SINE * float(np.linalg.norm(towards)):
            raise DrawingError(PlanePointsInLine())
        normal = over / size
        if normal[2] < -_FROM_BELOW:
            raise DrawingError(PlaneFromBelow())
        y = np.asarray(np.cross(normal, x), dtype=np.float64)
        axes = np.stack([x, y, normal], axis=1)
        local = (points - points[0]) @ axes
        off = np.abs(local[:, 2])
        if 1000 * off.max() > HIGHEST_MM:
            raise DrawingError(PlanePointOff(int(off.argmax()) + 1, float(off.max()), HIGHEST_MM / 1000))
        if count == 3:
            return cls(points[0], axes, np.zeros((0, 2)), np.zeros(3))
        return cls(points[0], axes, local[:, :2], _plate(local[:, :2], local[:, 2]))

    @property
    def flat(self) -> bool:
        """Whether it is a plane."""
        return len(self.knots) == 0

    def heights(self, places: FloatArray) -> FloatArray:
        """(k,) of the surface over the plane at places (k, 2) on it [m]."""
        if self.flat:
            return np.zeros(len(places))
        rows = np.concatenate([_kernel(places, self.knots), _slopes(places)], axis=1)
        return rows @ self.weights

    def highest(self, places: FloatArray) -> float:
        """The most that the surface stands over the plane [m] at places (k, 2), between them, and at knots.

        Every straight way from one of the places to another runs between them, in their convex hull.
        """
        if self.flat:
            return 0.0
        low, high = places.min(axis=0), places.max(axis=0)
        step = max(_STEP_M, float((high - low).max()) / _MOST_STEPS)
        x, y = (np.arange(a, b + step, step) for a, b in zip(low.tolist(), high.tolist(), strict=True))
        lattice = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        turn = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
        towards = np.stack([np.cos(turn), np.sin(turn)])
        between = (lattice @ towards <= (places @ towards).max(axis=0) + step).all(axis=1)
        return float(self.heights(np.concatenate([places, self.knots, lattice[between]])).max())

    def points(self, places: FloatArray, lift: float = 0.0) -> FloatArray:
        """(k, 3) in the base frame [m], ``lift`` above the surface, of places (k, 2) on the plane [m]."""
        return self.origin + places @ self.axes[:, :2].T + np.outer(self.heights(places) + lift, self.normal)

    @property
    def normal(self) -> FloatArray:
        """(3,) out of the plane."""
        return self.axes[:, 2]


def _slopes(places: FloatArray) -> FloatArray:
    return np.concatenate([np.ones((len(places), 1)), places], axis=1)


def _kernel(places: FloatArray, knots: FloatArray) -> FloatArray:
    """(k, m) r² log r."""
    squares = ((places[:, None] - knots) ** 2).sum(axis=2)
    return 0.5 * squares * np.log(np.maximum(squares, 1e-30))


def _plate(knots: FloatArray, heights: FloatArray) -> FloatArray:
    """Weights of the surface through all knots (Duchon 1977)."""
    slopes = _slopes(knots)
    rows = np.block([[_kernel(knots, knots), slopes], [slopes.T, np.zeros((3, 3))]])
    return np.asarray(np.linalg.solve(rows, np.append(heights, np.zeros(3))), dtype=np.float64)
