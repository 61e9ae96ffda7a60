"""Geometry that solver families share: vectors turned about axes, and the angles that meet a condition.

With the subproblems of Paden (1985), Kahan (1983), and A. J. Elias and J. T. Wen, "IK-Geo: Unified robot
inverse kinematics using subproblem decomposition" (2022), section 3, of which there are here

    1:  Rot(k, θ) p = q                                     ``angle_about``, ``angle_onto``
    3:  |Rot(k, θ) p - q| = d, 4:  h · Rot(k, θ) p = d      ``circle_angles``; ``circle`` and ``roots``
    5 and 6:  two conditions for two angles                 ``two_turns``, ``two_turns_of_many``

Axes are unit vectors in any position to each other. One problem is worked in plain floats, for which numpy
would take ten times as long.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import wrap
from armctl.lazy_dataclass import dataclass

TOLERANCE = 1e-10
"""what a condition may be missed by and still count as met, in the unit of the vectors"""
_STILL = 1e-12
"""how near to its axis a vector does not move when the axis turns, in its own length"""
_PARALLEL = 1e-6
"""sine of the angle below which two axes have no place where they meet"""
_SAME = 1e-7
"""angles this near to each other are one [rad]"""


class AnglePairs(NamedTuple):
    """Angles that meet two conditions."""

    angles: tuple[tuple[float, ...], ...]
    """pairs of angles [rad], in (-pi, pi]; empty where nothing meets the conditions"""
    free: tuple[int, ...] = ()
    """indices of the rotations that may be at any angle, so that there is a continuum; the angles given
    are one of it. With two indices, the one angle hangs on the other."""


# Vectors as three entries: floats, or arrays of as many vectors as there are. Arrays (m, 3) take far longer.

Columns = Sequence[Any] | NDArray[Any]
"""x, y and z of vectors: an array each, or a float that all have in common"""


def columns(v: FloatArray) -> Columns:
    """Of one vector (3,) or of many (m, 3)."""
    return v.tolist() if v.ndim == 1 else list(np.ascontiguousarray(v.T))


def dot(a: Columns, b: Columns) -> Any:
    """``a · b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Columns, b: Columns) -> tuple[Any, Any, Any]:
    """``a x b``."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def added(a: Columns, b: Columns, factor: float = 1.0) -> tuple[Any, Any, Any]:
    """``a + factor · b``."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def scaled(a: Columns, factor: Any) -> tuple[Any, Any, Any]:
    """``factor · a``."""
    return factor * a[0], factor * a[1], factor * a[2]


def length(a: Columns) -> FloatArray:
    """Of each vector."""
    return np.sqrt(dot(a, a))


CosSin = tuple[FloatArray, FloatArray]


def back(turn: CosSin) -> CosSin:
    """Cosine and sine of the turn the other way."""
    return turn[0], -turn[1]


def turned_by(v: Columns, axis: Columns, turn: CosSin) -> tuple[Any, Any, Any]:
    """Vectors turned about unit axes, by the cosines and sines of the angles (Rodrigues)."""
    c, s = turn
    along, across = (1.0 - c) * dot(axis, v), cross(axis, v)
    return (
        c * v[0] + s * across[0] + along * axis[0],
        c * v[1] + s * across[1] + along * axis[1],
        c * v[2] + s * across[2] + along * axis[2],
    )


def angle_onto(axis: Columns, start: Columns, end: Columns) -> FloatArray:
    """Subproblem 1: turns about unit axes that bring vectors onto others [rad], short ones too."""
    start, end = (added(v, scaled(axis, dot(axis, v)), -1.0) for v in (start, end))
    return np.arctan2(dot(axis, cross(start, end)), dot(start, end))


def meeting_point(points: FloatArray, axes: FloatArray, within: float) -> FloatArray | None:
    """The point (3,) in which lines meet ``within`` [m], through points (k, 3) along unit axes (k, 3).

    None where they do not; neighbours that are parallel do not meet either.
    """
    if np.linalg.norm(np.cross(axes[1:], axes[:-1]), axis=1).min() < _PARALLEL:
        return None
    levels: FloatArray = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    right = np.einsum("kij,kj->ki", levels, points)
    point = np.asarray(np.linalg.lstsq(levels.reshape(-1, 3), right.ravel(), rcond=None)[0], dtype=np.float64)
    missed = np.linalg.norm(np.einsum("kij,kj->ki", levels, points - point), axis=1)
    return point if missed.max() <= within else None


