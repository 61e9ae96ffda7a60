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

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.angles import half_angle_cos_sin, wrapped
from armctl.kinematics.chain import Chain
from armctl.kinematics.subproblems import (
    Columns,
    added,
    angle_onto,
    back,
    columns,
    cross,
    dot,
    length,
    roots,
    scaled,
    turned_by,
    two_turns_of_many,
)
from armctl.lazy_dataclass import dataclass

# Recognition of six-joint arms with three parallel axes in a row, and the numbers of their solution.

_PARALLEL = 1e-9
"""sine of the angle, or share of the reach, by which an arm may miss the family; polished away"""
_EXACT = 1e-13
"""a miss that is nothing but rounding"""
_SHORTEST = 1e-6
"""parallel axes nearer to each other than this share of the reach are one axis"""


@dataclass(frozen=True, slots=True, eq=False)
class ThreeParallel(ArrayRecord):
    """One arm, all joints at zero, in the base frame [m].

    The joints ``first``, ``first + 1`` and ``first + 2`` turn about the direction ``k``. In the closed loop
    of arm and target the others follow: ``a``, ``b`` and ``c``, where those ahead of the first come behind
    the target.
    """

    first: int
    axes: FloatArray
    """(6, 3) unit vectors"""
    points: FloatArray
    """(6, 3) one on each axis; those of two others that meet are where they meet"""
    plane: FloatArray
    """(3, 3) rows i, j, k: a right-handed frame, k along the parallel axes"""
    signs: tuple[float, float, float]
    """of each parallel axis: 1 along k, -1 against it"""
    links: FloatArray
    """(2, 2) from each parallel axis to the next in the coordinates i, j"""
    T_tool_base: FloatArray
    """(4, 4) the inverse of the tool pose at zero"""
    meet: tuple[bool, bool]
    """whether the axes a and b, b and c meet: that splits the equations"""
    exact: bool
    """False: the arm is beside the family by rounded numbers, and its ways need to be polished"""

    @property
    def straight(self) -> float:
        """The angle of the middle parallel joint at which both links are in line [rad]."""
        one, other = np.arctan2(self.links[:, 1], self.links[:, 0]).tolist()
        return one - other

    @property
    def others(self) -> tuple[int, int, int]:
        """The joints a, b and c."""
        a, b, c = ((self.first + i) % 6 for i in (3, 4, 5))
        return a, b, c


def recognise_three_parallel(chain: Chain) -> ThreeParallel | None:
    """The arm's geometry; None for an arm with other than six joints, or without three parallel axes.

    None too where four axes are parallel, or two are one line: such an arm moves without moving its tool.
    """
    if chain.n != 6:
        return None
    points, axes = chain.axes()
    tool = chain.forward(np.zeros(6))
    reach = float(np.linalg.norm(np.diff(np.vstack([points, tool[:3, 3]]), axis=0), axis=1).sum()) or 1.0
    crossed = np.linalg.norm(np.cross(axes[:-1], axes[1:]), axis=1)
    parallel = crossed < _PARALLEL
    for first in range(4):
        if parallel[first] and parallel[first + 1]:
            break
    else:
        return None
    if parallel[max(first - 1, 0) : first].any() or parallel[first + 2 : first + 3].any():
        return None
    k = axes[first]
    i = np.cross(np.eye(3)[int(np.abs(k).argmin())], k)
    i /= np.linalg.norm(i)
    plane = np.stack([i, np.cross(k, i), k])
    three = slice(first, first + 3)
    links = np.diff(points[three] @ plane[:2].T, axis=0)
    if np.linalg.norm(links, axis=1).min() < _SHORTEST * reach:
        return None
    misses = [float(crossed[first]), float(crossed[first + 1])]
    a, b, c = ((first + n) % 6 for n in (3, 4, 5))
    meet = [False, False]
    for which, (one, other) in enumerate(((a, b), (b, c))):
        if other != one + 1 or meet[0]:
            continue  # one is ahead of the parallel axes, one behind: that they meet depends on the pose
        gap, feet = _nearest_points(points[[one, other]], axes[[one, other]])
        if gap < _PARALLEL * reach and feet is not None:
            points[[one, other]] = feet
            meet[which] = True
            misses.append(gap / reach)
    sign, middle, last = (math.copysign(1.0, float(axes[n] @ k)) for n in range(first, first + 3))
    inverse = np.linalg.inv(tool).astype(np.float64)
    exact = max(misses) < _EXACT
    signs = sign, middle, last
    return ThreeParallel(first, axes, points, plane, signs, links, inverse, (meet[0], meet[1]), exact)


