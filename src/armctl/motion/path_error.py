"""How far the tool strays from the line or the arc that it shall follow, between points as well."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.motion.paths.tool_curve import ToolArc, ToolLine
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
IdealPath = ToolLine | ToolArc
TICK_S = 0.02
"""one setpoint of the default rate"""
_MOST_TICKS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class PathError:
    """Distances from the ideal path."""

    time: FloatArray
    """(k,) [s]; numbers of readings where their times are not known"""
    distance: FloatArray
    """(k,) [m]"""

    @property
    def largest(self) -> float:
        """The largest distance [m]."""
        return float(self.distance.max())

    @property
    def when(self) -> float:
        """When it is largest [s]."""
        return float(self.time[int(self.distance.argmax())])

    @property
    def rms(self) -> float:
        """Root mean square of the distances [m]."""
        return math.sqrt(float((self.distance**2).mean()))


def path_error(robot: Robot, trajectory: Trajectory, ideal: IdealPath, tick_s: float = TICK_S) -> PathError:
    """The planned tool path against the ideal one, at every tick of the run and at the end.

    Args:
        robot: the arm.
        trajectory: the motion.
        ideal: what the tool shall follow.
        tick_s: between two setpoints [s]; longer where the motion would have more than 100,000 of them.
    """
    ticks = min(math.ceil(trajectory.duration / tick_s - 1e-9), _MOST_TICKS)
    time = np.minimum(
        np.arange(ticks + 1) * max(tick_s, trajectory.duration / _MOST_TICKS), trajectory.duration
    )
    points = robot.forward(trajectory.sample(time).q)[:, :3, 3]
    return PathError(time, distances(ideal, points))


def distances(ideal: IdealPath, points: FloatArray) -> FloatArray:
    """How far points (k, 3) [m] lie from a line or an arc, ends included: (k,) [m]."""
    return np.linalg.norm(points - nearest(ideal, points), axis=-1)


def nearest(ideal: IdealPath, points: FloatArray) -> FloatArray:
    """The places of a line or an arc that are nearest to points (k, 3): (k, 3) [m]."""
    away = points - ideal.start
    if isinstance(ideal, ToolLine):
        return ideal.positions(np.clip(away @ ideal.direction, 0.0, ideal.length))
    x, y = ideal.radius - away @ ideal.inward, away @ ideal.along
    turned = np.arctan2(y, x) % (2 * np.pi)
    # beyond the end of the arc, the end that is the nearer one on the circle
    beyond = np.where(turned - ideal.sweep < 2 * np.pi - turned, ideal.sweep, 0.0)
    return ideal.positions(ideal.radius * np.where(turned <= ideal.sweep, turned, beyond))
