"""Convex hulls, and how far apart two of them are: many pairs in many poses at once."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.subproblems import dot
from armctl.lazy_dataclass import dataclass
from armctl.robot.parts import Obstacle

# Distances between straight segments, and from boxes: many at once, entry by entry in memory.

_PARALLEL = 1e-12
"""squared sine of the angle between two segments below which they count as parallel"""


def segment_distance(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray) -> FloatArray:
    """Smallest distance (...) between the segments ``p + s u`` and ``q + t v``, s and t in 0 … 1.

    All are (3, ...) [m]. After Ericson, *Real-Time Collision Detection* (2005), section 5.1.9: the nearest
    points of the two lines, then t clipped and s fitted to it. A segment of no length is a point.
    """
    r = p - q
    a, e, b = dot(u, u), dot(v, v), dot(u, v)
    c, f = dot(u, r), dot(v, r)
    crossing = a * e - b * b
    skew = crossing > _PARALLEL * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, crossing, 1.0), 0.0, 1.0), 0.0)
    t = np.clip(np.where(e > 0.0, (b * s + f) / np.where(e > 0.0, e, 1.0), 0.0), 0.0, 1.0)
    s = np.clip(np.where(a > 0.0, (b * t - c) / np.where(a > 0.0, a, 1.0), 0.0), 0.0, 1.0)
    gap = r + s * u - t * v
    return np.sqrt(dot(gap, gap))


def segment_box_distance(p: FloatArray, u: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Smallest signed distance (...) of the segments ``p + s u``, (3, ...) [m], to a box as ``box_distance``.

    The signed distance to a convex body is convex along a line, so a golden section search finds its
    minimum; it ends within 1e-9 of the segment's length.
    """
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    left, right = np.zeros(p.shape[1:]), np.ones(p.shape[1:])
    near, far = left + (1.0 - ratio), left + ratio
    at_near, at_far = box_distance(p + near * u, low, high), box_distance(p + far * u, low, high)
    for _ in range(44):
        lower = at_near < at_far
        left, right = np.where(lower, left, near), np.where(lower, far, right)
        step: FloatArray = ratio * (right - left)
        fresh: FloatArray = np.where(lower, right - step, left + step)
        value = box_distance(p + fresh * u, low, high)
        near, far = np.where(lower, fresh, far), np.where(lower, near, fresh)
        at_near, at_far = np.where(lower, value, at_far), np.where(lower, at_near, value)
    ends = np.minimum(box_distance(p, low, high), box_distance(p + u, low, high))
    return np.minimum(np.minimum(at_near, at_far), ends)


