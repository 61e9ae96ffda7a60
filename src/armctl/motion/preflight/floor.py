"""How far every part of the arm is above the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.kinematics.link_frames import LinkFrames
from armctl.motion.preflight.finding import Finding
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
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
