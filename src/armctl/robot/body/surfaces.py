"""The triangles of links, and how far apart they are: a second look where convex hulls overlap.

A hull bridges whatever is hollow, such as a fork. Distances of triangles are those of the library FCL
(python-fcl, an optional dependency; without it hulls alone decide).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray

CLEAR_M = 1e-3
"""A distance of triangles counts from here on: the pre-flight lets parts dip by half a millimetre, and by as
much again between samples, so that surfaces never cut each other."""
_MOST_TRIANGLES = 20_000
"""of one piece; where there are more, corners are moved to a grid"""
_WELDED_M, _FINEST_M, _COARSEST_M = 1e-5, 2.5e-4, 4e-3
"""spacing of that grid; beyond, hulls decide"""
_BITS = 21
_MOST_STEPS = 1 << _BITS


def comparable() -> bool:
    """Whether the library is there."""
    return find_spec("fcl") is not None


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangles of a piece of a link, in the link's frame."""

    points: bytes
    """(k, 3) little-endian float32 [m]"""
    faces: bytes
    """(f, 3) little-endian uint32, indices of points"""
    off: float
    """how far a point of the piece is from these triangles, at most [m]"""

    @classmethod
    def of(cls, triangles: FloatArray) -> Surface | None:
        """Of triangles (k, 3, 3) [m]; None: there are too many of them, or no library to compare them."""
        if not comparable():
            return None
        low = triangles.min(axis=(0, 1))
        spacing = max(_WELDED_M, float(np.ptp(triangles, axis=(0, 1)).max()) / (_MOST_STEPS - 1))
        while spacing <= _COARSEST_M:
            steps = np.rint((triangles.reshape(-1, 3) - low) / spacing).astype(np.int64)
            places, index = np.unique(_packed(steps), return_inverse=True)
            if len(places) < _MOST_STEPS:
                faces = np.unique(_packed(np.sort(index.reshape(-1, 3), axis=1)))
                if len(faces) <= _MOST_TRIANGLES:
                    points = low + spacing * _unpacked(places)
                    off = 0.5 * 3**0.5 * spacing
                    return cls(points.astype("<f4").tobytes(), _unpacked(faces).astype("<u4").tobytes(), off)
            spacing = max(_FINEST_M, 1.5 * spacing)
        return None

    def model(self) -> Any:
        """As FCL holds it."""
        points = np.frombuffer(self.points, "<f4").reshape(-1, 3).astype(np.float64)
        faces = np.frombuffer(self.faces, "<u4").reshape(-1, 3).astype(np.int32)
        model = _fcl().BVHModel()
        model.beginModel(len(faces), len(points))
        model.addSubModel(points, faces)
        model.endModel()
        return model


def _packed(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(k,) a number for each of (k, 3) numbers below ``_MOST_STEPS``: they are sorted ten times as fast."""
    return (rows[:, 0] << 2 * _BITS) | (rows[:, 1] << _BITS) | rows[:, 2]


def _unpacked(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    mask = _MOST_STEPS - 1
    return np.stack([numbers >> 2 * _BITS, (numbers >> _BITS) & mask, numbers & mask], axis=1)


@cache
def _fcl() -> Any:
    return import_module("fcl")  # a tenth of a second that an arm without meshes does without


class SurfacePairs:
    """Distances between any two of some surfaces."""

    def __init__(self, surfaces: Sequence[Surface | None]) -> None:
        self._surfaces = surfaces
        self._models: dict[int, Any] = {}

    def distances(
        self, one: NDArray[np.intp], other: NDArray[np.intp], R: FloatArray, origin: FloatArray
    ) -> FloatArray:
        """Distances (k,) [m] between surfaces and others, lower bounds; 0 where they cut each other.

        ``R`` (k, 3, 3) and ``origin`` (k, 3) [m] place the frames of the others in those of the first. What
        is inside another, and cuts none of it, counts as apart from it: no motion comes there without a cut.
        """
        fcl, found = _fcl(), np.zeros(len(one))
        here, request, touch = fcl.Transform(), fcl.DistanceRequest(), fcl.CollisionRequest()
        for k, (i, j) in enumerate(zip(one.tolist(), other.tolist(), strict=True)):
            first = fcl.CollisionObject(self._model(i), here)
            second = fcl.CollisionObject(self._model(j), fcl.Transform(R[k], origin[k]))
            if not fcl.collide(first, second, touch, fcl.CollisionResult()):  # several times as fast
                found[k] = fcl.distance(first, second, request, fcl.DistanceResult()) - self._off(i, j)
        return np.maximum(found, 0.0)

    def _off(self, *pair: int) -> float:
        return sum(one.off for k in pair if (one := self._surfaces[k]) is not None)

    def _model(self, k: int) -> Any:
        surface = self._surfaces[k]
        if k not in self._models and surface is not None:
            self._models[k] = surface.model()
        return self._models[k]
