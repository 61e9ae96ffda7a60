"""Capsules fitted to meshes: what the pre-flight keeps apart of an arm that is drawn from its files.

A capsule is convex: it contains a triangle where it contains its corners. So a link's triangles are shared
out among a few capsules, each of which contains all of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Self, cast

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import Chain
from armctl.robot.body import ArmBody, Capsule, link_name
from armctl.robot.meshes import ArmSolids
from armctl.robot.parts import Shape
from armctl.robot.solids import Solid

_TOOL_RADIUS = 0.003
"""of the capsule to a tool point that no mesh reaches [m]"""
MOST_PIECES = 3
"""capsules of a link"""
_WORTH = 0.85
"""two capsules take the place of one that is so much larger: their volume by its"""
_DIRECTIONS = 192
"""in which the outermost points are looked for; the others hardly matter for the fit"""
_FEW = 500
"""triangles by which it is decided how they are shared out"""
_SHARES = (0.3, 0.5, 0.7)
"""of a link's length at which its triangles may be shared out"""
_ROUNDS, _TRIES = 8, 12
"""of the search; each round has half the step of the one before"""
_PARTS = 10
"""No edge is longer than this part of the link where triangles are shared out."""
_MOST_SHARED = 20_000
"""triangles up to which edges are cut"""
_SPACING = 60
"""points of a mesh are so near to each other, by its size, when gaps are measured"""
_MOST_POINTS = 200_000
"""points between corners when gaps are measured; where that is too few, they are farther from each other"""
_ON_SURFACE = 400
"""points of a capsule's surface from which gaps are measured"""


@dataclass(frozen=True, slots=True)
class Fitted:
    """All points within a radius of a segment."""

    start: FloatArray
    """(3,) [m]"""
    end: FloatArray
    """(3,) [m]"""
    radius: float


def fitted_body(
    chain: Chain, shapes: Sequence[Shape], titles: Sequence[str], bars: Sequence[Capsule]
) -> ArmBody:
    """The body of an arm from the shapes of its links; of links without any that can be read, the bars."""
    capsules: list[Capsule] = []
    notes: list[str] = []
    widest, where = 0.0, ""
    arm = ArmSolids()
    for link in range(-1, chain.n):
        solids: list[Solid] = []
        for shape in shapes:
            if shape.link == link:
                try:
                    solids.append(arm.solid_of(shape))
                except RobotFileError as problem:
                    notes.append(f"passed over: {problem}")
        name = link_name(link, titles)
        if not solids:
            capsules += [bar for bar in bars if bar.link == link]
            continue
        found, gap = fit(solids)
        if gap > widest:
            widest, where = gap, name
        capsules += [Capsule(link, one.start, one.end, one.radius, name) for one in found]
    fitted = [one for one in capsules if all(one is not bar for bar in bars)]
    if fitted:
        count = f"{len(fitted)} capsule{'' if len(fitted) == 1 else 's'}"
        text = f"the body: {count} fitted to the meshes; the largest gap is {1000 * widest:.0f} mm ({where})"
        notes.insert(0, text)
        capsules += _to_tool(chain, fitted)
    return ArmBody(tuple(capsules), tuple(notes))


def _to_tool(chain: Chain, fitted: Sequence[Capsule]) -> list[Capsule]:
    """A thin capsule to the tool point, where the meshes of the last link do not reach it."""
    last, tool = chain.n - 1, chain.tail[:3, 3]
    ends = [end for one in fitted if one.link == last for end in (one.start, one.end)]
    own = [one for one in fitted if one.link == last]
    outside = [
        float(_distances(tool[None], np.concatenate([one.start, one.end])[None])[0, 0]) - one.radius
        for one in own
    ]
    if not own or min(outside) <= _TOOL_RADIUS:
        return []
    nearest = min(ends, key=lambda end: math.dist(end, tool))
    return [Capsule(last, nearest, tool.copy(), _TOOL_RADIUS, "the tool")]


