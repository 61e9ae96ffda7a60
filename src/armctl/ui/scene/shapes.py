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


def tube(start: Point, end: Point, width: float) -> Solid:
    """A round-ended tube between two points that are apart."""
    length = float(np.linalg.norm(_span(start, end)))
    mesh = trimesh.creation.capsule(height=length, radius=0.5 * width, count=(20, 12))
    # about its middle, however trimesh centres it
    mesh.apply_translation((0, 0, -float(mesh.bounds.mean(axis=0)[2])))
    return _placed(mesh, start, end)


def beam(start: Point, end: Point, width: float) -> Solid:
    """A square beam between two points that are apart, half its width longer at both ends.

    So two beams that meet at a right angle make a whole corner, as two tubes do.
    """
    length = float(np.linalg.norm(_span(start, end)))
    return _placed(trimesh.creation.box((width, width, length + width)), start, end)


def drum(radius: float, height: float, centre: Point = (0, 0, 0)) -> Solid:
    """A cylinder about z."""
    return _solid(trimesh.creation.cylinder(radius, height, sections=36).apply_translation(centre))


def spike(radius: float, length: float) -> Solid:
    """A cone about z with its tip in the origin, pointing along z."""
    return _solid(trimesh.creation.cone(radius, length, sections=36).apply_translation((0, 0, -length)))


def block(size: Point, centre: Point) -> Solid:
    """A box along the axes."""
    return _solid(trimesh.creation.box(size).apply_translation(centre))


def _span(start: Point, end: Point) -> FloatArray:
    return np.array(end, dtype=np.float64) - np.array(start, dtype=np.float64)


def _placed(mesh: trimesh.Trimesh, start: Point, end: Point) -> Solid:
    """A mesh about the origin along z, put half way between two points, along the line between them."""
    span = _span(start, end)
    mesh.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], span / np.linalg.norm(span)))
    mesh.apply_translation(np.array(start) + 0.5 * span)
    return _solid(mesh)


def _solid(mesh: trimesh.Trimesh) -> Solid:
    return Solid(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))
