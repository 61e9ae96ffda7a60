"""How well a list of points was met: the paper's error analysis of its two test trajectories."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.motion.paths.tool_curve import ToolCurve, ToolLine
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot


@dataclass(frozen=True, slots=True, eq=False)
class ErrorReport:
    """Points that were asked for, and where the tool came."""

    desired: FloatArray
    """(k, 3) [m]"""
    reached: FloatArray
    """(k, 3) [m]"""

    @property
    def error(self) -> FloatArray:
        """(k, 3) reached less desired [m]."""
        return self.reached - self.desired

    @property
    def mse(self) -> FloatArray:
        """(3,) mean squared error of each coordinate [m²]."""
        return (self.error**2).mean(axis=0)

    @property
    def rmse(self) -> FloatArray:
        """(3,) root mean squared error of each coordinate [m]."""
        return np.sqrt(self.mse)

    @property
    def largest(self) -> FloatArray:
        """(3,) largest error of each coordinate, without sign [m]."""
        return np.abs(self.error).max(axis=0)

    @property
    def distance(self) -> FloatArray:
        """(k,) distance between what was asked for and what was reached [m]."""
        return np.linalg.norm(self.error, axis=1)


def as_printed(q: FloatArray) -> FloatArray:
    """Joint angles (..., n) [rad] rounded as the paper's tables print them: to 0.001°."""
    return np.radians(np.degrees(q).round(3))


def closest_on_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """(k, 3) where a path (m, 3), straight between its points, is closest to each of ``points`` [m]."""
    if len(path) == 0:
        raise InputError("a path without points comes close to nothing")
    if len(path) == 1:
        return np.repeat(path, len(points), axis=0)
    starts, ways = path[:-1], np.diff(path, axis=0)
    squares = (ways**2).sum(axis=1)
    along = np.einsum("kmi,mi->km", points[:, None] - starts, ways)
    share = np.clip(np.divide(along, squares, out=np.zeros_like(along), where=squares > 0), 0.0, 1.0)
    candidates = starts + share[..., None] * ways
    nearest = np.linalg.norm(candidates - points[:, None], axis=2).argmin(axis=1)
    return candidates[np.arange(len(points)), nearest]


def report_csv(theoretical: ErrorReport, applied: ErrorReport | None) -> str:
    """Every point of a report as CSV, in mm; the applied columns only where the path was run."""
    heads = ["point", *(f"desired_{axis}_mm" for axis in "xyz")]
    columns = [theoretical.desired]
    for name, report in (("theoretical", theoretical), ("applied", applied)):
        if report is not None:
            heads += [f"{name}_{axis}_mm" for axis in "xyz"]
            columns.append(report.reached)
    rows = 1000 * np.hstack(columns) + 0.0
    lines = [",".join([f"{k}", *(f"{value:.6f}" for value in row)]) for k, row in enumerate(rows.tolist(), 1)]
    return "\n".join([",".join(heads), *lines, ""])


# How far the tool strays from a line or an arc, between points as well.

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


def path_error(robot: Robot, trajectory: Trajectory, ideal: ToolCurve) -> PathError:
    """The planned tool path against the ideal one, at every tick (100,000 at most) and at the end."""
    ticks = min(math.ceil(trajectory.duration / TICK_S - 1e-9), _MOST_TICKS)
    time = np.minimum(
        np.arange(ticks + 1) * max(TICK_S, trajectory.duration / _MOST_TICKS), trajectory.duration
    )
    points = robot.forward(trajectory.sample(time).q)[:, :3, 3]
    return PathError(time, distances(ideal, points))


def distances(ideal: ToolCurve, points: FloatArray) -> FloatArray:
    """How far points (k, 3) [m] lie from a line or an arc, ends included: (k,) [m]."""
    away = points - ideal.start
    if isinstance(ideal, ToolLine):
        s = np.clip(away @ ideal.direction, 0.0, ideal.length)
    else:
        x, y = ideal.radius - away @ ideal.inward, away @ ideal.along
        turned = np.arctan2(y, x) % (2 * np.pi)
        # beyond the end of the arc, the end that is the nearer one on the circle
        beyond = np.where(turned - ideal.sweep < 2 * np.pi - turned, ideal.sweep, 0.0)
        s = ideal.radius * np.where(turned <= ideal.sweep, turned, beyond)
    return np.linalg.norm(points - ideal.positions(s), axis=-1)


# The two test paths of the uzuner paper.

_PEN_PLANE_M = 0.085


def arc() -> FloatArray:
    """The arc: (58, 3) points [m] of radius 200 mm about the base axis, -87° ... 87°, 85 mm high."""
    angle = np.radians(np.linspace(-87.0, 87.0, 58))
    return np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.full(58, _PEN_PLANE_M)])


def line() -> FloatArray:
    """The line: (29, 3) points [m] at x = 220 mm, y = -196 ... 196 mm by 14 mm, 85 mm high."""
    y = np.arange(-196.0, 197.0, 14.0) / 1000
    return np.column_stack([np.full(29, 0.22), y, np.full(29, _PEN_PLANE_M)])
