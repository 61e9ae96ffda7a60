"""All ways of many tool poses, for arms with three parallel axes in a row; whatever the joint limits.

Closed loop: P E_a E_b E_c = G. P is what the three parallel joints do together, a planar motion: it keeps the
direction k and the coordinate of every point along k. With v = R_Gᵀ k that makes two conditions for the
angles of a and c, linear in their cosines and sines (b turns about its own axis, which both sides keep):

    b · Rot(a, -θa) k - b · Rot(c, θc) v = 0
    (p_a - p_b) · Rot(a, -θa) k + (p_b - p_c) · Rot(c, θc) v = k · (p_a - t_G) - v · p_c

Up to four pairs; θb then turns one vector onto another, and two links in a plane are left. The conditions are
those of subproblem 6 of IK-Geo (A. J. Elias and J. T. Wen, 2022, section 5), here for any place of the three
axes in the chain.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.subproblems import roots, two_turns_of_many
from armctl.kinematics.three_parallel.geometry import ThreeParallel

_CHUNK = 2048
"""poses worked on at a time, so that what they need stays in the processor's cache"""
BRANCHES = 8
"""four ways of the joints a and c, each with two of the elbow"""
_STILL = 2e-10
"""how near to axis b the direction k must be for the wrist to turn freely: sine of the angle"""
_MET = 1e-11
"""what the conditions for a and c may be missed by (the second one as a share of the reach)"""
_REACHED = 1e-9
"""what the links may be too short or too long by, as a share of their squared length: polishing decides"""
_CLOSE = 1e-3
"""a wrist as close to singular as this has its joint a computed from a distance: sine of the angle"""
_DOUBTFUL = 1e-4
"""a wrist or an elbow nearer to singular than this is polished [rad]"""
_ONE_ELBOW = 1e-6
"""elbows bent less than this, to both sides, are one: straight [rad]"""


class Ways(NamedTuple):
    """What many poses have; a column a branch."""

    q: FloatArray
    """(m, 8, 6) [rad] at any image; NaN where a pose does not have the branch"""
    pairs_free: NDArray[np.bool_]
    """(m,) where a or c may be at any angle"""
    wrist_free: NDArray[np.bool_]
    """(m, 8) where b may be at any angle, and the parallel joints follow"""
    shoulder_free: NDArray[np.bool_]
    """(m, 8) where the first parallel joint may be at any angle, and the third follows"""
    doubtful: NDArray[np.bool_]
    """(m, 8) where rounding counts for more, so close to a singularity"""


class Loop(NamedTuple):
    """The closed loop of arm and m targets."""

    G: FloatArray
    """(m, 4, 4) ``T_base_tool`` times the inverse of the tool pose at zero [m]"""
    axes: tuple[FloatArray, FloatArray, FloatArray]
    """of a, b and c: (3,), or (m, 3) where they come behind the target"""
    points: tuple[FloatArray, FloatArray, FloatArray]

    @classmethod
    def of(cls, arm: ThreeParallel, poses: FloatArray) -> Loop:
        """Of tool poses ``T_base_tool`` (m, 4, 4)."""
        G = poses @ arm.T_tool_base
        axes: list[FloatArray] = []
        points: list[FloatArray] = []
        for joint in arm.others:
            w, p = arm.axes[joint], arm.points[joint]
            if joint < arm.first:
                w, p = w @ G[:, :3, :3], np.einsum("mi,mij->mj", p - G[:, :3, 3], G[:, :3, :3])
            axes.append(w)
            points.append(p)
        return cls(G, (axes[0], axes[1], axes[2]), (points[0], points[1], points[2]))


