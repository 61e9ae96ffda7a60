"""All solutions of a position with three pitch joints: every way to face it, every turn of the joints."""

from __future__ import annotations

import cmath
import itertools
import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, images, into_window, window
from armctl.kinematics.grid import grid_values
from armctl.kinematics.two_link import ON_JOINT, bend_angle, inner_angle, two_link
from armctl.kinematics.yaw_pitch_roll.geometry import BaseBranch, YawPitchRoll, branch_index

# Smooth functions on a fine even grid, from their slopes at a few places of each panel.
#
# A panel is ``PANEL`` neighbouring grid values. Over so short a range a smooth slope is a polynomial to
# machine precision: its values at ``NODES`` Chebyshev nodes and the function's value at the anchor, one grid
# value midway, give all the others by one matrix product. The slope of an angle is algebraic, so that only
# the anchor costs arc functions. The last Chebyshev coefficients of the integral tell where that is so; where
# they are not negligible (next to a square-root end) the values have to be computed one by one.

FloatArray = NDArray[np.float64]
PANEL = 128
"""grid values in a panel"""
NODES = 16
"""exact slopes in a panel"""
ANCHOR = PANEL // 2
"""which grid value of a panel is the anchor"""
_WIDEST = 0.05
"""a wider panel is seldom a polynomial to machine precision [rad]"""
_NEGLIGIBLE = 2e-14
"""largest last coefficient of a function that counts as resolved: the error is no larger"""
_AT_ONCE = 120
"""panels in one matrix product: larger ones are spread over threads, which costs more than it brings"""
_TAIL = 3
"""how many last coefficients are looked at: one alone may vanish by symmetry"""


@dataclass(frozen=True, slots=True)
class Panels:
    """What turns slopes into values, for the panels of a grid of one step."""

    integral: FloatArray
    """(NODES + 1, PANEL) from slopes at the nodes and the value at the anchor to the values of a panel"""
    tail: FloatArray
    """(_TAIL, NODES) from slopes at the nodes to the last coefficients of the integral"""

    @classmethod
    def of(cls, step: float) -> Panels | None:
        """The panels of a grid's step; None where they would be too wide to be of use."""
        if step * PANEL > _WIDEST:
            return None
        half = 0.5 * (PANEL - 1)
        grid = np.arange(PANEL) / half - 1.0
        order = np.arange(NODES + 1)[:, None]
        coefficients = np.cos(order[:-1] * _node_angles()) * (2.0 / NODES)  # (order, node)
        coefficients[0] *= 0.5
        waves = np.cos(order * np.arccos(np.clip(grid, -1.0, 1.0)))
        # the integral of T_k is T_k+1 / 2(k+1) - T_k-1 / 2(k-1), that of T_0 is T_1
        risen = coefficients.copy()
        risen[0] *= 2.0
        risen[:-2] -= coefficients[2:]
        risen *= half * step / (2 * order[1:])
        panels = cls(
            integral=np.vstack([risen.T @ (waves[1:] - waves[1:, ANCHOR, None]), np.ones(PANEL)]),
            tail=risen[-_TAIL:].copy(),
        )
        for field in fields(panels):
            getattr(panels, field.name).flags.writeable = False
        return panels

    def integrated(self, slopes: FloatArray) -> FloatArray:
        """Functions on the grid (f, k · PANEL).

        Args:
            slopes: of f functions at the nodes of k panels, and last their values at the anchors:
                (f, NODES + 1, k).
        """
        slopes = slopes.transpose(0, 2, 1)
        functions, count, _ = slopes.shape
        out = np.empty((functions, count, PANEL))
        for k in range(0, count, _AT_ONCE):
            np.matmul(slopes[:, k : k + _AT_ONCE], self.integral, out=out[:, k : k + _AT_ONCE])
        return out.reshape(functions, -1)

    def unresolved(self, slopes: FloatArray) -> list[tuple[int, int]]:
        """Runs (begin, end) of panels where one of f functions is no polynomial to machine precision.

        Args:
            slopes: at the nodes of k panels: (f, NODES, k).
        """
        last = np.matmul(self.tail, slopes)
        np.abs(last, out=last)
        largest = np.maximum.reduce(last.reshape(-1, last.shape[2]))
        runs: list[tuple[int, int]] = []
        for panel in (largest > _NEGLIGIBLE).nonzero()[0].tolist():
            if runs and runs[-1][1] == panel:
                runs[-1] = (runs[-1][0], panel + 1)
            else:
                runs.append((panel, panel + 1))
        return runs