def fit(solids: Sequence[Solid]) -> tuple[list[Fitted], float]:
    """A few capsules that contain all triangles of a link, and the largest gap [m].

    The gap is how far a point of their surface is from the mesh, at most. It is measured at points, so
    that it may be a thirtieth of the link's size too large.
    """
    corners = np.concatenate([solid.vertices[solid.faces] for solid in solids])
    shared = _cut(corners) if len(corners) < _MOST_SHARED else corners
    pieces = [_Piece.of(shared, shared[:: max(1, len(shared) // _FEW)])]
    while len(pieces) < MOST_PIECES:
        halves = [(i, split) for i, piece in enumerate(pieces) if (split := _halved(piece)) is not None]
        if not halves:
            break
        i, best = max(halves, key=lambda one: pieces[one[0]].volume - sum(half.volume for half in one[1]))
        pieces[i : i + 1] = best
    capsules = [contain(piece.triangles.reshape(-1, 3)) for piece in pieces]
    return capsules, _largest_gap(capsules, corners)


@dataclass(frozen=True, slots=True)
class _Piece:
    triangles: FloatArray
    """(k, 3, 3) [m]"""
    few: FloatArray
    """some of them, by which it is decided how they are shared out"""
    volume: float
    """of a capsule that contains these, roughly [m³]"""

    @classmethod
    def of(cls, triangles: FloatArray, few: FloatArray) -> Self:
        return cls(triangles, few, _first(few.reshape(-1, 3))[1])


def _halved(whole: _Piece) -> list[_Piece] | None:
    """The best of a few ways to share the triangles of one capsule out to two; None: none is worth it."""
    middles = whole.few.mean(axis=1)
    best: list[_Piece] | None = None
    least = _WORTH * whole.volume
    for axis in _axes(middles):
        along = middles @ axis
        for share in _SHARES:
            border = along.min() + share * np.ptp(along)
            first = along < border
            if first.all() or not first.any():
                continue
            here = whole.triangles.mean(axis=1) @ axis < border
            parts = ((whole.triangles[here], whole.few[first]), (whole.triangles[~here], whole.few[~first]))
            halves = [_Piece.of(*part) for part in parts]
            volume = sum(half.volume for half in halves)
            if volume < least:
                best, least = halves, volume
    return best


def contain(points: FloatArray) -> Fitted:
    """A capsule of little volume that contains points (k, 3)."""
    outer = _outermost(points)
    ends = _improved(outer, *_first(outer))
    radius = float(_distances(points, ends[None])[0].max()) * (1 + 1e-12) + 1e-9
    return Fitted(ends[:3].copy(), ends[3:].copy(), radius)


def _axes(points: FloatArray) -> FloatArray:
    """The principal axes of points, a row each."""
    off = points - points.mean(axis=0)
    return np.linalg.eigh(off.T @ off)[1].T


def _first(outer: FloatArray) -> tuple[FloatArray, float]:
    """The best segment along a principal axis, ends (6,), and the volume of its capsule."""
    ends = np.concatenate([_along(outer, axis) for axis in _axes(outer)])
    volumes = _volumes(outer, ends)
    best = int(volumes.argmin())
    return ends[best], float(volumes[best])


def _outermost(points: FloatArray) -> FloatArray:
    if len(points) <= _DIRECTIONS:
        return points
    k = np.arange(_DIRECTIONS) + 0.5
    z, angle = 1 - 2 * k / _DIRECTIONS, math.pi * (1 + math.sqrt(5)) * k
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), z])
    best, value = np.zeros(_DIRECTIONS, dtype=np.intp), np.full(_DIRECTIONS, -math.inf)
    for begin in range(0, len(points), 4096):
        reach = points[begin : begin + 4096] @ directions
        at = reach.argmax(axis=0)
        further = reach[at, np.arange(_DIRECTIONS)] > value
        best[further], value[further] = begin + at[further], reach.max(axis=0)[further]
    return points[np.unique(best)]


def _along(points: FloatArray, axis: FloatArray) -> FloatArray:
    """Ends (2, 6) of segments along an axis: as long as the points, less a radius; and half of that."""
    along = points @ axis
    across = points - along[:, None] * axis
    centre = across.mean(axis=0)
    for k in range(2, 30):  # Bădoiu and Clarkson: towards the farthest point, ever less
        centre = centre + (across[((across - centre) ** 2).sum(axis=1).argmax()] - centre) / k
    radius = math.sqrt(float(((across - centre) ** 2).sum(axis=1).max()))
    half = max(0.5 * float(np.ptp(along)) - radius, 0.0)
    middle = centre + 0.5 * (along.min() + along.max()) * axis
    return np.array(
        [np.concatenate([middle - s * half * axis, middle + s * half * axis]) for s in (1.0, 0.5)]
    )


def _improved(points: FloatArray, ends: FloatArray, volume: float) -> FloatArray:
    """The ends (6,) of a segment nearby whose capsule has the least volume."""
    step = 0.1 * float(np.ptp(points, axis=0).max())
    both = np.concatenate([np.eye(3), np.eye(3)], axis=1)
    moves = np.concatenate([np.eye(6), -np.eye(6), both, -both])  # one end, or both together
    for _ in range(_ROUNDS):
        for _ in range(_TRIES):
            tries = ends + step * moves
            volumes = _volumes(points, tries)
            at = int(volumes.argmin())
            if volumes[at] >= volume * (1 - 1e-4):
                break
            ends, volume = tries[at], float(volumes[at])
        step *= 0.5
    return ends


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


def _largest_gap(capsules: Sequence[Fitted], triangles: FloatArray) -> float:
    """How far the surface of capsules is from triangles, at most [m]."""
    spacing = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / _SPACING
    points = _points_on(triangles, spacing)
    x, y, z = ((points - points.min(axis=0)) * (2 / spacing)).astype(np.int64).T
    _, one_a_cell = np.unique((x << 20 | y) << 20 | z, return_index=True)
    tree: Any = import_module("scipy.spatial").cKDTree(points[one_a_cell])
    largest = 0.0
    for i, capsule in enumerate(capsules):
        surface = _surface(capsule)
        for other in (*capsules[:i], *capsules[i + 1 :]):
            ends = np.concatenate([other.start, other.end])[None]
            surface = surface[_distances(surface, ends)[0] >= other.radius]
        if len(surface):
            largest = max(largest, float(tree.query(surface)[0].max()))
    return largest


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


def _surface(capsule: Fitted) -> FloatArray:
    """Points (k, 3) of a capsule's surface, evenly along and round it, and on both ends."""
    span = capsule.end - capsule.start
    length = float(np.linalg.norm(span))
    axis = span / length if length > 0 else np.array([0.0, 0.0, 1.0])
    aside = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    aside /= np.linalg.norm(aside)
    k = np.arange(_ON_SURFACE) + 0.5
    height = (
        length + 2 * capsule.radius
    ) * k / _ON_SURFACE - capsule.radius  # Archimedes: even over a ball, too
    angle = math.pi * (1 + math.sqrt(5)) * k
    past = np.minimum(height, 0.0) + np.maximum(height - length, 0.0)
    ring = np.sqrt(np.maximum(capsule.radius**2 - past**2, 0.0))
    round_it = np.cos(angle)[:, None] * aside + np.sin(angle)[:, None] * np.cross(axis, aside)
    return capsule.start + height[:, None] * axis + ring[:, None] * round_it
