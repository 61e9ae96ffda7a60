"""The solids that rows of a look stand for: meshes to draw, and convex corners to keep apart [mm]."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.lazy_dataclass import dataclass
from armctl.robot.look.rows import (
    MAKES,
    AnyRow,
    Bar,
    Box,
    Bracket,
    Direction,
    Motor,
    Paint,
    Plate,
    Rod,
    Tube,
    Widths,
)
from armctl.robot.solids import Solid

_SIDES, _BODY_SIDES = 28, 14
"""of a circle, as it is drawn and as it is kept apart: half of it outside its corners, half inside"""
_LOW_HORN_MM = 3.5
_SMALLEST_MM2 = 1e-3
_FILLED_MM = 2.0
"""An outline that is hollow by no more than this is kept apart as if it were filled."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A solid of one colour."""

    color: Paint
    solid: Solid
    """as it is drawn [mm]"""
    corners: tuple[FloatArray, ...]
    """(k, 3) of the convex bodies that fill it [mm]"""

    def moved(self, R: FloatArray, t: ArrayLike) -> Part:
        """The same, turned (or mirrored) by R (3, 3) and then moved by t (3,) [mm]."""
        t = np.asarray(t, dtype=np.float64)
        faces = self.solid.faces if np.linalg.det(R) > 0 else self.solid.faces[:, ::-1]
        solid = Solid(self.solid.vertices @ R.T + t, faces)
        return Part(self.color, solid, tuple(corners @ R.T + t for corners in self.corners))

    def scaled(self, factor: float) -> Part:
        """The same in another unit."""
        solid = Solid(factor * self.solid.vertices, self.solid.faces)
        return Part(self.color, solid, tuple(factor * corners for corners in self.corners))


def unit(direction: Direction) -> FloatArray:
    """A direction (3,) of length 1."""
    if isinstance(direction, str):
        v = np.zeros(3)
        v["xyz".index(direction[-1])] = -1.0 if direction[0] == "-" else 1.0
        return v
    v = np.array(direction, dtype=np.float64)
    return v / np.linalg.norm(v)


