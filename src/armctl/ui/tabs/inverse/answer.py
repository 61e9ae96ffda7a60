"""What the Inverse screen knows once a target is solved; made off the event loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import MotionRefusedError, UnreachableError
from armctl.kinematics import DEFAULT_STEP, Branch, Solutions, Target
from armctl.motion import plan_joints
from armctl.robot import Robot
from armctl.ui.tabs.inverse.solution_table import SolutionTable, energy_curve, short_branch
from armctl.ui.widgets.html import fixed, muted, numbers, refused, strong, table
from armctl.ui.widgets.plots import Picture

# Every branch of a target beside the others: which the arm may go to, which it may not, and why.

FloatArray = NDArray[np.float64]
_SAME = 1e-6
_SAME_PLACE_M = 1e-3


@dataclass(frozen=True, slots=True)
class Verdict:
    """One branch, numbered as the page and the 3D view number it."""

    number: int
    branch: Branch
    refused: str
    """why the arm may not go there; empty where it may"""
    chosen: bool
    """it is the one that "least energy" would send"""

    @property
    def label(self) -> str:
        """What the ghost is called in the 3D view."""
        state = "refused" if self.refused else "least energy" if self.chosen else "possible"
        return f"{self.number}: {state}"


def verdicts(robot: Robot, target: Target, start: FloatArray, best: FloatArray | None) -> tuple[Verdict, ...]:
    """Judge every branch of a target.

    Args:
        robot: the arm.
        target: what is asked for.
        start: (n,) where the arm stands [rad]: the way from there is checked too.
        best: (n,) the configuration of least energy [rad], if there is one.
    """
    branches = robot.branches(target.position, target.pitch, target.roll, target.rotation)
    return tuple(
        Verdict(i, branch, _refusal(robot, start, branch), _same(branch.q, best))
        for i, branch in enumerate(branches, 1)
    )


def _refusal(robot: Robot, start: FloatArray, branch: Branch) -> str:
    """Why a branch may not be gone to: joint limits, else what the pre-flight of the way there says."""
    if branch.forbidden:
        return "; ".join(branch.forbidden)
    try:
        plan_joints(robot, start, branch.q)
    except MotionRefusedError as refusal:
        return str(refusal)
    return ""


def _same(q: FloatArray, best: FloatArray | None) -> bool:
    """Whether two configurations are one, whole turns aside."""
    return best is not None and float(np.abs(np.exp(1j * q) - np.exp(1j * best)).max()) < _SAME


def standing_alike(robot: Robot, found: Sequence[Verdict]) -> list[list[Verdict]]:
    """Branches whose links lie in the same places, together: so they do with the base half a turn round."""
    groups: list[tuple[FloatArray, list[Verdict]]] = []
    for one in found:
        points = robot.frames(one.branch.q)[:, :3, 3]
        for other, group in groups:
            if np.abs(points - other).max() < _SAME_PLACE_M:
                group.append(one)
                break
        else:
            groups.append((points, [one]))
    return [group for _, group in groups]


def verdicts_html(robot: Robot, found: Sequence[Verdict], solutions: SolutionTable) -> str:
    """The branches as a table with their energies, and what is wrong with those that are refused."""
    if not found:
        return muted(
            "No isolated branches here: the point is out of reach, or a joint is free (then give a pitch)."
        )
    head = ["#", "branch", *(f"θ{i + 1}°" for i in range(robot.n)), f"energy {solutions.unit}", "verdict"]
    rows = [
        [
            str(one.number),
            short_branch(one.branch.name),
            *(fixed(value, 2) for value in np.degrees(one.branch.q).tolist()),
            "–" if one.branch.forbidden else fixed(solutions.energy_of(one.branch.q), 3),
            "refused" if one.refused else "chosen" if one.chosen else "possible",
        ]
        for one in found
    ]
    marked = next((i for i, one in enumerate(found) if one.chosen), None)
    said = [f"{one.number} is refused: {one.refused}." for one in found if one.refused]
    chosen = next((one.number for one in found if one.chosen), None)
    if chosen is not None:
        said.append(f"{chosen} is chosen among the possible ones: the least energy by {solutions.criterion}.")
    grid = f"<div style='font-size:11px'>{table(head, rows, marked=marked)}</div>"
    return grid + "".join(muted(text) for text in said)


_INVERSE_ANSWER_SAME = 1e-9
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
    if found.best is None or np.abs(row_1 - found.best).max() < _INVERSE_ANSWER_SAME:
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