def circle_angles(a: float, b: float, c: float, value: float) -> tuple[tuple[float, ...], float]:
    """The angles [rad] at which ``a + b cos θ + c sin θ`` has a value, and by how much it misses that.

    One angle at the ends of the range, and beyond them, where it is missed. The half-angle form keeps its
    digits where an arc cosine loses them.
    """
    size, off = math.hypot(b, c), value - a
    middle = math.atan2(c, b)
    near, far = size - off, size + off
    if near <= 0.0:
        return (middle,), -near
    if far <= 0.0:
        return (wrap(middle + math.pi),), -far
    away = 2.0 * math.atan2(math.sqrt(near), math.sqrt(far))
    return (wrap(middle + away), wrap(middle - away)), 0.0


# Two angles of two conditions.

_Pair = tuple[float, float]
_Matrix = tuple[_Pair, _Pair]
_BAND = 1e-2
"""how far off the unit circle a root may lie: rounding splits double ones, and the others are dropped"""
_NEWTON = 8
_SPREAD = 24


def two_turns(A: _Matrix, B: _Matrix, c: _Pair, tolerance: float = TOLERANCE) -> AnglePairs:
    """Angles with ``A (cos θ1, sin θ1) + B (cos θ2, sin θ2) = c``: up to four pairs.

    One angle is eliminated by its unit length, the one whose matrix has the larger determinant. What is left,
    ``|adj(B) (c - A u)|² = det(B)²``, is of degree 2 in exp(i θ1): four roots, which Newton steps in both
    angles make exact.
    """
    still_a, still_b = _size(A) <= _STILL * _size(B), _size(B) <= _STILL * _size(A)
    if still_a or still_b:
        angles = _one_turn(B if still_a else A, c, tolerance)
        pairs = tuple((0.0, x) if still_a else (x, 0.0) for x in angles)
        return AnglePairs(pairs, (0,) if still_a else (1,))
    if abs(_determinant_of(A)) > abs(_determinant_of(B)):
        answer = _two_turns(B, A, c, tolerance)
        return answer._replace(angles=tuple((x, y) for y, x in answer.angles))
    return _two_turns(A, B, c, tolerance)


def _two_turns(A: _Matrix, B: _Matrix, c: _Pair, tolerance: float) -> AnglePairs:
    firsts, anywhere = _eliminated(A, B, c)
    met: list[_Pair] = []
    for first, second in _starts(A, B, c, firsts):
        pair, missed = _descended(A, B, c, first, second)
        if missed <= tolerance and all(_apart(pair, other) > _SAME for other in met):
            met.append(pair)
    if anywhere and met:  # the angles hang on each other
        return AnglePairs((met[0],), (0, 1))
    return AnglePairs(tuple(met))


def _eliminated(A: _Matrix, B: _Matrix, c: _Pair) -> tuple[list[float], bool]:
    """Angles θ1 that may have a θ2 [rad], and whether every θ1 has."""
    (a, b), (d, e) = B
    det = a * e - b * d
    # w = adj(B) (c - A u) = w0 + F u
    w = e * c[0] - b * c[1], a * c[1] - d * c[0]
    (p, q), (r, s) = A
    F = (b * r - e * p, b * s - e * q), (d * p - a * r, d * q - a * s)
    g11, g22 = F[0][0] ** 2 + F[1][0] ** 2, F[0][1] ** 2 + F[1][1] ** 2
    g12 = F[0][0] * F[0][1] + F[1][0] * F[1][1]
    constant = w[0] * w[0] + w[1] * w[1] - det * det + 0.5 * (g11 + g22)
    first = complex(w[0] * F[0][0] + w[1] * F[1][0], -(w[0] * F[0][1] + w[1] * F[1][1]))
    second = 0.5 * complex(0.5 * (g11 - g22), -g12)
    scale = max(w[0] * w[0] + w[1] * w[1], det * det, g11, g22)
    if abs(constant) + 2.0 * (abs(first) + abs(second)) <= 1e-13 * scale:
        return [math.pi * k / _SPREAD for k in range(-_SPREAD, _SPREAD)], True
    if abs(second) <= 1e-13 * scale:
        return list(circle_angles(constant, 2.0 * first.real, -2.0 * first.imag, 0.0)[0]), False
    z = np.roots([second, first, constant, first.conjugate(), second.conjugate()])
    return np.angle(z[np.abs(np.abs(z) - 1.0) < _BAND]).tolist(), False