def _nearest_points(points: FloatArray, axes: FloatArray) -> tuple[float, FloatArray | None]:
    """How far two lines are apart [m], and the middle of the gap for both (2, 3); None where parallel."""
    normal = np.cross(*axes)
    size = float(normal @ normal)
    apart = points[1] - points[0]
    if size < _PARALLEL**2:
        return float(np.linalg.norm(np.cross(apart, axes[0]))), None
    along = [float(np.cross(apart, axis) @ normal) / size for axis in (axes[1], axes[0])]
    feet = points + np.array(along)[:, None] * axes
    return float(np.linalg.norm(feet[1] - feet[0])), np.tile(feet.mean(axis=0), (2, 1))


_CHUNK = 2048
"""poses worked on at a time, so that what they need stays in the processor's cache"""
BRANCHES = 8
"""four ways of the joints a and c, each with two of the elbow"""
_STILL = 2e-10
"""how near to axis b the direction k must be for the wrist to turn freely: sine of the angle"""
_MET = 1e-11
"""what the conditions for a and c may be missed by (the second one as a share of the reach)"""
_REACHED = 1e-7
"""what the links may be too short or too long by, as a share of their squared length: polishing decides"""
_CLOSE = 1e-3
"""a wrist as close to singular as this has its joint a computed from a distance: sine of the angle"""
_DOUBTFUL = 1e-4
"""a wrist or an elbow nearer to singular than this is polished [rad]"""
_ONE_ELBOW = 1e-7
"""elbows bent less than this, to both sides, are one: straight [rad]"""


class BranchConfigurations(NamedTuple):
    """What many poses have; a column a branch."""

    q: FloatArray
    """(m, 8, 6) [rad] at any image; NaN where a pose does not have the branch"""
    pairs_free: NDArray[np.bool_]
    """(m,) where a or c may be at any angle"""
    wrist_free: NDArray[np.bool_]
    """(m, 8) where b may be at any angle, and the parallel joints follow; they need not reach with b at 0"""
    shoulder_free: NDArray[np.bool_]
    """(m, 8) where the first parallel joint may be at any angle, and the third follows"""
    doubtful: NDArray[np.bool_]
    """(m, 8) where rounding counts for more, so close to a singularity"""


class ClosedLoop(NamedTuple):
    """The closed loop of arm and m targets."""

    G: FloatArray
    """(m, 4, 4) ``T_base_tool`` times the inverse of the tool pose at zero [m]"""
    axes: tuple[FloatArray, FloatArray, FloatArray]
    """of a, b and c: (3,), or (m, 3) where they come behind the target"""
    points: tuple[FloatArray, FloatArray, FloatArray]

    @classmethod
    def of(cls, arm: ThreeParallel, poses: FloatArray) -> ClosedLoop:
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


