"""How far the arm stays away from the things around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.link_frames import LinkFrames
from armctl.motion.preflight.finding import Finding
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


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
