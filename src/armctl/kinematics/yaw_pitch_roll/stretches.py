"""Where on the grid of the swept joint a point has solutions."""

from __future__ import annotations

import math
from typing import NamedTuple

from armctl.kinematics.yaw_pitch_roll.sweep_grid import SweepGrid
from armctl.kinematics.yaw_pitch_roll.sweep_intervals import Posture, SweepIntervals


class Stretch(NamedTuple):
    """Neighbouring grid values with a solution of one bend."""

    bend: int
    """+1 or -1: the sign of the last pitch joint's plane angle (wrapped)"""
    shift: float
    """whole turns that carry that angle from (-pi, pi] into its limits [rad]"""
    start: int
    stop: int
    """grid indices"""
    at_knot: tuple[tuple[int, Posture], ...]
    """which of them fall on a knot, where the array formulas lose digits, and what is true there"""
    through: bool
    """whether it runs through a knot, where an angle may lie on its limit"""


def stretches(feasible: SweepIntervals, grid: SweepGrid, x: float, y: float) -> list[Stretch]:
    """Where on the grid a point of the tool plane has solutions; seen from the first pitch axis [m]."""
    intervals, lone = feasible.intervals(x, y)
    out: list[Stretch] = []
    taken = {1: 0, -1: 0}  # each bend's next index: a value on two knots belongs to the first interval
    for bend, shift, low, high, between in intervals:
        i, low_knot = _edge(feasible, grid, x, y, low, bend, 1)
        j, high_knot = _edge(feasible, grid, x, y, high, bend, -1)
        if i < taken[bend]:
            i, low_knot = taken[bend], None
        knots = [(i, low_knot)] if low_knot else []
        for t2 in between:
            near, posture = _edge(feasible, grid, x, y, t2, bend, 1)
            if posture and i <= near <= j:
                knots.append((near, posture))
            elif (
                grid.position(t2)[1] is not None and i <= near - 1 <= j
            ):  # in line: listed with the other bend
                if near - 1 > i:
                    out.append(Stretch(bend, shift, i, near - 1, tuple(knots), True))
                i, knots = near, []
        if j >= i:
            taken[bend] = j + 1
            if high_knot:
                knots.append((j, high_knot))
            out.append(Stretch(bend, shift, i, j + 1, tuple(knots), bool(between)))
    for bend, t2 in lone:  # feasible at one value alone, if at all
        if grid.position(t2)[1] is not None:
            i, posture = _edge(feasible, grid, x, y, t2, bend, 1)
            if posture and not any(s.bend == bend and s.start <= i < s.stop for s in out):
                out.append(Stretch(bend, 0.0, i, i + 1, ((i, posture),), False))
    return out


def _edge(
    feasible: SweepIntervals, grid: SweepGrid, x: float, y: float, angle: float, bend: int, inward: int
) -> tuple[int, Posture | None]:
    """First (inward +1) or last (-1) grid index inside an interval's end; the posture if it falls on it."""
    position, near = grid.position(angle)
    if near is not None:
        # rounding must not decide here, the solution itself does
        posture = feasible.follow(float(grid.plane[near]), x, y, bend)
        return (near + inward if posture is None else near), posture
    return (max(0, math.ceil(position)) if inward > 0 else min(grid.last, math.floor(position))), None
