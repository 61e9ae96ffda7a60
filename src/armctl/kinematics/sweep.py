"""Position-only solutions of three pitch joints: the first one is swept, the other two follow.

Nothing infeasible is ever computed. Where the swept joint becomes feasible has closed-form ends: the
second or third pitch joint at a limit, or the last two links stretched or folded. Between two
neighbouring ends feasibility cannot change, so one look at the middle decides for all values between.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, images
from armctl.kinematics.two_link import COSINE_TOLERANCE, two_link
from armctl.kinematics.yaw_pitch_roll import YawPitchRoll

FloatArray = NDArray[np.float64]
DEFAULT_STEP = math.radians(0.01)
"""the paper's step of the swept joint [rad]"""


@dataclass(frozen=True, slots=True)
class SweepGrid:
    """Values of the swept joint: whole multiples of the step inside its limits."""

    step: float
    joint: FloatArray
    """(m,) joint angles [rad], in the order of rising plane angle"""
    plane: FloatArray
    """(m,) plane angles t_2, rising"""
    link_x: FloatArray
    link_y: FloatArray
    """(m,) end of the first link [m]"""


@dataclass(frozen=True, slots=True)
class SweepPart:
    """Solutions on one stretch of the grid with one bend."""

    bend: int
    """+1 or -1: the sign of the last pitch joint's plane angle (wrapped)"""
    first: FloatArray
    second: FloatArray
    third: FloatArray
    """(m,) joint angles of the three pitch joints [rad]"""


@dataclass(frozen=True, slots=True)
class _Interval:
    bend: int
    shift: float
    """whole turns that carry the third plane angle from (-pi, pi] into its limits"""
    low: float
    high: float