def all_ways(arm: ThreeParallel, poses: FloatArray) -> Ways:
    """Of tool poses ``T_base_tool`` (m, 4, 4) [m]; where a joint is free it is at 0."""
    parts: list[Ways] = []
    for at in range(0, max(len(poses), 1), _CHUNK):
        loop = Loop.of(arm, poses[at : at + _CHUNK])
        pairs, free = _pairs(arm, loop)
        parts.append(_rest(arm, loop, pairs)._replace(pairs_free=free))
    return parts[0] if len(parts) == 1 else Ways(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def with_pair(arm: ThreeParallel, pose: FloatArray, values: FloatArray) -> FloatArray:
    """(m, 8, 6) ways of one pose (4, 4) where a or c is free, with that one at ``values`` (m,) [rad]."""
    loop = Loop.of(arm, np.broadcast_to(pose, (len(values), 4, 4)))
    A, B, right = _conditions(arm, loop)
    holds_a = arm.meet[1] or np.linalg.norm(A[0]) <= _STILL * np.linalg.norm(B[0])
    held, other = (A, B) if holds_a else (B, A)
    rest = right - np.einsum("mij,mj->mi", held, np.stack([np.cos(values), np.sin(values)], axis=-1))
    row = int(np.linalg.norm(other[0], axis=1).argmax())
    one = np.broadcast_to(other[0, row], (len(values), 2))
    found = roots((np.zeros(len(values)), one[:, 0], one[:, 1]), rest[:, row], _MET)
    missed = np.abs(np.stack([np.cos(found), np.sin(found)], axis=-1) @ other[0].T - rest).max(axis=-1)
    found = np.where(missed <= _MET, found, np.nan)
    both = np.stack([np.broadcast_to(values, found.shape), found], axis=-1)
    pairs = np.full((len(values), 4, 2), np.nan)
    pairs[:, :2] = np.moveaxis(both if holds_a else both[..., ::-1], 0, 1)
    return _rest(arm, loop, pairs).q


def with_wrist(arm: ThreeParallel, pose: FloatArray, q: FloatArray, values: FloatArray) -> FloatArray:
    """(m, 2, 6) ways of one pose (4, 4) with a and c as in ``q`` (6,) and b at ``values`` (m,) [rad]."""
    a, _, c = arm.others
    loop = Loop.of(arm, np.broadcast_to(pose, (len(values), 4, 4)))
    pairs = np.full((len(values), 4, 2), np.nan)
    pairs[:, 0] = q[[a, c]]
    return _rest(arm, loop, pairs, values).q[:, [0, 4]]


def with_shoulder(arm: ThreeParallel, q: FloatArray, values: FloatArray) -> FloatArray:
    """(m, 6) the way ``q`` (6,) with the first parallel joint at ``values`` (m,), the third following."""
    out = np.tile(q, (len(values), 1))
    first = arm.first
    out[:, first] = values
    out[:, first + 2] -= arm.signs[2] * arm.signs[0] * (values - q[first])
    return out


def _conditions(arm: ThreeParallel, loop: Loop) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A, B (m, 2, 2) and d (m, 2) of ``A (cos θa, sin θa) + B (cos θc, sin θc) = d``, without units."""
    (wa, wb, wc), (pa, pb, pc) = loop.axes, loop.points
    k, R, t = arm.plane[2], loop.G[:, :3, :3], loop.G[:, :3, 3]
    unit = float(np.abs(arm.points).max() + np.abs(arm.links).max())
    v: FloatArray = k @ R
    along_a, along_c = _dot(wa, k), _dot(wc, v)
    a0 = wa * along_a[..., None]
    c0 = wc * along_c[:, None]
    a1, a2, c1, c2 = k - a0, _cross(k, wa), v - c0, _cross(wc, v)
    one, other = (pa - pb) / unit, (pb - pc) / unit
    m = len(R)
    A, B = np.empty((m, 2, 2)), np.empty((m, 2, 2))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = _dot(wb, a1), _dot(wb, a2), _dot(one, a1), _dot(one, a2)
    B[:, 0, 0], B[:, 0, 1], B[:, 1, 0], B[:, 1, 1] = (
        -_dot(wb, c1), -_dot(wb, c2), _dot(other, c1), _dot(other, c2),
    )  # fmt: skip
    right = np.empty((m, 2))
    right[:, 0] = _dot(wb, c0) - _dot(wb, a0)
    height = (_dot(k, pa) - t @ k - _dot(v, pc)) / unit
    right[:, 1] = height - _dot(one, a0) - _dot(other, c0)
    if arm.meet[0]:
        A[:, 1] = 0.0
    if arm.meet[1]:
        B[:, 1] = 0.0
    return A, B, right


def _pairs(arm: ThreeParallel, loop: Loop) -> tuple[FloatArray, NDArray[np.bool_]]:
    """(m, 4, 2) the angles of a and c [rad], NaN where there are fewer, and where one of them is free."""
    return two_turns_of_many(*_conditions(arm, loop), _MET)


def _rest(arm: ThreeParallel, loop: Loop, pairs: FloatArray, wrist: FloatArray | None = None) -> Ways:
    """The ways of pairs (m, 4, 2); where b is free it is at ``wrist`` (m,) [rad], or 0."""
    (wa, wb, wc), (pa, pb, pc) = (_columns(v) for v in loop.axes), (_columns(p) for p in loop.points)
    i, j, k = arm.plane
    m = len(pairs)
    qa, qc = pairs[..., 0], pairs[..., 1]
    v = np.broadcast_to((k @ loop.G[:, :3, :3])[:, None], (m, 4, 3))
    seen = _turned(v, wc, qc)
    across = np.linalg.norm(_cross(seen, wb), axis=-1)
    still = across < _STILL
    if (across < _CLOSE).any():
        qa = _close_to_singular(k, wa, wb, seen, qa, across < _CLOSE)
        if still.any():
            near = (
                np.abs(np.exp(1j * pairs[:, :, None]) - np.exp(1j * pairs[:, None])).max(axis=3) < _DOUBTFUL
            )
            qa = np.where(still & np.tril(near & still[:, None], -1).any(axis=2), np.nan, qa)
    goal = _turned(np.broadcast_to(k, seen.shape), wa, -qa)
    qb = np.where(still, 0.0 if wrist is None else wrist[:, None], _angle(wb, seen, goal))
    # P = G Ec⁻¹ Eb⁻¹ Ea⁻¹, of the direction i and of a point on the third parallel axis
    direction = np.broadcast_to(i, seen.shape)
    point = np.broadcast_to(arm.points[arm.first + 2], seen.shape)
    for w, p, angle in ((wa, pa, qa), (wb, pb, qb), (wc, pc, qc)):
        direction = _turned(direction, w, -angle)
        point = p + _turned(point - p, w, -angle)
    R, t = np.swapaxes(loop.G[:, :3, :3], 1, 2), loop.G[:, None, :3, 3]
    direction, point = direction @ R, point @ R + t
    turn = np.arctan2(direction @ j, direction @ i)
    reached = (point - arm.points[arm.first]) @ arm.plane[:2].T
    bends, shoulder_free = _elbows(arm, reached)
    (x1, y1), (x2, y2) = arm.links
    s = np.array(arm.signs)
    q = np.empty((m, 2, 4, 6))
    for way, bend in enumerate(bends):
        cosine, sine = np.cos(bend), np.sin(bend)
        x, y = x1 + cosine * x2 - sine * y2, y1 + sine * x2 + cosine * y2
        first = np.arctan2(reached[..., 1], reached[..., 0]) - np.arctan2(y, x)
        first = np.where(shoulder_free, 0.0, first)
        q[:, way, :, arm.first] = s[0] * first
        q[:, way, :, arm.first + 1] = s[1] * bend
        q[:, way, :, arm.first + 2] = s[2] * (turn - first - bend)
        for joint, angle in zip(arm.others, (qa, qb, qc), strict=True):
            q[:, way, :, joint] = angle
    doubtful = np.stack([np.abs(np.sin(bend - arm.straight)) < _DOUBTFUL for bend in bends], axis=1)
    doubtful |= ((across < _DOUBTFUL) | _double(pairs))[:, None]
    q, there = q.reshape(m, BRANCHES, 6), ~np.isnan(q).any(axis=-1).reshape(m, BRANCHES)
    q[~there] = np.nan
    return Ways(
        q,
        np.zeros(m, dtype=np.bool_),
        np.tile(still, 2) & there,
        np.tile(shoulder_free, 2) & there,
        doubtful.reshape(m, BRANCHES) & there,
    )


def _close_to_singular(
    k: FloatArray, wa: FloatArray, wb: FloatArray, seen: FloatArray, qa: FloatArray, close: NDArray[np.bool_]
) -> FloatArray:
    """Angles of a (m, 4) [rad], recomputed where ``seen`` (m, 4, 3), and so Rot(a, -θa) k, is close to ±b.

    There they are nearly a double root of the conditions, which have half of the digits only. The distance
    from b has them all: |Rot(a, -θa) k - b|² = d0² + 4 r1 r2 sin²((θa - θ0) / 2).
    """
    side = np.copysign(1.0, _dot(seen, wb))[..., None] * wb
    middle = _angle(wa, side, np.broadcast_to(k, seen.shape))
    radii = np.linalg.norm(_cross(wa, k), axis=-1), np.linalg.norm(_cross(wa, side), axis=-1)
    gap = seen - side
    least = (radii[0] - radii[1]) ** 2 + (_dot(wa, k) - _dot(wa, side)) ** 2
    half = np.sqrt(np.maximum(_dot(gap, gap) - least, 0.0) / np.maximum(4.0 * radii[0] * radii[1], 1e-300))
    off = qa - middle
    off -= 2.0 * math.pi * np.rint(off / (2.0 * math.pi))
    sign = np.where(off == 0.0, np.array([1.0, 1.0, -1.0, -1.0]), np.sign(off))
    return np.where(close & ~np.isnan(qa), middle + sign * 2.0 * np.arcsin(np.minimum(half, 1.0)), qa)


def _double(pairs: FloatArray) -> NDArray[np.bool_]:
    """(m, 4) where a pair (m, 4, 2) lies close to another."""
    turns = np.exp(1j * pairs)
    out = np.zeros(pairs.shape[:2], dtype=np.bool_)
    for i, j in itertools.combinations(range(4), 2):
        near = np.abs(turns[:, i] - turns[:, j]).max(axis=1) < _DOUBTFUL
        out[:, i] |= near
        out[:, j] |= near
    return out


def _elbows(
    arm: ThreeParallel, reached: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], NDArray[np.bool_]]:
    """Both angles of the middle parallel joint for a point (..., 2) of the third axis in the plane.

    NaN where the links do not reach, or for the second where both are one; and where the point lies on the
    first axis, so that the links may turn about it.
    """
    one, other = np.linalg.norm(arm.links, axis=1).tolist()
    squared = (reached * reached).sum(axis=-1)
    longest = (one + other) ** 2
    out, folded = longest - squared, squared - (one - other) ** 2
    misses = (out < -_REACHED * longest) | (folded < -_REACHED * longest)
    bend = 2.0 * np.arctan2(np.sqrt(np.maximum(out, 0.0)), np.sqrt(np.maximum(folded, 0.0)))
    bend = np.where(bend < 0.5 * _ONE_ELBOW, 0.0, np.where(bend > math.pi - 0.5 * _ONE_ELBOW, math.pi, bend))
    alone = (bend == 0.0) | (bend == math.pi)
    up, down = (
        arm.straight + np.where(misses, np.nan, bend),
        arm.straight - np.where(misses | alone, np.nan, bend),
    )
    return (up, down), squared <= (_STILL * (one + other)) ** 2


def _columns(v: FloatArray) -> FloatArray:
    """(3,) or (m, 3) so that it goes with (m, 4, 3)."""
    return v if v.ndim == 1 else v[:, None]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _turned(v: FloatArray, axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (m, 4, 3) turned about unit axes (3,) or (m, 1, 3) by angles (m, 4) [rad] (Rodrigues)."""
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    along = axis * _dot(v, axis)[..., None]
    return c * (v - along) + s * _cross(axis, v) + along


def _angle(axis: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Subproblem 1: the turn about a unit axis that brings vectors onto others [rad]."""
    start = start - axis * _dot(axis, start)[..., None]  # first, so that short ones keep their digits
    end = end - axis * _dot(axis, end)[..., None]
    return np.arctan2(_dot(axis, _cross(start, end)), _dot(start, end))