def _starts(A: _Matrix, B: _Matrix, c: _Pair, firsts: Sequence[float]) -> Iterator[_Pair]:
    """Both θ2 that a θ1 has by the condition in which θ2 counts more."""
    i = 0 if math.hypot(*B[0]) >= math.hypot(*B[1]) else 1
    for first in firsts:
        u = math.cos(first), math.sin(first)
        rest = c[i] - A[i][0] * u[0] - A[i][1] * u[1]
        for second in circle_angles(0.0, *B[i], rest)[0]:
            yield first, second


def _descended(A: _Matrix, B: _Matrix, c: _Pair, x: float, y: float) -> tuple[_Pair, float]:
    """Where Newton steps lead from a pair of angles, and by how much it misses the conditions."""
    r0, r1, missed = _missed(A, B, c, x, y)
    for _ in range(_NEWTON):
        sx, cx, sy, cy = math.sin(x), math.cos(x), math.sin(y), math.cos(y)
        j00, j01 = A[0][1] * cx - A[0][0] * sx, B[0][1] * cy - B[0][0] * sy
        j10, j11 = A[1][1] * cx - A[1][0] * sx, B[1][1] * cy - B[1][0] * sy
        det, size = j00 * j11 - j01 * j10, j00 * j00 + j01 * j01 + j10 * j10 + j11 * j11
        if abs(det) > 1e-10 * size:
            new_x, new_y = x - (j11 * r0 - j01 * r1) / det, y - (j00 * r1 - j10 * r0) / det
        else:  # near a double root J has no inverse: (JᵀJ + small) step = -Jᵀr
            h00, h01, h11 = j00 * j00 + j10 * j10, j00 * j01 + j10 * j11, j01 * j01 + j11 * j11
            h00, h11 = h00 + 1e-15 * size, h11 + 1e-15 * size
            g0, g1 = j00 * r0 + j10 * r1, j01 * r0 + j11 * r1
            det = h00 * h11 - h01 * h01
            if det <= 0.0:
                break
            new_x, new_y = x - (h11 * g0 - h01 * g1) / det, y - (h00 * g1 - h01 * g0) / det
        s0, s1, fewer = _missed(A, B, c, new_x, new_y)
        if not fewer < missed:
            break
        x, y, r0, r1, missed = new_x, new_y, s0, s1, fewer
    return (wrap(x), wrap(y)), missed


def _missed(A: _Matrix, B: _Matrix, c: _Pair, x: float, y: float) -> tuple[float, float, float]:
    cx, sx, cy, sy = math.cos(x), math.sin(x), math.cos(y), math.sin(y)
    r0 = A[0][0] * cx + A[0][1] * sx + B[0][0] * cy + B[0][1] * sy - c[0]
    r1 = A[1][0] * cx + A[1][1] * sx + B[1][0] * cy + B[1][1] * sy - c[1]
    return r0, r1, math.hypot(r0, r1)


def _one_turn(B: _Matrix, c: _Pair, tolerance: float) -> list[float]:
    """Angles with ``B (cos θ, sin θ) = c``."""
    i = 0 if math.hypot(*B[0]) >= math.hypot(*B[1]) else 1
    none = (0.0, 0.0), (0.0, 0.0)
    angles = circle_angles(0.0, *B[i], c[i])[0]
    return [angle for angle in angles if _missed(none, B, c, 0.0, angle)[2] <= tolerance]


def _determinant_of(M: _Matrix) -> float:
    return M[0][0] * M[1][1] - M[0][1] * M[1][0]


def _size(M: _Matrix) -> float:
    return math.hypot(*M[0], *M[1])


def _apart(a: _Pair, b: _Pair) -> float:
    return max(abs(wrap(x - y)) for x, y in zip(a, b, strict=True))


# For arrays of problems: vectors (..., 3), unit axes (3,), angles (...).

Circle = tuple[FloatArray, FloatArray, FloatArray]
"""A, B and C of ``A + B cos x + C sin x``, (...) each"""
_UNMOVED = 1e-11
"""a vector that lies this near to an axis does not move when the axis turns (unit vectors)"""


