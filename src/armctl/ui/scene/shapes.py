"""Meshes of simple solids, as vertices (v, 3) [m] and faces (f, 3)."""
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# (trimesh's creation functions are not typed)

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Solid:
    """One mesh."""

    vertices: FloatArray
    faces: NDArray[np.int64]


def tube(start: Point, end: Point, radius: float) -> Solid:
    """A round-ended tube between two points that are apart."""
    span = np.array(end, dtype=np.float64) - np.array(start, dtype=np.float64)
    length = float(np.linalg.norm(span))
    mesh = trimesh.creation.capsule(height=length, radius=radius, count=(20, 12))
    # from its start, however trimesh centres it
    mesh.apply_translation((0, 0, 0.5 * length - float(mesh.bounds.mean(axis=0)[2])))
    mesh.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], span / length))
    mesh.apply_translation(start)
    return _solid(mesh)


def drum(radius: float, height: float, centre: Point = (0, 0, 0)) -> Solid:
    """A cylinder about z."""
    return _solid(trimesh.creation.cylinder(radius, height, sections=36).apply_translation(centre))


def block(size: Point, centre: Point) -> Solid:
    """A box along the axes."""
    return _solid(trimesh.creation.box(size).apply_translation(centre))


def _solid(mesh: trimesh.Trimesh) -> Solid:
    return Solid(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))
