"""Is a gap (above the floor, between two links) kept over the whole of a motion, not only at its samples?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.kinematics.link_frames import LinkFrames
from armctl.motion.preflight.batch import Batch, Chunk, Finding, Worst
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_MISSED_M = 1e-3
"""How much deeper a dip between two samples may be before it is sure to be found."""
_TOO_FAST = 2.0
"""times the speed limits: a motion beyond is refused for its speed, and nothing else is proven of it"""


class Gaps(Protocol):
    """Something that parts of the arm must stay away from."""

    @property
    def tolerance_m(self) -> float:
        """By how much a gap may be closed all the same."""
        ...

    @property
    def levers(self) -> FloatArray:
        """(k, n) how much each gap changes a radian of each joint, at most [m/rad]."""
        ...

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) [m]; negative where it is not kept."""
        ...

    def finding(self, time: float, part: int, gap: float) -> Finding:
        """What to say of gap number ``part`` of ``gap`` [m]."""
        ...


class KeepOut:
    """Holds gaps open along motions.

    A gap must stay open; where a motion starts with it closed, it must not close further. A gap cannot
    change faster than its levers times the joint speeds, so with gaps g₀ and g₁ at two samples and a
    change of at most D between them, it is at least (g₀ + g₁ - D) / 2 there. Where that does not prove it
    open, the interval is halved.
    """

    def __init__(self, batch: Batch, source: Gaps, at_start: LinkFrames) -> None:
        """Prepare.

        Args:
            batch: the motions.
            source: what they must stay away from.
            at_start: the links where each motion starts.
        """
        self._batch, self._source = batch, source
        self._worst = Worst(batch.motions)
        self._allowed = np.minimum(source.gaps(at_start), 0.0) - source.tolerance_m
        """(k, motions) smallest gaps [m]"""
        self._rates = source.levers @ np.minimum(batch.speeds, _TOO_FAST * batch.robot.speed_limits).T
        """(k, leaves) how fast gaps change, at most [m/s]"""
        self._doubtful: list[_Intervals] = []

    def look(self, chunk: Chunk, links: LinkFrames) -> None:
        """Take in some samples."""
        if not len(self._allowed):
            return
        slack = self._slack(chunk.motion, chunk.time, links)
        inside = np.flatnonzero(chunk.leaf[1:] == chunk.leaf[:-1])
        steps = _Intervals(
            chunk.leaf[inside],
            chunk.time[inside],
            chunk.time[inside + 1],
            slack[:, inside],
            slack[:, inside + 1],
        )
        self._doubtful.append(self._unproven(steps))

    def findings(self) -> Iterator[tuple[int, Finding]]:
        """What was found, with the index of the motion; halves the intervals that are in doubt first."""
        for doubtful in self._doubtful:
            steps = self._unproven(doubtful)
            while steps.count:
                steps = self._halved(steps)
        worst = self._worst
        for i in worst.found.tolist():
            yield i, self._source.finding(float(worst.time[i]), int(worst.which[i]), float(worst.figure[i]))

    def _slack(self, motion: IntArray, time: FloatArray, links: LinkFrames) -> FloatArray:
        """(k, m) how much larger the gaps are than they must be [m]; notes those that are not."""
        gaps = self._source.gaps(links)
        slack = gaps - self._allowed[:, motion]
        which = slack.argmin(axis=0)
        columns = np.arange(len(motion))
        self._worst.look(motion, time, -slack[which, columns], which, gaps[which, columns])
        return slack

    def _unproven(self, steps: _Intervals) -> _Intervals:
        """Those in which a gap might close, of motions that nothing was found in yet."""
        change = self._rates[:, steps.leaf] * (steps.end - steps.begin)
        least = 0.5 * (steps.slack_begin + steps.slack_end - change)
        nothing_yet = self._worst.badness[self._batch.owner[steps.leaf]] <= 0.0
        return steps.where((least < -_MISSED_M).any(axis=0) & nothing_yet)

    def _halved(self, steps: _Intervals) -> _Intervals:
        middle = 0.5 * (steps.begin + steps.end)
        q = np.empty((steps.count, self._batch.robot.n))
        bounds = np.flatnonzero(np.diff(steps.leaf, prepend=-1, append=-1))
        for low, high in pairwise(bounds.tolist()):
            leaf = self._batch.leaves[int(steps.leaf[low])]
            q[low:high] = leaf.trajectory.sample(middle[low:high] - leaf.begins).q
        slack = self._slack(self._batch.owner[steps.leaf], middle, LinkFrames.at(self._batch.robot.chain, q))
        halves = (
            _Intervals(steps.leaf, steps.begin, middle, steps.slack_begin, slack),
            _Intervals(steps.leaf, middle, steps.end, slack, steps.slack_end),
        )
        return _Intervals.joined([self._unproven(half) for half in halves])


