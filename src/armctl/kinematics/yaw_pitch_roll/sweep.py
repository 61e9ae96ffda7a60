"""Position-only solutions of three pitch joints: the first one is swept, the other two follow.

Nothing infeasible is ever computed: ``stretches.py`` says where on the grid there are solutions, and those
are computed as arrays.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.panels import NODES, PANEL
from armctl.kinematics.yaw_pitch_roll.stretches import Stretch, stretches
from armctl.kinematics.yaw_pitch_roll.sweep_grid import SweepGrid
from armctl.kinematics.yaw_pitch_roll.sweep_intervals import SweepIntervals
from armctl.kinematics.yaw_pitch_roll.sweep_triangle import SweepTriangle

FloatArray = NDArray[np.float64]
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