def across(axis: FloatArray) -> FloatArray:
    """The matrix (3, 3) of ``axis x``."""
    x, y, z = axis.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def turn(axis: FloatArray, angle: FloatArray | float) -> FloatArray:
    """Rotations (..., 3, 3) about a unit axis by angles (...) [rad] (Rodrigues)."""
    K = across(axis)
    c, s = np.cos(angle)[..., None, None], np.sin(angle)[..., None, None]
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def turned(v: FloatArray, axis: FloatArray, angle: FloatArray | float) -> FloatArray:
    """Vectors (..., 3), each turned about a unit axis by its own angle (...) [rad]."""
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    sideways = v @ across(axis).T
    return v + s * sideways + (1.0 - c) * (sideways @ across(axis).T)


def circle(axis: FloatArray, turning: FloatArray, fixed: FloatArray) -> Circle:
    """``fixed · Rot(axis, x) turning`` of vectors (..., 3) over x."""
    sideways = turning @ across(axis).T
    level = sideways @ across(axis)
    a, cosine, sine = (np.einsum("...i,...i->...", fixed, v) for v in (turning - level, level, sideways))
    return a, cosine, sine


def angle_about(axis: FloatArray, start: FloatArray, end: FloatArray, rest: float = 0.0) -> FloatArray:
    """Subproblem 1: turns about a unit axis [rad] that bring vectors (..., 3) onto others.

    ``rest`` where the axis does not move them.
    """
    _, cosine, sine = circle(axis, start, end)
    still = np.linalg.norm(start @ across(axis).T, axis=-1) < _UNMOVED
    return np.where(still, rest, np.arctan2(sine, cosine))