def node_positions(count: int) -> FloatArray:
    """Where nodes and anchor of each panel lie, in grid indices: (NODES + 1, panels) for ``count`` values."""
    begins = np.arange(0, count, PANEL, dtype=np.float64)
    nodes = 0.5 * (PANEL - 1) * (1.0 + np.cos(_node_angles()))
    return np.append(nodes, float(ANCHOR))[:, None] + begins


def _node_angles() -> FloatArray:
    return (np.arange(NODES, dtype=np.float64) + 0.5) * (math.pi / NODES)


# Values of the swept joint of three parallel pitch joints, and where the first link ends then.

ComplexArray = NDArray[np.complex128]
_ON_GRID = 1e-4
"""how near to a value, in steps, an angle is on it"""
_LOST = 1e-6
"""the same [rad]: so near to a knot of the sweep the array formulas lose digits"""


@dataclass(frozen=True, slots=True)
class SweepGrid:
    """Values of the swept joint: those of ``grid_values``."""

    step: float
    start: float
    """the first plane angle"""
    last: int
    """the last index"""
    tolerance: float
    """how near to a value, in steps, an angle is on it"""
    joint: FloatArray
    """(m,) joint angles [rad], in the order of rising plane angle"""
    plane: FloatArray
    """(m,) plane angles t_2, rising"""
    link: ComplexArray
    """(m,) conjugate of the end of the first link, forward + i up [m]"""
    panels: Panels | None
    """None where the step is too coarse for them"""
    nodes: ComplexArray | None
    """(NODES + 1, panels) ``link`` at the nodes and, last, at the anchor of each panel"""

    def position(self, angle: float) -> tuple[float, int | None]:
        """Where a plane angle [rad] lies, in grid indices; and the value it falls on, but for rounding."""
        position = (angle - self.start) / self.step
        near = round(position)
        if abs(position - near) < self.tolerance and 0 <= near <= self.last:
            return position, near
        return position, None

    @classmethod
    def of(cls, geometry: YawPitchRoll, limits: tuple[float, float], step: float) -> SweepGrid:
        """The grid between joint limits [rad].

        Raises:
            InputError: ``step`` is so small that there are too many values.
        """
        joint = grid_values(*limits, step)
        if geometry.signs[0] < 0:
            joint = joint[::-1].copy()
        plane = geometry.signs[0] * joint + geometry.offsets[0]
        start, length = float(plane[0]), geometry.lengths[0]
        panels, nodes = Panels.of(step), None
        if panels is not None:
            nodes = _conjugate(length, start + step * node_positions(len(plane)))
        link = _conjugate(length, plane)
        for array in (joint, plane, link, *(() if nodes is None else (nodes,))):
            array.flags.writeable = False
        tolerance = max(_ON_GRID, _LOST / step)
        return cls(step, start, len(plane) - 1, tolerance, joint, plane, link, panels, nodes)


def _conjugate(length: float, angle: FloatArray) -> ComplexArray:
    out = np.empty(angle.shape, dtype=np.complex128)
    out.real, out.imag = length * np.cos(angle), -length * np.sin(angle)
    return out


# Where the first of three pitch joints can stand while the tool point stays.
#
# Feasibility changes at knots of closed form: the second or third pitch joint at a limit, or the last two
# links stretched or folded. Between two neighbouring knots it cannot change, so one look at the middle
# decides.

_NEAR_FOLD = 1e-6
"""how near a target must come to the circle of the second pitch axis for equal links to fold onto it [m]"""
_SAME_KNOT = 1e-13


Posture = tuple[float, float, float]
"""second and third plane angle (inside their limits) and the turns of the third [rad]"""


class Interval(NamedTuple):
    """Plane angles of the first pitch joint with a solution of one bend."""

    bend: int
    """+1 or -1: the sign of the last pitch joint's plane angle (wrapped)"""
    shift: float
    """whole turns that carry that angle from (-pi, pi] into its limits [rad]"""
    low: float
    high: float
    between: tuple[float, ...] = ()
    """knots that it runs through, rising"""


