"""All solutions of a position with three pitch joints: the first one takes the values of a grid.

Seen from the end of the first link the other two are a triangle. Its feasibility changes only at knots, which
have a closed form: the second or third pitch joint is at a limit, or the last two links are in line. So one
look at the middle between two neighbouring knots decides, and only feasible values are computed: 26 times
faster than the whole grid with a mask.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, images
from armctl.kinematics.samples import grid_values
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.yaw_pitch_roll.closed_form import ON_JOINT, bend_angle, inner_angle, two_link
from armctl.kinematics.yaw_pitch_roll.geometry import BaseBranch, branch_index

_ON_GRID = 1e-4
"""how near to a grid value, in steps, a knot counts as on it"""
_LOST = 1e-6
"""the same [rad]: so near to a knot the array formulas lose digits"""
_NEAR_FOLD = 1e-6
"""how near to the circle of the second pitch axis a target must lie for equal links to fold onto it [m]"""
_SAME_KNOT = 1e-13
_LEAST = 1e-60


class _Grid(NamedTuple):
    """Values of the swept joint: those of ``grid_values``."""

    step: float
    joint: FloatArray
    """(m,) joint angles [rad], in the order of rising plane angle"""
    start: float
    """the first plane angle [rad]"""
    link: FloatArray
    """(2, m) end of the first link, forward and up [m]"""

    def inside(self, low: float, high: float) -> tuple[int, int]:
        """Start and stop of the values strictly between two plane angles [rad]."""
        first, on_first = self.position(low)
        last, on_last = self.position(high)
        start = math.ceil(first) if on_first is None else on_first + 1
        stop = math.floor(last) + 1 if on_last is None else on_last
        return max(0, start), min(len(self.joint), stop)

    def position(self, angle: float) -> tuple[float, int | None]:
        """Where a plane angle lies, as a fractional index, and the index of the value that it falls on."""
        position = (angle - self.start) / self.step
        nearest = round(position)
        on = abs(position - nearest) < max(_ON_GRID, _LOST / self.step) and 0 <= nearest < len(self.joint)
        return position, nearest if on else None


class _Run(NamedTuple):
    """Neighbouring grid values with a solution of one bend."""

    bend: int
    """+1 or -1: sign of the third plane angle, wrapped"""
    start: int
    stop: int
    """grid indices"""
    shift: float
    """whole turns that carry the third plane angle from (-pi, pi] into its limits [rad]"""
    exact: tuple[float, float] | None
    """second and third plane angle of a single value that falls on a knot"""


class FreeJointSweep:
    """The list of one arm inside its limits. Immutable but for the cached grid; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry, self._limits = geometry, limits
        self._parts = [_Part(geometry, part) for part in _turns(limits)]
        self._grid: _Grid | None = None

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
            InputError: the step is so small that the grid would not fit into memory.
        """
        grid, shoulder = self._grid_of(step), self._geometry.shoulder
        found: list[tuple[BaseBranch, complex, _Part, list[_Run]]] = []
        for branch, part in itertools.product(branches, self._parts):
            target = complex(branch.r - shoulder.real, z - shoulder.imag)
            runs = part.runs(target, grid)
            if runs:
                found.append((branch, target, part, runs))
        count = sum(run.stop - run.start for *_, runs in found for run in runs)
        q, index, end = np.empty((len(self._limits), count)), np.empty(count, dtype=np.int8), 0
        for branch, target, part, runs in found:
            begin, places = end, list[FloatArray]()
            for run in runs:
                at, end = end, end + run.stop - run.start
                index[at:end] = branch_index(branch.front, run.bend)
                places.append(q[1:4, at:end])
            q[0, begin:end] = branch.angle
            part.fill(target, grid, runs, places)
        if self._geometry.roll_joint is not None:
            q[self._geometry.roll_joint] = roll
        return q, index

    def _grid_of(self, step: float) -> _Grid:
        """The grid for a step [rad]; the last one made is kept."""
        grid = self._grid
        if grid is None or grid.step != step:
            geometry = self._geometry
            low, high = self._limits[1].tolist()
            joint = grid_values(low, high, step)
            if geometry.signs[0] < 0:
                joint = joint[::-1].copy()
            plane = geometry.signs[0] * joint + geometry.offsets[0]
            link = geometry.lengths[0] * np.stack([np.cos(plane), np.sin(plane)])
            grid = self._grid = _Grid(step, joint, float(plane[0]), link)
        return grid


class _Part:
    """The sweep for limits of the second and third pitch joint that span less than a turn. Immutable."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry, self._joints = geometry, limits[2:4].tolist()
        self._l2, self._l3, self._l4 = l2, l3, l4 = geometry.lengths
        self._plane = [geometry.plane_limits(k, limits) for k in range(3)]
        self._elbow_locks = [(v, *joined(l2, l3, v)) for v in self._plane[1]]
        self._wrist_locks = [(v, *joined(l3, l4, v)) for v in (*self._plane[2], 0.0, math.pi)]
        low, high = self._joints[0]
        self._middle = 0.5 * (low + high)
        self._back = cmath.exp(-1j * geometry.plane_angle(1, self._middle))
        widest = math.asin(l4 / l3) if l4 < l3 else math.pi
        # then no solution lies half a turn from the middle of the limits, and none needs to be wrapped
        self._in_one_turn = 0.5 * (high - low) + widest < math.pi - 1e-3

    def runs(self, target: complex, grid: _Grid) -> list[_Run]:
        """Where on the grid a target has solutions; seen from the first pitch axis, forward + i up [m]."""
        x, y = target.real, target.imag
        knots: dict[int, list[float]] = {1: [*self._plane[0]], -1: [*self._plane[0]]}
        for bend, t2 in self._knots(x, y):
            for image in images(t2, *self._plane[0]):
                for sign in (bend,) if bend else (1, -1):
                    knots[sign].append(image)
        runs: list[_Run] = []
        for bend, ends in knots.items():
            ends.sort()
            taken = -1
            for low, high in itertools.pairwise((*ends, ends[-1])):
                _, on_grid = grid.position(low)
                if on_grid is not None and on_grid > taken:  # rounding must not decide here
                    taken = on_grid
                    posture = self._follow(grid.start + on_grid * grid.step, x, y, bend)
                    if posture is not None:
                        runs.append(_Run(bend, on_grid, on_grid + 1, 0.0, posture[:2]))
                if high - low <= _SAME_KNOT:
                    continue
                start, stop = grid.inside(low, high)
                posture = self._follow(0.5 * (low + high), x, y, bend) if start < stop else None
                if posture is None:
                    continue
                before = runs[-1] if runs else None
                if before and before[:1] == (bend,) and before[2:] == (start, posture[2], None):
                    start = runs.pop().start
                runs.append(_Run(bend, start, stop, posture[2], None))
        return runs

    def fill(self, target: complex, grid: _Grid, runs: list[_Run], places: list[FloatArray]) -> None:
        """Write the three pitch joints' angles (3, k) [rad] of each run into its place."""
        for start, stop, members in _unions(runs):  # both bends share one triangle
            direction, inner, bent = self._triangle(target, grid.link[:, start:stop])
            for i in members:
                (bend, begin, end, shift, exact), (first, second, third) = runs[i], places[i]
                first[:] = grid.joint[begin:end]
                part = slice(begin - start, end - start)
                sense2, sense3 = self._geometry.signs[1:]
                if exact is not None:
                    second[:], third[:] = (self._geometry.joint_angle(1 + k, exact[k]) for k in (0, 1))
                else:
                    add_inner = np.subtract if bend == sense2 else np.add
                    add_inner(direction[part], inner[part], out=second)
                    np.multiply(bent[part], bend * sense3, out=third)
                    third += sense3 * (shift - self._geometry.offsets[2])
                    if not self._in_one_turn:
                        second -= TWO_PI * np.rint((second - self._middle) / TWO_PI)
                for row, (low, high) in zip((second, third), self._joints, strict=True):
                    np.minimum(row, high, out=row)
                    np.maximum(row, low, out=row)

    def _triangle(self, target: complex, link: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Direction as a joint angle, inner angle and bend (k,) of the last two links [rad].

        From the end of the first link the target is seen at D. With v = (|D|² - l3² - l4²) / 2:
        direction = arg D, cos(inner) = (l3² + v) / (l3 |D|), cos(bend) = v / (l3 l4).
        """
        (c, s), l2, l3, l4 = link, self._l2, self._l3, self._l4
        turned, foot = target * self._back, l2 * l2 * self._back
        # D in the frame of the first link, turned back by the middle of the limits, times the link's length
        along, across = turned.real * c, turned.imag * c
        along += turned.imag * s
        along -= foot.real
        across -= turned.real * s
        across -= foot.imag
        direction = np.arctan2(across, along)
        if self._geometry.signs[1] < 0:
            np.negative(direction, out=direction)
        direction += self._middle
        v = 0.5 * (abs(target) ** 2 + l2 * l2 - l3 * l3 - l4 * l4) - target.real * c
        v -= target.imag * s
        distance = 2.0 * v
        distance += l3 * l3 + l4 * l4
        np.maximum(distance, _LEAST, out=distance)  # folded onto the second axis any direction serves
        np.sqrt(distance, out=distance)
        distance *= l3
        inner = v + l3 * l3
        inner /= distance
        v *= 1.0 / (l3 * l4)
        for cosine in (inner, v):
            np.minimum(cosine, 1.0, out=cosine)
            np.maximum(cosine, -1.0, out=cosine)
            np.arccos(cosine, out=cosine)
        return direction, inner, v

    def _follow(self, t2: float, x: float, y: float, bend: int) -> tuple[float, float, float] | None:
        """Second and third plane angle (inside their limits) and the turns of the third [rad], at one t_2.

        Links in line count as bent to the positive side, so that they are listed once. Folded onto the second
        pitch axis they may point anywhere: midway between the limits.
        """
        X, Y = x - self._l2 * math.cos(t2), y - self._l2 * math.sin(t2)
        square = X * X + Y * Y
        angle = bend_angle(square, self._l3, self._l4)
        if angle is None or (bend < 0 and (angle == 0.0 or angle == math.pi)):
            return None
        third = images(bend * angle, *self._plane[2])
        if not third:
            return None
        turns = TWO_PI * round((third[0] - bend * angle) / TWO_PI)
        low, high = self._plane[1]
        if square <= ON_JOINT * ON_JOINT:
            return 0.5 * (low + high), third[0], turns
        second = images(math.atan2(Y, X) - inner_angle(self._l3, self._l4, bend * angle) - t2, low, high)
        return (second[0], third[0], turns) if second else None

    def _knots(self, x: float, y: float) -> Iterator[tuple[int, float]]:
        """(bend, t_2) where feasibility may change; bend 0: for both."""
        if abs(self._l3 - self._l4) < _NEAR_FOLD and abs(math.hypot(x, y) - self._l2) < _NEAR_FOLD:
            yield 0, math.atan2(y, x)
        for v, length, turn in self._elbow_locks:
            for first, bend in two_link(x, y, length, self._l4) if length > 1e-12 else ():
                yield _sign(bend + turn - v), first - turn
        for v, length, _ in self._wrist_locks:
            for first, _ in two_link(x, y, self._l2, length) if length > 1e-12 else ():
                yield _sign(v), first


def joined(a: float, b: float, bend: float) -> tuple[float, float]:
    """Two links held at a bend, as one: its length and its direction relative to the first."""
    whole = a + b * cmath.exp(1j * bend)
    return abs(whole), cmath.phase(whole)


def _sign(angle: float) -> int:
    """Sign of an angle when wrapped; 0 where it is both (links in line)."""
    angle = math.remainder(angle, TWO_PI)
    if abs(angle) < 1e-7 or abs(abs(angle) - math.pi) < 1e-7:
        return 0
    return 1 if angle > 0 else -1


def _unions(runs: list[_Run]) -> list[tuple[int, int, list[int]]]:
    """Overlapping index ranges joined: start, stop and the numbers of the runs in each."""
    unions: list[tuple[int, int, list[int]]] = []
    for i in sorted(range(len(runs)), key=lambda i: runs[i].start):
        begin, end = runs[i].start, runs[i].stop
        if unions and begin <= unions[-1][1]:
            start, stop, members = unions.pop()
            unions.append((start, max(stop, end), [*members, i]))
        else:
            unions.append((begin, end, [i]))
    return unions


def _turns(limits: FloatArray) -> list[FloatArray]:
    """Limits of the first four joints (4, 2), cut so that each of the last two spans less than a turn."""
    ranges: list[list[tuple[float, float]]] = []
    for low, high in limits[2:4].tolist():
        count = 1 + math.floor((high - low) / TWO_PI + LIMIT_TOLERANCE)
        cuts = [*(low + (high - low) * i / count for i in range(count)), high]
        # so much between two parts that no angle is inside both
        ranges.append([(a + 2.0 * LIMIT_TOLERANCE * (a > low), b) for a, b in itertools.pairwise(cuts)])
    return [np.array([limits[0], limits[1], *pair]) for pair in itertools.product(*ranges)]