def roots(circle: Circle, value: FloatArray | float, tolerance: float, rest: float = math.nan) -> FloatArray:
    """Subproblem 4: both angles (2, ...) [rad] at which a circle has a value (...); NaN where none does.

    Of unit vectors. A value beyond the range by no more than ``tolerance`` counts as its end. Where every
    angle serves, the first is ``rest`` and there is no second.
    """
    a, b, c = circle
    size, off = np.hypot(b, c), value - a
    away = 2.0 * np.arctan2(np.sqrt(np.maximum(0.0, size - off)), np.sqrt(np.maximum(0.0, size + off)))
    middle, still = np.arctan2(c, b), size <= _UNMOVED
    both = np.stack([np.where(still, rest, middle + away), np.where(still, math.nan, middle - away)])
    return np.where(np.abs(off) <= size + tolerance, both, math.nan)


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles [rad] in 0..pi from vectors (..., 3) to one (3,), accurate also near 0 and pi."""
    return np.arctan2(np.linalg.norm(a @ across(b), axis=-1), a @ b)


def two_turns_of_many(
    A: FloatArray, B: FloatArray, c: FloatArray, tolerance: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """``two_turns`` of arrays: A, B (m, 2, 2) and c (m, 2) of ``A (cos x, sin x) + B (cos y, sin y) = c``.

    Returns up to four pairs x, y (m, 4, 2) [rad], NaN where there are fewer, and where one may be at any
    angle (m,): there it is at 0. A second row of zeros in all of A or B splits the conditions. Others are
    solved one by one.
    """
    if not A[:, 1].any():
        y = roots((np.zeros(len(c)), B[:, 1, 0], B[:, 1, 1]), c[:, 1], tolerance, 0.0)
        rest = c[:, 0] - B[:, 0, 0] * np.cos(y) - B[:, 0, 1] * np.sin(y)
        x = roots((np.zeros(len(c)), A[:, 0, 0], A[:, 0, 1]), rest, tolerance, 0.0)
        pairs = np.stack([x, np.broadcast_to(y, x.shape)], axis=-1)
        free = (np.linalg.norm(B[:, 1], axis=1) <= _UNMOVED) & ~np.isnan(y[0])
        return np.moveaxis(pairs.reshape(4, len(c), 2), 0, 1), free
    if not B[:, 1].any():
        pairs, free = two_turns_of_many(B, A, c, tolerance)
        return pairs[..., ::-1], free
    pairs, free = np.full((len(c), 4, 2), math.nan), np.zeros(len(c), dtype=np.bool_)
    for i, problem in enumerate(zip(A.tolist(), B.tolist(), c.tolist(), strict=True)):
        answer = two_turns(*problem, tolerance)
        if answer.angles:
            pairs[i, : len(answer.angles)] = answer.angles[:4]
            free[i] = bool(answer.free)
    return pairs, free


# The vertical plane in which parallel pitch joints move the tool; the first joint turns it.
#
#     x + i y = exp(i s1 θ1) (r + i d)              d: lateral offset, constant
#     (r - a1) + i (z - h) = Σ_k l_k exp(i (t_1 + … + t_k))      k over the pitch joints
#
# where ``t_k = s_k θ_k + o_k`` is the plane angle of joint k: s_k = ±1 is the sense of its axis, o_k the
# bend between the links at θ_k = 0.


@dataclass(frozen=True)
class ToolPlane:
    """Where the pitch joints move the tool: lengths in metres, angles in radians."""

    origin: FloatArray
    """(3,) a point on the base axis, base frame"""
    frame: FloatArray
    """(3, 3) columns: forward, left, up at θ1 = 0, base frame"""
    yaw_sign: int
    lateral: float
    """d: how far the tool plane lies to the left of the base axis"""
    shoulder: complex
    """a1 + i h: first pitch axis in the tool plane"""
    lengths: tuple[float, ...]
    """l_k of the 2 or 3 links between the pitch joints and to the tool point"""
    signs: tuple[int, ...]
    """s_k of the pitch joints"""
    offsets: tuple[float, ...]
    """o_k of the pitch joints, in (-pi, pi]"""
    tool_angle: float | None
    """angle of the approach axis above the last link; None: it leaves the plane, so pitch means nothing"""
    roll_joint: int | None
    """index of the joint that rolls the tool about an axis through the tool point"""

    @property
    def pitch_joints(self) -> tuple[int, ...]:
        """Indices of the parallel pitch joints."""
        return tuple(range(1, 1 + len(self.lengths)))

    def plane_angle(self, k: int, joint_angle: float) -> float:
        """t_k of pitch joint k (0 is the shoulder) at a joint angle."""
        return self.signs[k] * joint_angle + self.offsets[k]

    def joint_angle(self, k: int, plane_angle: float) -> float:
        """θ of pitch joint k at a plane angle t_k; not wrapped."""
        return self.signs[k] * (plane_angle - self.offsets[k])

    def plane_limits(self, k: int, limits: FloatArray) -> tuple[float, float]:
        """Limits of t_k from the joint limits (n, 2)."""
        ends = [self.plane_angle(k, float(limits[1 + k, side])) for side in (0, 1)]
        return min(ends), max(ends)

    def way_to_circle(self, rho: float, z: float, radius: float, hand: complex = 0j) -> float:
        """How far a point at ``rho`` from the base axis is from what a circle about the shoulder sweeps [m].

        ``hand``: from the circle to the tool point, where the tool keeps its pitch. The plane stands beside
        the axis and turns about it, so the shortest way lies in none of its poses.
        """
        centre, reach, count = 0.0, math.pi, 1441
        away = np.empty(0)
        for _ in range(4):
            angles = np.linspace(centre - reach, centre + reach, count)
            tip = self.shoulder + hand + radius * np.exp(1j * angles)
            away = np.hypot(np.hypot(tip.real, self.lateral) - rho, tip.imag - z)
            centre = float(angles[away.argmin()])
            reach, count = 2.0 * reach / (count - 1), 41
        return float(away.min())

    def local_of(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A point of the base frame as forward, left, up coordinates about the base axis [m]."""
        if self.upright:
            return x, y, z
        (x0, y0, z0), (fx, fy, fz), (lx, ly, lz), (ux, uy, uz) = self._floats
        x, y, z = x - x0, y - y0, z - z0
        return fx * x + fy * y + fz * z, lx * x + ly * y + lz * z, ux * x + uy * y + uz * z

    @cached_property
    def _floats(self) -> tuple[tuple[float, ...], ...]:
        """Origin, forward, left and up."""
        return tuple(tuple(row) for row in np.vstack([self.origin, self.frame.T]).tolist())

    @cached_property
    def upright(self) -> bool:
        """True where base coordinates are local ones."""
        return not self.origin.any() and bool((self.frame == np.eye(3)).all())
