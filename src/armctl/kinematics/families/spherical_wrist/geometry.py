"""Recognising six-joint arms of which three axes at one end meet, and their geometry.

With E_i the motion that joint i makes, the axes as they are at the zero pose, and T0 the tool frame there:
``T = E1 E2 E3 E4 E5 E6 T0``. The last three joints leave the point W alone in which their axes meet, so that
``D = T T0⁻¹`` carries W where the first three joints alone carry it, and the last three make up for the
rotation (Pieper 1968). Where the first three axes meet instead, ``D⁻¹ = E6⁻¹ … E1⁻¹`` is the same arm read
from its other end: the joints in reverse order, about opposite axes, with the same angles.

The first three axes and W are put into Denavit-Hartenberg frames (z along the axis, x along the common
normal to the next one), whatever the arm was described by. With φ2 = θ2 + o2 and φ3 = θ3 + o3

    W = B Rz(θ1) (p + Rx(α1) Rz(φ2) (q + Rx(α2) Rz(φ3) (r, 0, h)))
    B' R F = Rz(θ1) Rx(α1) Rz(φ2) Rx(α2) Rz(φ3) C · Rz(θ4) Rx(α) Rz(θ5 + o5) Rx(β) Rz(θ6)

R being the rotation of D, and C and F fixed. ``p = (a1, 0, 0)`` and ``q = (a2, 0, d2)``, the common normals,
where two neighbouring axes are parallel or meet.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.samples import even_spread
from armctl.kinematics.subproblems import across, meeting_point, turned
from armctl.lazy_dataclass import dataclass

Regional = Literal["parallel-23", "meet-23", "parallel-12", "meet-12", "skew"]
"""what makes the first three joints easy: which two axes are parallel or meet; ``skew``: none"""
_MEETS = 1e-9
"""how far the last three axes may miss W [m]"""
_EXACT = 1e-12
"""axes that miss each other by less [m], or are less inclined (sine), meet or are parallel"""
_NEARLY = 1e-3
"""sine, or share of the arm's size, below which other axes nearly do"""
_MOVES = 1e-7
"""an arm is always singular where its first three joints move W through less than this share of its cube"""
_PROBES = 24


@dataclass(frozen=True)
class SphericalWrist:
    """Geometry of one such arm: metres and radians, joints counted from the end where no axes meet."""

    backward: bool
    """True where the first three axes of the arm meet: its joints are counted from the tool"""
    regional: Regional
    nearly: bool
    """True where neighbouring axes are nearly parallel or nearly meet, so that rounding needs care"""
    base: FloatArray
    """(3, 3) B: the frame of the first axis at the zero pose, x towards the second axis"""
    origin: FloatArray
    """(3,) of that frame [m]"""
    centre: FloatArray
    """(3,) W at the zero pose [m]"""
    p: FloatArray
    """(3,) from the origin to a point of the second axis, in the frame of the first [m]"""
    q: FloatArray
    """(3,) from there to a point of the third axis, in the frame of the second joint [m]"""
    alpha: tuple[tuple[float, float], tuple[float, float]]
    """cosine and sine of α1 and of α2"""
    offsets: tuple[float, float, float]
    """o2, o3, o5"""
    hand: tuple[float, float]
    """r and h: W from the third axis and along it [m]"""
    C: FloatArray
    """(3, 3) the fourth joint's frame in that of the third, which has its x axis towards W"""
    wrist: tuple[float, float]
    """α and β in (0, pi): between the fourth and the fifth axis, the fifth and the sixth"""
    F: FloatArray
    """(3, 3) the sixth joint's frame at the zero pose"""
    home: FloatArray
    """(4, 4) T0"""
    misfit: float
    """how far the three axes miss W [m]"""

    @property
    def reach(self) -> float:
        """A length of the size of the arm [m]."""
        return float(np.linalg.norm(self.p) + np.linalg.norm(self.q)) + math.hypot(*self.hand)

    @property
    def gimbal(self) -> tuple[bool, bool]:
        """Whether the sixth axis can come to lie along the fourth, and opposite to it."""
        first, second = self.wrist
        return abs(first - second) < 1e-9, abs(first + second - math.pi) < 1e-9

    def order(self, values: FloatArray) -> FloatArray:
        """Values (..., 6) of the joints in the order of the geometry from that of the arm, or back."""
        return values[..., ::-1] if self.backward else values

    def joint(self, index: int) -> int:
        """The arm's joint that has an index in the geometry."""
        return 5 - index if self.backward else index


def recognise_wrist(chain: Chain) -> SphericalWrist | None:
    """The arm's geometry, or None when it is not of this build.

    Needed: six joints, of which the last three have axes that meet in W to 1e-9 m, neighbours not parallel,
    and of which the others move W in all directions; or the same read from the tool.
    """
    if chain.n != 6:
        return None
    points, axes = chain.axes()
    home = chain.forward(np.zeros(6))
    for backward in (False, True):
        h, p = (-axes[::-1], points[::-1]) if backward else (axes, points)
        centre = meeting_point(p[3:], h[3:], _MEETS)
        if centre is not None and _moves(h[:3], p[:3], centre):
            return _geometry(h, p, centre, home, backward=backward)
    return None


