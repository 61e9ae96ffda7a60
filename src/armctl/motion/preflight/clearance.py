"""Does the arm keep clear of the floor, of obstacles and of itself over the whole of a motion?"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.kinematics.chain import LinkFrames
from armctl.motion.preflight.sampled import Finding, SampledMotion
from armctl.robot import Robot

_MISSED_M = 1e-3
"""How much deeper a dip between two samples may be before it is sure to be found."""
_TOO_FAST = 2.0
"""times the speed limits: a motion beyond is refused for its speed, and nothing else is proven of it"""


class Gaps(Protocol):
    """k gaps between parts of the arm and what they must stay away from."""

    @property
    def tolerance_m(self) -> float:
        """By how much a gap may be negative."""
        ...

    @property
    def levers(self) -> FloatArray:
        """(k, n) how much each gap changes a radian of each joint, at most [m/rad]."""
        ...

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) [m]; negative where the parts overlap."""
        ...

    def finding(self, time: float, part: int, gap: float) -> Finding:
        """The finding for gap number ``part``, which is ``gap`` [m] at ``time`` [s]."""
        ...


def gap_finding(motion: SampledMotion, source: Gaps, gaps: FloatArray) -> Finding | None:
    """Check that gaps stay open; where a motion starts with one closed, it must not close further.

    A gap cannot change faster than its levers times the joint speeds, so with gaps g₀ and g₁ at two samples
    and a change of at most D between them, it is at least (g₀ + g₁ - D) / 2 there. Where that does not
    prove it open, the interval is halved.

    Args:
        motion: the motion.
        source: what the arm must stay away from.
        gaps: (k, m) at the samples [m].

    Returns:
        The deepest gap at the samples; if all are open there, the deepest of the first halves that shows
        one; None: all stay open.
    """
    if not len(gaps):
        return None
    allowed = np.minimum(gaps[:, :1], 0.0) - source.tolerance_m
    slack = gaps - allowed
    finding = _deepest(source, motion.time, gaps, slack)
    if finding is not None:
        return finding
    speed = np.minimum(motion.speed[1:], _TOO_FAST * motion.robot.speed_limits)
    begin, end, at_begin, at_end = motion.time[:-1], motion.time[1:], slack[:, :-1], slack[:, 1:]
    change = source.levers @ (speed * (end - begin)[:, None]).T
    while True:
        doubtful = (0.5 * (at_begin + at_end - change) < -_MISSED_M).any(axis=0)
        if not doubtful.any():
            return None
        begin, end, change = begin[doubtful], end[doubtful], 0.5 * change[:, doubtful]
        middle = 0.5 * (begin + end)
        gaps = source.gaps(LinkFrames.at(motion.robot.chain, motion.trajectory.sample(middle).q))
        slack = gaps - allowed
        finding = _deepest(source, middle, gaps, slack)
        if finding is not None:
            return finding
        begin, end, change = np.append(begin, middle), np.append(middle, end), np.tile(change, 2)
        at_begin = np.hstack([at_begin[:, doubtful], slack])
        at_end = np.hstack([slack, at_end[:, doubtful]])


def _deepest(source: Gaps, time: FloatArray, gaps: FloatArray, slack: FloatArray) -> Finding | None:
    """The place of least slack, the earliest of equals; None: there is slack everywhere."""
    least = slack.min(axis=0)
    at = int(least.argmin())
    if least[at] >= 0.0:
        return None
    part = int(slack[:, at].argmin())
    return source.finding(float(time[at]), part, float(gaps[part, at]))


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
        corners = self._robot.corners
        if not corners:
            return np.empty((0, links.origin[0].shape[-1]))
        points = np.array([corner.point for corner in corners])
        rises = np.array([links.rotation[corner.link][2] for corner in corners])
        heights = np.array([links.origin[corner.link][2] for corner in corners])
        return np.einsum("ki,kim->km", points, rises) + heights - self._robot.floor_z

    def finding(self, time: float, part: int, gap: float) -> Finding:
        """The finding for a corner whose height above the floor is ``gap`` [m]."""
        depth = -1000 * gap
        return Finding(
            time,
            self.parts[part],
            f"{depth:.1f} mm below the floor",
            f"raise the target, or go round by a point that is {depth:.0f} mm higher",
            "floor",
        )


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
        """The finding for a capsule whose gap to an obstacle is ``gap`` [m]."""
        title = self._titles[part]
        return Finding(
            time,
            self.parts[part],
            f"{-1000 * gap:.1f} mm inside {title}",
            f"choose another target or branch, or go round {title} by another point",
            "obstacle",
        )


class SelfCollision:
    """Gaps between the arm's capsules (``Robot.collision``)."""

    tolerance_m = 5e-4

    def __init__(self, robot: Robot) -> None:
        self._model = robot.collision
        capsules = self._model.capsules
        self.parts: tuple[str, ...] = tuple(capsules[j].part for _, j in self._model.pairs)
        """of each pair, the one nearer to the tool"""
        self._others = [capsules[i].part for i, _ in self._model.pairs]
        self.levers = self._model.pair_levers
        """(k, n) how much a gap changes a radian of each joint, at most [m/rad]"""

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) [m], negative where a pair overlaps."""
        return self._model.gaps(links)

    def finding(self, time: float, part: int, gap: float) -> Finding:
        """The finding for a pair whose gap is ``gap`` [m]."""
        other = self._others[part]
        return Finding(
            time,
            self.parts[part],
            f"{-1000 * gap:.1f} mm inside {other}",
            f"choose another branch, or go round by a point farther from {other}",
            "self-collision",
        )
