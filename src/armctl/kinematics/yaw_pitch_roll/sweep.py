"""Position-only solutions of three pitch joints: the first one is swept, the other two follow.

Nothing infeasible is ever computed. Where the swept joint becomes feasible has closed-form ends: the
second or third pitch joint at a limit, or the last two links stretched or folded. Between two
neighbouring ends feasibility cannot change, so one look at the middle decides for all values between.
"""

from __future__ import annotations

import cmath
import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI, images
from armctl.kinematics.two_link import bend_angle, two_link
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import into_window, window
from armctl.kinematics.yaw_pitch_roll.panels import PANEL, interpolated, unresolved
from armctl.kinematics.yaw_pitch_roll.sweep_grid import SweepGrid

FloatArray = NDArray[np.float64]
_ON_GRID = 1e-4  # how near to a grid value, in steps, an end must fall for rounding not to decide
_SAME_KNOT = 1e-13


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


class _Interval(NamedTuple):
    bend: int
    shift: float
    low: float
    high: float


class FreeJointSweep:
    """The sweep for one arm and its limits; immutable but for the cached grid, safe in several threads.

    The limits of the second and third pitch joint may span one turn at most: a wider range is a sweep
    for each turn (``turns``).
    """

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry = geometry
        self.l2, self.l3, self.l4 = geometry.lengths
        self.limits = tuple(geometry.plane_limits(k, limits) for k in range(3))
        self._windows = tuple(window(low, high) for low, high in self.limits[1:])
        self.joint_limits = tuple((float(low), float(high)) for low, high in limits[1:4])
        self._knots3 = [self._compound(self.l2, self.l3, v) for v in self.limits[1]]
        self._knots4 = [self._compound(self.l3, self.l4, v) for v in (*self.limits[2], 0.0, math.pi)]
        self._may_fold = abs(self.l3 - self.l4) < 1e-9
        self._squares, self._product = self.l3**2 + self.l4**2, 2 * self.l3 * self.l4
        self._grid: SweepGrid | None = None

    @staticmethod
    def _compound(a: float, b: float, bend: float) -> tuple[float, float, float]:
        """Two links locked at a bend, as one: (bend, length, direction relative to the first)."""
        whole = a + b * cmath.exp(1j * bend)
        return bend, abs(whole), cmath.phase(whole)

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
        if not len(grid.plane):
            return []
        intervals, lone = self.intervals(x, y)
        out: list[Stretch] = []
        for interval in intervals:
            i, low_knot = self._edge(interval.low, grid, x, y, interval.bend, 1)
            j, high_knot = self._edge(interval.high, grid, x, y, interval.bend, -1)
            if j >= i:
                knots = ((i,) if low_knot else ()) + ((j,) if high_knot else ())
                out.append(Stretch(interval.bend, interval.shift, i, j + 1, knots))
        for bend, t2 in lone:  # feasible at one value alone, if at all
            position = (t2 - grid.start) / grid.step
            if abs(position - round(position)) < _ON_GRID:
                i, on_grid = self._edge(t2, grid, x, y, bend, 1)
                if on_grid and not any(s.bend == bend and s.start <= i < s.stop for s in out):
                    out.append(Stretch(bend, 0.0, i, i + 1, (i,)))
        return out

    def _edge(
        self, angle: float, grid: SweepGrid, x: float, y: float, bend: int, inward: int
    ) -> tuple[int, bool]:
        """First (inward +1) or last (-1) grid index inside an interval's end, and whether it falls on it."""
        last = len(grid.plane) - 1
        position = (angle - grid.start) / grid.step
        near = round(position)
        if abs(position - near) < _ON_GRID and 0 <= near <= last:
            # rounding must not decide here, the solution itself does
            if self.follow(float(grid.plane[near]), x, y, bend) is not None:
                return near, True
            return near + inward, False
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
            bend[(bend == 0.0) | (bend == math.pi)] = (
                math.nan
            )  # clipped: a panel that ends there is not smooth
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
            exact = self.follow(float(grid.plane[i]), x, y, stretch.bend)
            if exact is not None:
                for k, (low, high) in enumerate(self.joint_limits[1:], 1):
                    joint = self.geometry.joint_angle(k, exact[k - 1])
                    rows[k, i - stretch.start] = min(max(joint, low), high)

    def follow(self, t2: float, x: float, y: float, bend: int) -> tuple[float, float, float] | None:
        """The second and third plane angle (inside their limits) and the turns of the third, at one t_2.

        Stretched or folded links count as bent to the positive side, so that they are listed once.
        """
        X, Y = x - self.l2 * math.cos(t2), y - self.l2 * math.sin(t2)
        cosine = (X * X + Y * Y - self._squares) / self._product
        angle = bend_angle(cosine)
        if angle is None:
            return None
        straight = angle == 0.0 or angle == math.pi
        if straight and bend < 0:
            return None
        g = bend * angle
        third = into_window(g, self._windows[1])
        if third is None:
            return None
        along, across = (math.cos(g), 0.0) if straight else (cosine, bend * math.sqrt(1.0 - cosine * cosine))
        raw = math.atan2(Y, X) - math.atan2(self.l4 * across, self.l3 + self.l4 * along) - t2
        second = into_window(raw, self._windows[0])
        return None if second is None else (second, third, TWO_PI * round((third - g) / TWO_PI))

    def intervals(self, x: float, y: float) -> tuple[list[_Interval], list[tuple[int, float]]]:
        """Feasible intervals of the first plane angle for each bend, rising, and the knots outside them all.

        A knot between two infeasible intervals may itself be feasible, and only a look can tell.
        """
        low, high = self.limits[0]
        ends: dict[int, list[float]] = {1: [low, high], -1: [low, high]}
        for bend, t2 in self._knots(x, y):
            for image in images(t2, low, high):
                if bend >= 0:
                    ends[1].append(image)
                if bend <= 0:
                    ends[-1].append(image)
        out: list[_Interval] = []
        lone: list[tuple[int, float]] = []
        for sign in (1, -1):
            knots = sorted(ends[sign])
            knots = [b for a, b in itertools.pairwise([-math.inf, *knots]) if b - a > _SAME_KNOT]
            touched = -1  # the last knot that ends a feasible interval
            for i, (a, b) in enumerate(itertools.pairwise(knots)):
                middle = self.follow(0.5 * (a + b), x, y, sign)
                if middle is None:
                    if touched != i:
                        lone.append((sign, a))
                    continue
                if touched == i and out[-1].shift == middle[2]:
                    out[-1] = _Interval(sign, middle[2], out[-1].low, b)
                else:
                    out.append(_Interval(sign, middle[2], a, b))
                touched = i + 1
            if touched != len(knots) - 1:
                lone.append((sign, knots[-1]))
        return out, lone

    def _knots(self, x: float, y: float) -> list[tuple[int, float]]:
        """(bend, t_2) where feasibility may change; bend 0: for both."""
        knots: list[tuple[int, float]] = []
        for v, length, turn in self._knots3:
            if length > 1e-12:
                for first, bend in two_link(x, y, length, self.l4):
                    third = math.remainder(bend + turn - v, TWO_PI)
                    knots.append((_sign(third), first - turn))
        for v, length, _ in self._knots4:
            if length > 1e-12:
                sign = _sign(math.remainder(v, TWO_PI))
                knots += [(sign, first) for first, _ in two_link(x, y, self.l2, length)]
        return knots


def turns(limits: FloatArray) -> list[FloatArray]:
    """Limits (n, 2) of the first four joints cut so that the last two span a turn at most."""
    ranges = [_cut(float(low), float(high)) for low, high in limits[2:4]]
    return [np.array([limits[0], limits[1], *pair]) for pair in itertools.product(*ranges)]


def _cut(low: float, high: float) -> list[tuple[float, float]]:
    count = max(1, math.ceil((high - low) / TWO_PI - 1e-9))
    return [(low + TWO_PI * i, min(high, low + TWO_PI * (i + 1))) for i in range(count)]


def _sign(angle: float) -> int:
    """Bend of a wrapped angle; 0 where it lies on both (stretched or folded)."""
    if abs(angle) < 1e-7 or abs(abs(angle) - math.pi) < 1e-7:
        return 0
    return 1 if angle > 0 else -1


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
