"""Every posture of a spherical-wrist arm at a pose, joint limits not looked at, in plain floats.

With W at (X, Y, Z) in the frame of the first axis, and u, v, w its place in that of the second one, the
first three joints have to meet (geometry.py; Pieper 1968, eq. 3.26 to 3.32)

    w:            cα1 Z + sα1 (X s1 - Y c1) = d2 + cα2 h + sα2 r s3
    u²+v²+w²:     X²+Y²+Z² + a1² - 2 a1 (X c1 + Y s1) = K + 2 a2 r c3 + 2 d2 sα2 r s3
                  K = a2² + r² + h² + d2² + 2 d2 cα2 h

or the same with any p and q. Where two neighbouring axes are parallel or meet, a sum of them has only one of
θ1 and φ3 (subproblem 3 or 4): two values, and two of the other one for each. Else they are two conditions on
two angles (subproblem 5): up to four pairs. φ2 then turns one side onto the other.

The wrist takes up M = (first three joints)' R: with σ the angle between the fourth axis and the sixth, α, β
and the angle b of the fifth joint make a spherical triangle, ``cos σ = cα cβ - sα sβ cos b``: two values.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import Range, fitted
from armctl.kinematics.families.spherical_wrist.geometry import SphericalWrist
from armctl.kinematics.newton import newton
from armctl.kinematics.subproblems import two_turns

ON_AXIS = 1e-10
"""where W is so near to the axis of the first or second joint, that joint may be at any angle [m]"""
GIMBAL = 2e-10
"""where the fourth and the sixth axis are so nearly along each other, only their sum counts [rad]"""
BEYOND = 1e-10
"""how far beyond the reach rounding may carry W [m], and beyond what the wrist takes up an angle [rad]"""
DOUBLE = 1e-12
"""two roots are one, or nearly, where ``size - |value|`` is less, as a share of the size"""
NEAR = 1e-5
"""where W is nearer to an axis, in lengths of the arm, or the wrist is nearer to its singular pose [rad],
rounding needs more care"""
APART = 1e-3
"""as it does where two postures are so near to each other [rad]"""
_STEPS = 5
ALMOST_HALF_TURN = math.pi - NEAR
CLIPPED = 1e-4
"""how far outside a limit rounding may put an angle [rad]: near a singular pose 1e-16 m are 1e-8 rad"""
Row = tuple[float, float, float, float, float, float]
"""six joint angles [rad]"""
Three = tuple[float, float, float]
Pair = tuple[float, float, int]
"""θ1 and φ3 [rad], and which of the four ways it is"""


class Wrist(NamedTuple):
    """One way in which the wrist takes up a rotation."""

    angles: Three
    """θ4, θ5, θ6 [rad]"""
    flip: int
    """0: the fifth joint is bent in its positive sense; 1: the other way"""
    coupled: float
    """1: any θ4 will do that keeps θ4 + θ6; -1: θ4 - θ6; 0: the angles are what they are"""


class Placed(NamedTuple):
    """A pose in the frame of the first axis."""

    centre: Three
    """W [m]"""
    rotation: tuple[float, ...]
    """``B' R F`` by its columns, nine numbers"""


