"""How well a list of points was met: the paper's error analysis of its two test trajectories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorReport:
    """Points that were asked for, and where the tool came. Make one with ``ErrorReport.of``."""

    desired: FloatArray
    """(k, 3) [m]"""
    reached: FloatArray
    """(k, 3) [m]"""

    @classmethod
    def of(cls, desired: FloatArray, reached: FloatArray) -> ErrorReport:
        """Check and keep.

        Raises:
            InputError: shapes that differ or are not (k, 3), or a value that is not finite.
        """
        if desired.shape != reached.shape or desired.ndim != 2 or desired.shape[1] != 3 or not len(desired):
            raise InputError(f"desired and reached points differ: {desired.shape} and {reached.shape}")
        if not (np.isfinite(desired).all() and np.isfinite(reached).all()):
            raise InputError("the points of an error report must be finite numbers")
        return cls(desired, reached)

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


def as_printed(q: FloatArray, digits: int = 3) -> FloatArray:
    """Joint angles (..., n) [rad] rounded as the paper's tables print them: to 0.001°."""
    return np.radians(np.degrees(q).round(digits))


def closest_on_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """Where a path comes closest to each point.

    Args:
        points: (k, 3) [m].
        path: (m, 3) [m], at least one; straight between one and the next.

    Returns:
        (k, 3) points of the path [m].

    Raises:
        InputError: an empty path.
    """
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
    lines = [
        f"{number}," + ",".join(f"{value:.6f}" for value in row)
        for number, row in enumerate(rows.tolist(), 1)
    ]
    return "\n".join([",".join(heads), *lines, ""])
