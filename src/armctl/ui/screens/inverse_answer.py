"""What the Inverse screen knows once a target is solved; made off the event loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import UnreachableError
from armctl.kinematics import DEFAULT_STEP, Solutions, Target
from armctl.robot import Robot
from armctl.ui.screens.branch_verdicts import Verdict, verdicts
from armctl.ui.screens.energy_curve import energy_curve
from armctl.ui.screens.solution_table import SolutionTable
from armctl.ui.widgets.html_bits import muted, numbers, refused, strong
from armctl.ui.widgets.plots import Picture

FloatArray = NDArray[np.float64]
_SAME = 1e-9
"""a row that is no farther off than this is the same configuration [rad]"""


@dataclass(frozen=True, eq=False)
class Answer:
    """Solutions of one target, sorted by one criterion, and the one of least energy."""

    table: SolutionTable
    best: FloatArray | None
    """(n,) [rad]; None: no solution, or none that the criterion admits"""
    why_not: str
    """why there is no best one; empty where there is"""
    curve: Picture | None
    verdicts: tuple[Verdict, ...]
    """every branch, those that are refused too; empty where a joint is free"""

    @property
    def solutions(self) -> Solutions:
        """What the solver said."""
        return self.table.solutions


def answer(robot: Robot, solutions: Solutions, criterion: str, start: FloatArray) -> Answer:
    """Sort and choose by a criterion; ``start`` (n,) [rad] is where the arm stands."""
    table = SolutionTable(solutions, criterion, start)
    if not solutions.success:
        why_not = solutions.explanation or "there is no solution"
        return Answer(table, None, why_not, None, verdicts(robot, solutions.target, start, None))
    best: FloatArray | None = None
    why_not = ""
    try:
        best = solutions.best(criterion, start)
    except UnreachableError as refusal:
        why_not = str(refusal)
    len(table.order)  # sorted here and not on the event loop
    judged = verdicts(robot, solutions.target, start, best)
    return Answer(table, best, why_not, energy_curve(robot, table, best), judged)


def solve(robot: Robot, target: Target, criterion: str, start: FloatArray) -> Answer:
    """Solve a target and choose by a criterion."""
    solutions = robot.inverse_kinematics.solve(target, DEFAULT_STEP)
    return answer(robot, solutions, criterion, start)


def answer_html(robot: Robot, found: Answer) -> str:
    """Count and branches, and what "least energy" would send; or why there is nothing."""
    if not found.solutions.success:
        return strong("No solution") + refused(f"{_sentence(found.why_not)}.")
    count = len(found.table)
    branches = "; ".join(f"{name}: {many}" for name, many in found.table.branch_counts().items())
    text = strong(f"{count} solution{'' if count == 1 else 's'} inside the limits")
    text += muted(branches + ("" if found.solutions.complete else "; the list may be incomplete"))
    if found.best is None:
        return text + refused(_sentence(found.why_not))
    point = robot.forward(found.best)[:3, 3]
    error_mm = 1000 * float(np.linalg.norm(point - found.solutions.target.position))
    angles = numbers(np.degrees(found.best).tolist(), 3)
    branch = found.solutions.branch_of(found.best)
    return (
        text
        + f"<div>least energy will go to θ = (<b>{angles}</b>)°</div>"
        + muted(f"{branch}; energy {found.table.energy_text(found.best)}; error {error_mm:.1e} mm")
        + _between_rows(found)
    )


def _between_rows(found: Answer) -> str:
    """Why the first row of the list is not quite the one of least energy; empty where it is."""
    row_1 = found.table.q(1)
    if found.best is None or np.abs(row_1 - found.best).max() < _SAME:
        return ""
    least = found.table.energy_text(row_1)
    return muted(f"The exact least: it lies between two rows of the list (row 1: {least}).")


def no_curve(found: Answer) -> str:
    """Why there is no energy curve to show."""
    many = len(found.table)
    if many == 0:
        return "There is no solution."
    if found.solutions.free_joint is None:
        return f"No joint is free here: {many} isolated solution{'' if many == 1 else 's'}, no curve."
    if many == 1:
        return "There is a single solution, and no curve."
    return "The criterion admits none of the solutions."


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