class ClosedForm:
    """The equations of one arm, with all that does not depend on the pose worked out. Immutable."""

    def __init__(self, geometry: SphericalWrist) -> None:
        g = self.geometry = geometry
        self._set_frames(g)
        self._set_arm(g)
        self._alpha, self._beta = g.wrist
        self.right_angled = max(abs(angle - math.pi / 2) for angle in g.wrist) < 1e-15
        self._unflipped = math.copysign(1.0, math.cos(g.offsets[2]))
        self.first_is_flipped = int(self._unflipped < 0.0)
        self.wrist = (*_cos_sin(g.wrist[0]), *_cos_sin(g.wrist[1]))
        self._sum, self._difference = g.gimbal

    def _set_frames(self, g: SphericalWrist) -> None:
        home, tip = g.home[:3, :3], g.home[:3, 3]
        if g.backward:
            left, right, offset, centre = g.base.T @ home, g.F, tip - g.origin, g.centre
        else:
            left, right, offset, centre = g.base.T, home.T @ g.F, -g.origin, home.T @ (g.centre - tip)
        self.upright = np.abs(left - np.eye(3)).max() == 0.0
        self.left: list[float] = left.ravel().tolist()
        self.right: list[float] = right.ravel().tolist()
        self.offset: list[float] = (g.base.T @ offset).tolist()
        self.centre: list[float] = centre.tolist()
        c, s = g.alpha[1]
        twist = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        self.C: list[float] = g.C.T.ravel().tolist()
        self.twisted: list[float] = (twist @ g.C).T.ravel().tolist()
        """columns of C, and of Rx(α2) C, which follows φ2 ± φ3 where second and third axis are parallel"""

    def _set_arm(self, g: SphericalWrist) -> None:
        ((self.ca1, sa1), (ca2, sa2)), (r, h) = g.alpha, g.hand
        (a1, py, pz), (a2, qy, d2) = g.p.tolist(), g.q.tolist()
        self.v0, self.side = self.ca1 * py + sa1 * pz, qy - sa2 * h
        """what p and q add to v and to the other side of it [m]"""
        self.a1, self.sa1, self.a2, self.ca2, self.sa2, self.d2, self.r, self.h = (
            *(a1, sa1, a2, ca2, sa2, d2, r, h),
        )
        self.w0 = d2 + ca2 * h
        self.k = a2 * a2 + r * r + h * h + d2 * d2 + 2.0 * d2 * ca2 * h - a1 * a1
        p_square, q_square = float(g.p @ g.p), float(g.q @ g.q)
        self._skew_reach = q_square + r * r + h * h + 2.0 * h * (d2 * ca2 - qy * sa2) - p_square
        self.length, self.near = g.reach, NEAR * g.reach
        self.first_comes_first = g.regional in ("parallel-23", "meet-23")
        # the equation with θ1 is (m1 X + m2 Y) c1 + (m1 Y - m2 X) s1 = value
        squares = 2.0 * g.reach * BEYOND
        self.by_height = g.regional in ("parallel-23", "meet-12")
        self.m1, self.m2 = (0.0, -sa1) if self.by_height else (-2.0 * a1, 0.0)
        self.first_beyond = BEYOND if self.by_height else squares
        if g.regional == "meet-23":  # of the two conditions the second less 2 d2 times the first
            self.m2 = 2.0 * d2 * sa1
        third = (2.0 * a2 * r, 2.0 * d2 * sa2 * r) if self.by_height else (0.0, sa2 * r)
        self.third_beyond = squares if self.by_height else BEYOND
        self.third_size, self.third_middle = math.hypot(*third), math.atan2(third[1], third[0])
        self.named = g.regional == "parallel-23" and not g.backward
        """whether front and back, elbow up and down have a meaning: the first of each comes first"""
        up = -1.0 if g.base[2, 2] < -0.1 else 1.0
        self.front = -math.copysign(1.0, sa1) if self.named else 1.0
        self.elbow_up = -math.copysign(1.0, ca2 * sa1 * up) if self.named else 1.0

    def place(self, point: Sequence[float], rotation: FloatArray) -> Placed:
        """A tool pose, point [m] and (3, 3), in the frame of the first axis."""
        a, b, c, d, e, f, g, h, i = rotation.ravel().tolist()
        x, y, z = point
        ox, oy, oz = self.offset
        u, v, w = self.centre
        backward = self.geometry.backward
        if backward:
            b, d, c, g, f, h = d, b, g, c, h, f
            u, v, w = u - x, v - y, w - z
        if not self.upright:
            j, k, l, m, n, o, p, q, r = self.left  # noqa: E741
            a, d, g = j * a + k * d + l * g, m * a + n * d + o * g, p * a + q * d + r * g
            b, e, h = j * b + k * e + l * h, m * b + n * e + o * h, p * b + q * e + r * h
            c, f, i = j * c + k * f + l * i, m * c + n * f + o * i, p * c + q * f + r * i
            if not backward:
                x, y, z = j * x + k * y + l * z, m * x + n * y + o * z, p * x + q * y + r * z
        if not backward:
            ox, oy, oz = ox + x, oy + y, oz + z
        centre = ox + a * u + b * v + c * w, oy + d * u + e * v + f * w, oz + g * u + h * v + i * w
        j, k, l, m, n, o, p, q, r = self.right  # noqa: E741
        return Placed(
            centre,
            (
                a * j + b * m + c * p, d * j + e * m + f * p, g * j + h * m + i * p,
                a * k + b * n + c * q, d * k + e * n + f * q, g * k + h * n + i * q,
                a * l + b * o + c * r, d * l + e * o + f * r, g * l + h * o + i * r,
            ),
        )  # fmt: skip

    def pairs(self, centre: Three) -> tuple[list[Pair], bool]:
        """Every θ1 and φ3 [rad] that hold W at a point [m], with the way's index: 2 · shoulder + elbow.

        And whether rounding needs care: two ways are nearly one, or W is near the first axis.
        """
        X, Y, Z = centre
        square = X * X + Y * Y
        whole = square + Z * Z
        if self.geometry.regional == "skew":
            found, care = self._skew_pairs(X, Y, Z, whole)
            return found, care or square < self.near * self.near
        b, c = self.m1 * X + self.m2 * Y, self.m1 * Y - self.m2 * X
        size, middle = math.sqrt(b * b + c * c), math.atan2(c, b)
        care = square < self.near * self.near
        found: list[Pair] = []
        third_size, third_middle, up = self.third_size, self.third_middle, self.elbow_up
        if self.first_comes_first:
            if self.by_height:
                value = self.w0 - self.ca1 * Z
            else:
                value = self.k - whole + 2.0 * self.d2 * (self.ca1 * Z - self.w0)
            away, close = _away(size, value, self.first_beyond)
            care = care or close
            sign = self.front
            for shoulder in (0, 2) if 0.0 < away < math.pi else (0,) if away >= 0.0 else ():
                first = middle + sign * away
                c1, s1 = math.cos(first), math.sin(first)
                if self.by_height:
                    value = whole - 2.0 * self.a1 * (X * c1 + Y * s1) - self.k
                else:
                    value = self.ca1 * Z + self.sa1 * (X * s1 - Y * c1) - self.w0
                bend, close = _away(third_size, value, self.third_beyond)
                care = care or close
                if bend >= 0.0:
                    found.append((first, third_middle + up * bend, shoulder))
                    if 0.0 < bend < math.pi:
                        found.append((first, third_middle - up * bend, shoulder + 1))
                sign, up = -sign, -up if self.named else up
            return found, care
        value = whole - self.k if self.by_height else self.ca1 * Z - self.w0
        bend, close = _away(third_size, value, self.third_beyond)
        care = care or close
        for elbow in (0, 1) if 0.0 < bend < math.pi else (0,) if bend >= 0.0 else ():
            third = third_middle + (-bend if elbow else bend)
            c3, s3 = math.cos(third), math.sin(third)
            if self.by_height:
                value = self.w0 + self.sa2 * self.r * s3 - self.ca1 * Z
            else:
                value = self.k - whole + 2.0 * self.r * (self.a2 * c3 + self.d2 * self.sa2 * s3)
            away, close = _away(size, value, self.first_beyond)
            care = care or close
            if away >= 0.0:
                found.append((middle + away, third, elbow))
                if 0.0 < away < math.pi:
                    found.append((middle - away, third, 2 + elbow))
        return found, care

    def quick(self, placed: Placed, limits: Sequence[Range]) -> tuple[list[Row], list[int]] | None:
        """Postures inside limits, in the geometry's order, and their branches; None: it needs care."""
        pairs, care = self.pairs(placed.centre)
        if care:
            return None
        range1, range2, range3, range4, range5, range6 = limits
        o2, o3, o5 = self.geometry.offsets
        a2, ca2, sa2, r = self.a2, self.ca2, self.sa2, self.r
        side, parallel, right = self.side, sa2 == 0.0, self.right_angled
        xx, xy, xz, yx, yy, yz, zx, zy, zz = self.twisted if parallel else self.C
        atan2, cos, sin, rows, branches = math.atan2, math.cos, math.sin, list[Row](), list[int]()
        previous, seen = math.nan, tuple([0.0] * 12)
        for first, third, way in pairs:
            if first != previous:
                previous, seen = first, self._ahead_of_second(first, placed, range1)
            q1, u, v, px, py, pz, qx, qy, qz, rx, ry, rz = seen
            if q1 != q1:
                continue
            square, c3, s3 = u * u + v * v, cos(third), sin(third)
            g, h = a2 + r * c3, ca2 * r * s3 + side
            if square < self.near * self.near:
                return None
            c2, s2 = (g * u + h * v) / square, (g * v - h * u) / square
            q2, q3 = fitted(atan2(s2, c2) - o2, range2), fitted(third - o3, range3)
            if q2 != q2 or q3 != q3:
                continue
            if parallel:  # both turn about the same direction
                c2, s2 = c2 * c3 - s2 * (ca2 * s3), s2 * c3 + c2 * (ca2 * s3)
                tx, ty, tz, ex, ey, ez, dx, dy, dz = zx, zy, zz, xx, xy, xz, yx, yy, yz
            else:
                tx, ty, tz = _through(c3, s3, ca2, sa2, zx, zy, zz)
                ex, ey, ez = _through(c3, s3, ca2, sa2, xx, xy, xz)
                dx, dy, dz = _through(c3, s3, ca2, sa2, yx, yy, yz)
            # of M = (ex, dx, tx ..)' (p q r) only the third row and the third column are needed
            tx, ty = c2 * tx - s2 * ty, s2 * tx + c2 * ty
            m31, m32 = tx * px + ty * py + tz * pz, tx * qx + ty * qy + tz * qz
            m33 = tx * rx + ty * ry + tz * rz
            wx, wy = c2 * rx + s2 * ry, c2 * ry - s2 * rx
            m13, m23 = ex * wx + ey * wy + ez * rz, dx * wx + dy * wy + dz * rz
            if (level := math.sqrt(m13 * m13 + m23 * m23)) < NEAR:
                return None
            fourth, sixth = atan2(m23, m13), -atan2(m32, m31)
            if right:
                bend = atan2(level, -m33)
                ways = (bend, fourth, sixth), (-bend, fourth + math.pi, sixth + math.pi)
            else:
                bend = self._bend(atan2(level, m33))
                if bend < 0.0:
                    continue
                if not NEAR < bend < ALMOST_HALF_TURN:
                    return None
                ways = self._skew_wrist(bend, fourth, sixth)
            branch = 2 * way + self.first_is_flipped
            for b, q4, q6 in ways:
                q4, q5, q6 = fitted(q4, range4), fitted(b - o5, range5), fitted(q6, range6)
                if q4 == q4 and q5 == q5 and q6 == q6:
                    rows.append((q1, q2, q3, q4, q5, q6))
                    branches.append(branch)
                branch ^= 1
        return None if any(math.inf in row for row in rows) else (rows, branches)

    def _skew_wrist(self, bend: float, fourth: float, sixth: float) -> tuple[tuple[float, float, float], ...]:
        """θ5, θ4 and θ6 [rad] of both ways of a wrist whose axes are not at right angles."""
        ca, sa, cb, sb = self.wrist
        c, s = math.cos(bend), math.sin(bend)
        k13, k23, k31, k32 = s * sb, -(ca * c * sb + sa * cb), sa * s, sa * c * cb + ca * sb
        return (
            (bend, fourth - math.atan2(k23, k13), sixth + math.atan2(k32, k31)),
            (-bend, fourth - math.atan2(k23, -k13), sixth + math.atan2(k32, -k31)),
        )

    def _ahead_of_second(self, first: float, placed: Placed, limits: Range) -> tuple[float, ...]:
        """Of θ1 [rad] its fitted angle, u and v [m], and the rotation's columns in the second frame."""
        (X, Y, Z), (px, py, pz, qx, qy, qz, rx, ry, rz) = placed
        ca, sa = self.ca1, self.sa1
        c, s = math.cos(first), math.sin(first)
        px, py = px * c + py * s, py * c - px * s
        qx, qy = qx * c + qy * s, qy * c - qx * s
        rx, ry = rx * c + ry * s, ry * c - rx * s
        return (
            fitted(first, limits), X * c + Y * s - self.a1, ca * (Y * c - X * s) + sa * Z - self.v0,
            px, ca * py + sa * pz, ca * pz - sa * py,
            qx, ca * qy + sa * qz, ca * qz - sa * qy,
            rx, ca * ry + sa * rz, ca * rz - sa * ry,
        )  # fmt: skip

    def _skew_pairs(self, X: float, Y: float, Z: float, whole: float) -> tuple[list[Pair], bool]:
        """As ``pairs``, for axes of which no neighbours are parallel or meet; numbered by rising θ1.

        The second condition is divided by a length.
        """
        s, r, length = self.sa1, self.r, self.length
        (px, py, pz), qy = self.geometry.p.tolist(), float(self.geometry.q[1])
        near, far = -2.0 / length, -2.0 * r / length
        reach = self._skew_reach - whole + 2.0 * pz * Z
        answer = two_turns(
            ((-s * Y, s * X), (near * (px * X + py * Y), near * (px * Y - py * X))),
            ((0.0, -self.sa2 * r), (far * self.a2, far * (self.ca2 * qy + self.sa2 * self.d2))),
            (self.w0 - s * py + self.ca1 * (pz - Z), reach / length),
            BEYOND,
        )
        pairs = sorted(answer.angles)[:4]
        apart = [math.dist(*two) for two in itertools.combinations(pairs, 2)]
        care = self.geometry.nearly or bool(answer.free) or min(apart, default=1.0) < APART
        return [(first, third, k) for k, (first, third) in enumerate(pairs)], care

    def second(self, centre: Three, first: float, third: float) -> tuple[float, float]:
        """φ2 [rad] that belongs to θ1 and φ3, and how far W is from the second axis [m]."""
        X, Y, Z = centre
        c1, s1, c3, s3 = math.cos(first), math.sin(first), math.cos(third), math.sin(third)
        u, v = X * c1 + Y * s1 - self.a1, self.ca1 * (Y * c1 - X * s1) + self.sa1 * Z - self.v0
        p, q = self.a2 + self.r * c3, self.ca2 * self.r * s3 + self.side
        return math.atan2(p * v - q * u, p * u + q * v), math.sqrt(u * u + v * v)

    def turned_back(self, rotation: tuple[float, ...], arm: Three) -> FloatArray:
        """M (3, 3): what the first three joints at θ1, φ2, φ3 [rad] leave of a rotation to the wrist."""
        first, second, third = arm
        back = _about_z(first) @ _about_x(self.ca1, self.sa1) @ _about_z(second)
        back = back @ _about_x(self.ca2, self.sa2) @ _about_z(third) @ self.geometry.C
        return back.T @ np.array(rotation).reshape(3, 3).T

    def refined(self, centre: Three, arm: Three) -> Three:
        """θ1, φ2, φ3 [rad] that hold W at a point [m] to the last digit, from such that nearly do."""
        z = np.array([0.0, 0.0, 1.0])

        def rows(q: FloatArray) -> tuple[FloatArray, FloatArray]:
            first = _about_z(q[0])
            second = first @ _about_x(self.ca1, self.sa1) @ _about_z(q[1])
            third = second @ _about_x(self.ca2, self.sa2)
            beyond3 = third @ _about_z(q[2]) @ [self.r, 0.0, self.h]
            beyond2 = second @ self.geometry.q + beyond3
            W = first @ self.geometry.p + beyond2
            axes = np.stack([z, second[:, 2], third[:, 2]])
            return W - centre, np.cross(axes, np.stack([W, beyond2, beyond3])).T

        first, second, third = newton(rows, np.array(arm), _STEPS, rank=1e-10)[0].tolist()
        return first, second, third

    def wrists(self, M: FloatArray) -> list[Wrist]:
        """Both ways in which the wrist takes up M (3, 3), with care; none where it cannot."""
        alpha, beta = self._alpha, self._beta
        ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
        side = math.atan2(math.hypot(M[0, 2], M[1, 2]), M[2, 2])
        bend = self._bend(side)
        found: list[Wrist] = []
        for b in (bend, -bend) if 0.0 < bend < math.pi else (bend,) if bend >= 0.0 else ():
            K = _about_x(ca, sa) @ _about_z(b) @ _about_x(cb, sb)
            q4 = math.atan2(M[1, 2], M[0, 2]) - math.atan2(K[1, 2], K[0, 2])
            coupled = float(self._sum and side < GIMBAL) - float(self._difference and math.pi - side < GIMBAL)
            if coupled:
                q4 = 0.0
            # what is left is a turn about z, or nearly: the nearest one
            rest = K.T @ _about_z(q4).T @ M
            q6 = math.atan2(rest[1, 0] - rest[0, 1], rest[0, 0] + rest[1, 1])
            flip = int(math.copysign(1.0, b) != self._unflipped)
            found.append(Wrist((q4, b - self.geometry.offsets[2], q6), flip, coupled))
            if coupled:
                break  # the other way is the same continuum
        return found

    def _bend(self, side: float) -> float:
        """The least b in 0..pi at which fourth and sixth axis stand at an angle; -1: there is none."""
        if self.right_angled:
            return math.pi - side
        alpha, beta = self._alpha, self._beta
        # b' = pi - b of the spherical triangle; the half-angle form keeps its digits
        wide = math.sin(0.5 * (side + alpha - beta)) * math.sin(0.5 * (side - alpha + beta))
        close = math.sin(0.5 * (alpha + beta + side)) * math.sin(0.5 * (alpha + beta - side))
        if min(wide, close) < -BEYOND:
            return -1.0
        return math.pi - 2.0 * math.atan2(math.sqrt(max(0.0, wide)), math.sqrt(max(0.0, close)))


def _away(size: float, value: float, beyond: float) -> tuple[float, bool]:
    """The angle in 0..pi with ``size · cos = value``, -1: there is none; and whether rounding needs care."""
    near, far = size - value, size + value
    least = DOUBLE * size
    if near > least and far > least:
        return 2.0 * math.atan2(math.sqrt(near), math.sqrt(far)), False
    if near <= 0.0:
        return (0.0 if near >= -beyond else -1.0), near >= -beyond
    if far <= 0.0:
        return (math.pi if far >= -beyond else -1.0), far >= -beyond
    return 2.0 * math.atan2(math.sqrt(near), math.sqrt(far)), True


def _through(c: float, s: float, cosine: float, sine: float, x: float, y: float, z: float) -> Three:
    """``Rx Rz`` of a vector: the turn about z first."""
    x, y = c * x - s * y, s * x + c * y
    return x, cosine * y - sine * z, sine * y + cosine * z


def _cos_sin(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


def _about_z(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(c: float, s: float) -> FloatArray:
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
