"""Three-vectors and quaternions of one rotation, in plain floats: a ufunc call costs more than all of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""w, x, y, z"""


def vector(array: FloatArray) -> Vector:
    """(3,) as a tuple."""
    x, y, z = array.tolist()
    return x, y, z


def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    """``a + factor · b``."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def times(a: Vector, factor: float) -> Vector:
    """``factor · a``."""
    return factor * a[0], factor * a[1], factor * a[2]


def norm(a: Vector) -> float:
    """Length."""
    return math.hypot(*a)


def angle_between(a: Vector, b: Vector) -> float:
    """Angle [rad] in 0..pi, accurate also near 0 and pi."""
    return math.atan2(norm(cross(a, b)), dot(a, b))


def turned(v: Vector, axis: Vector, angle: float) -> Vector:
    """``v`` turned about a unit axis by an angle [rad] (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    along = dot(axis, v) * (1.0 - c)
    x, y, z = cross(axis, v)
    return (
        c * v[0] + s * x + along * axis[0],
        c * v[1] + s * y + along * axis[1],
        c * v[2] + s * z + along * axis[2],
    )


def angle_about(axis: Vector, start: Vector, end: Vector) -> float:
    """The turn about a unit axis [rad] that brings ``start`` onto ``end`` (Paden-Kahan subproblem 1)."""
    return math.atan2(dot(axis, cross(start, end)), dot(start, end) - dot(axis, start) * dot(axis, end))


def circle(axis: Vector, turning: Vector, fixed: Vector) -> tuple[float, float, float]:
    """``fixed · Rot(axis, x) turning`` as (A, B, C) of ``A + B cos x + C sin x``."""
    along = dot(axis, turning) * dot(axis, fixed)
    return along, dot(fixed, turning) - along, dot(fixed, cross(axis, turning))


def any_perpendicular(v: Vector) -> Vector:
    """A unit vector across a unit vector."""
    k = min(range(3), key=lambda i: abs(v[i]))
    across = cross(v, (float(k == 0), float(k == 1), float(k == 2)))
    return times(across, 1.0 / norm(across))


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The rotation ``q``, then ``p``."""
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a rotation."""
    return q[0], -q[1], -q[2], -q[3]


def about(axis: Vector, angle: float) -> Quaternion:
    """The turn about a unit axis by an angle [rad]."""
    s = math.sin(0.5 * angle)
    return math.cos(0.5 * angle), s * axis[0], s * axis[1], s * axis[2]


def rotated(q: Quaternion, v: Vector) -> Vector:
    """``v`` turned by a unit quaternion."""
    w, *u = q
    axis = (u[0], u[1], u[2])
    across = cross(axis, v)
    twice = cross(axis, across)
    return (
        v[0] + 2.0 * (w * across[0] + twice[0]),
        v[1] + 2.0 * (w * across[1] + twice[1]),
        v[2] + 2.0 * (w * across[2] + twice[2]),
    )


def shortest_turn(start: Vector, end: Vector) -> Quaternion:
    """The least rotation that brings one unit vector onto another."""
    if dot(start, end) < -0.5:  # first half a turn across: 1 + start · end loses its digits near -1
        half_turn = about(any_perpendicular(start), math.pi)
        return product(shortest_turn(times(start, -1.0), end), half_turn)
    w = 1.0 + dot(start, end)
    x, y, z = cross(start, end)
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return w / size, x / size, y / size, z / size


def turn_about(q: Quaternion, axis: Vector) -> float:
    """The turn about a unit axis that comes nearest to a rotation [rad]."""
    return 2.0 * math.atan2(q[1] * axis[0] + q[2] * axis[1] + q[3] * axis[2], q[0])


def turn_of(q: Quaternion) -> float:
    """The angle of a rotation [rad] in 0..pi."""
    return 2.0 * math.atan2(math.hypot(q[1], q[2], q[3]), abs(q[0]))