def box_distance(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Signed distance (...) of points (3, ...) to a box, corners (3,); inside, minus the depth."""
    shape = (3, *[1] * (points.ndim - 1))
    middle, half = 0.5 * (low + high).reshape(shape), 0.5 * (high - low).reshape(shape)
    beyond = np.abs(points - middle) - half
    outside = np.maximum(beyond, 0.0)
    return np.sqrt(dot(outside, outside)) + np.minimum(beyond.max(axis=0), 0.0)


_STEPS = 32
"""towards the points that are nearest to each other, at most"""
_EXACT_M = 1e-4
"""A distance that is known to this is not made more exact."""
_DOUBTFUL_M = 0.002
"""Where no more than this is known to lie between two hulls, their faces are looked at."""
_TURNS, _PATIENCE = 40, 10
"""of the direction in which two hulls that overlap come apart; fewer where so many have brought nothing"""
_STARTS = 4
"""directions that are turned"""
_BLOCK, _BLOCK_OF_FACES = 512, 128
"""pairs in one array, so that memory stays bounded; where all their faces are looked at, fewer"""


@dataclass(frozen=True, slots=True, eq=False)
class Hull(ArrayRecord):
    """All points within a margin of the convex hull of its corners."""

    corners: FloatArray
    """(k, 3) in the frame of its link [m]"""
    normals: FloatArray
    """(f, 3) unit vectors out of its faces, or across it where it is flat; none are needed"""
    margin: float
    """[m]"""

    @property
    def thickness(self) -> float:
        """Half of its least extent across a face [m]."""
        return self.margin + 0.5 * float(np.ptp(self.corners @ self.normals.T, axis=0).min())


def box_hull(box: Obstacle) -> Hull:
    """The hull of a box that stands around the arm."""
    low, high = box.low, box.high
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    return Hull(corners, np.vstack([np.eye(3), -np.eye(3)]), 0.0)


class HullPairs:
    """Gaps between any two of some hulls."""

    def __init__(self, hulls: Sequence[Hull]) -> None:
        self._corners = padded([one.corners for one in hulls], np.zeros((1, 3)))
        self._normals = padded([one.normals for one in hulls], np.array([[1.0, 0.0, 0.0]]))
        self._margins = np.array([one.margin for one in hulls])
        self._sizes = np.array([(len(one.corners), max(len(one.normals), 1)) for one in hulls]).reshape(-1, 2)
        """(hulls, 2) how many corners and normals are not padding"""
        self._middles = self._corners.mean(axis=1)
        self._heights = (self._normals @ self._corners.transpose(0, 2, 1)).max(axis=2)
        """(hulls, f) of each face above the origin, along its normal [m]"""

    def gaps(
        self,
        one: NDArray[np.intp],
        other: NDArray[np.intp],
        R: FloatArray,
        origin: FloatArray,
        enough: ArrayLike,
        *,
        depths: bool = True,
    ) -> FloatArray:
        """Gaps (k,) [m] between hulls and others.

        ``R`` (k, 3, 3) and ``origin`` (k, 3) [m] place the frames of the others in those of the first.
        Negative where they overlap: minus the way on which they come apart. Each is a lower bound: in some
        direction the two are so far apart. Beyond ``enough`` [m], (k,) or one for all, any lower bound will
        do. Where the nearest points do not tell them clearly apart, the normals of all faces are tried;
        without ``depths`` not where the two touch, to 0.1 mm: then any negative gap will do.
        """
        low, enough = np.empty(len(one)), np.broadcast_to(np.asarray(enough, dtype=np.float64), len(one))
        # pairs of like sizes together: half of the time went into the padding of small hulls beside large
        order = np.lexsort((self._sizes[other, 0], self._sizes[one, 0]))
        for begin in range(0, len(one), _BLOCK):
            block = order[begin : begin + _BLOCK]
            low[block] = self._gaps_of_block(
                one[block], other[block], R[block], origin[block], enough[block], depths
            )
        return low

    def _gaps_of_block(
        self,
        i: NDArray[np.intp],
        j: NDArray[np.intp],
        R: FloatArray,
        origin: FloatArray,
        enough: FloatArray,
        depths: bool,
    ) -> FloatArray:
        """As ``gaps``, of few enough for one array."""
        (corners, faces), (other_corners, other_faces) = (self._sizes[k].max(axis=0) for k in (i, j))
        turned, margin = R.transpose(0, 2, 1), self._margins[i] + self._margins[j]
        here = self._corners[i, :corners]
        there = self._corners[j, :other_corners] @ turned + origin[:, None]
        apart = self._middles[i] - (self._middles[j, None] @ turned)[:, 0] - origin
        near, far = nearing(here, there, enough + margin, apart)
        low = near - margin
        doubtful = low < np.minimum(_DOUBTFUL_M, enough)
        doubtful &= (near <= 0.0) | (far - near > _EXACT_M)
        if not depths:
            touch = far <= margin + _EXACT_M
            low[touch] = np.minimum(low[touch], -_EXACT_M)
            doubtful &= ~touch
        doubtful = np.flatnonzero(doubtful)
        for some in np.split(doubtful, range(_BLOCK_OF_FACES, len(doubtful), _BLOCK_OF_FACES)):
            own, others = self._normals[i[some], :faces], -self._normals[j[some], :other_faces] @ turned[some]
            # (k, f): the lowest of the other less the highest of one, of which a face knows one
            beyond = (own @ there[some].transpose(0, 2, 1)).min(axis=2) - self._heights[i[some], :faces]
            behind = (others @ origin[some, :, None])[:, :, 0] - self._heights[j[some], :other_faces]
            behind -= (others @ here[some].transpose(0, 2, 1)).max(axis=2)
            d, along = np.concatenate([own, others], axis=1), np.concatenate([beyond, behind], axis=1)
            apart = _parted(here[some], there[some], d, along, enough[some] + margin[some]) - margin[some]
            low[some] = np.maximum(low[some], apart)
        return low


def _parted(
    one: FloatArray, other: FloatArray, d: FloatArray, apart: FloatArray, enough: FloatArray
) -> FloatArray:
    """How far hulls of corners (k, c, 3) lie beyond others in the best direction found, (k,) [m].

    Where they overlap it is minus the way out. Of directions ``d`` (k, f, 3), the normals of all faces, in
    which they lie ``apart`` (k, f) [m], the best are turned on, as the way out may be that of two edges.
    Beyond ``enough`` (k,) [m] none is.
    """
    out = apart.max(axis=1)
    short = np.flatnonzero(out < enough)
    if len(short):
        out[short] = _turned(one[short], other[short], d[short], apart[short])
    return out


def _turned(one: FloatArray, other: FloatArray, d: FloatArray, apart: FloatArray) -> FloatArray:
    """As ``_parted``, where all directions are turned; ``apart`` (k, f): how far they lie beyond in each."""
    busy, row = np.arange(len(d)), np.arange(len(d))[:, None]
    best = np.argsort(apart, axis=1)[:, : -_STARTS - 1 : -1]
    found, turned, step = apart[row, best], d[row, best], 0.5
    out = found.max(axis=1)
    for turn in range(1, _TURNS + 1):
        lowest = other[row, (turned @ other.transpose(0, 2, 1)).argmin(axis=2)]
        highest = one[row, (turned @ one.transpose(0, 2, 1)).argmax(axis=2)]
        w = lowest - highest
        here = (w * turned).sum(axis=2)
        found = np.maximum(found, here)
        w -= here[:, :, None] * turned
        turned = turned + step * w / np.maximum(np.linalg.norm(w, axis=2), 1e-300)[:, :, None]
        turned /= np.linalg.norm(turned, axis=2)[:, :, None]
        step *= 0.85
        if turn % _PATIENCE == 0:
            now = found.max(axis=1)
            better = now - out[busy] >= 0.1 * _EXACT_M
            out[busy] = now
            if not better.any():
                return out
            busy, row = busy[better], np.arange(int(better.sum()))[:, None]
            one, other, found, turned = (each[better] for each in (one, other, found, turned))
    out[busy] = found.max(axis=1)
    return out


def depth(one: Hull, other: Hull, R: FloatArray, origin: FloatArray) -> float | None:
    """How deep a hull is inside another [m], exact: the shortest way on which they come apart.

    ``R`` (3, 3) and ``origin`` (3,) [m] place the frame of the other in that of the first. None: they overlap
    with their margins at most, or both are flat. Takes some ten times as long as ``HullPairs.gaps`` of one:
    all faces of the hull of all differences of their points are looked at.
    """
    from scipy.spatial import ConvexHull, QhullError

    there = other.corners @ R.T + origin
    try:
        faces = ConvexHull((one.corners[:, None] - there).reshape(-1, 3)).equations
    except QhullError:
        return None
    inside = -float(faces[:, 3].max())
    return inside + one.margin + other.margin if inside > 0.0 else None


def distances(corners: FloatArray, points: FloatArray) -> FloatArray:
    """How far points (m, 3) are from the hull of corners (k, 3), (m,) [m]; upper bounds."""
    here = np.broadcast_to(corners, (len(points), *corners.shape))
    return nearing(here, points[:, None], np.full(len(points), np.inf))[1]


def nearing(
    one: FloatArray, other: FloatArray, enough: FloatArray, between: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """How far apart hulls of corners (k, c, 3) and (k, d, 3) are at least and at most, (k,) each [m].

    At most is no less than 0. Beyond ``enough`` (k,) [m] they are not made more exact. ``between`` (k, 3):
    from some point of the other to some point of the one, to begin with.

    Gilbert, Johnson and Keerthi (1988), *A fast procedure for computing the distance between complex
    objects*: of all differences of points, the outermost one towards the origin joins a simplex, and of that
    only the corners round its point nearest to the origin are kept.
    """
    k = len(one)
    low, high = np.full(k, -np.inf), np.full(k, np.inf)
    v = one.mean(axis=1) - other.mean(axis=1) if between is None else between
    busy, kept = np.arange(k), np.repeat(v[:, None], 3, axis=1)
    for _ in range(_STEPS):
        size = np.sqrt(np.einsum("ki,ki->k", v, v))
        d = v / np.where(size > 0, size, 1.0)[:, None]
        row = np.arange(len(busy))
        w = one[row, (one @ d[:, :, None])[:, :, 0].argmin(axis=1)]
        w = w - other[row, (other @ d[:, :, None])[:, :, 0].argmax(axis=1)]
        apart = np.where(size > 0, (w * d).sum(axis=1), -np.inf)
        low[busy], high[busy] = np.maximum(low[busy], apart), np.minimum(high[busy], size)
        go_on = (high[busy] - low[busy] > _EXACT_M) & (low[busy] < enough[busy]) & (size > _EXACT_M)
        if not go_on.any():
            break
        busy, one, other = busy[go_on], one[go_on], other[go_on]
        v, kept = _nearest(w[go_on], kept[go_on])
    return low, high


_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def _nearest(w: FloatArray, kept: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The point (k, 3) nearest to the origin in simplices, and the three corners (k, 3, 3) to keep of each.

    The simplices have the corner ``w`` (k, 3), which is nearer than all before, and those ``kept`` of the
    last time (k, 3, 3). So the point is the foot of the origin on ``w`` itself, or on an edge, a face or the
    inside at ``w``: of those feet that lie inside, the nearest one.
    """
    k = len(w)
    a = kept - w[:, None]
    G, to = a @ a.transpose(0, 2, 1), -(a @ w[:, :, None])[:, :, 0]
    own = np.einsum("kii->ki", G)
    both, next_own, next_to = G[:, (0, 1, 2), _NEXT], own[:, _NEXT], to[:, _NEXT]
    after, before = a[:, _NEXT], a[:, _LAST]
    # across[i] is a[i + 1] x a[i + 2]
    across = after[:, :, _NEXT] * before[:, :, _LAST] - after[:, :, _LAST] * before[:, :, _NEXT]
    shares = np.zeros((k, 8, 3))  # of the kept corners; the first foot is w
    with np.errstate(divide="ignore", invalid="ignore"):  # corners in one place: no shares, and no better
        shares[:, _EDGES, _FIRST] = to / own
        square = own * next_own - both * both
        shares[:, _FACES, _FIRST] = (to * next_own - next_to * both) / square
        shares[:, _FACES, _NEXT] = (next_to * own - to * both) / square
        shares[:, 7] = -(across @ w[:, :, None])[:, :, 0] / (across[:, 0] * a[:, 0]).sum(axis=1)[:, None]
        feet = w[:, None] + shares @ a
        size = np.einsum("kfi,kfi->kf", feet, feet)
        first, second, third = shares[:, :, 0], shares[:, :, 1], shares[:, :, 2]  # numpy is slow along three
        lowest = np.minimum(np.minimum(first, second), third)
        outside = ~((lowest >= 0.0) & (first + second + third <= 1.0))
    size[outside] = np.inf
    row, best = np.arange(k), size.argmin(axis=1)
    share = shares[row, best]
    # w takes the place of the least needed, and of all others that are not
    needed = share > 0.0
    needed[row, share.argmin(axis=1)] = False
    return feet[row, best], np.where(needed[:, :, None], kept, w[:, None])


_FIRST, _EDGES, _FACES = [0, 1, 2], [1, 2, 3], [4, 5, 6]


def padded(arrays: Sequence[FloatArray], nothing: FloatArray) -> FloatArray:
    """Arrays (k, 3) as one (n, most, 3): the shorter ones end with their first row, or with ``nothing``."""
    arrays = [one if len(one) else nothing for one in arrays]
    most = max(map(len, arrays), default=1)
    padded = [np.concatenate([one, np.broadcast_to(one[0], (most - len(one), 3))]) for one in arrays]
    return np.array(padded).reshape(-1, most, 3)


_CLOSE, _LEVEL = 1e-6, 1e-7
"""Points so near to each other, of the size of a hull, are one; faces that bend by so little are one."""
_EACH = 4
"""One in so many points tells of most lines that they are no edges."""


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """As ``np.cross`` of vectors (k, 3), in a third of its time for some hundred."""
    return a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT]


