"""Which parts of an arm may touch each other, and how far apart they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.frames import LinkFrames
from armctl.kinematics.samples import joint_samples
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.arm_body import CLEAR_M, Capsule, SurfacePairs
from armctl.robot.body.hulls import (
    HullPairs,
    box_distance,
    box_hull,
    depth,
    segment_box_distance,
    segment_distance,
)
from armctl.robot.look.pieces import Mount, link_levers, mount_levers, of_joints
from armctl.robot.parts import Obstacle

NEAR_M = 0.02
"""Beyond this a gap is given as a lower bound, which costs less than its exact size."""
_AT_ONCE = 32
"""configurations of which all capsules are compared with all, so that the processor's cache holds them"""
_SAMPLES, _FIRST_SAMPLES, _FEW_SAMPLES = 512, 8, 3
_BESIDE_M = 4e-4
"""What lies beside each other may overlap by this: less than the pre-flight lets parts dip."""


def _mount(chain: Chain, mounts: Sequence[Mount], link: int) -> Mount:
    """The frame with an index: of a link, or of what moves with two links."""
    count = len(chain.segments)
    return Mount(link, link) if link < count else mounts[link - count]


def _may_meet(inner: frozenset[int], outer: frozenset[int]) -> bool:
    """Whether what these links move is kept apart: it shares no link, and two links are no neighbours."""
    if len(inner) == len(outer) == 1:
        return max(outer) - max(inner) > 1
    return not inner & outer


Pairs = tuple[tuple[int, int], ...]
SolidPairs = frozenset[tuple[int, int]]
"""of solids of a look, of which a capsule each is in a pair"""


