"""The nearest point that the tool can reach: exact, by the conditions that an optimum must meet.

At the nearest point each joint is either at a limit or at rest: the distance does not fall when it alone
turns. For the base, at rest means that the tip faces the target. For the pitch joints it means that the
joint lies on the line along which the tip misses the target, within the tool plane. So there are 3^m
choices of which pitch joints are at which limit, and for each the free groups of links lie on one line:
the arm is rigid but for one angle, and its tip runs on a circle. Nearest on a circle is closed form while
the base is at a limit, and a search in one variable while it faces the target.

One case is left: the tip misses the target only sideways, across the tool plane, where the pitch joints
can do nothing about it. Then they have an ordinary inverse solution in the plane.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, images, rest_angle
from armctl.kinematics.yaw_pitch_roll.base_yaw import base_branches
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.plane_circles import PlaneCircle, collinear_circles

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
PlaneSolver = Callable[[float, float, float, float | None], FloatArray | None]
"""(1 + m,) joint angles inside the limits for a base angle, a forward and an upward coordinate, and the last
link's direction or any; None where there are none"""
_SAMPLES = 128
_BISECTIONS = 52
_NO_LENGTH = 1e-12
_ALIKE_M = 1e-12
"""distances that differ by rounding alone [m]"""


class _Circles:
    """Many of them, as columns."""

    def __init__(self, circles: Iterable[PlaneCircle], shoulder: complex) -> None:
        kept = list(circles)
        self.centre: ComplexArray = np.array([c.centre for c in kept], dtype=np.complex128) + shoulder
        self.arm: ComplexArray = np.array([c.arm for c in kept], dtype=np.complex128)
        self.constants: FloatArray = np.array([c.constants for c in kept], dtype=np.float64)
        self.slopes: FloatArray = np.array([c.slopes for c in kept], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Nearest:
    """A nearest configuration."""

    q: FloatArray
    """(1 + m,) base and pitch joints [rad]"""
    distance: float
    """of its tip from the target [m]"""


def nearest_of(found: Iterable[Nearest | None]) -> Nearest | None:
    """The nearest; of several that are, such as one and the same point over the back, the least turned."""
    known = [one for one in found if one is not None]
    if not known:
        return None
    least = min(one.distance for one in known) + _ALIKE_M
    return min((one for one in known if one.distance <= least), key=lambda one: np.abs(one.q).sum())


class NearestReach:
    """Nearest reachable points of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray, in_plane: PlaneSolver) -> None:
        self.geometry, self._in_plane = geometry, in_plane
        self._limits = limits[: 1 + len(geometry.lengths)]
        self._base = (float(limits[0, 0]), float(limits[0, 1]))
        self._plane = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]
        self._free = _Circles(collinear_circles(geometry.lengths, self._plane), geometry.shoulder)

    def solve(self, x: float, y: float, z: float, tool_angle: float | None = None) -> Nearest | None:
        """The nearest configuration inside the limits.

        Args:
            x: target, forward of the base axis [m].
            y: target, left of the base axis [m].
            z: target, above the base origin [m].
            tool_angle: plane angle of the last link to be kept [rad]; None: free.

        Returns:
            None when no configuration has that tool angle.
        """
        for branch in base_branches(self.geometry, x, y, self._base):
            reached = self._in_plane(branch.angle, branch.r, z, tool_angle)
            if reached is not None:  # it was refused for something else, such as the roll
                return Nearest(reached, 0.0)
        circles = self._free
        if tool_angle is not None:
            circles = _Circles(self._at_tool_angle(tool_angle), self.geometry.shoulder)
        found = [self._best(circles, *self._facing(circles, x, y, z))]
        for yaw in self._base:
            across = complex(x, y) * cmath.exp(-1j * self.geometry.yaw_sign * yaw)
            phi = np.angle(complex(across.real, z) - circles.centre) - np.angle(circles.arm)
            tip = circles.centre + circles.arm * np.exp(1j * phi)
            miss = np.hypot(np.abs(tip - complex(across.real, z)), across.imag - self.geometry.lateral)
            found.append(self._best(circles, np.arange(len(phi)), phi, np.full(len(phi), yaw), miss))
            found.append(self._sideways(yaw, across, z, tool_angle, across.real))
        rho, d = math.hypot(x, y), self.geometry.lateral
        if rho < abs(d):  # inside the cylinder that the tool plane cannot enter
            turn = self.geometry.yaw_sign * (math.atan2(y, x) - math.copysign(0.5 * math.pi, d))
            for yaw in images(turn, *self._base):
                across = complex(x, y) * cmath.exp(-1j * self.geometry.yaw_sign * yaw)
                found.append(self._sideways(yaw, across, z, tool_angle, 0.0))
        return nearest_of(found)

    def _sideways(
        self, yaw: float, across: complex, z: float, tool_angle: float | None, r: float
    ) -> Nearest | None:
        """The tip level with the target, at a forward coordinate r [m] of the tool plane."""
        q = self._in_plane(yaw, r, z, tool_angle)
        return None if q is None else Nearest(q, abs(across - complex(r, self.geometry.lateral)))

    def _best(
        self, circles: _Circles, row: NDArray[np.intp], phi: FloatArray, yaw: FloatArray, miss: FloatArray
    ) -> Nearest | None:
        """The nearest of some candidates that is inside the limits of the pitch joints."""
        plane = circles.constants[row] + circles.slopes[row] * phi[:, None]
        inside = np.isfinite(miss)
        for k, limits in enumerate(self._plane):
            plane[:, k], ok = _into(plane[:, k], *limits)
            inside &= ok
        if not inside.any():
            return None
        near = inside & (miss <= miss[inside].min() + _ALIKE_M)
        return nearest_of(self._at(yaw[i], plane[i], miss[i]) for i in np.flatnonzero(near))

    def _at(self, yaw: float, plane: FloatArray, miss: float) -> Nearest:
        angles = [self.geometry.joint_angle(k, float(t)) for k, t in enumerate(plane)]
        return Nearest(np.clip([yaw, *angles], *self._limits.T), float(miss))

    def _facing(
        self, circles: _Circles, x: float, y: float, z: float
    ) -> tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray]:
        """Circle, phi, base angle and distance of every minimum with the tip facing the target."""
        rho, d = math.hypot(x, y), self.geometry.lateral
        row, phi = self._minima(circles, rho, z)
        tip = circles.centre[row] + circles.arm[row] * np.exp(1j * phi)
        miss = np.hypot(rho - np.hypot(tip.real, d), tip.imag - z)
        low, high = self._base
        if rho == 0.0:  # any base angle serves
            return row, phi, np.full(len(phi), rest_angle(low, high)), miss
        yaw, inside = _into(self.geometry.yaw_sign * (math.atan2(y, x) - np.arctan2(d, tip.real)), low, high)
        return row, phi, yaw, np.where(inside, miss, np.inf)

    def _minima(self, circles: _Circles, rho: float, z: float) -> tuple[NDArray[np.intp], FloatArray]:
        """Circle and phi of every minimum of the distance from a ring of radius rho at height z."""
        d, size = self.geometry.lateral, np.abs(circles.arm)

        def slope(row: NDArray[np.intp], phi: FloatArray) -> FloatArray:
            """Half the derivative of the squared distance over phi."""
            lever = circles.arm[row] * np.exp(1j * phi)
            tip = circles.centre[row] + lever
            w = np.maximum(np.hypot(tip.real, d), 1e-300)
            return (rho - w) * (tip.real / w) * lever.imag + (tip.imag - z) * lever.real

        every = np.arange(len(size))
        # where a circle passes over the base axis two minima may lie close together: sample there too
        over = np.clip(-circles.centre.real / np.maximum(size, _NO_LENGTH), -1.0, 1.0)
        crossing = np.stack([np.arccos(over), -np.arccos(over)], axis=1) - np.angle(circles.arm)[:, None]
        even = np.broadcast_to(
            np.linspace(-math.pi, math.pi, _SAMPLES, endpoint=False), (len(size), _SAMPLES)
        )
        phi = np.sort(np.concatenate([even, (crossing + math.pi) % TWO_PI - math.pi], axis=1), axis=1)
        phi = np.concatenate([phi, phi[:, :1] + TWO_PI], axis=1)
        value = slope(every[:, None], phi)
        row, at = np.nonzero((value[:, :-1] < 0.0) & (value[:, 1:] >= 0.0))
        low, high = phi[row, at], phi[row, at + 1]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            falling = slope(row, middle) < 0.0
            low, high = np.where(falling, middle, low), np.where(falling, high, middle)
        still = np.flatnonzero(size < _NO_LENGTH)  # every joint at a limit: nothing turns
        return np.concatenate([row, still]), np.concatenate([0.5 * (low + high), np.zeros(len(still))])

    def _at_tool_angle(self, tool_angle: float) -> Iterator[PlaneCircle]:
        """The circles with the last link's direction kept: two links turn, the third joint makes up."""
        if len(self.geometry.lengths) != 3:
            return
        l2, l3, l4 = self.geometry.lengths
        hand = l4 * cmath.exp(1j * tool_angle)
        limits2, limits3, limits4 = self._plane

        def circle(
            centre: complex, arm: complex, first: tuple[float, float], second: tuple[float, float]
        ) -> PlaneCircle:
            (c2, s2), (c3, s3) = first, second
            return PlaneCircle(hand + centre, arm, (c2, c3, tool_angle - c2 - c3), (s2, s3, -s2 - s3))

        headings = [tool_angle - v for v in limits4]  # of the second link, with the third joint at a limit
        yield circle(0j, complex(l2 + l3), (0.0, 1.0), (0.0, 0.0))
        yield circle(0j, complex(l2 - l3), (0.0, 1.0), (math.pi, 0.0))
        for v in limits2:
            yield circle(l2 * cmath.exp(1j * v), complex(l3), (v, 0.0), (-v, 1.0))
        for v in limits3:
            yield circle(0j, l2 + l3 * cmath.exp(1j * v), (0.0, 1.0), (v, 0.0))
        for heading in headings:
            yield circle(l3 * cmath.exp(1j * heading), complex(l2), (0.0, 1.0), (heading, -1.0))
        corners = [*itertools.product(limits2, limits3), *((v, h - v) for v in limits2 for h in headings)]
        for t2, t3 in [*corners, *((h - v, v) for v in limits3 for h in headings)]:
            tip = l2 * cmath.exp(1j * t2) + l3 * cmath.exp(1j * (t2 + t3))
            yield circle(tip, 0j, (t2, 0.0), (t3, 0.0))


def _into(angle: FloatArray, low: float, high: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Images of angles nearest to the middle of their limits, clipped onto them, and which are inside."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    near = angle - TWO_PI * np.rint((angle - middle) / TWO_PI)
    return np.clip(near, low, high), np.abs(near - middle) <= half + LIMIT_TOLERANCE