def hull_of_few(points: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """The hull of few points (k, 3) that do not lie in a plane: indices of its corners, and normals (f, 3).

    Each line through two points is looked along: it is an edge, or lies in a face, where all other points are
    within half a turn about it, and the outermost of them span the faces. All k² lines are looked along at
    once: in 1 ms for 28 points. ``scipy.spatial`` takes a fifth of that, but 0.4 s to import, which was most
    of what it took to open an arm.
    """
    points = points - points.mean(axis=0)
    close = _CLOSE * float(np.abs(points).max())
    one, other = np.triu_indices(len(points), 1)
    along = points[other] - points[one]
    length = np.sqrt((along * along).sum(axis=1))
    doubled = np.zeros(len(points), dtype=np.bool_)
    doubled[other[length <= close]] = True
    along /= np.maximum(length, close)[:, None]
    # across a line: x towards the middle of all points, which is the origin, and y
    y = _cross(points[one], along)
    aside = np.sqrt((y * y).sum(axis=1))
    kept = np.flatnonzero((aside > close) & ~(doubled[one] | doubled[other]))
    y, x = y / np.maximum(aside, close)[:, None], np.empty_like(y)
    x[kept] = _cross(y[kept], along[kept])
    turn = _turns(x[kept] @ points[::_EACH].T + aside[kept, None], y[kept] @ points[::_EACH].T, close)
    kept = kept[np.ptp(turn, axis=1) <= 2.0 + _LEVEL]
    to_x, to_y = x[kept] @ points.T + aside[kept, None], y[kept] @ points.T
    turn = _turns(to_x, to_y, close)
    span = np.ptp(turn, axis=1)
    face = np.flatnonzero(span <= 2.0 + _LEVEL)
    normals = np.concatenate([
        side * (to_x[face, at, None] * y[kept[face]] - to_y[face, at, None] * x[kept[face]])
        for side, at in ((1.0, turn[face].argmax(axis=1)), (-1.0, turn[face].argmin(axis=1)))
    ])  # fmt: skip
    normals /= np.sqrt((normals * normals).sum(axis=1))[:, None]
    # an edge ends where no point lies farther on its line
    edge = np.flatnonzero(span < 2.0 - _LEVEL)
    line = kept[edge]
    ahead = along[line] @ points.T - (along[line] * points[one[line]]).sum(axis=1)[:, None]
    on_line = np.abs(to_x[edge]) + np.abs(to_y[edge]) <= close
    beyond = on_line & ((ahead < -close) | (ahead > length[line, None] + close))
    line = line[~beyond.any(axis=1)]
    return np.unique(np.concatenate([one[line], other[line]])), np.unique(normals.round(9), axis=0)


def _turns(x: FloatArray, y: FloatArray, close: float) -> FloatArray:
    """Angles from x, in a measure that is quickly found: 1 is a quarter of a turn; 0 next to the origin."""
    away = np.abs(x) + np.abs(y)
    turn: FloatArray = y / np.maximum(away, close)
    turn = np.where(x < 0, np.copysign(2.0, y) - turn, turn)
    turn[away <= close] = 0.0
    return turn