def _chosen(pairs: Pairs, which: NDArray[np.intp]) -> Pairs:
    indices: list[int] = which.tolist()
    return tuple(pairs[k] for k in indices)


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """The pieces of an arm, and the pairs of them that are kept apart.

    Left out are pairs of one link or of neighbours, which the joint's own limits keep apart; cranks and rods,
    and what they are pinned to; and pairs that touch in every one of 512 configurations spread over the
    limits: they meet in a joint, and no motion could mend that. So are pairs that turn beside each other.
    Pairs that touch in the home or the rest pose only may overlap as deep as there.

    Where the hulls of a pair overlap, its surfaces are looked at, if both are known and do not cut each other
    at rest. Their gap is their distance less ``CLEAR_M``; where they cut each other, that of the hulls.
    """

    chain: Chain
    capsules: tuple[Capsule, ...]
    """from the base to the tool"""
    pairs: Pairs
    """indices of capsules, the one nearer to the base first"""
    closed: FloatArray
    """(k,) the gap of each in the home or the rest pose where that is negative, else 0 [m]"""
    touching: Pairs = ()
    """pairs that are left out because they always touch"""
    obstacles: tuple[Obstacle, ...] = ()
    """what stands around the arm"""
    mounts: tuple[Mount, ...] = ()
    """frames of capsules that move with two links: their indices follow those of the links"""
    solids: tuple[int, ...] = ()
    """which solid of the body each capsule is of, or is a part of; empty: each is of its own"""

    @classmethod
    def build(
        cls,
        chain: Chain,
        capsules: Sequence[Capsule],
        limits: FloatArray,
        poses: FloatArray,
        obstacles: tuple[Obstacle, ...] = (),
        mounts: tuple[Mount, ...] = (),
        solids: Sequence[int] = (),
        always: SolidPairs | None = None,
        among: SolidPairs | None = None,
    ) -> Self:
        """Find the pairs of an arm with these ``limits`` (n, 2) and poses at rest (m, n) [rad].

        ``always``: pairs of ``solids`` that are known to touch in all configurations; None: look for them.
        ``among``: the only ones that are looked at; None: all.
        """
        carried = [_mount(chain, mounts, one.link).links for one in capsules]
        order = sorted(range(len(carried)), key=lambda k: (max(carried[k]), capsules[k].link))
        ordered, carried = tuple(capsules[k] for k in order), [carried[k] for k in order]
        numbers = solids or range(len(order))
        solids = tuple(numbers[k] for k in order)
        apart: Pairs = tuple(
            (i, j)
            for j, outer in enumerate(carried)
            for i, inner in enumerate(carried[:j])
            if _may_meet(inner, outer) and (among is None or (solids[i], solids[j]) in among)
        )
        model = cls(chain, ordered, apart, np.zeros(len(apart)), mounts=mounts)
        model = model._of(np.flatnonzero(~model._side_by_side(joint_samples(limits, _FEW_SAMPLES))))
        apart = model.pairs
        resting = model.gaps(model.frames(poses), 1e-9)
        if always is None:
            met = model.always_met(
                np.flatnonzero((resting <= 0.0).all(axis=1)), joint_samples(limits, _SAMPLES)
            )
        else:
            known = [(solids[i], solids[j]) in always for i, j in apart]
            met = np.flatnonzero(np.array(known, dtype=np.bool_))
        kept: NDArray[np.intp] = np.setdiff1d(np.arange(len(apart)), met)
        pairs, touching = _chosen(apart, kept), _chosen(apart, met)
        closed = np.minimum(resting[kept].min(axis=1, initial=0.0), 0.0)
        return cls(chain, ordered, pairs, closed, touching, obstacles, mounts, solids)

    def carrying(self, part: Capsule, limits: FloatArray) -> Self:
        """The same with a part on the last link, kept apart from all that is not of this link.

        Neighbours count, too, but not what touches it in every configuration inside ``limits`` (n, 2) [rad]:
        no motion could mend that. In the home and the rest pose it may overlap nothing.
        """
        last = len(self.capsules)
        links = _mount(self.chain, self.mounts, part.link).links
        beside: Pairs = tuple(
            (i, last)
            for i, one in enumerate(self.capsules)
            if not links & _mount(self.chain, self.mounts, one.link).links
        )
        hung = replace(
            self,
            capsules=(*self.capsules, part),
            pairs=beside,
            closed=np.zeros(len(beside)),
            solids=(*self.solids, max(self.solids) + 1) if self.solids else (),
        )
        met = hung.always_met(np.arange(len(beside)), joint_samples(limits, _SAMPLES))
        kept: NDArray[np.intp] = np.setdiff1d(np.arange(len(beside)), met)
        return replace(
            hung,
            pairs=(*self.pairs, *_chosen(beside, kept)),
            closed=np.concatenate([self.closed, np.zeros(len(kept))]),
            touching=(*self.touching, *_chosen(beside, met)),
        )

    def frames(self, q: ArrayLike) -> LinkFrames:
        """The links at ``q`` (m, n) [rad] and, behind them, what moves with two of them."""
        links = LinkFrames.at(self.chain, q)
        return links.and_also([mount.at(links) for mount in self.mounts]) if self.mounts else links

    def _of(self, pairs: NDArray[np.intp]) -> Self:
        """The same with some of its pairs."""
        return replace(self, pairs=_chosen(self.pairs, pairs), closed=self.closed[pairs])

    def always_met(self, pairs: NDArray[np.intp], samples: FloatArray) -> NDArray[np.intp]:
        """Those of ``pairs`` that touch in every one of ``samples`` (m, n) [rad]."""
        at, some = 0, _FIRST_SAMPLES
        while len(pairs) and at < len(samples):  # most pairs come apart soon
            gaps = self._of(pairs).gaps(self.frames(samples[at : at + some]), 1e-9, depths=False)
            pairs, at, some = pairs[(gaps <= 0.0).all(axis=1)], at + some, 2 * some
        return pairs

    def _side_by_side(self, samples: FloatArray) -> NDArray[np.bool_]:
        """(k,) pairs that never meet: all joints between turn them in parallel planes, and they lie beside.

        Along the axes of these joints neither ever moves. ``samples`` (m, n) [rad]: a few configurations.
        """
        links, never = self.frames(samples), np.zeros(len(self.pairs), dtype=np.bool_)
        axes = np.array([links.rotation[j][:, 2] for j in range(len(self.chain.segments))])  # (links, 3, m)
        carried = [_mount(self.chain, self.mounts, one.link).links for one in self.capsules]
        parallel: dict[tuple[int, int], bool] = {}
        extents: dict[tuple[int, int], FloatArray] = {}

        def extent(piece: int, axis: int) -> FloatArray:
            """(2, m) lowest and highest point along the axis of a link [m]."""
            if (piece, axis) not in extents:
                hull = self.capsules[piece].as_hull
                points = links.place(self.capsules[piece].link, hull.corners)
                along = np.einsum("cpm,cm->pm", points, axes[axis])
                extents[piece, axis] = np.array(
                    [along.min(axis=0) - hull.margin, along.max(axis=0) + hull.margin]
                )
            return extents[piece, axis]

        for k, (i, j) in enumerate(self.pairs):
            first = min(min(carried[i]), min(carried[j])) + 1
            last = max(max(carried[i]), max(carried[j]))
            if (first, last) not in parallel:
                turning = np.abs(np.einsum("jcm,cm->jm", axes[first : last + 1], axes[last]))
                parallel[first, last] = turning.min(initial=1.0) > 1.0 - 1e-9
            if parallel[first, last]:
                one, other = extent(i, last), extent(j, last)
                never[k] = np.maximum(one[0] - other[1], other[0] - one[1]).min() > -_BESIDE_M
        return never

    @property
    def touching_solids(self) -> SolidPairs:
        """Solids of which some are left out because they always touch."""
        return frozenset((self.solids[i], self.solids[j]) for i, j in self.touching)

    @property
    def notes(self) -> tuple[str, ...]:
        """Which parts are not kept apart, or not altogether, a sentence each."""
        always = dict.fromkeys(self._names(pair) for pair in self.touching)
        resting = {
            self._names(pair): -1000 * gap
            for gap, pair in sorted(zip(self.closed.tolist(), self.pairs, strict=True), reverse=True)
            if gap < 0.0
        }
        return (
            *(f"whether {one} touches {other}: pieces of them do in every pose" for one, other in always),
            *(
                f"whether {one} touches {other} while they overlap no deeper than at rest ({depth:.0f} mm)"
                for (one, other), depth in resting.items()
            ),
        )

    def _names(self, pair: tuple[int, int]) -> tuple[str, str]:
        return self.capsules[pair[1]].part, self.capsules[pair[0]].part

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Indices of the capsules that a joint moves."""
        return tuple(i for i, capsule in enumerate(self.capsules) if capsule.link >= 0)

    @cached_property
    def levers(self) -> FloatArray:
        """(capsules, n) how far a corner of each one moves a radian of each joint, at most [m/rad]."""
        return of_joints(self.chain, self._link_levers)

    @cached_property
    def _link_levers(self) -> FloatArray:
        """(capsules, m) as ``levers``, a radian of each link's turn."""
        rows = [self.levers_of(c.link, c.corners) for c in self.capsules]
        return np.array(rows).reshape(-1, len(self.chain.segments))

    def levers_of(self, link: int, points: FloatArray) -> FloatArray:
        """How far points (p, 3) [m] in a frame move a radian of each link's turn, at most: (m,) [m/rad]."""
        count = len(self.chain.segments)
        if link < count:
            return link_levers(self.chain, link, points)
        return mount_levers(self.chain, self.mounts[link - count], points)

    @cached_property
    def pair_levers(self) -> FloatArray:
        """(k, n) how much the gap of each pair changes a radian of each joint, at most [m/rad]."""
        first, second = self._pieces
        levers = self._link_levers[first] + self._link_levers[second]
        for row, pair in zip(levers, self.pairs, strict=True):
            links = (_mount(self.chain, self.mounts, self.capsules[i].link).links for i in pair)
            row[: min(map(min, links)) + 1] = 0.0  # these turns carry both
        return of_joints(self.chain, levers)

    def gaps(self, links: LinkFrames, enough: ArrayLike = NEAR_M, *, depths: bool = True) -> FloatArray:
        """Gaps between the pairs: (k, m) [m], negative where they overlap.

        ``links``: as ``frames`` gives them. Beyond ``enough`` (k, m) [m] they are lower bounds, which cost
        less than exact ones. Without ``depths`` any negative one will do where hulls touch, within 0.1 mm.
        """
        starts, spans = placed = self.placed(links)
        out = self._apart_by_balls(starts + 0.5 * spans)
        enough = np.broadcast_to(np.asarray(enough, dtype=np.float64), out.shape)
        pair, at = np.nonzero(out < enough)
        if len(pair):
            out[pair, at] = self._gaps_at(links, placed, pair, at, enough[pair, at], depths)
        return out

    def depth(self, links: LinkFrames, pair: int) -> float | None:
        """How deep the hulls of a pair are in each other at the first configuration [m]; see ``depth``."""
        one, other = (self.capsules[k] for k in self.pairs[pair])
        return depth(one.as_hull, other.as_hull, *_first(links, one.link, other.link))

    def depth_in(self, links: LinkFrames, obstacle: Obstacle, piece: int) -> float | None:
        """The same of a piece that is inside an obstacle."""
        one = self.capsules[piece]
        return depth(box_hull(obstacle), one.as_hull, *_first(links, -1, one.link))

    @cached_property
    def by_surface(self) -> NDArray[np.bool_]:
        """(k,) pairs whose surfaces decide where their hulls overlap."""
        known = np.array([None not in (c.hull, c.surface) for c in self.capsules], dtype=np.bool_)
        first, second = self._pieces
        return known[first] & known[second] & (self.closed > -CLEAR_M)

    def _by_surfaces(
        self, links: LinkFrames, hulls: FloatArray, pair: NDArray[np.intp], at: NDArray[np.intp]
    ) -> FloatArray:
        """Gaps (m,) [m] of pairs at configurations where those of their ``hulls`` (m,) are negative."""
        i, j = self._pieces[:, pair]
        pose = links.relative(self._links[i], self._links[j], at)
        apart = self._surfaces.distances(i, j, *pose)
        return np.where(apart > 0.0, np.maximum(apart - CLEAR_M, hulls), np.minimum(hulls, -CLEAR_M))

    def _gaps_at(
        self,
        links: LinkFrames,
        placed: tuple[FloatArray, FloatArray],
        pair: NDArray[np.intp],
        at: NDArray[np.intp],
        enough: FloatArray,
        depths: bool,
    ) -> FloatArray:
        """Gaps (e,) [m] of pairs at configurations: by capsules, by hulls, and by surfaces.

        ``placed``: as ``placed`` gives them.
        """
        i, j = self._pieces[:, pair]
        (start, span), (other_start, other_span) = ([one[:, k, at] for one in placed] for k in (i, j))
        out = segment_distance(start, span, other_start, other_span) - self._radii[i] - self._radii[j]
        near = np.flatnonzero((self._fitted[i] | self._fitted[j]) & (out < enough))
        i, j, at, enough = i[near], j[near], at[near], enough[near]
        pose = links.relative(self._links[i], self._links[j], at)
        out[near] = np.maximum(out[near], self._hulls.gaps(i, j, *pose, enough, depths=depths))
        cut = (out[near] < np.minimum(enough, 0.0)) & self.by_surface[pair[near]]
        if cut.any():
            out[near[cut]] = self._by_surfaces(links, out[near[cut]], pair[near[cut]], at[cut])
        return out

    @cached_property
    def _pieces(self) -> NDArray[np.intp]:
        """(2, k) indices of the capsules of each pair."""
        return np.array(self.pairs, dtype=np.intp).reshape(-1, 2).T

    def _apart_by_balls(self, middles: FloatArray) -> FloatArray:
        """Lower bounds (k, m) [m] of gaps: of balls round all capsules, ``middles`` (3, capsules, m)."""
        places, (first, second) = middles.transpose(2, 1, 0), self._pieces
        square = (places * places).sum(axis=2, keepdims=True)
        one = np.concatenate([-2.0 * places, square, np.ones_like(square)], axis=2)
        other = np.concatenate([places, np.ones_like(square), square], axis=2).transpose(0, 2, 1)
        out = np.empty((len(first), len(places)))
        for begin in range(0, len(places), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            squares: FloatArray = one[some] @ other[some]  # of all distances
            out[:, some] = squares[:, first, second].T
        sizes = self._radii + self._halves
        return np.sqrt(np.maximum(out, 0.0)) - (sizes[first] + sizes[second])[:, None]

    def gaps_around(self, links: LinkFrames) -> FloatArray:
        """Gaps between each obstacle and each moving piece: (obstacles · moving, m) [m], as ``gaps``."""
        obstacles, (starts, spans) = self.obstacles, self.placed(links)
        out = np.empty((len(obstacles) * len(self.moving), links.origin[0].shape[-1]))
        piece, box = np.tile(self.moving, len(obstacles)), np.arange(len(obstacles)).repeat(len(self.moving))
        places = ((obstacle, i) for obstacle in obstacles for i in self.moving)
        for gap, (obstacle, i) in zip(out, places, strict=True):
            radius = self.capsules[i].radius
            middle = starts[:, i] + 0.5 * spans[:, i]
            gap[:] = box_distance(middle, obstacle.low, obstacle.high) - (self._halves[i] + radius)
            near = np.flatnonzero(gap < NEAR_M)
            if len(near) and not self._fitted[i]:
                axis = starts[:, i, near], spans[:, i, near]
                gap[near] = segment_box_distance(*axis, obstacle.low, obstacle.high) - radius
        row, at = np.nonzero((out < NEAR_M) & self._fitted[piece][:, None])
        if len(row):
            pose = links.relative(np.full(len(at), -1), self._links[piece[row]], at)
            closer = self._hulls.gaps(len(self.capsules) + box[row], piece[row], *pose, NEAR_M)
            out[row, at] = np.maximum(out[row, at], closer)
        return out

    @cached_property
    def _hulls(self) -> HullPairs:
        """Of the capsules, and behind them of the obstacles."""
        return HullPairs([*(one.as_hull for one in self.capsules), *map(box_hull, self.obstacles)])

    @cached_property
    def _surfaces(self) -> SurfacePairs:
        return SurfacePairs([one.surface for one in self.capsules])

    @cached_property
    def _fitted(self) -> NDArray[np.bool_]:
        return np.array([capsule.hull is not None for capsule in self.capsules])

    @cached_property
    def _links(self) -> NDArray[np.intp]:
        return np.array([capsule.link for capsule in self.capsules], dtype=np.intp)

    @cached_property
    def _halves(self) -> FloatArray:
        return np.array([0.5 * math.dist(capsule.start, capsule.end) for capsule in self.capsules])

    @cached_property
    def _radii(self) -> FloatArray:
        return np.array([capsule.radius for capsule in self.capsules])

    def placed(self, links: LinkFrames) -> tuple[FloatArray, FloatArray]:
        """Starts and spans of all capsules: (3, capsules, m) each [m], base frame."""
        starts, ends = np.empty((2, 3, len(self.capsules), links.tool.shape[1]))
        for link, which, points in self._ends:
            placed = links.place(link, points)
            starts[:, which], ends[:, which] = placed[:, : len(which)], placed[:, len(which) :]
        return starts, ends - starts

    @cached_property
    def _ends(self) -> list[tuple[int, NDArray[np.intp], FloatArray]]:
        """Of each frame: its index, those of its capsules (k,), their starts and then ends (2 k, 3) [m]."""
        found: list[tuple[int, NDArray[np.intp], FloatArray]] = []
        for link in dict.fromkeys(self._links.tolist()):
            which = np.flatnonzero(self._links == link)
            here = [self.capsules[k] for k in which.tolist()]
            found.append((link, which, np.array([*(c.start for c in here), *(c.end for c in here)])))
        return found


def _first(links: LinkFrames, one: int, other: int) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and origin (3,) [m] of a frame in another, at the first configuration."""
    R, origin = links.relative(*np.array([[one], [other], [0]], dtype=np.intp))
    return R[0], origin[0]
