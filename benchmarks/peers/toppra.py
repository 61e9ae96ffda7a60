"""toppra: time-optimal path parameterisation by reachability analysis, its linear programs in Cython."""

from __future__ import annotations

import logging
from itertools import pairwise

import numpy as np
from benchmarks.peers.peer import load

from armctl import Robot
from armctl.motion import PiecewisePolynomial

_PLACES = 500
"""points of the grid, at least, spread evenly over the pieces of a path"""


class Toppra:
    """One arm's speed and acceleration limits."""

    name = "toppra"

    def __init__(self, robot: Robot) -> None:
        self._toppra = load("toppra")
        logging.getLogger("toppra").setLevel(logging.ERROR)
        both = np.array([-1.0, 1.0])
        self._limits = [
            self._toppra.constraint.JointVelocityConstraint(robot.speed_limits[:, None] * both),
            self._toppra.constraint.JointAccelerationConstraint(robot.acceleration_limits[:, None] * both),
        ]

    def duration(self, path: PiecewisePolynomial) -> float:
        """Of the fastest motion along a path, from rest to rest [s]."""

        class Path(self._toppra.interpolator.AbstractGeometricPath):
            dof = path.n
            path_interval = np.array([path.low, path.high])
            waypoints = None

            def __call__(self, places: float, order: int = 0) -> object:
                return path.derivatives(places, order)[order]

        count = -(-_PLACES // len(path.coefficients))
        grid = np.unique([np.linspace(*ends, count + 1) for ends in pairwise(path.breaks)])
        problem = self._toppra.algorithm.TOPPRA(
            self._limits, Path(), gridpoints=grid, parametrizer="ParametrizeConstAccel"
        )
        found = problem.compute_trajectory(0.0, 0.0)
        return np.nan if found is None else float(found.duration)