class FreeJointSweep:
    """The sweep for one arm and its limits. Immutable but for the cached grid; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry = geometry
        self.l2, self.l3, self.l4 = geometry.lengths
        self.limits = tuple(geometry.plane_limits(k, limits) for k in range(3))
        self.joint_limits = (float(limits[1, 0]), float(limits[1, 1]))
        self._knots3 = [self._compound(self.l2, self.l3, v) for v in self.limits[1]]
        self._knots4 = [self._compound(self.l3, self.l4, v) for v in (*self.limits[2], 0.0, math.pi)]
        self._grid: SweepGrid | None = None

    @staticmethod
    def _compound(a: float, b: float, bend: float) -> tuple[float, float, float]:
        """Two links locked at a bend, as one: (bend, length, direction relative to the first)."""
        whole = a + b * cmath.exp(1j * bend)
        return bend, abs(whole), cmath.phase(whole)

    def grid(self, step: float) -> SweepGrid:
        """The grid for a step [rad]; the last one made is kept."""
        grid = self._grid
        if grid is None or grid.step != step:
            low, high = self.joint_limits
            first = math.ceil(low / step - 1e-6)
            last = math.floor(high / step + 1e-6)
            joint = np.clip(step * np.arange(first, last + 1), low, high)
            if self.geometry.signs[0] < 0:
                joint = joint[::-1].copy()
            plane = self.geometry.signs[0] * joint + self.geometry.offsets[0]
            grid = SweepGrid(step, joint, plane, self.l2 * np.cos(plane), self.l2 * np.sin(plane))
            for array in (grid.joint, grid.plane, grid.link_x, grid.link_y):
                array.flags.writeable = False
            self._grid = grid
        return grid

    def solve(self, x: float, y: float, step: float) -> list[SweepPart]:
        """All solutions on the grid for a point of the tool plane, seen from the first pitch axis [m]."""
        grid = self.grid(step)
        stretches = self._stretches(x, y, grid)
        parts: list[SweepPart] = []
        for start, stop, members in _unions(stretches):
            X, Y = x - grid.link_x[start:stop], y - grid.link_y[start:stop]
            square = X * X
            square += Y * Y
            direction = np.arctan2(Y, X, out=Y)
            direction -= grid.plane[start:stop]
            cosine = square - (self.l3**2 + self.l4**2)
            cosine *= 1.0 / (2 * self.l3 * self.l4)
            bend = np.arccos(np.clip(cosine, -1.0, 1.0, out=cosine), out=cosine)
            distance = np.sqrt(square, out=X)
            square += self.l3**2 - self.l4**2
            square /= distance
            square *= 1.0 / (2 * self.l3)
            inner = np.arccos(np.clip(square, -1.0, 1.0, out=square), out=square)
            for interval, i, j in members:
                cut = slice(i - start, j - start)
                parts.append(self._part(grid, interval, i, j, direction[cut], inner[cut], bend[cut]))
        return parts

    def _part(
        self, grid: SweepGrid, interval: _Interval, i: int, j: int,
        direction: FloatArray, inner: FloatArray, bend: FloatArray,
    ) -> SweepPart:  # fmt: skip
        geometry = self.geometry
        second = direction - inner if interval.bend > 0 else direction + inner
        low, high = self.limits[1]
        if second.min() < low - LIMIT_TOLERANCE or second.max() > high + LIMIT_TOLERANCE:
            # seen from the middle of its limits (less than a turn apart) the right image is the near one
            middle = 0.5 * (low + high)
            second -= TWO_PI * np.rint((second - middle) / TWO_PI)
        np.clip(second, low, high, out=second)
        third = bend + interval.shift if interval.bend > 0 else interval.shift - bend
        np.clip(third, *self.limits[2], out=third)
        return SweepPart(
            interval.bend,
            grid.joint[i:j],
            self._to_joint(1, second),
            self._to_joint(2, third),
        )

    def _to_joint(self, k: int, plane: FloatArray) -> FloatArray:
        offset = self.geometry.offsets[k]
        if offset != 0.0:
            plane -= offset
        if self.geometry.signs[k] < 0:
            np.negative(plane, out=plane)
        return plane

    def _stretches(self, x: float, y: float, grid: SweepGrid) -> list[tuple[_Interval, int, int]]:
        """Index ranges of the grid with the interval that each belongs to."""
        out: list[tuple[_Interval, int, int]] = []
        for interval in self.intervals(x, y):
            i = self._edge(interval.low, grid, x, y, interval, ceiling=True)
            j = self._edge(interval.high, grid, x, y, interval, ceiling=False) + 1
            if j > i:
                out.append((interval, i, j))
        return out

    def _edge(
        self, angle: float, grid: SweepGrid, x: float, y: float, interval: _Interval, *, ceiling: bool
    ) -> int:
        """First (or last) grid index inside an interval's end."""
        position = (angle - float(grid.plane[0])) / grid.step if len(grid.plane) else 0.0
        near = round(position)
        if abs(position - near) < 1e-4 and 0 <= near < len(grid.plane):
            # the end falls on a grid value: rounding must not decide, the solution itself does
            inside = self.follow(float(grid.plane[near]), x, y, interval.bend) is not None
            return near if inside else near + (1 if ceiling else -1)
        if ceiling:
            return max(0, math.ceil(position))
        return min(len(grid.plane) - 1, math.floor(position))

    def follow(self, t2: float, x: float, y: float, bend: int) -> tuple[float, float, float] | None:
        """The second and third plane angle (inside their limits) and the turns of the third, at one t_2."""
        X, Y = x - self.l2 * math.cos(t2), y - self.l2 * math.sin(t2)
        cosine = (X * X + Y * Y - self.l3**2 - self.l4**2) / (2 * self.l3 * self.l4)
        if not -1.0 - COSINE_TOLERANCE <= cosine <= 1.0 + COSINE_TOLERANCE:
            return None
        g = bend * math.acos(max(-1.0, min(1.0, cosine)))
        third = images(g, *self.limits[2])
        if not third:
            return None
        raw = math.atan2(Y, X) - math.atan2(self.l4 * math.sin(g), self.l3 + self.l4 * math.cos(g)) - t2
        second = images(raw, *self.limits[1])
        return (second[0], third[0], TWO_PI * round((third[0] - g) / TWO_PI)) if second else None

    def intervals(self, x: float, y: float) -> list[_Interval]:
        """Feasible intervals of the first plane angle, for each bend, rising."""
        low, high = self.limits[0]
        ends: dict[int, list[float]] = {1: [low, high], -1: [low, high]}
        for bend, t2 in self._knots(x, y):
            for image in images(t2, low, high):
                for sign in (1, -1) if bend == 0 else (bend,):
                    ends[sign].append(image)
        out: list[_Interval] = []
        for sign in (1, -1):
            knots = sorted(ends[sign])
            for a, b in zip(knots, knots[1:], strict=False):
                if b - a < 1e-13:
                    continue
                middle = self.follow(0.5 * (a + b), x, y, sign)
                if middle is None:
                    continue
                if out and out[-1].bend == sign and out[-1].high == a and out[-1].shift == middle[2]:
                    out[-1] = _Interval(sign, middle[2], out[-1].low, b)
                else:
                    out.append(_Interval(sign, middle[2], a, b))
        return out

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


def _sign(angle: float) -> int:
    """Bend of a wrapped angle; 0 where it lies on both (stretched or folded)."""
    if abs(angle) < 1e-7 or abs(abs(angle) - math.pi) < 1e-7:
        return 0
    return 1 if angle > 0 else -1


def _unions(
    stretches: list[tuple[_Interval, int, int]],
) -> list[tuple[int, int, list[tuple[_Interval, int, int]]]]:
    """Overlapping index ranges joined, so that both bends share one computation."""
    unions: list[tuple[int, int, list[tuple[_Interval, int, int]]]] = []
    for stretch in sorted(stretches, key=lambda s: s[1]):
        _, i, j = stretch
        if unions and i <= unions[-1][1]:
            start, stop, members = unions[-1]
            unions[-1] = (start, max(stop, j), [*members, stretch])
        else:
            unions.append((i, j, [stretch]))
    return unions
