"""Convex hulls of meshes: what the pre-flight keeps apart of an arm that is drawn from its files.

A link's triangles are shared out among a few pieces. Round each there is its hull, and a capsule, which is
quickly looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import Chain
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.arm_body import ArmBody, Capsule, Surface, comparable
from armctl.robot.body.hulls import Hull, distances, hull_of_few, padded
from armctl.robot.body.meshes import ArmSolids, across, extent, too_large, units_for
from armctl.robot.look.pieces import link_name
from armctl.robot.parts import Shape
from armctl.robot.solids import Solid

Progress = Callable[[int, int], None]
_TOOL_RADIUS = 0.003
"""of the capsule to a tool point that no mesh reaches [m]"""
MOST_PIECES = 5
"""hulls of a link"""
_WORTH = 0.93
"""two hulls take the place of one that is so much larger: their volume by its"""
_FEW = 1500
"""triangles by which it is decided how they are shared out"""
_SHARES = (0.3, 0.5, 0.7)
"""of a link's length at which its triangles may be shared out"""
_PARTS = 10
"""No edge is longer than this part of the link where triangles are shared out."""
_MOST_SHARED = 20_000
"""triangles up to which edges are cut"""
_SPACING = 60
"""points of a mesh are so near to each other, by its size, when gaps are measured"""
_MOST_POINTS = 200_000
"""points between corners when gaps are measured; where that is too few, they are farther from each other"""
_FIRST_CORNERS, _AT_ONCE, _MOST_CORNERS, _MOST_ADDED = 32, 4, 64, 96
"""A hull begins with corners in so many directions; those farthest outside are added, a few at once."""
_BESIDE = 0.2
"""of the size of a hull: a corner so near to another is not added at once with it"""
_CLOSE_M, _COARSE = 5e-4, 0.015
"""No more corners are added where none is farther outside, in metres or of the size of the hull; the margin
makes up for those left out."""
_LARGEST, _MIDDLE, _SMALLEST = 20.0, 5.0, 0.005
"""A mesh beyond so many lengths of the arm has another unit. So have all where half of those that joints move
are beyond the second number, or none is larger than the third."""
_MOST_OF_FEW = 100
"""The hull of more points takes less time with scipy."""
_FLAT_M, _FLAT = 1e-7, 1e-5
"""A hull that is no thicker has no inside."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """All points within a radius of a segment."""

    start: FloatArray
    """(3,) [m]"""
    end: FloatArray
    """(3,) [m]"""
    radius: float
    hull: Hull
    """inside it"""
    surface: Surface | None = None
    """inside that"""


def fitted_body(
    chain: Chain,
    shapes: Sequence[Shape],
    titles: Sequence[str],
    drawn: Sequence[Capsule],
    progress: Progress | None = None,
) -> ArmBody:
    """The body of an arm from the shapes of its links; of links without any that can be read, what is drawn.

    ``progress`` is told how many of how many links are done.
    """
    capsules: list[Capsule] = []
    found, notes = _readable(shapes, chain.length)
    widest, where = 0.0, ""
    for link in range(-1, chain.n):
        if progress is not None:
            progress(link + 1, chain.n + 1)
        solids = [solid for k, solid in found.items() if shapes[k].link == link]
        name = link_name(link, titles)
        if not solids:
            capsules += [one for one in drawn if one.link == link]
            continue
        pieces, gap = fit(solids)
        if gap > widest:
            widest, where = gap, name
        capsules += [
            Capsule(link, one.start, one.end, one.radius, name, one.hull, one.surface) for one in pieces
        ]
    fitted = [one for one in capsules if all(one is not other for other in drawn)]
    if fitted:
        count = f"{len(fitted)} convex hull{'' if len(fitted) == 1 else 's'}"
        text = f"the body: {count} of the meshes; the largest gap is {1000 * widest:.0f} mm ({where})"
        notes.insert(0, text)
        if not comparable():
            notes.append("where hulls of links overlap, they decide; for the meshes: pip install python-fcl")
        capsules += _to_tool(chain, fitted)
    unused = tuple(k for k in range(len(shapes)) if k not in found)
    return ArmBody(tuple(capsules), tuple(notes), unused)


def _readable(shapes: Sequence[Shape], size: float) -> tuple[dict[int, Solid], list[str]]:
    """The shapes that can be read and fit an arm of this size [m], by index; why others are passed over."""
    arm, found, notes = ArmSolids(), dict[int, Solid](), list[str]()
    sizes, moving = list[float](), list[float]()
    for k, shape in enumerate(shapes):
        try:
            solid = arm.solid_of(shape)
            beside = extent(Solid(solid.vertices - shape.pose[:3, 3], solid.faces))
            if shape.kind == "mesh" and beside > _LARGEST * size:
                raise RobotFileError(
                    f"{too_large(shape, across(solid), size)} (the arm is {size:.2g} m long)"
                )
            found[k] = solid
            sizes += [beside] * (shape.kind == "mesh")
            moving += [across(solid)] * (shape.kind == "mesh" and shape.link >= 0)
        except RobotFileError as problem:
            notes.append(f"passed over: {problem}")
    if len(sizes) == len(found) > 1 and max(sizes) < _SMALLEST * size:
        notes.append(
            f"passed over: all meshes, as the largest is {1000 * max(sizes):.2g} mm large, and the arm is "
            f"{size:.2g} m long; see what scale= their <mesh> has"
        )
        found = {}
    elif len(moving) > 1 and (middle := float(np.median(moving))) > _MIDDLE * size:
        scale = next(shape.size for shape in shapes if shape.kind == "mesh")
        notes.append(
            f"passed over: all meshes, as those of the links are around {middle:.2g} m large, and the arm is "
            f"{size:.2g} m long; {units_for(middle, size, scale)} into each <mesh>"
        )
        found = {}
    return found, list(dict.fromkeys(notes))


def _to_tool(chain: Chain, fitted: Sequence[Capsule]) -> list[Capsule]:
    """A thin capsule to the tool point, where the meshes of the last link do not reach it."""
    last, tool = chain.n - 1, chain.tail[:3, 3]
    own = [one.as_hull for one in fitted if one.link == last]
    if (
        not own
        or min(float(distances(one.corners, tool[None])[0]) - one.margin for one in own) <= _TOOL_RADIUS
    ):
        return []
    nearest = min((end for one in own for end in one.corners), key=lambda end: math.dist(end, tool))
    return [Capsule(last, nearest, tool.copy(), _TOOL_RADIUS, "the tool")]


def fit(solids: Sequence[Solid]) -> tuple[list[Fitted], float]:
    """A few hulls, each in a capsule, that contain all triangles of a link, and the largest gap [m].

    The gap: how far hull points are from the mesh, at most; up to a thirtieth of the link's size too large.
    """
    corners = np.concatenate([solid.vertices[solid.faces] for solid in solids])
    shared = _cut(corners) if len(corners) < _MOST_SHARED else corners
    pieces = [_FittedPiece.of(shared, shared[:: max(1, len(shared) // _FEW)])]
    while len(pieces) < MOST_PIECES:
        halves = [(i, split) for i, piece in enumerate(pieces) if (split := piece.halves) is not None]
        if not halves:
            break
        i, best = max(halves, key=lambda one: pieces[one[0]].volume - sum(half.volume for half in one[1]))
        pieces[i : i + 1] = best
    found = [
        replace(capsule, surface=Surface.of(piece.triangles))
        for piece, capsule in zip(
            pieces, in_capsules([hull_of(one.triangles.reshape(-1, 3)) for one in pieces]), strict=True
        )
    ]
    return found, _largest_gap([one.hull for one in found], corners)


@dataclass(frozen=True)
class _FittedPiece:
    triangles: FloatArray
    """(k, 3, 3) [m]"""
    few: FloatArray
    """some of them, by which it is decided how they are shared out"""
    volume: float
    """of the hull of these [m³]"""

    @classmethod
    def of(cls, triangles: FloatArray, few: FloatArray) -> Self:
        qhull = _qhull(few.reshape(-1, 3))
        return cls(triangles, few, 0.0 if qhull is None else float(qhull.volume))

    @cached_property
    def halves(self) -> list[_FittedPiece] | None:
        """The best of a few ways to share the triangles of one hull out to two; None: none is worth it."""
        middles, of_all = self.few.mean(axis=1), self.triangles.mean(axis=1)
        best: list[_FittedPiece] | None = None
        least = _WORTH * self.volume
        for axis in _axes(middles):
            along = middles @ axis
            for share in _SHARES:
                border = along.min() + share * np.ptp(along)
                first = along < border
                if first.all() or not first.any():
                    continue
                here = of_all @ axis < border
                parts = ((self.triangles[here], self.few[first]), (self.triangles[~here], self.few[~first]))
                halves = [_FittedPiece.of(*part) for part in parts]
                volume = sum(half.volume for half in halves)
                if volume < least:
                    best, least = halves, volume
        return best


def hull_as_it_is(points: FloatArray) -> Hull:
    """The hull of points (k, 3), some of which may lie inside it, with all its corners."""
    if _is_flat(points, _FLAT * float(np.ptp(points, axis=0).max())):
        return Hull(points, _across(points), 0.0)
    if len(points) <= _MOST_OF_FEW:
        kept, normals = hull_of_few(points)
        return Hull(points[kept], normals, 0.0)
    qhull = _qhull(points)
    kept = points if qhull is None else points[qhull.vertices]
    return Hull(kept, _normals(kept), 0.0)


def in_capsules(hulls: Sequence[Hull]) -> list[Fitted]:
    """Each of some hulls in a capsule of little volume; all at once, as that takes a third of the time."""
    found: list[Fitted] = []
    if not hulls:
        return found
    for hull, choices in zip(hulls, _along([hull.corners for hull in hulls]), strict=True):
        ends = choices[int(_volumes(hull.corners, choices).argmin())]
        radius = float(_distances(hull.corners, ends[None]).max() + hull.margin) * (1 + 1e-12) + 1e-9
        found.append(Fitted(ends[:3].copy(), ends[3:].copy(), radius, hull))
    return found


def hull_of(points: FloatArray) -> Hull:
    """A hull of few corners that contains points (k, 3); its margin is as small as they allow."""
    qhull = _qhull(points)
    if qhull is not None:
        points = points[qhull.vertices]
    else:
        points = np.unique(points, axis=0)
        points = points[_rim(points)]
    corners = _outermost(points, _FIRST_CORNERS)
    while len(corners) < min(_MOST_CORNERS, len(points)) and (qhull := _qhull(corners)) is not None:
        beyond = (points @ qhull.equations[:, :3].T + qhull.equations[:, 3]).max(axis=1)
        if beyond.max() < _CLOSE_M:
            break
        corners = np.concatenate([corners, _some_of(points, beyond)])
    # beyond a face is not far from it where the hull is thin: there the distance decides
    away = distances(corners, points)
    while away.max() > max(_CLOSE_M, _COARSE * np.ptp(points, axis=0).max()) and len(corners) < _MOST_ADDED:
        corners = np.concatenate([corners, _some_of(points, away)])
        away = distances(corners, points)
    return Hull(corners, _normals(corners), float(away.max()))


def _some_of(points: FloatArray, outside: FloatArray) -> FloatArray:
    """A few of points (k, 3) that are far ``outside`` (k,) [m], the farthest first, none beside another."""
    left, beside, chosen = outside.copy(), _BESIDE * float(np.ptp(points, axis=0).max()), list[int]()
    while len(chosen) < _AT_ONCE and left.max() > 0.5 * outside.max():
        chosen.append(int(left.argmax()))
        left[np.linalg.norm(points - points[chosen[-1]], axis=1) <= beside] = 0.0
    return points[chosen]


def _normals(corners: FloatArray) -> FloatArray:
    qhull = _qhull(corners)
    if qhull is not None:
        return np.unique(qhull.equations[:, :3].round(9), axis=0)
    return _across(corners)


def _across(corners: FloatArray) -> FloatArray:
    """Both normals of the plane in which corners (k, 3) lie."""
    across = np.linalg.svd(corners - corners.mean(axis=0))[2][2]
    return np.array([across, -across])


def _is_flat(points: FloatArray, least_m: float = 0.0) -> bool:
    off = points - points.mean(axis=0)
    return len(points) < 4 or bool(np.linalg.svd(off, compute_uv=False)[2] < max(_FLAT_M, least_m))


def _qhull(points: FloatArray) -> Any:
    """The hull of points (k, 3), as scipy gives it; None where they lie in a plane."""
    if _is_flat(points):
        return None
    spatial = import_module("scipy.spatial")
    try:
        return spatial.ConvexHull(points)
    except spatial.QhullError:  # all but flat
        return None


def _axes(points: FloatArray) -> FloatArray:
    """The principal axes of points, a row each."""
    off = points - points.mean(axis=0)
    return np.linalg.eigh(off.T @ off)[1].T


def _outermost(points: FloatArray, count: int) -> FloatArray:
    """The outermost of points in so many directions; all of them where they are fewer."""
    if len(points) <= count:
        return points
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, math.pi * (1 + math.sqrt(5)) * k
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), z])
    best, value = np.zeros(count, dtype=np.intp), np.full(count, -math.inf)
    for begin in range(0, len(points), 4096):
        reach = points[begin : begin + 4096] @ directions
        at = reach.argmax(axis=0)
        further = reach[at, np.arange(count)] > value
        best[further], value[further] = begin + at[further], reach.max(axis=0)[further]
    return points[np.unique(best)]


def _along(many: Sequence[FloatArray]) -> FloatArray:
    """Ends (m, 6, 6) of segments along the principal axes of each of m times points (k, 3).

    They are as long as the points, less a radius, and half of that.
    """
    axes = [_axes(points) for points in many]
    along = [[points @ axis for axis in three] for points, three in zip(many, axes, strict=True)]
    across = [
        points - np.stack(lengths)[:, :, None] * three[:, None]
        for points, lengths, three in zip(many, along, axes, strict=True)
    ]
    centre = np.concatenate([three.mean(axis=1) for three in across])
    points = padded([one for three in across for one in three], np.zeros((1, 3)))
    row, (x, y, z) = np.arange(len(centre)), np.moveaxis(points, 2, 0).copy()

    def squares() -> FloatArray:
        u, v, w = centre.T[:, :, None]
        return (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2

    for k in range(2, 30):  # Bădoiu and Clarkson: towards the farthest point, ever less
        centre += (points[row, squares().argmax(axis=1)] - centre) / k
    radius = np.sqrt(squares().max(axis=1))
    low, high = (np.array([side(one) for three in along for one in three]) for side in (np.min, np.max))
    axis = np.concatenate(axes)
    half = np.maximum(0.5 * (high - low) - radius, 0.0)[:, None] * axis
    middle = centre + 0.5 * (low + high)[:, None] * axis
    ends = [np.hstack([middle - s * half, middle + s * half]) for s in (1.0, 0.5)]
    return np.stack(ends, axis=1).reshape(-1, 6, 6)


def _volumes(points: FloatArray, ends: FloatArray) -> FloatArray:
    radius = _distances(points, ends).max(axis=1)
    length = np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1)
    return math.pi * radius**2 * (length + 4.0 / 3.0 * radius)


def _distances(points: FloatArray, ends: FloatArray) -> FloatArray:
    """Distances (m, k) of points (k, 3) from segments, ends (m, 6)."""
    start, span = ends[:, :3], ends[:, 3:] - ends[:, :3]
    square = (span**2).sum(axis=1)
    # |p - s|² and (p - s)·v by sums of products, without an array (m, k, 3)
    along = points @ span.T - (start * span).sum(axis=1)
    t = np.clip(along / np.where(square > 0, square, 1.0), 0.0, 1.0)
    from_start = (points**2).sum(axis=1)[:, None] - 2 * points @ start.T + (start**2).sum(axis=1)
    return np.sqrt(np.maximum(from_start - 2 * t * along + t * t * square, 0.0)).T


def _cut(triangles: FloatArray) -> FloatArray:
    """The same surface with edges no longer than a part of it: long triangles are halved, again and again."""
    longest = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / _PARTS
    done: list[FloatArray] = []
    while len(triangles) and sum(map(len, done)) < _MOST_SHARED:
        sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)  # 0-1, 1-2, 2-0
        long = sides.max(axis=1) > longest
        done.append(triangles[~long])
        triangles, worst = triangles[long], sides[long].argmax(axis=1)
        row = np.arange(len(triangles))
        a, b, c = (triangles[row, (worst + k) % 3] for k in range(3))
        half = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, half, c], axis=1), np.stack([half, b, c], axis=1)])
    return np.concatenate([*done, triangles])


def _largest_gap(hulls: Sequence[Hull], triangles: FloatArray) -> float:
    """How far the surface of hulls is from triangles, at most [m]."""
    spacing = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / _SPACING
    points = _points_on(triangles, spacing)
    x, y, z = ((points - points.min(axis=0)) * (2 / spacing)).astype(np.int64).T
    _, one_a_cell = np.unique((x << 20 | y) << 20 | z, return_index=True)
    tree: Any = import_module("scipy.spatial").cKDTree(points[one_a_cell])
    largest = 0.0
    for i, hull in enumerate(hulls):
        surface = _points_on(_faces(hull.corners), spacing)
        for other in (*hulls[:i], *hulls[i + 1 :]):
            height = (other.corners @ other.normals.T).max(axis=0)
            surface = surface[(surface @ other.normals.T - height).max(axis=1) >= 0.0]
        if len(surface):
            largest = max(largest, float(tree.query(surface)[0].max()) + hull.margin)
    return largest


def _rim(points: FloatArray) -> NDArray[np.intp]:
    """Which of points (k, 3) in a plane are corners of their hull, in their order round it."""
    off = points - points.mean(axis=0)
    flat = off @ np.linalg.svd(off)[2][:2].T
    spatial = import_module("scipy.spatial")
    try:
        return spatial.ConvexHull(flat).vertices if len(points) > 2 else np.arange(len(points))
    except spatial.QhullError:  # all but a line
        return np.array([flat[:, 0].argmin(), flat[:, 0].argmax()])


def _faces(corners: FloatArray) -> FloatArray:
    """Triangles (k, 3, 3) of the surface of a hull; of a flat one, of one side."""
    qhull = _qhull(corners)
    if qhull is not None:
        return corners[qhull.simplices]
    rim = corners[_rim(corners)]
    return np.stack([np.broadcast_to(rim[0], rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)


def _points_on(triangles: FloatArray, spacing: float) -> FloatArray:
    """Points of triangles (k, 3, 3), so many of each that none of it is farther from one than a spacing.

    The spacing is made larger where that were more than ``_MOST_POINTS`` beside the corners.
    """
    sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2).max(axis=1)
    counts = np.minimum(np.ceil(sides / spacing), _SPACING).astype(np.int64)
    while int(np.where(counts > 1, (counts + 1) * (counts + 2) // 2, 0).sum()) > _MOST_POINTS:
        spacing *= 1.25
        counts = np.minimum(np.ceil(sides / spacing), _SPACING).astype(np.int64)
    points = [triangles.reshape(-1, 3)]
    for count in cast("list[int]", np.unique(counts[counts > 1]).tolist()):
        steps = np.arange(count + 1, dtype=np.float64)
        i, j = np.repeat(steps, count + 1), np.tile(steps, count + 1)
        inside = i + j <= count
        weights = np.stack([i, j, count - i - j], axis=1)[inside] / count
        points.append(np.einsum("pc,tcx->tpx", weights, triangles[counts == count]).reshape(-1, 3))
    return np.concatenate(points)
