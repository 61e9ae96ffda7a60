"""The tool's way as geometry alone: a line, an arc or a spline in the base frame, over the metres gone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics.target import Target
from armctl.motion.polynomial import PiecewisePolynomial

NO_WAY_M = 1e-7
"""points nearer to each other than this count as one: a thousandth of what any of these arms can do [m]"""
_FLAT = 1e-6
"""sine of the angle at which three points count as standing on one line"""


class ToolLine:
    """A straight line between two points (3,) [m]. Immutable."""

    kind = "line"

    def __init__(self, start: ArrayLike, end: ArrayLike) -> None:
        self.start, self.end = Target.of(start).position, Target.of(end).position
        way = self.end - self.start
        length = float(np.linalg.norm(way))
        still = length < NO_WAY_M
        self.length = 0.0 if still else length
        """[m]; 0 where the ends count as one point"""
        self.direction: FloatArray = np.zeros(3) if still else way / length
        """(3,) unit vector; zeros where the line has no length"""

    def positions(self, s: float | FloatArray) -> FloatArray:
        """Tool points (..., 3) [m] at ``s`` (...) [m]; not held beyond the ends."""
        return self.start + np.asarray(s, dtype=np.float64)[..., None] * self.direction

    def derivatives(self, s: float | FloatArray) -> FloatArray:
        """(3, ..., 3) at ``s`` (...) [m]: point [m], unit direction, curvature vector [1/m]."""
        points = self.positions(s)
        found = np.zeros((3, *points.shape))
        found[0], found[1] = points, self.direction
        return found


class ToolArc:
    """A circular arc over three points (3,) [m], start, via and end. Immutable.

    With t ``along`` and n ``inward`` the place is ``start + R (sin(s/R) t + (1 - cos(s/R)) n)``: this keeps
    its digits however large the radius is.
    Raises ``InputError``: a point that is not three finite numbers, two points that are one, or three on a
    line.
    """

    kind = "arc"

    def __init__(self, start: ArrayLike, via: ArrayLike, end: ArrayLike) -> None:
        a, b, c = (Target.of(point).position for point in (start, via, end))
        for first, second, names in ((a, b, "start and via"), (b, c, "via and end"), (a, c, "start and end")):
            if np.linalg.norm(second - first) < NO_WAY_M:
                raise InputError(
                    f"the {names} points of an arc are the same point ({_mm(first)}); "
                    "an arc needs three that differ"
                )
        to_via, to_end = b - a, c - a
        normal = np.cross(to_via, to_end)
        size = float(np.linalg.norm(normal))
        if size < _FLAT * float(np.linalg.norm(to_via) * np.linalg.norm(c - b)):
            raise InputError(
                f"the points of the arc, start ({_mm(a)}), via ({_mm(b)}) and end ({_mm(c)}), stand on one "
                "line; move the via point aside, or use a line"
            )
        normal /= size
        to_centre = np.cross(to_via @ to_via * to_end - to_end @ to_end * to_via, normal) / (2.0 * size)
        self.start: FloatArray = a
        self.radius = float(np.linalg.norm(to_centre))
        """[m]"""
        self.inward: FloatArray = to_centre / self.radius
        """(3,) unit direction from the start to the centre"""
        self.along: FloatArray = np.cross(self.inward, normal)
        """(3,) unit direction at the start"""
        x, y = float(to_end @ self.along), self.radius - float(to_end @ self.inward)
        self.sweep = math.atan2(x, y) % (2.0 * math.pi)
        """angle of the arc [rad], in 0 … 2 pi"""
        self.length = self.radius * self.sweep
        """[m]"""

    def positions(self, s: float | FloatArray) -> FloatArray:
        """As ``ToolLine.positions``."""
        angle = np.asarray(s, dtype=np.float64)[..., None] / self.radius
        rise = 2.0 * np.sin(0.5 * angle) ** 2
        return self.start + self.radius * (np.sin(angle) * self.along + rise * self.inward)

    def derivatives(self, s: float | FloatArray) -> FloatArray:
        """As ``ToolLine.derivatives``."""
        angle = np.asarray(s, dtype=np.float64)[..., None] / self.radius
        cos, sin = np.cos(angle), np.sin(angle)
        direction = cos * self.along + sin * self.inward
        curvature = (cos * self.inward - sin * self.along) / self.radius
        return np.stack([self.positions(s), direction, curvature])


class ToolSpline:
    """A smooth curve in space, polynomials in pieces over about the metres gone. Immutable."""

    kind = "stroke"

    def __init__(self, curve: PiecewisePolynomial) -> None:
        """``curve``: three coordinates [m] over 0 … its length [m], smooth to the second derivative."""
        self.curve = curve
        self.length = curve.high
        """[m]"""

    def positions(self, s: float | FloatArray) -> FloatArray:
        """As ``ToolLine.positions``."""
        return self.curve(s)

    def derivatives(self, s: float | FloatArray) -> FloatArray:
        """As ``ToolLine.derivatives``; the direction is shorter than 1 where a corner is rounded."""
        return self.curve.derivatives(s, 2)


ToolCurve = ToolLine | ToolArc | ToolSpline


def _mm(point: FloatArray) -> str:
    x, y, z = (1000.0 * point).tolist()
    return f"{x:.2f}, {y:.2f}, {z:.2f} mm"