@dataclass(frozen=True, slots=True, eq=False)
class _Intervals:
    """Pieces of motions between two samples, i of them."""

    leaf: IntArray
    begin: FloatArray
    """(i,) from the start of the motion [s]"""
    end: FloatArray
    slack_begin: FloatArray
    """(k, i) [m]"""
    slack_end: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[_Intervals]) -> _Intervals:
        """Several, in the order of their leaves."""
        leaf = np.concatenate([part.leaf for part in parts])
        order = np.argsort(leaf, kind="stable")
        return cls(
            leaf[order],
            np.concatenate([part.begin for part in parts])[order],
            np.concatenate([part.end for part in parts])[order],
            np.concatenate([part.slack_begin for part in parts], axis=1)[:, order],
            np.concatenate([part.slack_end for part in parts], axis=1)[:, order],
        )

    @property
    def count(self) -> int:
        """How many."""
        return len(self.leaf)

    def where(self, mask: NDArray[np.bool_]) -> _Intervals:
        """Some of them."""
        return _Intervals(
            self.leaf[mask],
            self.begin[mask],
            self.end[mask],
            self.slack_begin[:, mask],
            self.slack_end[:, mask],
        )


# How far every part of the arm is above the floor.

FLOOR_TOLERANCE_M = 5e-4
"""How far a part may dip below the floor: less than a servo arm can tell."""


class Floor:
    """Heights of the arm's corners (``Robot.corners``) above the floor plane.

    Corners whose height no joint changes (the base, a turning column) are left out: no motion could mend
    them.
    """

    tolerance_m = FLOOR_TOLERANCE_M

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.parts: tuple[str, ...] = tuple(corner.part for corner in robot.corners)
        """names of the corners that ``clearance`` gives, from the base to the tool"""
        self.levers = np.array([corner.levers for corner in robot.corners]).reshape(-1, robot.n)
        """(k, n) how far a corner rises or sinks a radian of each joint, at most [m/rad]"""

    def clearance(self, q: ArrayLike) -> FloatArray:
        """Heights above the floor.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            (..., k) [m], one a corner of ``parts``; negative below the floor. k may be 0.
        """
        q = self._robot.chain.checked(q)
        links = LinkFrames.at(self._robot.chain, q.reshape(-1, self._robot.n))
        return self.gaps(links).T.reshape(*q.shape[:-1], len(self.parts))

    def gaps(self, links: LinkFrames) -> FloatArray:
        """As ``clearance``, for links that are placed already: (k, m) [m], a column a configuration."""
        out = np.empty((len(self.parts), links.origin[0].shape[-1]))
        for height, corner in zip(out, self._robot.corners, strict=True):
            rotation, origin = links.rotation[corner.link], links.origin[corner.link]
            height[:] = np.matmul(corner.point, rotation[2]) + (origin[2] - self._robot.floor_z)
        return out

    def finding(self, time: float, part: int, gap: float) -> Finding:
        """What to say of a corner whose height above the floor is ``gap`` [m]."""
        depth = -1000 * gap
        return Finding(
            time,
            self.parts[part],
            f"{depth:.1f} mm below the floor",
            f"raise the target, or go round by a point that is {depth:.0f} mm higher",
            "floor",
        )


# How far the arm stays away from the things around it.


class Obstacles:
    """Gaps between the capsules that joints move and the obstacles of the robot file."""

    tolerance_m = 5e-4

    def __init__(self, robot: Robot) -> None:
        self._model, self._obstacles = robot.collision, robot.obstacles
        moving = [self._model.capsules[i] for i in self._model.moving]
        self.parts: tuple[str, ...] = tuple(c.part for _ in robot.obstacles for c in moving)
        self._titles = [obstacle.title for obstacle in robot.obstacles for _ in moving]
        self.levers = np.tile(self._model.levers[list(self._model.moving)], (len(robot.obstacles), 1))
        """(k, n) how much a gap changes a radian of each joint, at most [m/rad]"""

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) [m], negative inside an obstacle."""
        return self._model.gaps_to(self._obstacles, links)

    def finding(self, time: float, part: int, gap: float) -> Finding:
        """What to say of a capsule whose gap to an obstacle is ``gap`` [m]."""
        title = self._titles[part]
        return Finding(
            time,
            self.parts[part],
            f"{-1000 * gap:.1f} mm inside {title}",
            f"choose another target or branch, or go round {title} by another point",
            "obstacle",
        )


# How far the arm stays away from itself.


class SelfCollision:
    """Gaps between the arm's capsules (``Robot.collision``)."""

    tolerance_m = 5e-4

    def __init__(self, robot: Robot) -> None:
        self._model = robot.collision
        capsules = self._model.capsules
        self.parts: tuple[str, ...] = tuple(capsules[j].part for _, j in self._model.pairs)
        """of each pair, the one nearer to the tool"""
        self._others = [capsules[i].part for i, _ in self._model.pairs]

    @property
    def levers(self) -> FloatArray:
        """(k, n) how much a gap changes a radian of each joint, at most [m/rad]."""
        return self._model.pair_levers

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) [m], negative where a pair overlaps."""
        return self._model.gaps(links)

    def finding(self, time: float, part: int, gap: float) -> Finding:
        """What to say of a pair whose gap is ``gap`` [m]."""
        other = self._others[part]
        return Finding(
            time,
            self.parts[part],
            f"{-1000 * gap:.1f} mm inside {other}",
            f"choose another branch, or go round by a point farther from {other}",
            "self-collision",
        )
