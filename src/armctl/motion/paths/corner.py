"""Turning off from one path to the next before its end is met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.motion.paths.quintic import quintic
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

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
