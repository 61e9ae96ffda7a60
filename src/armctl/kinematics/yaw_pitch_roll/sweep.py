"""Position-only solutions of three pitch joints: the first one is swept, the other two follow.

Nothing infeasible is ever computed: ``sweep_intervals.py`` says where on the grid there are solutions, and
those are computed as arrays.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.panels import PANEL, interpolated, unresolved
from armctl.kinematics.yaw_pitch_roll.sweep_grid import SweepGrid
from armctl.kinematics.yaw_pitch_roll.sweep_intervals import SweepIntervals

FloatArray = NDArray[np.float64]


class Stretch(NamedTuple):
    """Neighbouring grid values with a solution of one bend."""

    bend: int
    """+1 or -1: the sign of the last pitch joint's plane angle (wrapped)"""
    shift: float
    """whole turns that carry that angle from (-pi, pi] into its limits [rad]"""
    start: int
    stop: int
    """grid indices"""
    at_knot: tuple[int, ...] = ()
    """which of them fall on a knot, where the array formulas lose digits"""

    @property
    def size(self) -> int:
        """How many grid values."""
        return self.stop - self.start


class FreeJointSweep:
    """The sweep for one arm and its limits; immutable but for the cached grid, safe in several threads.

    The limits of the second and third pitch joint must span less than a turn: a wider range is a sweep for
    each part of it (``turns``).
    """

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry = geometry
        _, self.l3, self.l4 = geometry.lengths
        self._feasible = SweepIntervals(geometry, limits)
        self.joint_limits = tuple((float(low), float(high)) for low, high in limits[1:4])
        self._may_fold = abs(self.l3 - self.l4) < 1e-9
        self._squares, self._product = self.l3**2 + self.l4**2, 2 * self.l3 * self.l4
        self._grid: SweepGrid | None = None

    def grid(self, step: float) -> SweepGrid:
        """The grid for a step [rad]; the last one made is kept.

        Raises:
            InputError: so small a step that the grid would not fit into memory.
        """
        grid = self._grid
        if grid is None or grid.step != step:
            grid = self._grid = SweepGrid.of(self.geometry, self.joint_limits[0], step)
        return grid

    def stretches(self, x: float, y: float, step: float) -> list[Stretch]:
        """Where on the grid a point of the tool plane has solutions; seen from the first pitch axis [m]."""
        grid = self.grid(step)
        intervals, lone = self._feasible.intervals(x, y)
        out: list[Stretch] = []
        taken = {1: 0, -1: 0}  # each bend's next index: a value on two knots belongs to the first interval
        for interval in intervals:
            i, low_knot = self._edge(interval.low, grid, x, y, interval.bend, 1)
            j, high_knot = self._edge(interval.high, grid, x, y, interval.bend, -1)
            if i < taken[interval.bend]:
                i, low_knot = taken[interval.bend], False
            knots: list[int] = [i] if low_knot else []
            for t2 in interval.between:
                near, feasible = self._edge(t2, grid, x, y, interval.bend, 1)
                if feasible and i <= near <= j:
                    knots.append(near)
                elif grid.holds(t2) is not None and i <= near - 1 <= j:  # in line: listed with the other bend
                    if near - 1 > i:
                        out.append(Stretch(interval.bend, interval.shift, i, near - 1, tuple(knots)))
                    i, knots = near, []
            if j >= i:
                taken[interval.bend] = j + 1
                if high_knot:
                    knots.append(j)
                out.append(Stretch(interval.bend, interval.shift, i, j + 1, tuple(knots)))
        for bend, t2 in lone:  # feasible at one value alone, if at all
            if grid.holds(t2) is not None:
                i, on_grid = self._edge(t2, grid, x, y, bend, 1)
                if on_grid and not any(s.bend == bend and s.start <= i < s.stop for s in out):
                    out.append(Stretch(bend, 0.0, i, i + 1, (i,)))
        return out

    def _edge(
        self, angle: float, grid: SweepGrid, x: float, y: float, bend: int, inward: int
    ) -> tuple[int, bool]:
        """First (inward +1) or last (-1) grid index inside an interval's end, and whether it falls on it."""
        near, last = grid.holds(angle), len(grid.plane) - 1
        if near is not None:
            # rounding must not decide here, the solution itself does
            if self._feasible.follow(float(grid.plane[near]), x, y, bend) is not None:
                return near, True
            return near + inward, False
        position = (angle - grid.start) / grid.step
        return (max(0, math.ceil(position)) if inward > 0 else min(last, math.floor(position))), False

    def fill(self, x: float, y: float, step: float, stretches: list[Stretch], out: FloatArray) -> None:
        """Compute the solutions of some stretches of one point.

        Args:
            x: the point, forward of the first pitch axis [m].
            y: the point, above it [m].
            step: of the grid [rad].
            stretches: what ``stretches`` gave for the same point.
            out: (3, k) the three pitch joints' angles [rad], one stretch behind the other.
        """
        grid = self.grid(step)
        begins = itertools.accumulate((s.size for s in stretches), initial=0)
        places = {id(s): slice(at, at + s.size) for s, at in zip(stretches, begins, strict=False)}
        for start, stop, members in _unions(stretches):
            direction, inner, bend = self._triangle(grid, x, y, start, stop)
            for stretch in members:
                cut = slice(stretch.start - start, stretch.stop - start)
                rows = out[:, places[id(stretch)]]
                rows[0] = grid.joint[stretch.start : stretch.stop]
                self._fill_one(stretch, direction[cut], inner[cut], bend[cut], rows)
        for stretch in stretches:
            self._mend_knots(grid, x, y, stretch, out[:, places[id(stretch)]])

    def _triangle(self, grid: SweepGrid, x: float, y: float, start: int, stop: int) -> FloatArray:
        """What both bends share on a range of the grid (3, k); ``_exact_triangle`` says what.

        Exact at the nodes of each panel, interpolated between them; one by one where that does not do.
        """
        if grid.nodes is None or stop - start < 2 * PANEL:
            return self._exact_triangle(x, y, *grid.first_link(start, stop))
        first, last = start // PANEL, -(-stop // PANEL)
        at_nodes = self._exact_triangle(x, y, *grid.nodes[:, first:last])
        bend = at_nodes[2]
        if np.minimum.reduce(bend, axis=None) == 0.0 or np.maximum.reduce(bend, axis=None) == math.pi:
            # clipped: a panel that ends there is not smooth
            bend[(bend == 0.0) | (bend == math.pi)] = math.nan
        begin = first * PANEL
        out = interpolated(at_nodes)[:, start - begin : stop - begin]
        for low, high in unresolved(at_nodes):
            low, high = max(start, begin + low * PANEL), min(stop, begin + high * PANEL)
            out[:, low - start : high - start] = self._exact_triangle(x, y, *grid.first_link(low, high))
        return out

    def _exact_triangle(
        self, x: float, y: float, plane: FloatArray, link_x: FloatArray, link_y: FloatArray
    ) -> FloatArray:
        """The triangle of the last two links for values of the first plane angle: (3, *shape).

        The direction from the second pitch axis to the point as seen from the first link, the angle
        between it and the second link, and the bend: the cosine rule twice, in as few passes as will do.
        Out of reach the cosines are clipped onto ±1.
        """
        out = np.empty((3, *plane.shape))
        Y, square, X = out[0], out[1], out[2]
        np.subtract(x, link_x, out=X)
        np.subtract(y, link_y, out=Y)
        np.multiply(X, X, out=square)
        distance = Y * Y
        square += distance
        np.arctan2(Y, X, out=Y)
        np.subtract(Y, plane, out=Y)
        np.sqrt(square, out=distance)
        bend = np.subtract(square, self._squares, out=X)
        bend *= 1.0 / self._product
        np.minimum(bend, 1.0, out=bend)
        np.maximum(bend, -1.0, out=bend)
        np.arccos(bend, out=bend)
        square += self.l3**2 - self.l4**2
        if self._may_fold:  # folded onto the second axis, where any direction serves
            np.maximum(distance, 1e-300, out=distance)
        distance *= 2 * self.l3
        square /= distance
        np.minimum(square, 1.0, out=square)
        np.maximum(square, -1.0, out=square)
        np.arccos(square, out=square)
        return out

    def _fill_one(
        self, stretch: Stretch, direction: FloatArray, inner: FloatArray, bend: FloatArray, rows: FloatArray
    ) -> None:
        second, third = rows[1], rows[2]
        if stretch.bend > 0:
            np.subtract(direction, inner, out=second)
            np.add(bend, stretch.shift, out=third)
        else:
            np.add(direction, inner, out=second)
            np.subtract(stretch.shift, bend, out=third)
        for k, angles in ((1, second), (2, third)):
            if self.geometry.offsets[k] != 0.0:
                angles -= self.geometry.offsets[k]
            if self.geometry.signs[k] < 0:
                np.negative(angles, out=angles)
            low, high = self.joint_limits[k]
            if not (low <= np.minimum.reduce(angles) and np.maximum.reduce(angles) <= high):
                # seen from the middle of its limits (a turn apart at most) the right image is the near one
                middle = 0.5 * (low + high)
                angles -= TWO_PI * np.rint((angles - middle) / TWO_PI)
                np.clip(angles, low, high, out=angles)

    def _mend_knots(self, grid: SweepGrid, x: float, y: float, stretch: Stretch, rows: FloatArray) -> None:
        """On a knot the two arc cosines lose half their digits, each on its own: take the scalar solution."""
        for i in stretch.at_knot:
            exact = self._feasible.follow(float(grid.plane[i]), x, y, stretch.bend)
            if exact is not None:
                for k, (low, high) in enumerate(self.joint_limits[1:], 1):
                    joint = self.geometry.joint_angle(k, exact[k - 1])
                    rows[k, i - stretch.start] = min(max(joint, low), high)