def _moves(h: FloatArray, p: FloatArray, centre: FloatArray) -> bool:
    """Whether three joints move a point in all directions in some pose."""
    probes = math.tau * even_spread(_PROBES, np.full(2, 0.5))
    greatest = 0.0
    for second, third in probes.tolist():
        # all in the frame of the first joint
        hand = p[2] + turned(centre - p[2], h[2], third)
        hand = p[1] + turned(hand - p[1], h[1], second)
        axis3 = turned(h[2], h[1], second)
        point3 = p[1] + turned(p[2] - p[1], h[1], second)
        J = np.stack(
            [np.cross(h[0], hand - p[0]), np.cross(h[1], hand - p[1]), np.cross(axis3, hand - point3)]
        )
        greatest = max(greatest, abs(float(np.linalg.det(J))))
    size = float(np.abs([centre - p[0], centre - p[1], centre - p[2]]).max())
    return greatest > _MOVES * size**3


def _geometry(
    h: FloatArray, p: FloatArray, centre: FloatArray, home: FloatArray, *, backward: bool
) -> SphericalWrist:
    foot1, foot2, x1 = _common_normal(p[0], h[0], p[1], h[1])
    before3, foot3, x2 = _common_normal(p[1], h[1], p[2], h[2])
    parallel12, parallel23 = x1 is None, x2 is None
    if x1 is None:  # any normal will do: the one that meets the second axis where the next one begins
        foot2 = before3
        foot1 = p[0] + ((foot2 - p[0]) @ h[0]) * h[0]
        x1 = _unit(foot2 - foot1)
    if x2 is None:
        before3 = foot2
        foot3 = p[2] + ((before3 - p[2]) @ h[2]) * h[2]
        x2 = _unit(foot3 - before3)
    a1, a2 = float((foot2 - foot1) @ x1), float((foot3 - before3) @ x2)
    meet12, meet23 = abs(a1) < _EXACT, abs(a2) < _EXACT
    if meet12 and (centre - foot1) @ x1 < 0.0:
        x1 = -x1  # no side of the first axis is special: take that of W
    first = _frame(x1, h[0])
    if not (parallel12 or parallel23 or meet12 or meet23):
        # any points of the axes will do; the common normal of nearly parallel ones is far away
        foot3, foot2 = (p[k] + ((centre - p[k]) @ h[k]) * h[k] for k in (2, 1))
        foot1 = p[0] + ((foot2 - p[0]) @ h[0]) * h[0]
        to_second, to_third = first.T @ (foot2 - foot1), _frame(x2, h[1]).T @ (foot3 - foot2)
    else:
        d2 = 0.0 if parallel12 or parallel23 else float((before3 - foot2) @ h[1])
        to_second = np.array([0.0 if meet12 else a1, 0.0, 0.0])
        to_third = np.array([0.0 if meet23 else a2, 0.0, d2])
    along = (centre - foot3) @ h[2]
    level = centre - foot3 - along * h[2]
    r = float(np.linalg.norm(level))
    x3, x4, x5 = level / r, _across(h[3], h[4]), _across(h[4], h[5])
    regional: Regional = (
        "parallel-23" if parallel23 else "meet-23" if meet23 else
        "parallel-12" if parallel12 else "meet-12" if meet12 else "skew"
    )  # fmt: skip
    twists = _twist(h[0], h[1], x1, parallel12), _twist(h[1], h[2], x2, parallel23)
    size = float(np.linalg.norm(to_second) + np.linalg.norm(to_third)) + r
    least = min(abs(twists[0][1]), abs(twists[1][1]), abs(a1) / size, abs(a2) / size)
    misses = [float(np.linalg.norm(across(h[k]) @ (centre - p[k]))) for k in (3, 4, 5)]
    return SphericalWrist(
        backward=backward,
        regional=regional,
        nearly=regional == "skew" and least < _NEARLY,
        base=first,
        origin=foot1,
        centre=centre,
        p=to_second,
        q=to_third,
        alpha=twists,
        offsets=(_angle(h[1], x1, x2), _angle(h[2], x2, x3), _angle(h[4], x4, x5)),
        hand=(r, float(along)),
        C=_frame(x3, h[2]).T @ _frame(x4, h[3]),
        wrist=(_between(h[3], h[4]), _between(h[4], h[5])),
        F=_frame(x5, h[5]),
        home=home,
        misfit=max(misses),
    )


def _common_normal(
    p: FloatArray, h: FloatArray, q: FloatArray, k: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Feet of the common normal of two axes, and its direction; any feet and None where they are parallel."""
    normal = np.cross(h, k)
    square = float(normal @ normal)
    if square < _EXACT**2:
        return p, q, None
    first = p + (np.cross(q - p, k) @ normal / square) * h
    second = q + (np.cross(q - p, h) @ normal / square) * k
    x = normal / math.sqrt(square)
    return first, second, -x if (second - first) @ x < 0.0 else x


def _twist(h: FloatArray, k: FloatArray, x: FloatArray, parallel: bool) -> tuple[float, float]:
    """Cosine and sine of the angle about x from one axis to another."""
    cosine = float(h @ k)
    return (math.copysign(1.0, cosine), 0.0) if parallel else (cosine, float(x @ np.cross(h, k)))


def _angle(axis: FloatArray, start: FloatArray, end: FloatArray) -> float:
    return math.atan2(float(axis @ np.cross(start, end)), float(start @ end))


def _between(a: FloatArray, b: FloatArray) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def _across(a: FloatArray, b: FloatArray) -> FloatArray:
    """(3,) the unit vector at right angles to both."""
    return _unit(np.asarray(np.cross(a, b), dtype=np.float64))


def _unit(v: FloatArray) -> FloatArray:
    return v / np.linalg.norm(v)


def _frame(x: FloatArray, z: FloatArray) -> FloatArray:
    """(3, 3) the frame with these axes."""
    return np.stack([x, np.cross(z, x), z], axis=1)
