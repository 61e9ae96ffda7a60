"""Gaps between parts of the arm and what they must stay away from: the floor, obstacles, the arm itself.

Each kind has k gaps: ``parts`` are their names, ``levers`` (k, n) how much each changes at most [m/rad].
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.kinematics.chain import LinkFrames
from armctl.robot import Robot

FLOOR_TOLERANCE_M = 5e-4
"""How far a part may dip below the floor, or into anything else: less than a servo arm can tell."""


class Floor:
    """Heights of those corners of the arm above the floor that joints change (``Robot.corners``)."""

    kind: ClassVar[Literal["floor"]] = "floor"

    def __init__(self, robot: Robot) -> None:
        self._robot, self._corners = robot, robot.corners
        self.levers = np.array([corner.levers for corner in robot.corners]).reshape(-1, robot.n)
        self.parts = tuple(corner.part for corner in robot.corners)

    def clearance(self, q: ArrayLike) -> FloatArray:
        """(..., k) heights above the floor [m] at ``q`` (..., n) [rad], negative below it; k may be 0."""
        q = self._robot.chain.checked(q)
        links = LinkFrames.at(self._robot.chain, q.reshape(-1, self._robot.n))
        return self.gaps(links).T.reshape(*q.shape[:-1], len(self._corners))

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) heights [m] at m configurations."""
        heights = np.empty((len(self._corners), links.origin[0].shape[-1]))
        for height, corner in zip(heights, self._corners, strict=True):
            height[:] = corner.point @ links.rotation[corner.link][2] + links.origin[corner.link][2]
        return heights - self._robot.floor_z

    def words(self, part: int, depth_mm: float) -> tuple[str, str]:
        """What is wrong where gap ``part`` is closed by ``depth_mm``, and what to do."""
        higher = f"raise the target, or go round by a point that is {depth_mm:.0f} mm higher"
        return f"{depth_mm:.1f} mm below the floor", higher


class Obstacles:
    """Gaps between the capsules that joints move and the obstacles of the robot file."""

    kind: ClassVar[Literal["obstacle"]] = "obstacle"

    def __init__(self, robot: Robot) -> None:
        self._model, self._obstacles = robot.collision, robot.obstacles
        moving = list(self._model.moving)
        self.parts = tuple(self._model.capsules[i].part for _ in robot.obstacles for i in moving)
        self.levers = np.tile(self._model.levers[moving], (len(robot.obstacles), 1))

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) [m] at m configurations, negative inside an obstacle."""
        return self._model.gaps_to(self._obstacles, links)

    def words(self, part: int, depth_mm: float) -> tuple[str, str]:
        """As ``Floor.words``."""
        title = self._obstacles[part // len(self._model.moving)].title
        return (
            f"{depth_mm:.1f} mm inside {title}",
            f"choose another target or branch, or go round {title} by another point",
        )


class SelfCollision:
    """Gaps between the arm's capsules (``Robot.collision``), each named by the one nearer to the tool."""

    kind: ClassVar[Literal["self-collision"]] = "self-collision"

    def __init__(self, robot: Robot) -> None:
        self._model = robot.collision
        self.levers = self._model.pair_levers
        self.parts = tuple(self._model.capsules[j].part for _, j in self._model.pairs)

    def gaps(self, links: LinkFrames) -> FloatArray:
        """(k, m) [m] at m configurations, negative where a pair overlaps."""
        return self._model.gaps(links)

    def words(self, part: int, depth_mm: float) -> tuple[str, str]:
        """As ``Floor.words``."""
        other = self._model.capsules[self._model.pairs[part][0]].part
        return (
            f"{depth_mm:.1f} mm inside {other}",
            f"choose another branch, or go round by a point farther from {other}",
        )


Gaps = Floor | Obstacles | SelfCollision