def turns(limits: FloatArray) -> list[FloatArray]:
    """Limits of the first four joints (4, 2), cut so that each of the last two spans less than a turn."""
    ranges = [_cut(float(low), float(high)) for low, high in limits[2:4]]
    return [np.array([limits[0], limits[1], *pair]) for pair in itertools.product(*ranges)]


def _cut(low: float, high: float) -> list[tuple[float, float]]:
    """Equal parts, with so much between them that no angle is inside two (``LIMIT_TOLERANCE``)."""
    count = 1 + math.floor((high - low) / TWO_PI + LIMIT_TOLERANCE)
    cuts = np.linspace(low, high, count + 1).tolist()
    return [(a if a == low else a + 2.0 * LIMIT_TOLERANCE, b) for a, b in itertools.pairwise(cuts)]


def _unions(stretches: list[Stretch]) -> list[tuple[int, int, list[Stretch]]]:
    """Overlapping index ranges joined, so that both bends share one computation."""
    unions: list[tuple[int, int, list[Stretch]]] = []
    for stretch in sorted(stretches, key=lambda s: s.start):
        if unions and stretch.start <= unions[-1][1]:
            start, stop, members = unions[-1]
            unions[-1] = (start, max(stop, stretch.stop), [*members, stretch])
        else:
            unions.append((stretch.start, stretch.stop, [stretch]))
    return unions
