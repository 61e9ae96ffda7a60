"""How far every part of the arm is above the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.robot import Robot

FloatArray = NDArray[np.float64]


class Floor:
    """Heights of the arm's corners above the floor plane.

    Between two frames a DH row runs along x and z in straight lines, and over a plane a straight line
    is lowest at one of its ends: the frames' origins and the corners between them are the whole arm.
    Corners whose height no joint changes (the base, a turning column) are left out: no motion could
    mend them.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        chain = robot.chain
        modified = chain.convention == "modified"
        self._offsets = np.array([row.a_m if modified else row.d_m for row in chain.rows])
        self._axis = 0 if modified else 2  # modified rows go along x first, standard ones along z
        heights = self._heights(self._probes())
        self._moving = np.flatnonzero(np.ptp(heights, axis=0) > 1e-9)
        names = self._names()
        self.parts: tuple[str, ...] = tuple(names[i] for i in self._moving)
        """names of the corners that ``clearance`` gives, from the base to the tool"""

    def clearance(self, q: ArrayLike) -> FloatArray:
        """Heights above the floor.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            (..., k) [m], one a corner of ``parts``; negative below the floor. k may be 0.
        """
        return self._heights(q)[..., self._moving] - self._robot.floor_z

    def _heights(self, q: ArrayLike) -> FloatArray:
        frames = self._robot.frames(q)
        origins = frames[..., 1:, 2, 3]
        corners = frames[..., :-1, 2, 3] + frames[..., :-1, 2, self._axis] * self._offsets
        return np.stack([corners, origins], axis=-1).reshape(*origins.shape[:-1], -1)

    def _probes(self) -> FloatArray:
        """(k, n) configurations among which every corner that can rise or sink does: each joint in turn."""
        low, high = self._robot.limits[:, 0], self._robot.limits[:, 1]
        bases = [low + share * (high - low) for share in (0.37, 0.61)]
        probes: list[FloatArray] = []
        for base in bases:
            probes.append(base)
            for i in range(len(base)):
                for share in (0.13, 0.83):
                    probe = base.copy()
                    probe[i] = low[i] + share * (high[i] - low[i])
                    probes.append(probe)
        return np.array(probes)

    def _names(self) -> list[str]:
        """One a corner and one an origin of each row: the link behind the last joint ahead of it."""
        names: list[str] = []
        joint = -1
        last = len(self._robot.chain.rows) - 1
        for i, row in enumerate(self._robot.chain.rows):
            joint += row.joint
            link = "the base" if joint < 0 else f"the link behind {self._robot.joints[joint].title.lower()}"
            names += [link, "the tool" if i == last else link]
        return names
