"""What the arm must stay out of while it is led by hand: the floor, obstacles, its own body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.link_frames import LinkFrames
from armctl.motion import Floor, Obstacles, SelfCollision
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9
_STEP_M = 5e-3
"""How much any gap may change between two looks along a way."""
_MOST_LOOKS = 400


class KeepClear:
    """Looks along short ways for the first configuration that may not be.

    A gap that is closed where the way begins must not close further. Immutable: any thread may use it.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        floor, obstacles, body = Floor(robot), Obstacles(robot), SelfCollision(robot)
        self._sources = tuple(
            (source, words)
            for source, words in (
                (floor, ["the floor is in the way"] * len(floor.parts)),
                (obstacles, [f"an obstacle is in the way of {part}" for part in obstacles.parts]),
                (body, [f"the arm itself is in the way of {part}" for part in body.parts]),
            )
            if len(words)
        )
        levers = [source.levers for source, _ in self._sources]
        self._levers = np.concatenate(levers) if levers else np.zeros((1, robot.n))

    def blocked(self, path: FloatArray) -> tuple[int, str] | None:
        """The first row of ``path`` (k, n) [rad] that may not be, and why; None: all may be.

        The first row is where the arm is, and always may be.
        """
        links = LinkFrames.at(self._robot.chain, path)
        first: tuple[int, str] | None = None
        for source, words in self._sources:
            gaps = source.gaps(links)
            closing = gaps < np.minimum(gaps[:, :1], 0.0) - _ROUNDING
            rows = np.flatnonzero(closing.any(axis=0))
            if len(rows) and (first is None or rows[0] < first[0]):
                row = int(rows[0])
                first = row, words[int(np.argmin(np.where(closing[:, row], gaps[:, row], np.inf)))]
        return first

    def line(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Configurations (k, n) from ``start`` to ``end`` (n,), evenly spaced.

        Near enough to each other for ``blocked``, which looks at them and not in between.
        """
        moves = float((self._levers @ np.abs(end - start)).max(initial=0.0))
        count = int(np.clip(np.ceil(moves / _STEP_M), 1, _MOST_LOOKS))
        return start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)
