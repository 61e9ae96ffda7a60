"""Which parts of an arm may touch each other, and how far apart they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import DHChain
from armctl.kinematics.link_frames import LinkFrames
from armctl.kinematics.workspace.joint_samples import joint_samples
from armctl.robot.capsules import Capsule
from armctl.robot.levers import lever_bounds
from armctl.robot.obstacle import Obstacle
from armctl.robot.segments import box_distance, segment_box_distance, segment_distance

FloatArray = NDArray[np.float64]
NEAR_M = 0.02
"""Beyond this a gap is given as a lower bound, which costs less than its exact size."""
_SAMPLES = 512


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """The capsules of an arm, and the pairs of them that are kept apart.

    Left out are pairs of one link or of neighbours, which the joint's own limits keep apart, and pairs that
    touch in the home pose or in every one of 512 configurations spread over the limits: they meet in a
    joint, and no motion could mend that.
    """

    chain: DHChain
    capsules: tuple[Capsule, ...]
    """from the base to the tool"""
    pairs: tuple[tuple[int, int], ...]
    """indices of capsules, the one nearer to the base first"""

    @classmethod
    def build(cls, chain: DHChain, capsules: Sequence[Capsule], limits: FloatArray, home: FloatArray) -> Self:
        """Find the pairs.

        Args:
            chain: the arm.
            capsules: its body.
            limits: (n, 2) [rad].
            home: (n,) [rad].
        """
        ordered = tuple(sorted(capsules, key=lambda capsule: capsule.link))
        apart = tuple(
            (i, j)
            for j, outer in enumerate(ordered)
            for i, inner in enumerate(ordered[:j])
            if outer.link - inner.link > 1
        )
        samples = np.concatenate([home[None], joint_samples(limits, _SAMPLES)])
        touching = cls(chain, ordered, apart).gaps(LinkFrames.at(chain, samples)) <= 0.0
        kept = ~(touching[:, 0] | touching.all(axis=1))
        return cls(chain, ordered, tuple(pair for pair, keep in zip(apart, kept, strict=True) if keep))

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Indices of the capsules that a joint moves, and so could be kept out of an obstacle."""
        return tuple(i for i, capsule in enumerate(self.capsules) if capsule.link >= 0)

    @cached_property
    def levers(self) -> FloatArray:
        """(capsules, n) how far a point of each one's axis moves a radian of each joint, at most [m/rad]."""
        rows = [lever_bounds(self.chain, c.link, np.array([c.start, c.end])) for c in self.capsules]
        return np.array(rows).reshape(-1, self.chain.n)

    @cached_property
    def pair_levers(self) -> FloatArray:
        """(k, n) how much the gap of each pair changes a radian of each joint, at most [m/rad]."""
        levers = self.levers[[j for _, j in self.pairs]].reshape(-1, self.chain.n)
        for row, (i, _) in zip(levers, self.pairs, strict=True):
            row[: self.capsules[i].link + 1] = 0.0  # these joints carry both
        return levers

    def gaps(self, links: LinkFrames) -> FloatArray:
        """Gaps between the pairs: (k, m) [m], negative where they overlap.

        Gaps of more than ``NEAR_M`` are lower bounds.
        """
        starts, spans = self._placed(links)
        out = np.empty((len(self.pairs), links.origin[0].shape[-1]))
        for gap, (i, j) in zip(out, self.pairs, strict=True):
            apart = starts[i] - starts[j] + 0.5 * (spans[i] - spans[j])
            radii = self.capsules[i].radius + self.capsules[j].radius
            gap[:] = np.sqrt(np.einsum("im,im->m", apart, apart)) - (
                self._halves[i] + self._halves[j] + radii
            )
            near = np.flatnonzero(gap < NEAR_M)
            if len(near):
                one, other = (starts[i][:, near], spans[i][:, near]), (starts[j][:, near], spans[j][:, near])
                gap[near] = segment_distance(*one, *other) - radii
        return out

    def gaps_to(self, obstacles: Sequence[Obstacle], links: LinkFrames) -> FloatArray:
        """Gaps between each obstacle and each moving capsule: (obstacles · moving, m) [m], as ``gaps``."""
        starts, spans = self._placed(links)
        out = np.empty((len(obstacles) * len(self.moving), links.origin[0].shape[-1]))
        places = [(obstacle, i) for obstacle in obstacles for i in self.moving]
        for gap, (obstacle, i) in zip(out, places, strict=True):
            radius = self.capsules[i].radius
            middle = starts[i] + 0.5 * spans[i]
            gap[:] = box_distance(middle, obstacle.low, obstacle.high) - (self._halves[i] + radius)
            near = np.flatnonzero(gap < NEAR_M)
            if len(near):
                axis = starts[i][:, near], spans[i][:, near]
                gap[near] = segment_box_distance(*axis, obstacle.low, obstacle.high) - radius
        return out

    @cached_property
    def _halves(self) -> list[float]:
        return [0.5 * float(np.linalg.norm(capsule.end - capsule.start)) for capsule in self.capsules]

    def _placed(self, links: LinkFrames) -> tuple[list[FloatArray], list[FloatArray]]:
        """Starts and spans of all capsules: (3, m) each [m], base frame."""
        ends = [links.place(c.link, np.array([c.start, c.end])) for c in self.capsules]
        return [end[:, 0] for end in ends], [end[:, 1] - end[:, 0] for end in ends]
