"""Several paths as one motion that does not stop between them.

Where a leg ends, the tool may turn off towards the next one within a radius (``paths/corner.py``). All
legs and corners then are one path, and one speed plan runs over it: it slows down in a corner as far as
the joints need, and looks ahead as far as legs are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial, quintic
from armctl.motion.speed_plan import PathLimits, SpeedPlan
from armctl.motion.timing import PathTrajectory
from armctl.robot import Robot

# Turning off from one path to the next before its end is met.

FloatArray = NDArray[np.float64]
_PROBES = 33


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """A curve from one path to the next: joint angles, slope and curvature go over without a jump."""

    path: PiecewisePolynomial
    """q(u), u = 0 ... 1"""
    leaves: float
    """where it leaves the path before, in that path's variable"""
    joins: float
    """where it joins the path after"""
    before: float
    """variable of the path before, per u, at the beginning"""
    after: float
    """variable of the path after, per u, at the end"""


def corner(before: PiecewisePolynomial, leaves: float, after: PiecewisePolynomial, joins: float) -> Corner:
    """The quintic from a point of one path to a point of the next.

    The speeds at its ends are such that a corner without a turn runs along the paths themselves: its
    control points then lie on them, so that it stays inside the triangle of the two points and the corner.

    Args:
        before: ends where ``after`` begins.
        leaves: where to leave it, less than its end.
        after: the next path.
        joins: where to join it, more than its beginning.
    """
    scale, scale_after = 2 * (before.high - leaves), 2 * (joins - after.low)
    start = before.derivatives(leaves, 2) * np.array([1.0, scale, scale**2])[:, None]
    # a break belongs to the piece before it: what follows "joins" starts with the same values
    end = after.derivatives(joins, 2) * np.array([1.0, scale_after, scale_after**2])[:, None]
    path = PiecewisePolynomial([0.0, 1.0], quintic(start, end)[None])
    return Corner(path, leaves, joins, scale, scale_after)


def leaves_at(robot: Robot, path: PiecewisePolynomial, radius: float) -> float:
    """Where the tool comes within ``radius`` [m] of a path's end for good; half way at the earliest."""
    s = np.linspace(0.5 * (path.low + path.high), path.high, _PROBES)
    tool = robot.forward(path(s))[:, :3, 3]
    return _crossing(s[::-1], np.linalg.norm(tool - tool[-1], axis=1)[::-1], radius)


def joins_at(robot: Robot, path: PiecewisePolynomial, radius: float) -> float:
    """Where the tool first is ``radius`` [m] away from a path's beginning; half way at the latest."""
    s = np.linspace(path.low, 0.5 * (path.low + path.high), _PROBES)
    tool = robot.forward(path(s))[:, :3, 3]
    return _crossing(s, np.linalg.norm(tool - tool[0], axis=1), radius)


def _crossing(s: FloatArray, distance: FloatArray, radius: float) -> float:
    """The first s at which the distance, which begins at 0, is the radius; the last one if it never is."""
    beyond = np.flatnonzero(distance > radius)
    if len(beyond) == 0:
        return float(s[-1])
    k = int(beyond[0])
    share = (radius - distance[k - 1]) / (distance[k] - distance[k - 1])
    return float(s[k - 1] + share * (s[k] - s[k - 1]))


_REGIONS = 4
_TRIES = 6
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One path of a blended motion."""

    path: PiecewisePolynomial
    """q(s), (n,) [rad]"""
    blend_m: float = 0.0
    """how far from its end the tool may turn off towards the next leg [m]; 0: it stops there"""
    rate_cap: float = math.inf
    """largest ds/dt"""


@dataclass(frozen=True, slots=True)
class Entry:
    """Where and how fast the first leg is begun."""

    s: float
    rate: float
    """ds/dt"""


@dataclass(frozen=True, slots=True, eq=False)
class Blend:
    """The motion of some legs, and how the leg after each of them is begun."""

    trajectories: tuple[PathTrajectory, ...]
    """one a leg; the corner at a leg's end belongs to it"""
    entries: tuple[Entry | None, ...]
    """how the leg after each is begun; None: from rest, at its beginning"""


