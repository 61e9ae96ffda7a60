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
from math import atan2, cos, floor, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, central_images, images, wrap
from armctl.kinematics.families.yaw_pitch_roll.closed_form import ON_JOINT, bend_angle, inner_angle, two_link
from armctl.kinematics.families.yaw_pitch_roll.geometry import BaseBranch, branch_index
from armctl.kinematics.samples import grid_values
from armctl.kinematics.subproblems import ToolPlane

_ON_GRID = 1e-4
"""how near to a grid value, in steps, a knot counts as on it"""
_LOST = 1e-6
"""the same [rad]: so near to a knot the array formulas lose digits"""
_NEAR_FOLD = 1e-6
"""how near to the circle of the second pitch axis a target must lie for equal links to fold onto it [m]"""


class _Grid(NamedTuple):
    """``grid_values`` (m,) of the swept joint [rad], in the order of rising plane angle."""

    step: float
    joint: FloatArray
    start: float
    """the first plane angle [rad]"""
    cos: FloatArray
    """of the plane angles, as ``sin``"""
    sin: FloatArray


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


_Place = tuple[int, int, int, _Run]
"""grid indices from and to, the column at which they begin, and the run"""


class FreeJointSweep:
    """The list of one arm inside its limits. Immutable but for the cached grid; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry, self._limits = geometry, limits
        self._parts = [_Part(geometry, part) for part in _turns(limits)]
        self._grid: _Grid | None = None

    def solve(
        self, branches: list[BaseBranch], z: float, roll: float, step: float
    ) -> tuple[FloatArray, NDArray[np.int8]]:
        """(n, k) joint angles [rad], joint by joint in memory, and (k,) their branch indices.

        For base angles inside their limits, a target at a height z [m], the roll joint's angle [rad] and the
        step of the grid [rad]; ``InputError`` for one so small that the grid would not fit into memory.
        """
        grid, shoulder = self._grid_of(step), self._geometry.shoulder
        y = z - shoulder.imag
        found = [
            (branch, part, part.runs(branch.r - shoulder.real, y, grid))
            for branch, part in itertools.product(branches, self._parts)
        ]
        count = sum(run.stop - run.start for *_, runs in found for run in runs)
        q, index, end = np.empty((len(self._limits), count)), np.empty(count, dtype=np.int8), 0
        for branch, part, runs in found:
            begin = end
            for run in runs:
                at, end = end, end + run.stop - run.start
                index[at:end] = branch_index(branch.front, run.bend)
            q[0, begin:end] = branch.angle
            part.fill(branch.r - shoulder.real, y, grid, runs, q[1:4, begin:end])
        if self._geometry.roll_joint is not None:
            q[self._geometry.roll_joint] = roll
        return q, index

    def _grid_of(self, step: float) -> _Grid:
        """The grid for a step [rad]; the last one made is kept."""
        grid = self._grid
        if grid is None or grid.step != step:
            sign, low, high = self._geometry.signs[0], *self._limits[1].tolist()
            joint = grid_values(low, high, step)
            if sign < 0:
                joint = joint[::-1].copy()
            plane = sign * joint + self._geometry.offsets[0]
            grid = self._grid = _Grid(step, joint, float(plane[0]), np.cos(plane), np.sin(plane))
        return grid


class _Part:
    """The sweep for limits of the second and third pitch joint that span less than a turn. Immutable."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry, (self._low, self._high) = geometry, limits[2:4].T[..., None]
        self._second: list[float] = limits[2].tolist()
        self._l2, self._l3, self._l4 = l2, l3, l4 = geometry.lengths
        self._plane = [geometry.plane_limits(k, limits) for k in range(3)]
        self._elbow_locks = [(v, *joined(l2, l3, v)) for v in self._plane[1]]
        self._wrist_locks = [(v, *joined(l3, l4, v)) for v in (*self._plane[2], 0.0, math.pi)]
        widest = math.asin(l4 / l3) if l4 < l3 else math.pi
        # then the direction is never half a turn from the first link's, and nothing needs to be wrapped
        self._in_one_turn = max(map(abs, self._plane[1])) + widest < math.pi - 1e-3

    def runs(self, x: float, y: float, grid: _Grid) -> list[_Run]:
        """Where on the grid a target has solutions; seen from the first pitch axis, forward, up [m]."""
        start, step, last = grid.start, grid.step, len(grid.joint) - 1
        tolerance = max(_ON_GRID, _LOST / step)
        lowest, highest = self._plane[0]
        knots: dict[int, list[float]] = {1: [lowest, highest], -1: [lowest, highest]}
        for bend, t2 in self._knots(x, y):
            for side in (bend,) if bend else (1, -1):
                knots[side] += images(t2, lowest, highest)
        runs: list[_Run] = []
        for bend, ends in knots.items():
            before, begin, taken = lowest, 0, -1
            for knot in sorted(ends):
                position = (knot - start) / step
                on_grid = round(position)
                if abs(position - on_grid) >= tolerance or not 0 <= on_grid <= last:
                    on_grid = -1
                stop = on_grid if on_grid >= 0 else min(floor(position), last) + 1
                posture = self._follow(0.5 * (before + knot), x, y, bend) if begin < stop else None
                if posture is not None:
                    previous = runs[-1] if runs else None
                    if previous and previous[:1] == (bend,) and previous[2:] == (begin, posture[2], None):
                        begin = runs.pop().start
                    runs.append(_Run(bend, begin, stop, posture[2], None))
                if on_grid > taken:  # rounding must not decide here
                    taken = on_grid
                    posture = self._follow(start + on_grid * step, x, y, bend)
                    if posture is not None:
                        runs.append(_Run(bend, on_grid, on_grid + 1, 0.0, posture[:2]))
                before, begin = knot, stop + (on_grid >= 0)
        return runs

    def fill(self, x: float, y: float, grid: _Grid, runs: list[_Run], q: FloatArray) -> None:
        """Write the pitch joints' angles [rad] of each run into its columns of ``q`` (3, k)."""
        (_, o2, o3), (_, s2, s3) = self._geometry.offsets, self._geometry.signs
        first, second, third = q
        places: list[_Place] = []
        at = 0
        for run in runs:
            end = at + run.stop - run.start
            first[at:end] = grid.joint[run.start : run.stop]
            if run.exact is None:
                places.append((run.start, run.stop, at, run))
            else:
                second[at], third[at] = (self._geometry.joint_angle(1 + k, run.exact[k]) for k in (0, 1))
            at = end
        for begin, stop, members in _unions(places):  # both bends share one triangle
            direction, inner, bent = self._triangle(x, y, grid.cos[begin:stop], grid.sin[begin:stop])
            if o2:
                direction -= s2 * o2
            for start, end, at, run in members:
                part, place = slice(start - begin, end - begin), slice(at, at + end - start)
                add_inner = np.subtract if run.bend == s2 else np.add
                add_inner(direction[part], inner[part], out=second[place])
                np.multiply(bent[part], run.bend * s3, out=third[place])
                if run.shift != o3:
                    third[place] += s3 * (run.shift - o3)
        if not self._in_one_turn:
            central_images(second, *self._second, out=second)
        np.clip(q[1:], self._low, self._high, out=q[1:])

    def _triangle(
        self, x: float, y: float, cos: FloatArray, sin: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The last two links, seen from the end of the first, whose plane angle has ``cos`` and ``sin`` (k,).

        Direction of the target against the first link, in the sense of the joint, the angle between it and
        the second link, and the bend (k,) [rad]. With D the way from there to the target:
        cos(bend) = (|D|² - l3² - l4²) / 2 l3 l4,  cos(inner) = (l3 + l4 cos(bend)) / |D|.
        """
        l2, l3, l4 = self._l2, self._l3, self._l4
        scale, s2 = l2 / (l3 * l4), self._geometry.signs[1]
        u, w = (scale * x) * cos, (s2 * scale * y) * cos
        term = (scale * y) * sin
        u += term
        np.multiply(sin, s2 * scale * x, out=term)
        w -= term
        cosine = (x * x + y * y + l2 * l2 - l3 * l3 - l4 * l4) / (2.0 * l3 * l4) - u
        u -= scale * l2  # D in the frame of the first link, times l2 / l3 l4
        direction = np.arctan2(w, u, out=w)
        np.clip(cosine, -1.0, 1.0, out=cosine)
        # |D| / l4, above zero where the links fold onto their joint, and any direction serves
        distance = np.add(cosine, max((l3 * l3 + l4 * l4) / (2.0 * l3 * l4), 1.0 + 4e-16), out=u)
        distance *= 2.0 * l3 / l4
        np.sqrt(distance, out=distance)
        inner = np.add(cosine, l3 / l4, out=term)
        inner /= distance
        np.clip(inner, -1.0, 1.0, out=inner)
        return direction, np.arccos(inner, out=inner), np.arccos(cosine, out=cosine)

    def _follow(self, t2: float, x: float, y: float, bend: int) -> tuple[float, float, float] | None:
        """Second and third plane angle (inside their limits) and the turns of the third [rad], at one t_2.

        Links in line count as bent to the positive side, so that they are listed once. Folded onto the second
        pitch axis they may point anywhere: midway between the limits.
        """
        x, y = x - self._l2 * cos(t2), y - self._l2 * sin(t2)
        square = x * x + y * y
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
        second = images(atan2(y, x) - inner_angle(self._l3, self._l4, bend * angle) - t2, low, high)
        return (second[0], third[0], turns) if second else None

    def _knots(self, x: float, y: float) -> Iterator[tuple[int, float]]:
        """(bend, t_2) where feasibility may change; bend 0: for both."""
        if abs(self._l3 - self._l4) < _NEAR_FOLD and abs(math.hypot(x, y) - self._l2) < _NEAR_FOLD:
            yield 0, atan2(y, x)
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
    angle = wrap(angle)
    if abs(angle) < 1e-7 or abs(abs(angle) - math.pi) < 1e-7:
        return 0
    return 1 if angle > 0 else -1


def _unions(places: list[_Place]) -> list[tuple[int, int, list[_Place]]]:
    """Overlapping ranges joined: start, stop and the members of each."""
    unions: list[tuple[int, int, list[_Place]]] = []
    for place in sorted(places):
        begin, end = place[:2]
        if unions and begin <= unions[-1][1]:
            start, stop, members = unions.pop()
            unions.append((start, max(stop, end), [*members, place]))
        else:
            unions.append((begin, end, [place]))
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