def all_ways(arm: ThreeParallel, poses: FloatArray) -> BranchConfigurations:
    """Of tool poses ``T_base_tool`` (m, 4, 4) [m]; where a joint is free it is at 0."""
    parts: list[BranchConfigurations] = []
    for at in range(0, max(len(poses), 1), _CHUNK):
        loop = ClosedLoop.of(arm, poses[at : at + _CHUNK])
        pairs, free = two_turns_of_many(*_conditions(arm, loop), _MET)
        parts.append(_rest(arm, loop, pairs)._replace(pairs_free=free))
    return (
        parts[0]
        if len(parts) == 1
        else BranchConfigurations(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    )


def with_pair(arm: ThreeParallel, pose: FloatArray, values: FloatArray) -> FloatArray:
    """(m, 8, 6) ways of one pose (4, 4) where a or c is free, with that one at ``values`` (m,) [rad]."""
    loop = ClosedLoop.of(arm, np.broadcast_to(pose, (len(values), 4, 4)))
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


def with_wrist(arm: ThreeParallel, pose: FloatArray, way: int, values: FloatArray) -> FloatArray:
    """(m, 2, 6) ways of one pose (4, 4) with a and c as in column ``way`` and b at ``values`` (m,) [rad]."""
    loop = ClosedLoop.of(arm, np.broadcast_to(pose, (len(values), 4, 4)))
    found, _ = two_turns_of_many(*_conditions(arm, ClosedLoop.of(arm, pose[None])), _MET)
    pairs = np.full((len(values), 4, 2), np.nan)
    pairs[:, 0] = found[0, way]
    return _rest(arm, loop, pairs, values).q[:, [0, 4]]


def with_shoulder(arm: ThreeParallel, q: FloatArray, values: FloatArray) -> FloatArray:
    """(m, 6) the way ``q`` (6,) with the first parallel joint at ``values`` (m,), the third following."""
    out = np.tile(q, (len(values), 1))
    first = arm.first
    out[:, first] = values
    out[:, first + 2] -= arm.signs[2] * arm.signs[0] * (values - q[first])
    return out


def _conditions(arm: ThreeParallel, loop: ClosedLoop) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A, B (m, 2, 2) and d (m, 2) of ``A (cos θa, sin θa) + B (cos θc, sin θc) = d``, without units."""
    (wa, wb, wc), (pa, pb, pc) = map(_all_columns, (loop.axes, loop.points))
    k, R, t = arm.plane[2], loop.G[:, :3, :3], columns(loop.G[:, :3, 3])
    unit = float(np.abs(arm.points).max() + np.abs(arm.links).max())
    v, k = columns(k @ R), columns(k)
    a0, c0 = scaled(wa, dot(wa, k)), scaled(wc, dot(wc, v))
    a1, a2, c1, c2 = added(k, a0, -1.0), cross(k, wa), added(v, c0, -1.0), cross(wc, v)
    one, other = scaled(added(pa, pb, -1.0), 1.0 / unit), scaled(added(pb, pc, -1.0), 1.0 / unit)
    m = len(R)
    A, B = np.empty((m, 2, 2)), np.empty((m, 2, 2))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = dot(wb, a1), dot(wb, a2), dot(one, a1), dot(one, a2)
    B[:, 0, 0], B[:, 0, 1], B[:, 1, 0], B[:, 1, 1] = (
        -dot(wb, c1), -dot(wb, c2), dot(other, c1), dot(other, c2),
    )  # fmt: skip
    right = np.empty((m, 2))
    right[:, 0] = dot(wb, c0) - dot(wb, a0)
    height = (dot(k, pa) - dot(t, k) - dot(v, pc)) / unit
    right[:, 1] = height - dot(one, a0) - dot(other, c0)
    if arm.meet[0]:
        A[:, 1] = 0.0
    if arm.meet[1]:
        B[:, 1] = 0.0
    return A, B, right


def _rest(
    arm: ThreeParallel, loop: ClosedLoop, pairs: FloatArray, wrist: FloatArray | None = None
) -> BranchConfigurations:
    """The ways of pairs (m, 4, 2); where b is free it is at ``wrist`` (m,) [rad], or 0."""
    (wa, wb, wc), (pa, pb, pc) = map(_all_columns, (loop.axes, loop.points))
    R, t = loop.G[:, :3, :3], loop.G[:, :3, 3]
    i, k = columns(arm.plane[0]), columns(arm.plane[2])
    qa, qc = (np.ascontiguousarray(pairs[..., n].T) for n in (0, 1))  # (4, m), as all that follows
    turn_c = half_angle_cos_sin(qc)
    seen = turned_by(columns(arm.plane[2] @ R), wc, turn_c)
    across = length(cross(seen, wb))
    still = across < _STILL
    close = across < _CLOSE
    if close.any():
        _close_to_singular(k, wa, wb, seen, qa, close)
        if still.any():
            near = _apart(pairs[:, :, None] - pairs[:, None]).max(axis=3) < _DOUBTFUL
            again = np.tril(near & still.T[:, None], -1).any(axis=2).T
            qa[still & again] = np.nan
    turn_a = back(half_angle_cos_sin(qa))
    goal = turned_by(k, wa, turn_a)
    qb = np.where(still, 0.0 if wrist is None else wrist, angle_onto(wb, seen, goal))
    turns = (wa, pa, turn_a), (wb, pb, back(half_angle_cos_sin(qb))), (wc, pc, back(turn_c))
    # P = G Ec⁻¹ Eb⁻¹ Ea⁻¹, of the direction i and of a point on the third parallel axis
    direction, point = i, columns(arm.points[arm.first + 2])
    for w, p, by in turns:
        direction, point = turned_by(direction, w, by), added(p, turned_by(added(point, p, -1.0), w, by))
    ahead, aside = (columns(axis @ R) for axis in arm.plane[:2])
    turn = np.arctan2(dot(direction, aside), dot(direction, ahead))
    x, y = ((t - arm.points[arm.first]) @ axis for axis in arm.plane[:2])
    x, y = dot(point, ahead) + x, dot(point, aside) + y
    bends, shoulder_free = _elbows(arm, x * x + y * y)
    facing, m = np.arctan2(y, x), len(pairs)
    (x1, y1), (x2, y2) = arm.links
    s = arm.signs
    q = np.empty((6, 2, 4, m))  # joint by joint in memory: contiguous to write
    for way, bend in enumerate(bends):
        cosine, sine = half_angle_cos_sin(bend)
        first = facing - np.arctan2(y1 + sine * x2 + cosine * y2, x1 + cosine * x2 - sine * y2)
        first = np.where(shoulder_free, 0.0, first)
        q[arm.first, way] = s[0] * first
        q[arm.first + 1, way] = s[1] * bend
        q[arm.first + 2, way] = s[2] * (turn - first - bend)
        for joint, angle in zip(arm.others, (qa, qb, qc), strict=True):
            q[joint, way] = angle
    doubtful = np.stack([np.abs(np.sin(bend - arm.straight)) < _DOUBTFUL for bend in bends])
    doubtful |= (across < _DOUBTFUL) | _double(qa, qc)
    there = np.isfinite(q[arm.first + 2] + qb)
    q[:, ~there] = np.nan

    def by_pose(what: NDArray[np.bool_], where: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return np.broadcast_to(what & where, there.shape).reshape(BRANCHES, m).T

    none = np.zeros(m, dtype=np.bool_)
    q = q.reshape(6, BRANCHES, m).transpose(2, 1, 0)
    free = by_pose(still, np.isfinite(qa))
    return BranchConfigurations(q, none, free, by_pose(shoulder_free, there), by_pose(doubtful, there))


def _close_to_singular(
    k: Columns, wa: Columns, wb: Columns, seen: Columns, qa: FloatArray, close: NDArray[np.bool_]
) -> None:
    """Recompute the angles of a (4, m) [rad] where ``seen`` (4, m), and so Rot(a, -θa) k, is close to ±b.

    There they are nearly a double root of the conditions, which have half of the digits only. The distance
    from b has them all: |Rot(a, -θa) k - b|² = d0² + 4 r1 r2 sin²((θa - θ0) / 2).
    """
    way, pose = np.nonzero(close & ~np.isnan(qa))
    seen, wa, wb = ([_of(entry, way, pose) for entry in v] for v in (seen, wa, wb))
    side = scaled(wb, np.copysign(1.0, dot(seen, wb)))
    middle = angle_onto(wa, side, k)
    radii = length(cross(wa, k)), length(cross(wa, side))
    gap = added(seen, side, -1.0)
    least = (radii[0] - radii[1]) ** 2 + (dot(wa, k) - dot(wa, side)) ** 2
    half = np.sqrt(np.maximum(dot(gap, gap) - least, 0.0) / np.maximum(4.0 * radii[0] * radii[1], 1e-300))
    off = wrapped(qa[way, pose] - middle)
    sign = np.where(off == 0.0, np.where(way < 2, 1.0, -1.0), np.sign(off))
    qa[way, pose] = middle + sign * 2.0 * np.arcsin(np.minimum(half, 1.0))


def _of(entry: FloatArray | float, way: NDArray[np.intp], pose: NDArray[np.intp]) -> FloatArray | float:
    """Those of (4, m), (m,) or one for all that belong to some ways of some poses."""
    if not isinstance(entry, np.ndarray):
        return entry
    return entry[way, pose] if entry.ndim == 2 else entry[pose]


def _apart(angles: FloatArray) -> FloatArray:
    """Differences of angles [rad] without whole turns and sign."""
    return np.abs(wrapped(angles))


def _double(qa: FloatArray, qc: FloatArray) -> NDArray[np.bool_]:
    """(4, m) where a pair of angles (4, m) lies close to another."""
    out = np.zeros(qa.shape, dtype=np.bool_)
    for i, j in itertools.combinations(range(4), 2):
        near = (_apart(qa[i] - qa[j]) < _DOUBTFUL) & (_apart(qc[i] - qc[j]) < _DOUBTFUL)
        out[i] |= near
        out[j] |= near
    return out


def _elbows(
    arm: ThreeParallel, squared: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], NDArray[np.bool_]]:
    """Both angles of the middle parallel joint for a squared distance (...) of the third axis from the first.

    NaN where the links do not reach, or for the second where both are one; and where the third axis lies on
    the first, so that the links may turn about it.
    """
    one, other = np.linalg.norm(arm.links, axis=1).tolist()
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


def _all_columns(vectors: tuple[FloatArray, FloatArray, FloatArray]) -> tuple[Columns, Columns, Columns]:
    a, b, c = map(columns, vectors)
    return a, b, c
