"""All ways of one pose in plain floats, for arms like Universal Robots'; arrays take thirty times as long.

The parallel axes are joints 2, 3 and 4, and the last two axes meet in a point x. Seen from the first link
everything is a sum ``a + b cos q1 + c sin q1`` of numbers that the pose fixes, and seen from the fourth link
a sum ``a + b cos q5 + c sin q5`` of numbers that the arm fixes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.subproblems import circle_angles, cross
from armctl.kinematics.three_parallel.geometry import ThreeParallel

_Circle = tuple[float, float, float]
_DOUBTFUL = 1e-6
"""closer than this to a singularity nothing is answered: sines and squared lengths over the longest"""


class OnePose:
    """The constants of one arm. Immutable."""

    def __init__(self, arm: ThreeParallel) -> None:
        i, j, k = arm.plane
        w1, w5, w6 = arm.axes[0], arm.axes[4], arm.axes[5]
        x, first = arm.points[4], arm.points[0]
        self._T = arm.T_tool_base.tolist()
        self._first, self._x = first.tolist(), x.tolist()
        self._ahead = [_turns(w1, v) for v in (i, j, k)]
        """of the plane's axes, turned by the first joint"""
        u = np.cross(w6, np.eye(3)[int(np.abs(w6).argmin())])
        u /= np.linalg.norm(u)
        self._last = [v.tolist() for v in (w6, u)]
        self._behind = [[_along(_turns(w5, v), axis) for axis in (i, j, k)] for v in (w6, u, np.cross(w6, u))]
        """of the last axis and of two across it, turned by joint 5: along the plane's axes"""
        self._height = float(k @ (x - first))
        self._shoulder = (float(i @ (first - arm.points[1])), float(j @ (first - arm.points[1])))
        self._wrist = (float(i @ (arm.points[3] - x)), float(j @ (arm.points[3] - x)))
        (self._x1, self._y1), (self._x2, self._y2) = arm.links.tolist()
        self._lengths = math.hypot(self._x1, self._y1), math.hypot(self._x2, self._y2)
        self._straight, self._signs = arm.straight, arm.signs

    def ways(self, pose: Sequence[Sequence[float]]) -> tuple[list[list[float]], list[int]] | None:
        """Rows of six angles [rad] of a tool pose (4 rows), and their columns in ``closed_form.all_ways``.

        None so close to a singularity that arrays have to look more carefully.
        """
        rows: list[list[float]] = []
        columns: list[int] = []
        R = [_row(row, self._T) for row in pose[:3]]
        p, x, (w6, u) = self._first, self._x, self._last
        wrist = [row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[3] - p[n] for n, row in enumerate(R)]
        axis = [row[0] * w6[0] + row[1] * w6[1] + row[2] * w6[2] for row in R]
        side = [row[0] * u[0] + row[1] * u[1] + row[2] * u[2] for row in R]
        at_wrist, at_axis, at_side = (
            [_circle(turns, v) for turns in self._ahead] for v in (wrist, axis, side)
        )
        size = math.hypot(at_wrist[2][1], at_wrist[2][2])
        firsts, missed = circle_angles(*at_wrist[2], self._height)
        if abs(missed) > 0.0 or len(firsts) == 1:
            return None if missed < _DOUBTFUL else (rows, columns)
        if size - abs(self._height - at_wrist[2][0]) < _DOUBTFUL * size:
            return None
        for n, q1 in enumerate(firsts):
            c1, s1 = math.cos(q1), math.sin(q1)
            px, py = (a + b * c1 + c * s1 for a, b, c in at_wrist[:2])
            gi, gj, gk = (a + b * c1 + c * s1 for a, b, c in at_axis)
            ui, uj, uk = (a + b * c1 + c * s1 for a, b, c in at_side)
            a, b, c = self._behind[0][2]
            size = math.hypot(b, c)
            fifths, missed = circle_angles(a, b, c, gk)
            if missed > _DOUBTFUL:
                continue
            if missed > 0.0 or size - abs(gk - a) < _DOUBTFUL * size or gi * gi + gj * gj < _DOUBTFUL:
                return None
            for m, q5 in enumerate(fifths):
                c5, s5 = math.cos(q5), math.sin(q5)
                (mi, mj), (vi, vj, vk), (wi, wj, wk) = (
                    [a + b * c5 + c * s5 for a, b, c in part]
                    for part in (self._behind[0][:2], self._behind[1], self._behind[2])
                )
                cosine, sine = mi * gi + mj * gj, mi * gj - mj * gi
                norm = math.hypot(cosine, sine)
                cosine, sine = cosine / norm, sine / norm
                ti, tj = cosine * ui + sine * uj, cosine * uj - sine * ui
                q6 = math.atan2(wi * ti + wj * tj + wk * uk, vi * ti + vj * tj + vk * uk)
                ei, ej = self._wrist
                dx = px + self._shoulder[0] + cosine * ei - sine * ej
                dy = py + self._shoulder[1] + sine * ei + cosine * ej
                if not self._elbows(
                    rows, columns, (q1, q5, q6), (dx, dy), math.atan2(sine, cosine), 2 * m + n
                ):
                    return None
        return rows, columns

    def _elbows(
        self,
        rows: list[list[float]],
        columns: list[int],
        others: tuple[float, float, float],
        reached: tuple[float, float],
        turn: float,
        column: int,
    ) -> bool:
        """Add both ways of the parallel joints; False where they are singular."""
        one, other = self._lengths
        squared = reached[0] ** 2 + reached[1] ** 2
        longest = (one + other) ** 2
        out, folded = longest - squared, squared - (one - other) ** 2
        if min(abs(out), abs(folded)) < _DOUBTFUL * longest or squared < _DOUBTFUL * longest:
            return False
        if out < 0.0 or folded < 0.0:
            return True
        q1, q5, q6 = others
        bend, facing = 2.0 * math.atan2(math.sqrt(out), math.sqrt(folded)), math.atan2(reached[1], reached[0])
        s2, s3, s4 = self._signs
        for way, q3 in enumerate((self._straight + bend, self._straight - bend)):
            c, s = math.cos(q3), math.sin(q3)
            q2 = facing - math.atan2(
                self._y1 + s * self._x2 + c * self._y2, self._x1 + c * self._x2 - s * self._y2
            )
            rows.append([q1, s2 * q2, s3 * q3, s4 * (turn - q2 - q3), q5, q6])
            columns.append(4 * way + column)
        return True


def _turns(axis: FloatArray, v: FloatArray) -> list[list[float]]:
    """Vectors a, b, c of ``a + b cos q + c sin q``: v turned about an axis by q."""
    level = axis * (axis @ v)
    return [level.tolist(), (v - level).tolist(), list(cross(axis.tolist(), v.tolist()))]


def _along(turns: list[list[float]], direction: FloatArray) -> _Circle:
    a, b, c = (float(direction @ np.array(v)) for v in turns)
    return a, b, c


def _circle(turns: list[list[float]], v: list[float]) -> _Circle:
    x, y, z = v
    (a, b, c), (d, e, f), (g, h, i) = turns
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def _row(row: Sequence[float], T: list[list[float]]) -> tuple[float, float, float, float]:
    """A row of a pose times another pose."""
    a, b, c, d = row
    (e, f, g, h), (i, j, k, m), (n, o, p, q), _ = T
    return a * e + b * i + c * n, a * f + b * j + c * o, a * g + b * k + c * p, a * h + b * m + c * q + d