def blend(robot: Robot, legs: Sequence[Leg], entry: Entry | None = None) -> Blend:
    """Plan legs as one motion that ends at rest.

    A corner that would leave the joint limits is drawn tighter; where that does not help, the arm stops
    at its point.

    Args:
        robot: the arm.
        legs: at least one; each begins where the one before it ends.
        entry: how the first one is begun; None: from rest, at its beginning.

    Raises:
        InputError: no legs, legs that do not meet, or an entry that is too fast to be braked.
    """
    if not legs:
        raise InputError("a blended motion needs at least one leg")
    corners = [_corner_between(robot, before, after) for before, after in pairwise(legs)]
    pieces: list[_Piece] = []
    begin = Entry(legs[0].path.low, 0.0) if entry is None else entry
    scale = 1.0
    for k, leg in enumerate(legs):
        bend = corners[k] if k < len(corners) else None
        pieces.append(_piece(leg, begin.s, scale, bend, legs[k + 1].rate_cap if bend is not None else 0.0))
        if bend is None:
            begin, scale = Entry(legs[k + 1].path.low if k + 1 < len(legs) else 0.0, 0.0), 1.0
        else:
            begin, scale = Entry(bend.joins, 0.0), pieces[-1].next_scale
    plans = _planned(robot, pieces, 0.0 if entry is None else entry.rate)
    entries: list[Entry | None] = []
    for k, piece in enumerate(pieces):
        bend = corners[k] if k < len(corners) else None
        rate = float(plans[k].rates[-1])
        entries.append(None if bend is None else Entry(bend.joins, rate / piece.next_scale))
    trajectories = [PathTrajectory(piece.path, plan.law()) for piece, plan in zip(pieces, plans, strict=True)]
    return Blend(tuple(trajectories), tuple(entries))


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """A leg from where it is begun, with the corner at its end, over one variable from 0."""

    path: PiecewisePolynomial
    caps: FloatArray
    """largest rate in each polynomial piece"""
    next_scale: float
    """the path's variable, per variable of the next leg"""
    stops: bool


def _piece(leg: Leg, begin: float, scale: float, bend: Corner | None, next_cap: float) -> _Piece:
    end = leg.path.high if bend is None else bend.leaves
    body = _stretch(leg.path, begin, end, scale)
    if bend is None:
        if body is None:
            raise InputError("a leg that is left before it was begun cannot end at rest")
        return _Piece(body, np.full(len(body.coefficients), leg.rate_cap * scale), 1.0, stops=True)
    corner_scale = scale * bend.before
    next_scale = corner_scale / bend.after
    cap = min(leg.rate_cap * scale, next_cap * next_scale)
    turn = bend.path.scaled(corner_scale)
    if body is None:
        return _Piece(turn, np.array([cap]), next_scale, stops=False)
    caps = np.append(np.full(len(body.coefficients), leg.rate_cap * scale), cap)
    return _Piece(body.followed_by(turn), caps, next_scale, stops=False)


def _stretch(path: PiecewisePolynomial, begin: float, end: float, scale: float) -> PiecewisePolynomial | None:
    """A part of a path over another scale, from 0; None where corners leave nothing of it."""
    if end - begin <= _ROUNDING * (path.high - path.low):
        return None
    inner = path.breaks[(path.breaks > begin) & (path.breaks < end)]
    part = path.cut(np.concatenate([[begin], inner, [end]]))
    return PiecewisePolynomial((part.breaks - begin), part.coefficients).scaled(scale)


def _planned(robot: Robot, pieces: Sequence[_Piece], first: float) -> list[SpeedPlan]:
    """One speed plan a piece; all that follow on each other without a stop are planned together."""
    plans: list[SpeedPlan] = []
    run: list[_Piece] = []
    for piece in pieces:
        run.append(piece)
        if piece.stops:
            plans += _planned_run(robot, run, first)
            run, first = [], 0.0
    return plans


def _planned_run(robot: Robot, run: Sequence[_Piece], first: float) -> list[SpeedPlan]:
    path = run[0].path.followed_by(*(piece.path for piece in run[1:]))
    caps = np.concatenate([piece.caps for piece in run])
    limits = PathLimits.of(path, robot.speed_limits, robot.acceleration_limits, caps, _REGIONS)
    rates = SpeedPlan.fastest(limits, first).rates
    plans: list[SpeedPlan] = []
    at, begin = 0, 0.0
    for piece in run:
        to = at + _REGIONS * len(piece.caps)
        breaks = np.append(limits.breaks[at:to] - begin, piece.path.high)
        part = PathLimits(breaks, limits.rate[at:to], limits.acceleration[at:to])
        plans.append(SpeedPlan(part, rates[at : to + 1]))
        at, begin = to, begin + piece.path.high
    return plans


def _corner_between(robot: Robot, before: Leg, after: Leg) -> Corner | None:
    gap = float(np.abs(before.path(before.path.high) - after.path(after.path.low)).max())
    if not gap <= _ROUNDING:
        raise InputError(f"a leg begins {np.degrees(gap):.4f}° away from where the one before it ends")
    radius = before.blend_m
    if radius <= 0:
        return None
    for _ in range(_TRIES):
        bend = corner(
            before.path,
            leaves_at(robot, before.path, radius),
            after.path,
            joins_at(robot, after.path, radius),
        )
        if _inside(robot, bend.path):
            return bend
        radius *= 0.5
    return None


def _inside(robot: Robot, path: PiecewisePolynomial) -> bool:
    lower, upper = robot.limits[:, 0] - _ROUNDING, robot.limits[:, 1] + _ROUNDING
    # the bounds are cheap and nearly always enough
    for look in (path.bounds_by_piece, path.extremes):
        low, high = look()
        if (low >= lower).all() and (high <= upper).all():
            return True
    return False