class SweepIntervals:
    """The intervals of one arm and its limits, those of the last two pitch joints less than a turn wide.

    Immutable; safe in several threads.
    """

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._l2, self._l3, self._l4 = geometry.lengths
        self._limits = tuple(geometry.plane_limits(k, limits) for k in range(3))
        self._windows = tuple(window(low, high) for low, high in self._limits[1:])
        self._knots3 = [_compound(self._l2, self._l3, v) for v in self._limits[1]]
        self._knots4 = [_compound(self._l3, self._l4, v) for v in (*self._limits[2], 0.0, math.pi)]
        self._may_fold = abs(self._l3 - self._l4) < _NEAR_FOLD

    def intervals(self, x: float, y: float) -> tuple[list[Interval], list[tuple[int, float]]]:
        """Feasible intervals of the first plane angle for each bend, rising, and the knots outside them all.

        A knot between two infeasible intervals may itself be feasible, and only a look can tell.
        """
        low, high = self._limits[0]
        ends: dict[int, list[float]] = {1: [low, high], -1: [low, high]}
        for bend, t2 in self._knots(x, y):
            for image in images(t2, low, high):
                if bend >= 0:
                    ends[1].append(image)
                if bend <= 0:
                    ends[-1].append(image)
        out: list[Interval] = []
        lone: list[tuple[int, float]] = []
        for sign, knots in ends.items():
            knots.sort()
            a, before = knots[0], knots[0]
            touched = False  # whether the knot a ends a feasible interval
            for b in knots[1:]:
                if b - before <= _SAME_KNOT:
                    before = b
                    continue
                before = b
                middle = self.follow(0.5 * (a + b), x, y, sign)
                if middle is None:
                    if not touched:
                        lone.append((sign, a))
                    touched = False
                else:
                    if touched and out[-1].shift == middle[2]:
                        _, shift, begin, _, between = out[-1]
                        out[-1] = Interval(sign, shift, begin, b, (*between, a))
                    else:
                        out.append(Interval(sign, middle[2], a, b))
                    touched = True
                a = b
            if not touched:
                lone.append((sign, a))
        return out, lone

    def follow(self, t2: float, x: float, y: float, bend: int) -> Posture | None:
        """The second and third plane angle (inside their limits) and the turns of the third, at one t_2.

        Stretched or folded links count as bent to the positive side, so that they are listed once. Folded
        onto the second pitch axis they may point anywhere: midway between the limits.
        """
        X, Y = x - self._l2 * math.cos(t2), y - self._l2 * math.sin(t2)
        square = X * X + Y * Y
        angle = bend_angle(square, self._l3, self._l4)
        if angle is None:
            return None
        if bend < 0 and (angle == 0.0 or angle == math.pi):
            return None
        g = bend * angle
        second_window, third_window = self._windows
        turns, third = 0.0, g
        if not third_window[0] <= g <= third_window[1]:
            third = into_window(g, third_window)
            if third is None:
                return None
            turns = TWO_PI * round((third - g) / TWO_PI)
        if square <= ON_JOINT * ON_JOINT:
            return second_window[2], third, turns
        second = math.atan2(Y, X) - inner_angle(self._l3, self._l4, g) - t2
        if not second_window[0] <= second <= second_window[1]:
            second = into_window(second, second_window)
        return None if second is None else (second, third, turns)

    def _knots(self, x: float, y: float) -> list[tuple[int, float]]:
        """(bend, t_2) where feasibility may change; bend 0: for both."""
        knots: list[tuple[int, float]] = []
        if self._may_fold and abs(math.hypot(x, y) - self._l2) < _NEAR_FOLD:
            knots.append((0, math.atan2(y, x)))
        for v, length, turn in self._knots3:
            if length > 1e-12:
                for first, bend in two_link(x, y, length, self._l4):
                    third = math.remainder(bend + turn - v, TWO_PI)
                    knots.append((_sign(third), first - turn))
        for v, length, _ in self._knots4:
            if length > 1e-12:
                sign = _sign(math.remainder(v, TWO_PI))
                knots += [(sign, first) for first, _ in two_link(x, y, self._l2, length)]
        return knots


def _compound(a: float, b: float, bend: float) -> tuple[float, float, float]:
    """Two links locked at a bend, as one: (bend, length, direction relative to the first)."""
    whole = a + b * cmath.exp(1j * bend)
    return bend, abs(whole), cmath.phase(whole)


def _sign(angle: float) -> int:
    """Bend of a wrapped angle; 0 where it lies on both (stretched or folded)."""
    if abs(angle) < 1e-7 or abs(abs(angle) - math.pi) < 1e-7:
        return 0
    return 1 if angle > 0 else -1