def upright(along: FloatArray, beside: FloatArray) -> FloatArray:
    """A rotation (3, 3) whose x is along one vector, and whose y is as near to another one as can be."""
    x = along / np.linalg.norm(along)
    y = beside - (beside @ x) * x
    if np.linalg.norm(y) < 1e-6:
        y = np.cross(np.eye(3)[np.abs(x).argmin()], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def parts(row: AnyRow, start: FloatArray, end: FloatArray) -> Iterator[Part]:
    """What a row stands for, in its frame.

    ``start`` and ``end`` (3,) [mm]: where a row with two ends begins and ends. A rod lies along x, from 0.
    """
    match row:
        case Box():
            yield _box(row.color, row.size_mm, row.edge_mm).moved(_turned(row.turn_deg), row.at_mm)
        case Plate():
            # face y: an outline in x and z, seen from the side where y points away
            across = np.eye(3)[:, {"x": [1, 2, 0], "y": [0, 2, 1], "z": [0, 1, 2]}[row.face]]
            part = _plate(row.color, outline_of(row), row.thick_mm)
            yield part.moved(across, row.at_mm)
        case Motor():
            yield from _motor(row)
        case Rod():
            length, wide = float(np.linalg.norm(end - start)), pair(row.width_mm)
            yield (
                _tube(row.color, length, wide)
                if row.thick_mm is None
                else _bar(row.color, length, wide, row.thick_mm)
            )
        case Tube():
            way, length = _along(start, end, "y")
            yield _tube(row.color, length, pair(row.width_mm), rounded=row.ends == "round").moved(way, start)
        case Bar():
            way, length = _along(start, end, row.face)
            yield _bar(row.color, length, pair(row.width_mm), row.thick_mm).moved(way, start)
        case Bracket():
            way, length = _along(start, end, row.face)
            for part in _bracket(row, length):
                yield part.moved(way, start)


def _along(start: FloatArray, end: FloatArray, face: Direction) -> tuple[FloatArray, float]:
    length = float(np.linalg.norm(end - start))
    return upright(end - start if length else unit("x"), unit(face)), length


def pair(width: Widths) -> tuple[float, float]:
    """A width at both ends [mm]."""
    return width if isinstance(width, tuple) else (width, width)


def _turned(degrees: Sequence[float]) -> FloatArray:
    """About x, then y, then z of the frame outside."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


# Convex solids, as rings of as many points each, one on the other.


def _loft(rings: Sequence[FloatArray]) -> Solid:
    """The surface through rings (k, 3), counter-clockwise seen from the last one, closed at both ends."""
    k, count = len(rings[0]), len(rings)
    here = np.arange(k * count).reshape(count, k)
    after = np.roll(here, -1, axis=1)
    fan = np.stack([np.zeros(k - 2, dtype=np.int64), np.arange(1, k - 1), np.arange(2, k)], axis=1)
    sides = [
        np.stack([here[:-1], after[:-1], after[1:]], axis=-1).reshape(-1, 3),
        np.stack([here[:-1], after[1:], here[1:]], axis=-1).reshape(-1, 3),
    ]
    vertices, index = np.unique(np.concatenate(rings).round(9), axis=0, return_inverse=True)
    a, b, c = faces = index.reshape(-1)[np.concatenate([*sides, fan[:, ::-1], fan + here[-1, 0]])].T
    return Solid(vertices, faces.T[(a != b) & (b != c) & (c != a)])


def _box(color: Paint, size: Sequence[float], edge: float | None = None) -> Part:
    half = np.array(size, dtype=np.float64) / 2
    edge = min(1.5, 0.2 * half.min()) if edge is None else min(edge, 0.98 * half.min())
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)], dtype=np.float64)
    inner, outer = half[:2] - edge, half[:2]
    flat = np.repeat(signs * inner, 2, axis=0)
    # at each corner first what reaches out along one axis, then along the other, the way round
    wide = np.empty((8, 2))
    for i, sign in enumerate(signs):
        x_out, y_out = sign * (outer[0], inner[1]), sign * (inner[0], outer[1])
        wide[2 * i : 2 * i + 2] = (x_out, y_out) if sign[0] == sign[1] else (y_out, x_out)
    rings = [
        np.column_stack([ring, np.full(8, z)])
        for ring, z in (
            (flat, -half[2]),
            (wide, edge - half[2]),
            (wide, half[2] - edge),
            (flat, half[2]),
        )
    ]
    solid = _loft(rings) if edge > 0 else _loft([rings[0][::2], rings[3][::2]])
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    return Part(color, solid, (corners if edge <= _FILLED_MM else solid.vertices,))


def _circle(radius: float, sides: int) -> FloatArray:
    a = (np.arange(sides) + 0.5) * 2 * math.pi / sides
    return radius / math.sqrt(math.cos(math.pi / sides)) * np.stack([np.cos(a), np.sin(a)], axis=1)


def _tube(color: Paint, length: float, wide: tuple[float, float], *, rounded: bool = False) -> Part:
    """Along x from the origin."""

    def rings(sides: int, rounds: int, *, bevelled: bool) -> list[FloatArray]:
        found: list[FloatArray] = []
        for x, d, out in ((0.0, wide[0], -1.0), (length, wide[1], 1.0)):
            r, bevel = d / 2, min(1.0, 0.08 * d) if bevelled else 0.0
            profile = [(r, -bevel), (r - bevel, 0.0)] if bevelled else [(r, 0.0)]
            if rounded:
                profile = [(r * math.cos(t), r * math.sin(t)) for t in np.linspace(0, 1.55, rounds)]
            ends = [np.insert(_circle(ring, sides), 0, x + out * dx, axis=1) for ring, dx in profile]
            found += ends if out > 0 else ends[::-1]
        return found

    corners = np.concatenate(rings(_BODY_SIDES, 3, bevelled=False))
    return Part(color, _loft(rings(_SIDES, 5, bevelled=True)), (corners,))


def _stadium(length: float, wide: tuple[float, float], inset: float, sides: int) -> FloatArray:
    """The outline (k, 2) round two circles, the second at ``length`` along the first axis."""
    first, last = wide[0] / 2, wide[1] / 2
    lean = math.asin(min(1.0, max(-1.0, (first - last) / length))) if length > 0 else 0.0
    half = sides // 2 + 1
    grown = 1.0 / math.sqrt(math.cos(math.pi / sides))
    # the tangent points are half a turn less twice the lean apart, on the second circle
    end = np.linspace(lean - math.pi / 2, math.pi / 2 - lean, half) if length > 0 else np.empty(0)
    begin = np.linspace(math.pi / 2 - lean, 1.5 * math.pi + lean, half)
    if abs(first - last) >= length:  # one lies inside the other
        centre, r = (0.0, first) if first >= last else (length, last)
        return _circle(r - inset, 2 * half) + np.array([centre, 0.0])
    at_end = grown * (last - inset) * np.stack([np.cos(end), np.sin(end)], axis=1)
    at_end[:, 0] += length
    at_begin = grown * (first - inset) * np.stack([np.cos(begin), np.sin(begin)], axis=1)
    return np.concatenate([at_end, at_begin])


def _bar(color: Paint, length: float, wide: tuple[float, float], thick: float) -> Part:
    """Along x from the origin, flat across y."""
    edge = min(0.8, 0.15 * thick, 0.4 * min(wide))

    def ring(y: float, inset: float, sides: int) -> FloatArray:
        outline = _stadium(length, wide, inset, sides)
        return np.column_stack([outline[:, 0], np.full(len(outline), y), -outline[:, 1]])

    half = thick / 2
    levels = ((-half, edge), (edge - half, 0.0), (half - edge, 0.0), (half, edge))
    solid = _loft([ring(y, inset, _SIDES) for y, inset in levels])
    corners = np.concatenate([ring(y, 0.0, _BODY_SIDES) for y in (-half, half)])
    return Part(color, solid, (corners,))


def _bracket(row: Bracket, length: float) -> Iterator[Part]:
    """Two cheeks along x from the axis in the origin, and the back across their ends."""
    wide, deep, thick = pair(row.width_mm)[0], row.deep_mm, row.thick_mm
    straight = max(length - deep / 2, 1.0)
    for side in (-1, 1):
        y = side * (wide - thick) / 2
        yield _bar(row.color, straight, (deep, deep), thick).moved(np.eye(3), (0, y, 0))
        if length > deep / 2:  # the corners that the round ends leave
            corner = _box(row.color, (deep / 2, thick, deep))
            yield corner.moved(np.eye(3), (length - deep / 4, y, 0))
    yield _box(row.color, (thick, wide, deep)).moved(np.eye(3), (length - thick / 2, 0, 0))


def _motor(row: Motor) -> Iterator[Part]:
    make = MAKES[row.make]
    color, shaft, case = row.color or make.color, unit(row.shaft), unit(row.case)
    (long, wide, high), (horn_wide, horn_high) = make.case, make.horn
    R, at = np.stack([case, np.cross(shaft, case), shaft], axis=1), np.array(row.at_mm)
    middle, top = long / 2 - make.shaft, -horn_high
    horn = _tube(make.horn_color, horn_high, (horn_wide, horn_wide))
    below = (top, top - high - horn_high) if make.idler else (top,)
    horns = [horn.moved(upright(shaft, case), at + R @ [0, 0, z]) for z in below]
    box = _box(color, (long, wide, high), 2.0).moved(R, at + R @ [middle, 0, top - high / 2])
    if horn_high <= _LOW_HORN_MM:  # case and horns are one body
        body = np.concatenate([*box.corners, *(corners for one in horns for corners in one.corners)])
        box, horns = replace(box, corners=(body,)), [replace(one, corners=()) for one in horns]
    yield box
    if make.ears is not None:
        over, thick, height = make.ears
        yield _box(color, (over, wide, thick)).moved(R, at + R @ [middle, 0, top - high + height])
    yield from horns


# Outlines, which may be hollow.


def _plate(color: Paint, outline: FloatArray, thick: float) -> Part:
    """An outline (k, 2) about 0 along z."""
    triangles = cut(outline)
    k = len(outline)
    flat = np.array(triangles, dtype=np.int64)
    low, high = (np.insert(outline, 2, side * thick / 2, axis=1) for side in (-1, 1))
    i, j = np.arange(k), np.roll(np.arange(k), -1)
    sides = [np.stack([i, j, j + k], axis=1), np.stack([i, j + k, i + k], axis=1)]
    solid = Solid(np.concatenate([low, high]), np.concatenate([flat[:, ::-1], flat + k, *sides]))
    bodies = [list(range(k))] if _hollow(outline) <= _FILLED_MM else convex(outline, triangles)
    return Part(color, solid, tuple(np.concatenate([low[one], high[one]]) for one in bodies))


def outline_of(row: Plate) -> FloatArray:
    """Its corners (k, 2) [mm], counter-clockwise."""
    outline = np.array(row.outline_mm, dtype=np.float64)
    return outline if _area(outline) > 0 else outline[::-1]


def _area(outline: FloatArray) -> float:
    """Twice the area; negative where it goes round clockwise."""
    x, y = outline.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def _turn(outline: FloatArray, a: int, b: int, c: int) -> float:
    (ax, ay), (bx, by), (cx, cy) = outline[[a, b, c]].tolist()
    return (bx - ax) * (cy - by) - (by - ay) * (cx - bx)


def cut(outline: FloatArray) -> list[tuple[int, int, int]]:
    """Triangles of an outline (k, 2) that goes round counter-clockwise, by cutting ears.

    Raises ``ValueError``: it crosses itself, or has no area.
    """
    left, triangles = list(range(len(outline))), list[tuple[int, int, int]]()
    if abs(_area(outline)) < _SMALLEST_MM2:
        raise ValueError("the outline has no area: it crosses itself, or its corners lie in a line")

    def inside(p: int, a: int, b: int, c: int) -> bool:
        return min(_turn(outline, *side, p) for side in ((a, b), (b, c), (c, a))) > 0

    while len(left) > 2:
        for i, b in enumerate(left):
            a, c = left[i - 1], left[(i + 1) % len(left)]
            others = (p for p in left if p not in (a, b, c))
            if _turn(outline, a, b, c) >= 0 and not any(inside(p, a, b, c) for p in others):
                triangles.append((a, b, c))
                del left[i]
                break
        else:
            raise ValueError("the outline crosses itself")
    return triangles


def _hollow(outline: FloatArray) -> float:
    """How far a corner of an outline is inside the hull of all of them, at most [mm]."""
    hull = _rim(outline)
    edges = np.roll(hull, -1, axis=0) - hull
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    inside = ((hull * normals).sum(axis=1) - outline @ normals.T).min(axis=1)
    return float(inside.max())


def _rim(points: FloatArray) -> FloatArray:
    """Corners of the hull of points (k, 2), counter-clockwise (Andrew's monotone chain)."""
    listed: list[tuple[float, float]] = [(x, y) for x, y in points.tolist()]
    ordered = sorted(set(listed))

    def half(way: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        kept = list[tuple[float, float]]()
        for p in way:
            while len(kept) > 1 and _turn(np.array([*kept[-2:], p]), 0, 1, 2) <= 0:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array([*half(ordered), *half(ordered[::-1])])


def convex(outline: FloatArray, triangles: Sequence[tuple[int, int, int]]) -> list[list[int]]:
    """Triangles joined to few convex polygons (Hertel and Mehlhorn 1983), as indices of the outline."""
    polygons = [list(one) for one in triangles if _turn(outline, *one) > 0]
    i = 0
    while i < len(polygons):
        for j in range(i + 1, len(polygons)):
            if (both := _joined(outline, polygons[i], polygons[j])) is not None:
                polygons[i] = both
                del polygons[j]
                break
        else:
            i += 1
    return polygons


def _joined(outline: FloatArray, one: list[int], other: list[int]) -> list[int] | None:
    """Two polygons as one, where they share an edge and are convex together."""
    for k, (a, b) in enumerate(zip(one, [*one[1:], one[0]], strict=True)):
        for m, (c, d) in enumerate(zip(other, [*other[1:], other[0]], strict=True)):
            if (a, b) == (d, c):
                rest = [*other[m:], *other[:m]][2:]
                both = [*one[: k + 1], *rest, *one[k + 1 :]]
                turns = (
                    _turn(outline, both[i - 1], both[i], both[(i + 1) % len(both)]) for i in range(len(both))
                )
                return both if min(turns) >= -1e-9 else None
    return None
