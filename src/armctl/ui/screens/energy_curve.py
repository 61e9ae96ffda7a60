"""The energy over the free joint, one line a branch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.robot import Robot
from armctl.ui.screens.solution_table import SolutionTable
from armctl.ui.widgets.plots import COLORS, Line, Picture, thinned

FloatArray = NDArray[np.float64]
_MOST_POINTS = 1000
_BEST_COLOR = "#e03131"


def energy_curve(robot: Robot, table: SolutionTable, best: FloatArray | None) -> Picture | None:
    """What to plot; None where no joint is free, or no solution is admitted.

    Args:
        robot: the arm.
        table: solutions and their energies.
        best: (n,) the configuration of least energy [rad], marked in the plot.
    """
    solutions = table.solutions
    free = solutions.free_joint
    if free is None or len(solutions) < 2:
        return None
    free_deg: FloatArray = np.degrees(solutions.q[:, free])
    unique, place = np.unique(np.round(free_deg, 6), return_inverse=True)
    angles = unique.astype(np.float64)
    marked = None if best is None else int(np.abs(angles - np.degrees(best[free])).argmin())
    kept = thinned(len(angles), _MOST_POINTS, [] if marked is None else [marked])
    lines = _branch_lines(table, place.reshape(-1), len(angles), kept)
    if not lines:
        return None
    if marked is not None:
        least = np.fmin.reduce([line.y[np.searchsorted(kept, marked)] for line in lines])
        dot = np.full(len(kept), np.nan)
        dot[np.searchsorted(kept, marked)] = least
        lines.append(Line("least energy", dot, _BEST_COLOR, mark=True))
    unit = f" ({table.unit})" if table.unit else ""
    title = f"Energy{unit}: {table.criterion}"
    return Picture(title, f"{robot.joints[free].title} (°)", angles[kept], tuple(lines))


def _branch_lines(
    table: SolutionTable, place: NDArray[np.int64], count: int, kept: NDArray[np.int64]
) -> list[Line]:
    lines: list[Line] = []
    index = table.solutions.branch_index
    for i, (name, color) in enumerate(zip(table.solutions.branch_names, COLORS, strict=False)):
        here = index == i
        if not here.any():
            continue
        energy = np.full(count, np.inf)
        np.minimum.at(energy, place[here], table.energy[here])
        line = energy[kept]
        line[~np.isfinite(line)] = np.nan
        if np.isfinite(line).any():  # else the criterion admits none of this branch
            lines.append(Line(name, line, color))
    return lines