# The triangle of the last two of three pitch joints while the first one is swept, in arrays.
#
# Seen from the end of the first link the target lies at D. With
#
# v = (|D|² - l3² - l4²) / 2 = l3 l4 cos(bend),  S = √((l3 l4)² - v²) = l3 l4 sin(bend)
#
# the angles are
#
# direction = arg D,  inner = atan2(S, l3² + v),  bend = atan2(S, v)
#
# and their slopes along the sweep are algebraic. Seen from the first link, where w = -dv/dt,
#
# direction' = -1/2 + (l2² - |target|²) / 2|D|²,  bend' = w / S,  inner' = bend' (1/2 + (l4² - l3²) / 2|D|²)
#
# Everything follows from one complex number, target · conjugate(first link) = u + i w.

# constants as arrays: a ufunc spends 0.25 µs a call on turning a float into one
_ONE, _MINUS_ONE, _HALF, _LEAST = np.array(1.0), np.array(-1.0), np.array(0.5), np.array(1e-60)


class SweepTriangle:
    """The formulas for one arm, the direction as a joint angle. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, middle: float) -> None:
        """The triangle of an arm.

        Args:
            geometry: of the arm.
            middle: the direction is given within half a turn of this angle of the second pitch joint [rad].
        """
        l2, l3, l4 = geometry.lengths
        self._sense = geometry.signs[1]
        self._middle = np.array(middle)
        self._back = np.array(cmath.exp(-1j * geometry.plane_angle(1, middle)))
        self._l2_square, self._l3_square = np.array(l2 * l2), np.array(l3 * l3)
        self._twice_l3_square, self._mean = np.array(2 * l3 * l3), np.array(0.5 * (l3 * l3 + l4 * l4))
        self._per_product, self._product_square = np.array(1.0 / (l3 * l4)), np.array((l3 * l4) ** 2)
        self._unequal = np.array(0.25 * (l4 * l4 - l3 * l3))
        self._half_turn = np.array(0.5 * self._sense)

    def angles(self, target: complex, product: ComplexArray) -> FloatArray:
        """Direction, inner angle and bend (3, k) [rad]; inner angle and bend in [0, pi].

        Args:
            target: seen from the first pitch axis, forward + i up [m].
            product: target · conjugate(first link) (k,) [m²].
        """
        out = np.empty((3, len(product)))
        direction, inner, bend = out
        seen = product - self._l2_square  # D, from the first link, times its length
        seen *= self._back
        np.arctan2(seen.imag, seen.real, out=direction)
        if self._sense < 0:
            np.negative(direction, out=direction)
        direction += self._middle
        v = np.subtract(self._v(target), product.real, out=bend)
        distance = v + self._mean
        distance *= self._twice_l3_square
        np.maximum(distance, _LEAST, out=distance)  # folded onto the second axis any direction serves
        np.sqrt(distance, out=distance)
        np.add(v, self._l3_square, out=inner)
        inner /= distance
        v *= self._per_product
        cosines = out[1:]
        np.minimum(cosines, _ONE, out=cosines)
        np.maximum(cosines, _MINUS_ONE, out=cosines)
        np.arccos(cosines, out=cosines)
        return out

    def slopes(self, target: complex, product: ComplexArray, out: FloatArray) -> None:
        """Slopes of the three angles along the sweep.

        Args:
            target: as ``angles`` has it.
            product: the same, any shape.
            out: (3, *shape), written; huge where the target is out of reach.
        """
        direction, inner, bend = out
        v = self._v(target) - product.real
        np.multiply(v, v, out=direction)
        np.subtract(self._product_square, direction, out=direction)
        np.maximum(direction, _LEAST, out=direction)
        height = np.sqrt(direction, out=direction)
        np.divide(product.imag, height, out=bend)
        v += self._mean
        half_square = np.maximum(v, _LEAST, out=v)
        np.divide(self._unequal, half_square, out=inner)
        inner += _HALF
        inner *= bend
        square = target.real * target.real + target.imag * target.imag
        np.divide(0.25 * self._sense * (float(self._l2_square) - square), half_square, out=direction)
        direction -= self._half_turn

    def _v(self, target: complex) -> float:
        """What v is but for the product of target and first link [m²]."""
        square = target.real * target.real + target.imag * target.imag
        return 0.5 * (square + float(self._l2_square)) - float(self._mean)


# Where on the grid of the swept joint a point has solutions.


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


# Position-only solutions of three pitch joints: the first one is swept, the other two follow.
#
# Nothing infeasible is ever computed: ``stretches.py`` says where on the grid there are solutions, and those
# are computed as arrays.

_AT_LIMIT = 1e-9
"""how near to a limit an end of a stretch lies when rounding may carry angles next to it over [rad]"""


class FreeJointSweep:
    """The sweep for one arm and its limits. Immutable; safe in several threads.

    The limits of the second and third pitch joint must span less than a turn: a wider range is a sweep for
    each part of it (``position_sweep.turns``).
    """

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._geometry = geometry
        self._feasible = SweepIntervals(geometry, limits)
        _, self._second, self._third = ((float(low), float(high)) for low, high in limits[1:4])
        _, self._sense2, self._sense3 = geometry.signs
        self._offset3 = self._sense3 * geometry.offsets[2]
        low, high = self._second
        self._middle = 0.5 * (low + high)
        self._triangle = SweepTriangle(geometry, self._middle)
        _, l3, l4 = geometry.lengths
        widest = math.asin(l4 / l3) if l4 < l3 else math.pi
        # then the direction of a solution is never so far from the middle that it is a turn off
        self._in_one_turn = 0.5 * (high - low) + widest < math.pi - 1e-3

    def stretches(self, target: complex, grid: SweepGrid) -> list[Stretch]:
        """Where on the grid a target has solutions; seen from the first pitch axis, forward + i up [m]."""
        return stretches(self._feasible, grid, target.real, target.imag)

    def fill(self, target: complex, grid: SweepGrid, found: list[Stretch], out: FloatArray) -> None:
        """Compute the solutions of one target.

        Args:
            target: seen from the first pitch axis, forward + i up [m].
            grid: of the swept joint.
            found: what ``stretches`` gave for both.
            out: (3, k) the three pitch joints' angles [rad], one stretch behind the other.
        """
        end = 0
        places: list[FloatArray] = []
        for _, _, start, stop, _, _ in found:
            begin, end = end, end + stop - start
            rows = out[:, begin:end]
            rows[0] = grid.joint[start:stop]
            places.append(rows)
        for start, stop, members in _unions(found):
            angles = self._angles(grid, target, start, stop)
            for i in members:
                stretch = found[i]
                self._fill_one(stretch, angles[:, stretch.start - start : stretch.stop - start], places[i])

    def _angles(self, grid: SweepGrid, target: complex, start: int, stop: int) -> FloatArray:
        """What both bends share on a range of the grid: ``SweepTriangle.angles`` (3, k).

        From slopes at the nodes of each panel; one by one where that does not do.
        """
        panels, triangle = grid.panels, self._triangle
        if panels is None or grid.nodes is None or stop - start < 2 * PANEL:
            return triangle.angles(target, target * grid.link[start:stop])
        first, last = start // PANEL, -(-stop // PANEL)
        product = target * grid.nodes[:, first:last]
        slopes = np.empty((3, NODES + 1, last - first))
        at_nodes = slopes[:, :NODES]
        triangle.slopes(target, product[:NODES], at_nodes)
        products = [product[NODES]]
        runs: list[tuple[int, int]] = []
        for low, high in panels.unresolved(at_nodes):
            low, high = max(start, (first + low) * PANEL), min(stop, (first + high) * PANEL)
            runs.append((low - start, high - start))
            products.append(target * grid.link[low:high])
        exact = triangle.angles(target, np.concatenate(products) if runs else product[NODES])
        at = last - first
        slopes[:, NODES] = exact[:, :at]
        begin = first * PANEL
        out = panels.integrated(slopes)[:, start - begin : stop - begin]
        for low, high in runs:
            out[:, low:high] = exact[:, at : at + high - low]
            at += high - low
        return out

    def _fill_one(self, stretch: Stretch, angles: FloatArray, rows: FloatArray) -> None:
        bend, shift, start, _, at_knot, through = stretch
        direction, inner, bent = angles
        _, second, third = rows
        (np.subtract if bend == self._sense2 else np.add)(direction, inner, second)
        if bend == self._sense3:
            np.add(bent, self._sense3 * shift - self._offset3, third)
        else:
            np.subtract(self._sense3 * shift - self._offset3, bent, third)
        if not self._in_one_turn:
            # seen from the middle of its limits (a turn apart at most) the right image is the near one
            second -= TWO_PI * np.rint((second - self._middle) / TWO_PI)
        for row, (low, high) in ((second, self._second), (third, self._third)):
            # limits are reached at the ends of a stretch, or at a knot that it runs through
            if through or not (
                low + _AT_LIMIT < row.item(0) < high - _AT_LIMIT
                and low + _AT_LIMIT < row.item(-1) < high - _AT_LIMIT
            ):
                np.minimum(row, high, out=row)
                np.maximum(row, low, out=row)
        joint_angle = self._geometry.joint_angle
        for i, (exact2, exact3, _) in at_knot:
            second[i - start] = min(max(joint_angle(1, exact2), self._second[0]), self._second[1])
            third[i - start] = min(max(joint_angle(2, exact3), self._third[0]), self._third[1])


def _unions(found: list[Stretch]) -> list[tuple[int, int, list[int]]]:
    """Overlapping index ranges joined, so that both bends share one computation; with their members."""
    unions: list[tuple[int, int, list[int]]] = []
    for i in sorted(range(len(found)), key=lambda i: found[i].start):
        _, _, begin, end, _, _ = found[i]
        if unions and begin <= unions[-1][1]:
            start, stop, members = unions[-1]
            members.append(i)
            unions[-1] = start, max(stop, end), members
        else:
            unions.append((begin, end, [i]))
    return unions


class PositionSweep:
    """The sweep of one arm and its limits; immutable but for the cached grid, safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._geometry, self._joint_count = geometry, len(limits)
        self._swept = float(limits[1, 0]), float(limits[1, 1])
        self._sweeps = [FreeJointSweep(geometry, part) for part in turns(limits)]
        self._grid: SweepGrid | None = None

    def grid(self, step: float) -> SweepGrid:
        """The grid for a step [rad]; the last one made is kept.

        Raises:
            InputError: so small a step that the grid would not fit into memory.
        """
        grid = self._grid
        if grid is None or grid.step != step:
            grid = self._grid = SweepGrid.of(self._geometry, self._swept, step)
        return grid

    def solve(
        self, branches: list[BaseBranch], z: float, roll: float, step: float
    ) -> tuple[FloatArray, NDArray[np.int8]]:
        """Solutions on the grid of the first pitch joint.

        Args:
            branches: base angles inside their limits.
            z: height of the target above the base origin [m].
            roll: the roll joint's angle [rad], where there is one.
            step: of the grid [rad].

        Returns:
            (n, k) joint angles [rad], joint by joint in memory, and (k,) their branch indices.

        Raises:
            InputError: so small a step that the grid would not fit into memory.
        """
        grid = self.grid(step)
        shoulder = self._geometry.shoulder
        parts: list[tuple[BaseBranch, complex, FreeJointSweep, list[Stretch]]] = []
        count = 0
        for branch in branches:
            target = complex(branch.r - shoulder.real, z - shoulder.imag)
            for sweep in self._sweeps:
                found = sweep.stretches(target, grid)
                if found:
                    parts.append((branch, target, sweep, found))
                    count += sum([stop - start for _, _, start, stop, _, _ in found])
        q = np.empty((self._joint_count, count))
        index = np.empty(count, dtype=np.int8)
        end = 0
        for branch, target, sweep, found in parts:
            begin = end
            for bend, _, start, stop, _, _ in found:
                at, end = end, end + stop - start
                index[at:end] = branch_index(branch.front, bend)
            q[0, begin:end] = branch.angle
            sweep.fill(target, grid, found, q[1:4, begin:end])
        if self._geometry.roll_joint is not None:
            q[self._geometry.roll_joint] = roll
        return q, index


def turns(limits: FloatArray) -> list[FloatArray]:
    """Limits of the first four joints (4, 2), cut so that each of the last two spans less than a turn."""
    ranges = [_cut(float(low), float(high)) for low, high in limits[2:4]]
    return [np.array([limits[0], limits[1], *pair]) for pair in itertools.product(*ranges)]


def _cut(low: float, high: float) -> list[tuple[float, float]]:
    """Equal parts, with so much between them that no angle is inside two (``LIMIT_TOLERANCE``)."""
    count = 1 + math.floor((high - low) / TWO_PI + LIMIT_TOLERANCE)
    cuts = np.linspace(low, high, count + 1).tolist()
    return [(a if a == low else a + 2.0 * LIMIT_TOLERANCE, b) for a, b in itertools.pairwise(cuts)]
