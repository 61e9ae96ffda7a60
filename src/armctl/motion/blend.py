"""Several paths as one motion that does not stop between them.

Where a leg ends, the tool may turn off towards the next one within a radius: a corner. One speed plan runs
over all legs and corners: it slows down in a corner, and looks ahead as far as legs are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts.angles import in_degrees
from armctl.lazy_dataclass import dataclass
from armctl.motion.polynomial import PiecewisePolynomial, first_crossing, quintic
from armctl.motion.time_optimal import PathLimits, fastest_rates, time_optimal_law
from armctl.motion.timing import PathTrajectory
from armctl.robot import Robot

_PROBES = 33
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
    """Plan legs, each beginning where the one before it ends, as one motion that ends at rest.

    A corner that would leave the joint limits is drawn tighter; where that does not help, the arm stops at
    its point. ``entry``: how the first leg is begun; None: from rest, at its beginning.
    Raises ``InputError`` for no legs, legs that do not meet, or an entry that is too fast to be braked.
    """
    if not legs:
        raise InputError("a blended motion needs at least one leg")
    corners = [*(_corner_between(robot, before, after) for before, after in pairwise(legs)), None]
    trajectories: list[PathTrajectory] = []
    entries: list[Entry | None] = []
    begin, rate = (legs[0].path.low, 0.0) if entry is None else (entry.s, entry.rate)
    run: list[_LegWithCorner] = []  # legs that follow on each other without a stop are planned together
    for k, (leg, bend) in enumerate(zip(legs, corners, strict=True)):
        next_cap = 0.0 if bend is None else legs[k + 1].rate_cap
        run.append(_piece(leg, begin, run[-1].next_scale if run else 1.0, bend, next_cap))
        if bend is not None:
            begin = bend.joins
            continue
        for piece, (trajectory, last_rate) in zip(run, _planned(robot, run, rate), strict=True):
            trajectories.append(trajectory)
            entries.append(None if piece.joins is None else Entry(piece.joins, last_rate / piece.next_scale))
        run, rate = [], 0.0
        begin = legs[k + 1].path.low if k + 1 < len(legs) else 0.0
    return Blend(tuple(trajectories), tuple(entries))


# Corners: turning off from one path to the next before its end is met.


@dataclass(frozen=True, slots=True, eq=False)
class _Corner:
    """A quintic from one path to the next: joint angles, slope and curvature go over without a jump."""

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


def _corner_between(robot: Robot, before: Leg, after: Leg) -> _Corner | None:
    """The largest corner inside the joint limits; None: the arm stops at the point."""
    gap = float(np.abs(before.path(before.path.high) - after.path(after.path.low)).max())
    if not gap <= _ROUNDING:
        raise InputError(f"a leg begins {in_degrees(gap, '.4f')} away from where the one before it ends")
    radius = before.blend_m
    if radius <= 0:
        return None
    bounds = robot.limits + np.array([-_ROUNDING, _ROUNDING])
    for _ in range(_TRIES):
        leaves = _at_radius(robot, before.path, before.path.high, before.path.low, radius)
        joins = _at_radius(robot, after.path, after.path.low, after.path.high, radius)
        # with these speeds at its ends the control points of the corner lie on the paths
        scale, scale_after = 2 * (before.path.high - leaves), 2 * (joins - after.path.low)
        start = before.path.derivatives(leaves, 2) * np.array([1.0, scale, scale**2])[:, None]
        end = after.path.derivatives(joins, 2) * np.array([1.0, scale_after, scale_after**2])[:, None]
        path = PiecewisePolynomial([0.0, 1.0], quintic(start, end)[None])
        if first_crossing(path, bounds) is None:
            return _Corner(path, leaves, joins, scale, scale_after)
        radius *= 0.5
    return None


def _at_radius(robot: Robot, path: PiecewisePolynomial, near: float, far: float, radius: float) -> float:
    """Where the tool is first ``radius`` [m] away from an end ``near`` of a path; half way at the most."""
    s = np.linspace(near, 0.5 * (near + far), _PROBES)
    tool = robot.forward(path(s))[:, :3, 3]
    distance = np.linalg.norm(tool - tool[0], axis=1)
    beyond = np.flatnonzero(distance > radius)
    if len(beyond) == 0:
        return float(s[-1])
    k = int(beyond[0])
    return float(np.interp(radius, distance[k - 1 : k + 1], s[k - 1 : k + 1]))


@dataclass(frozen=True, slots=True, eq=False)
class _LegWithCorner:
    """A leg from where it is begun, with the corner at its end, over one variable from 0."""

    path: PiecewisePolynomial
    caps: FloatArray
    """largest rate in each polynomial piece"""
    next_scale: float = 1.0
    """the path's variable, per variable of the next leg"""
    joins: float | None = None
    """where the next leg is begun; None: this one ends at rest"""


def _piece(leg: Leg, begin: float, scale: float, bend: _Corner | None, next_cap: float) -> _LegWithCorner:
    """A leg from ``begin`` on; ``scale``: the run's variable per variable of the leg."""
    end = leg.path.high if bend is None else bend.leaves
    parts: list[PiecewisePolynomial] = []
    if end - begin > _ROUNDING * (leg.path.high - leg.path.low):  # corners have left something of it
        inner = leg.path.breaks[(leg.path.breaks > begin) & (leg.path.breaks < end)]
        body = leg.path.cut(np.concatenate([[begin], inner, [end]]))
        parts.append(PiecewisePolynomial(body.breaks - begin, body.coefficients).scaled(scale))
    caps = np.full(sum(len(part.coefficients) for part in parts), leg.rate_cap * scale)
    if bend is None:
        return _LegWithCorner(parts[0], caps)
    next_scale = scale * bend.before / bend.after
    parts.append(bend.path.scaled(scale * bend.before))
    cap = min(leg.rate_cap * scale, next_cap * next_scale)
    return _LegWithCorner(parts[0].followed_by(*parts[1:]), np.append(caps, cap), next_scale, bend.joins)


def _planned(robot: Robot, run: Sequence[_LegWithCorner], first: float) -> list[tuple[PathTrajectory, float]]:
    """The motion of each piece of a run that is begun at the rate ``first``, and its last rate."""
    path = run[0].path.followed_by(*(piece.path for piece in run[1:]))
    limits = PathLimits.of(robot, path, np.concatenate([piece.caps for piece in run]))
    rates = fastest_rates(limits, first)
    found: list[tuple[PathTrajectory, float]] = []
    piece_at, begin = 0, 0.0
    for piece in run:
        at, to = limits.first[[piece_at, piece_at + len(piece.caps)]].tolist()
        breaks = np.append(limits.breaks[at:to] - begin, piece.path.high)
        law = time_optimal_law(breaks, rates[at : to + 1], limits.cap[at:to], limits.push[at:to])
        found.append((PathTrajectory(piece.path, law), float(rates[to])))
        piece_at, begin = piece_at + len(piece.caps), begin + piece.path.high
    return found
