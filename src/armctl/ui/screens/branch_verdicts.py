"""Every branch of a target beside the others: which the arm may go to, which it may not, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import MotionRefusedError
from armctl.kinematics import Branch, Target
from armctl.motion import plan_joints
from armctl.robot import Robot
from armctl.ui.screens.solution_table import SolutionTable, short_branch
from armctl.ui.widgets.html_bits import fixed, muted
from armctl.ui.widgets.text import table

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
