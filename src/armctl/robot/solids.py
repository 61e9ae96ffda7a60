"""Meshes: simple solids, and coarser versions of large ones. Triangles are counter-clockwise from outside."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.lazy_dataclass import dataclass

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Solid:
    """One mesh."""

    vertices: FloatArray
    faces: NDArray[np.int64]


def tube(start: Point, end: Point, width: float) -> Solid:
    """A round-ended tube between two points that are apart."""
    radius, half = 0.5 * width, 0.5 * math.dist(start, end)
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 14)
    height = radius * np.sin(latitude) + np.copysign(half, latitude)
    return _placed(_revolved(radius * np.cos(latitude), height, 20), start, end)


def beam(start: Point, end: Point, width: float) -> Solid:
    """A square beam between two points that are apart, half its width longer at both ends, for corners."""
    return _placed(block((width, width, math.dist(start, end) + width)), start, end)


def drum(radius: float, height: float, centre: Point = (0, 0, 0)) -> Solid:
    """A cylinder about z."""
    solid = _revolved((0, radius, radius, 0), (-0.5 * height, -0.5 * height, 0.5 * height, 0.5 * height), 36)
    return Solid(solid.vertices + centre, solid.faces)


def block(size: Point, centre: Point = (0, 0, 0)) -> Solid:
    """A box along the axes."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]
    return Solid(corners * size + centre, np.array(faces, dtype=np.int64))


def _revolved(radius: ArrayLike, height: ArrayLike, sections: int) -> Solid:
    """A profile turned about z: ``radius``, ``height`` (k,) [m] upwards, the first and last on the axis."""
    r, z = np.asarray(radius, dtype=np.float64)[1:-1], np.asarray(height, dtype=np.float64)
    angle = np.arange(sections) * (2 * np.pi / sections)
    rings = np.empty((len(r), sections, 3))
    rings[..., 0] = r[:, None] * np.cos(angle)
    rings[..., 1] = r[:, None] * np.sin(angle)
    rings[..., 2] = z[1:-1, None]
    vertices = np.vstack([rings.reshape(-1, 3), [(0, 0, z[0]), (0, 0, z[-1])]])
    here = np.arange(rings[..., 0].size).reshape(rings.shape[:2])
    after = np.roll(here, -1, axis=1)
    bottom, top = np.full(sections, here.size), np.full(sections, here.size + 1)
    triangles = [
        (bottom, after[0], here[0]),
        (here[:-1], after[:-1], after[1:]),
        (here[:-1], after[1:], here[1:]),
        (here[-1], after[-1], top),
    ]
    return Solid(vertices, np.vstack([np.stack(one, axis=-1).reshape(-1, 3) for one in triangles]))


def _placed(solid: Solid, start: Point, end: Point) -> Solid:
    """A solid about the origin along z, put half way between two points, along the line between them."""
    span = np.array(end) - np.array(start)
    along = span / np.linalg.norm(span)
    aside = np.cross(np.eye(3)[np.abs(along).argmin()], along)
    aside /= np.linalg.norm(aside)
    rotation = np.column_stack([aside, np.cross(along, aside), along])
    return Solid(solid.vertices @ rotation.T + np.array(start) + 0.5 * span, solid.faces)


def decimated(solid: Solid, most: int) -> Solid:
    """A solid of at most so many triangles: vertices that lie in one cell of a grid become one.

    No vertex moves farther than the diagonal of a cell, which is the smallest that does.
    """
    if len(solid.faces) <= most:
        return solid
    low = solid.vertices.min(axis=0)
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    size = max(math.sqrt(2 * area / most), 1e-9 + 1e-6 * float(np.ptp(solid.vertices)))
    while True:
        cells = np.floor((solid.vertices - low) / size).astype(np.int64)
        spans = cells.max(axis=0) + 1
        keys = (cells[:, 0] * spans[1] + cells[:, 1]) * spans[2] + cells[:, 2]
        _, index, counts = np.unique(keys, return_inverse=True, return_counts=True)
        faces = np.sort(index[solid.faces], axis=1)
        _, first = np.unique(faces, axis=0, return_index=True)
        faces = index[solid.faces[np.sort(first)]]
        a, b, c = faces.T
        faces = faces[(a != b) & (b != c) & (c != a)]
        if len(faces) <= most:
            sums = [np.bincount(index, solid.vertices[:, k]) for k in range(3)]
            return Solid(np.stack(sums, axis=1) / counts[:, None], faces)
        size *= 1.15


def welded(solid: Solid) -> Solid:
    """The solid with vertices in one place made one; STL files write three for each triangle."""
    vertices, index = np.unique(solid.vertices.round(7), axis=0, return_inverse=True)
    return Solid(vertices, index.reshape(-1)[solid.faces])


def grown(solid: Solid, by: float) -> Solid:
    """The solid with each vertex moved outwards by so much [m]."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    normals = np.zeros_like(solid.vertices)
    for k in range(3):
        np.add.at(normals, solid.faces[:, k], np.cross(b - a, c - a))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Solid(solid.vertices + by * normals / np.where(length > 0, length, 1.0), solid.faces)


def joined(solids: Sequence[Solid]) -> Solid:
    """Several solids as one mesh."""
    begins = np.cumsum([0, *(len(solid.vertices) for solid in solids)]).tolist()
    faces = [solid.faces + begin for solid, begin in zip(solids, begins, strict=False)]
    return Solid(np.concatenate([solid.vertices for solid in solids]), np.concatenate(faces))


def creased(solid: Solid, angle: float) -> Solid:
    """The solid with its vertices doubled along edges where it bends by more than ``angle`` [rad].

    Normals of vertices, the mean of their faces', then leave these edges sharp and the rest smooth. Faces
    that share an edge name the same vertices there.
    """
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    # each edge of each face from its first corner to its next: both are corners 0 .. 3 f
    corner = np.arange(solid.faces.size).reshape(-1, 3)
    first, after = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    index, count = solid.faces.reshape(-1), len(solid.vertices)
    key, reverse = index[first] * count + index[after], index[after] * count + index[first]
    order = np.argsort(key)
    other = order[np.minimum(np.searchsorted(key[order], reverse), len(key) - 1)]
    bend = (normals[first // 3] * normals[other // 3]).sum(axis=1)
    smooth = (key[other] == reverse) & (bend >= math.cos(angle))
    # the edge of the other face runs the other way: its first corner is where this one's next is
    one = np.concatenate([first[smooth], after[smooth]])
    same = np.concatenate([after[other[smooth]], first[other[smooth]]])
    group = np.arange(solid.faces.size)
    while True:  # corners that a way over smooth edges joins get the least number of them all
        least = group.copy()
        np.minimum.at(least, one, group[same])
        least = least[least]
        if np.array_equal(least, group):
            break
        group = least
    kept, faces = np.unique(group, return_inverse=True)
    return Solid(solid.vertices[index[kept]], faces.reshape(-1, 3))
