"""A stroke as the pen's way in space: smooth, with corners rounded by less than can be seen.

Between corners a cubic spline goes through the points. A corner is a quintic from one spline to the next, so
that the pen slows down there only as much as the joints need. Where the line turns back on itself the pen
stops.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from armctl.arrays import FloatArray
from armctl.drawing.plane import DrawingPlane
from armctl.motion.polynomial import PiecewisePolynomial, cubic_spline, quintic

ROUNDED_M = 0.03e-3
"""how far a rounded corner passes from its point at most [m]"""
_SMOOTH_TURN = 0.3
"""a line that turns by more at a point has a corner there [rad]"""
_SMOOTH_OFF_M = 0.04e-3
"""and one that a curve through the points would leave by more [m]"""
_CUSP = 2.6
"""where it turns by more, the pen stops [rad]"""
_MIDDLE = 0.375
"""how far the middle of such a quintic is from the corner, of its way to the corner, for a turn of 180°"""
_MOST_OF_A_RUN, _LONGEST_CORNER_M = 0.45, 1e-3
_GROWS = 2.0
"""by how much a piece of a spline may be longer than its neighbour, so that it does not swing out"""
_SURFACE_M = 3e-3
"""how far apart the points are where the surface is not flat"""


def pen_paths(points_mm: FloatArray, plane: DrawingPlane) -> list[PiecewisePolynomial]:
    """The ways of the pen along points (k, 2) on the plane [mm]: smooth each, the pen stops between them.

    Each has three coordinates in the base frame [m] over the metres gone, from 0.
    """
    points = points_mm / 1000
    if not plane.flat:
        points = _subdivided(points, _SURFACE_M)
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    turns = np.abs(np.arctan2(cross, (steps[:-1] * steps[1:]).sum(axis=1)))
    shorter = np.minimum(lengths[:-1], lengths[1:])
    corner = (turns > _SMOOTH_TURN) | (shorter * turns / 4.0 > _SMOOTH_OFF_M)
    paths: list[PiecewisePolynomial] = []
    at = np.flatnonzero(corner) + 1
    stops = [0, *(at[turns[at - 1] > _CUSP]).tolist(), len(points) - 1]
    for first, last in pairwise(stops):
        inner = at[(at > first) & (at < last)].tolist()
        runs = [_run(points[a : b + 1], plane) for a, b in pairwise([first, *inner, last])]
        paths.append(_rounded(runs, turns[[k - 1 for k in inner]].tolist()))
    return paths


def stroke_line(points_mm: FloatArray, plane: DrawingPlane) -> FloatArray:
    """(m, 3) the stroke itself on the surface, in the base frame [m]: what the pen is to meet."""
    points = points_mm / 1000
    if not plane.flat:
        points = _subdivided(points, _SURFACE_M)
    return plane.points(points)


def _run(points: FloatArray, plane: DrawingPlane) -> PiecewisePolynomial:
    """A spline through points (k, 2) on the plane [m]."""
    if len(points) > 2:
        points = _graded(points)
    space = plane.points(points)
    way = np.linalg.norm(np.diff(space, axis=0), axis=1)
    return cubic_spline(np.append(0.0, np.cumsum(way)), space)


def _graded(points: FloatArray) -> FloatArray:
    """The same line with points between, so that no piece is much longer than the ones beside it."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    beside = lengths.copy()
    for k in range(1, len(beside)):
        beside[k] = min(beside[k], _GROWS * beside[k - 1])
    for k in range(len(beside) - 2, -1, -1):
        beside[k] = min(beside[k], _GROWS * beside[k + 1])
    if (lengths <= _GROWS * beside).all():
        return points
    found = [points[:1]]
    for k, (begin, end) in enumerate(pairwise(points)):
        before = lengths[k - 1] if k else math.inf
        after = lengths[k + 1] if k + 1 < len(lengths) else math.inf
        shares = _shares(float(lengths[k]), float(before), float(after))
        found.append(begin + shares[:, None] * (end - begin))
    return np.concatenate(found)


def _shares(length: float, before: float, after: float) -> FloatArray:
    """Where a piece is cut, 0 … 1, its end with it: finer towards a neighbour that is short."""
    cuts: list[list[float]] = []
    for near in (before, after):
        at, step, found = 0.0, _GROWS * near, list[float]()
        while at + step < 0.5 * length:
            at += step
            found.append(at)
            step *= _GROWS
        cuts.append(found)
    return np.array([*cuts[0], *(length - at for at in reversed(cuts[1])), length]) / length


def _subdivided(points: FloatArray, longest: float) -> FloatArray:
    """Points (k, 2) with further ones between, so that no piece is longer."""
    found = [points[:1]]
    for begin, end in pairwise(points):
        count = max(math.ceil(float(np.linalg.norm(end - begin)) / longest), 1)
        found.append(begin + (np.arange(1, count + 1) / count)[:, None] * (end - begin))
    return np.concatenate(found)


def _rounded(runs: Sequence[PiecewisePolynomial], turns: Sequence[float]) -> PiecewisePolynomial:
    """Runs one after the other, each corner between them a quintic."""
    parts: list[PiecewisePolynomial] = []
    begin = 0.0
    for k, run in enumerate(runs):
        last = k == len(runs) - 1
        way = 0.0
        if not last:
            room = _MOST_OF_A_RUN * min(run.high, runs[k + 1].high)
            way = min(ROUNDED_M / (_MIDDLE * math.sin(turns[k] / 2.0)), room, _LONGEST_CORNER_M)
        end = run.high - way
        inner = run.breaks[(run.breaks > begin + 1e-9) & (run.breaks < end - 1e-9)]
        body = run.cut(np.concatenate([[begin], inner, [end]]))
        parts.append(PiecewisePolynomial(body.breaks - begin, body.coefficients))
        if not last:
            scale = np.array([1.0, 2.0 * way, (2.0 * way) ** 2])[:, None]
            states = run.derivatives(end, 2) * scale, runs[k + 1].derivatives(way, 2) * scale
            parts.append(PiecewisePolynomial([0.0, 1.0], quintic(*states)[None]).scaled(2.0 * way))
        begin = way
    return parts[0].followed_by(*parts[1:])
