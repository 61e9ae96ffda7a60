"""How far the arm stays away from itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.link_frames import LinkFrames
from armctl.motion.preflight.finding import Finding
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


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
