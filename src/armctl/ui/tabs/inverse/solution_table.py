"""The list of inverse kinematic solutions as the page shows it: sorted by energy, one page at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from html import escape

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import Criterion, Solutions, checked_criterion
from armctl.kinematics.energy import energies
from armctl.robot import Robot
from armctl.ui.widgets.html import fixed
from armctl.ui.widgets.plots import COLORS, Line, Picture, thinned

FloatArray = NDArray[np.float64]
PAGE_ROWS = 15
_ENERGY: dict[Criterion, tuple[float, str]] = {
    "least-rotation": (180 / np.pi, "°"),
    "published": (180 / np.pi, "°"),
    "least-travel": (1.0, "s"),
    "least-torque": (1000.0, "×10⁻³"),
}
_CELL = "padding:0 4px;text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap"


@dataclass(frozen=True, eq=False)
class SolutionTable:
    """All solutions of one target in the order of one criterion."""

    solutions: Solutions
    criterion: str
    start: FloatArray
    """(n,) where the arm stood [rad], for ``least-travel``"""

    @cached_property
    def energy(self) -> FloatArray:
        """(k,) energies in the unit of ``unit``, in the solver's order; infinite where not admitted."""
        scale, _ = _ENERGY[checked_criterion(self.criterion)]
        return scale * self.solutions.energies(self.criterion, self.start)

    @property
    def unit(self) -> str:
        """Unit of the energies."""
        return _ENERGY[checked_criterion(self.criterion)][1]

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """(k,) indices of the solutions, least energy first."""
        return np.argsort(self.energy, kind="stable")

    def __len__(self) -> int:
        return len(self.solutions)

    @property
    def pages(self) -> int:
        """Number of pages, at least 1."""
        return max(1, -(-len(self) // PAGE_ROWS))

    def q(self, row: int) -> FloatArray:
        """Configuration (n,) [rad] of a row, counted from 1."""
        return self.solutions.q[self.order[row - 1]].copy()

    def branch(self, row: int) -> str:
        """Branch name of a row."""
        return str(self.solutions.branch[self.order[row - 1]])

    def energy_of(self, q: FloatArray) -> float:
        """Energy of any configuration ``q`` (n,) [rad], in the unit of ``unit``; infinite if not admitted."""
        criterion, arm = checked_criterion(self.criterion), self.solutions.arm
        scale, _ = _ENERGY[criterion]
        return scale * float(energies(criterion, q[None], arm.energy, arm.pitch_joints, self.start)[0])

    def energy_text(self, q: FloatArray) -> str:
        """Energy of ``q`` (n,) [rad] with its unit, as exact as in the list."""
        return f"{fixed(self.energy_of(q), 3)}{'' if self.unit == '°' else ' '}{self.unit}"

    def branch_counts(self) -> dict[str, int]:
        """How many solutions each branch has, in the order of the branches."""
        used, counts = np.unique(self.solutions.branch_index, return_counts=True)
        names = self.solutions.branch_names
        return {names[i]: int(count) for i, count in zip(used.tolist(), counts.tolist(), strict=True)}

    def html(self, page: int, selected: int | None) -> str:
        """One page (from 0) as an HTML table; ``selected`` is the row to highlight."""
        heads = ["#", *(f"θ{i + 1}°" for i in range(self.solutions.q.shape[1])), "branch"]
        heads.append(f"energy {self.unit}".strip())
        first = page * PAGE_ROWS
        rows = range(first, min(first + PAGE_ROWS, len(self)))
        body = "".join(self._row(row + 1, row + 1 == selected) for row in rows)
        head = "".join(f"<th style='{_CELL};opacity:.7'>{escape(text)}</th>" for text in heads)
        style = "border-collapse:collapse;width:100%;font-size:11px;line-height:1.55"
        return f"<table style='{style}'><tr>{head}</tr>{body}</table>"

    def _row(self, row: int, selected: bool) -> str:
        index = int(self.order[row - 1])
        cells = [
            str(row),
            *(fixed(value, 2) for value in np.degrees(self.solutions.q[index]).tolist()),
            short_branch(self.branch(row)),
            fixed(float(self.energy[index]), 3),
        ]
        mark = ";background:rgba(34,139,230,.25)" if selected else ""
        inside = "".join(f"<td style='{_CELL}'>{escape(text)}</td>" for text in cells)
        return f"<tr style='border-top:1px solid rgba(128,128,128,.2){mark}'>{inside}</tr>"


def short_branch(name: str) -> str:
    """A branch name for a narrow column: ``front elbow-up`` becomes ``front up``."""
    return name.replace("shoulder-", "").replace("elbow-", "").replace("tool-in", "in")


# The energy over the free joint, one line a branch.

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
