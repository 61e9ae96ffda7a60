"""Where the first of three pitch joints can stand while the tool point stays.

Feasibility changes at knots of closed form: the second or third pitch joint at a limit, or the last two links
stretched or folded. Between two neighbouring knots it cannot change, so one look at the middle decides.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI, images
from armctl.kinematics.two_link import ON_JOINT, bend_angle, inner_angle, two_link
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import into_window, window

FloatArray = NDArray[np.float64]
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
