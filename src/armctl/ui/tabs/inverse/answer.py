"""What the Inverse tab knows once a target is solved: computed in a worker thread, shown as HTML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import UnreachableError
from armctl.facts import Reason
from armctl.facts.angles import to_degrees
from armctl.kinematics import DEFAULT_STEP, Branch, Criterion, Solutions, Target, checked_criterion
from armctl.kinematics.energy import EnergyModel, energies
from armctl.motion import Profile
from armctl.motion.choices import JudgedConfigurations, first_possible
from armctl.motion.figure import color_of
from armctl.robot import Robot
from armctl.ui.widgets.html import fixed
from armctl.ui.widgets.plots import Picture, PlotLine, thinned

_UNITS: dict[Criterion, tuple[float, str]] = {
    "least-rotation": (180 / np.pi, "°"),
    "published": (180 / np.pi, "°"),
    "least-travel": (1.0, "s"),
    "shortest-time": (1.0, "s"),
}
_PLAIN: dict[Criterion, str] = {
    "least-rotation": "rotation",
    "published": "as published",
    "least-travel": "travel",
    "shortest-time": "time",
    "least-torque": "torque",
}
"""what is least, in a word"""
SAME_RAD = 1e-9
"""a row that is no farther off than this is the same configuration"""
_SAME_BRANCH = 1e-6
_MOST_POINTS = 1000
"""of an energy curve"""
_MOST_WAYS, _MOST_TURNS = 16, 3
"""ways to choose among; whole turns of one that are tried for one that may be gone to"""
_SAME_COST = 1 + 1e-6
_GAP_STEPS, _FAR_RAD = 2.5, 0.5


def _shown(criterion: Criterion, energy: FloatArray, model: EnergyModel) -> FloatArray:
    """Energies as they are shown, in ``_unit``; of loads the root of the sum of squares."""
    if criterion == "least-torque":
        return (1.0 if model.stall_torque is None else 100.0) * np.sqrt(energy)
    return _UNITS[criterion][0] * energy


def unit_of(criterion: Criterion, model: EnergyModel) -> str:
    """Of the energies of a criterion, as they are shown."""
    if criterion == "least-torque":
        return "N·m" if model.stall_torque is None else "% of stall"
    return _UNITS[criterion][1]


@dataclass(frozen=True, slots=True)
class BranchVerdict:
    """One branch of a target, numbered as the page and the 3D view number it."""

    number: int
    branch: Branch
    refused: str
    """why the arm may not go there; empty where it may"""
    chosen: bool
    """it is the one of least energy"""

    @property
    def label(self) -> str:
        """The text beside its ghost in the 3D view."""
        state = "refused" if self.refused else "least energy" if self.chosen else "possible"
        return f"{self.number}: {state}"


@dataclass(frozen=True, eq=False)
class RankedSolutions:
    """Solutions of one target, sorted by one criterion, and the one of least energy."""

    robot: Robot
    solutions: Solutions
    criterion: Criterion
    start: FloatArray
    """(n,) where the arm stood [rad], for the criteria ``FROM_START``"""
    energy: FloatArray
    """(k,) in the unit of the criterion, in the solver's order; infinite where not admitted"""
    order: NDArray[np.int64]
    """(k,) indices of the solutions, least energy first"""
    best: FloatArray | None
    """(n,) [rad]; None: no solution, or none that the criterion admits"""
    why_not: Reason | None
    """why there is none to go to by itself: no best one, or not in that orientation; None where there is"""
    ways: JudgedConfigurations
    """from ``start``"""
    verdicts: tuple[BranchVerdict, ...]
    """every branch, also those that are refused; empty where a joint is free"""
    way_refused: str = ""
    """why the arm may not go to ``best`` from where it stands; empty where it may"""
    curve: Picture | str = ""
    """energy over the free joint; or why there is nothing to plot"""
    instead: int | None = None
    """the first row to which the arm may go, of some, where it may not go to ``best``; None: there is none"""
    choices: tuple[Way, ...] = ()
    """what a person chooses among, those that may be gone to first, by energy"""
    representatives: tuple[Representative, ...] = ()
    """a few rows that stand for all; empty where there is no solution"""

    @property
    def next(self) -> FloatArray | None:
        """(n,) where *Go by least energy* goes [rad]: to the best, or instead of one that is refused."""
        return self.best if self.instead is None else self.q(self.instead)

    def q(self, row: int) -> FloatArray:
        """Configuration (n,) [rad] of a row of the list, counted from 1, as the criterion takes it."""
        return self.solutions.taken(self.solutions.q[self.order[row - 1]], self.criterion, self.start)

    def row_at(self, angle: float) -> int:
        """The row of least energy whose free joint is nearest to an angle [rad]; from 1."""
        free = self.solutions.free_joint
        away = np.abs(self.solutions.q[self.order, 0 if free is None else free] - angle)
        return int(np.flatnonzero(away <= away.min() + SAME_RAD)[0]) + 1

    def energy_of(self, q: FloatArray) -> float:
        """Energy of any configuration ``q`` (n,) [rad], as ``energy``; infinite if not admitted."""
        arm = self.solutions.arm
        energy = energies(self.criterion, q[None], arm.energy, arm.pitch_joints, self.start)
        return float(_shown(self.criterion, energy, arm.energy)[0])

    @property
    def unit(self) -> str:
        """Of the energies."""
        return unit_of(self.criterion, self.solutions.arm.energy)

    def energy_text(self, q: FloatArray) -> str:
        """Energy of ``q`` (n,) [rad] with its unit, as exact as in the list."""
        return f"{fixed(self.energy_of(q), 3)}{'' if self.unit == '°' else ' '}{self.unit}"


def solve(
    robot: Robot, target: Target, criterion: str, start: FloatArray, profile: Profile = "cubic"
) -> RankedSolutions:
    """Solve a target, and then as ``answer``."""
    solutions = robot.inverse_kinematics.solve(target, DEFAULT_STEP, start)
    return answer(robot, solutions, criterion, start, profile)


def prepare(robot: Robot) -> None:
    """Do what takes half a second the first time, before somebody waits for it: imports, the arm's body."""
    home = robot.pose("home")
    solve(robot, Target.of(robot.forward(home)[:3, 3]), "shortest-time", home)


def answer(
    robot: Robot, solutions: Solutions, criterion: str, start: FloatArray, profile: Profile = "cubic"
) -> RankedSolutions:
    """Sort solutions, choose among them, and judge the ways to a few of them by motions of a ``profile``.

    ``start`` (n,) [rad] is where the arm stands.
    """
    name = checked_criterion(criterion)
    best, why_not, energy = None, None, np.empty(0)
    try:
        best = solutions.best(name, start)
        why_not = robot.off_rotation(solutions, best)
    except UnreachableError as refusal:
        why_not = refusal.reason
    if solutions.success:
        energy = _shown(name, solutions.energies(name, start), solutions.arm.energy)
    order = solutions.order(name, start)
    ways = JudgedConfigurations(robot, start, profile)
    way = "" if best is None or why_not else ways.refused(best)
    judged = _verdicts(robot, solutions, name, start, best, ways)
    found = RankedSolutions(robot, solutions, name, start, energy, order, best, why_not, ways, judged, way)
    few = representatives(found) if solutions.success else ()
    other = _first_possible(robot, found, few) if way else None
    choices = ways_to(found) if solutions.success else ()
    return replace(
        found, curve=_energy_curve(robot, found), representatives=few, instead=other, choices=choices
    )


def _first_possible(robot: Robot, found: RankedSolutions, few: Sequence[Representative]) -> int | None:
    """The first row to which the arm may go, of some that differ from each other and of the ``few``."""
    possible = min((one.row for one in few if not one.refused), default=len(found.order) + 1)
    before = found.solutions.q[found.order[: possible - 1]]
    taken = found.solutions.taken(before, found.criterion, found.start)
    row = first_possible(robot, found.start, taken, found.ways.possible)
    if row is not None:
        return row + 1
    return possible if possible <= len(found.order) else None


def _verdicts(
    robot: Robot,
    solutions: Solutions,
    criterion: Criterion,
    start: FloatArray,
    best: FloatArray | None,
    ways: JudgedConfigurations,
) -> tuple[BranchVerdict, ...]:
    """Judge every branch, and the way to it from ``start`` (n,) [rad]."""
    verdicts: list[BranchVerdict] = []
    point, pitch, roll, rotation = solutions.target
    for number, found in enumerate(robot.branches(point, pitch, roll, rotation), 1):
        branch = replace(found, q=solutions.taken(found.q, criterion, start))
        # whole turns make no difference
        chosen = best is not None and np.abs(np.exp(1j * branch.q) - np.exp(1j * best)).max() < _SAME_BRANCH
        if chosen and best is not None:
            branch = replace(branch, q=best)
        refusal = "; ".join(branch.forbidden) or ways.refused(branch.q)
        verdicts.append(BranchVerdict(number, branch, refusal, bool(chosen)))
    return tuple(verdicts)


class Costs(NamedTuple):
    """What a configuration costs."""

    rotation_deg: float
    """sum of |joint angles|"""
    time_s: float
    """from the present pose, all joints together by a cubic"""
    travel_s: float
    """from the present pose, one joint after the other at full speed"""
    load: float
    """of all joints against gravity, as ``least-torque`` counts it, in its unit; 0: no link has a mass"""


_COSTS: dict[Criterion, Callable[[Costs], float]] = {
    "shortest-time": lambda one: one.time_s,
    "least-travel": lambda one: one.travel_s,
    "least-rotation": lambda one: one.rotation_deg,
}


@dataclass(frozen=True, slots=True)
class Representative:
    """One row of the list that stands for many, and what it costs."""

    names: tuple[str, ...]
    """criteria by which it is the least, or the branch of which it is"""
    row: int
    """in the list, from 1"""
    costs: Costs
    refused: bool
    """whether the arm may not go there from where it stands"""

    @property
    def label(self) -> str:
        """As it is chosen from a list."""
        return f"row {self.row}: least {' and '.join(self.names)}{' (refused)' if self.refused else ''}"


def representatives(found: RankedSolutions) -> tuple[Representative, ...]:
    """The least by each criterion and of each branch, those chosen by the criterion in force first."""
    solutions, start = found.solutions, found.start
    place = np.empty(len(found.order), dtype=np.int64)
    place[found.order] = np.arange(1, len(found.order) + 1)
    named: dict[int, list[str]] = {}
    others: list[Criterion] = [one for one in solutions.arm.energy.criteria if one != found.criterion]
    for criterion in (found.criterion, *others):
        try:
            best = solutions.best(criterion, start)
        except UnreachableError:  # it admits none
            continue
        named.setdefault(int(place[solutions.index_of(best)]), []).append(_PLAIN[criterion])
    admitted = found.order[np.isfinite(found.energy[found.order])]
    for i, name in enumerate(solutions.branch_names if len(solutions.branch_names) > 1 else ()):
        of_branch = admitted[solutions.branch_index[admitted] == i]
        if len(of_branch):
            named.setdefault(int(place[of_branch[0]]), []).append(f"of {short_branch(name)}")
    return tuple(
        Representative(tuple(names), row, costs(found, found.q(row)), not found.ways.possible(found.q(row)))
        for row, names in named.items()
    )


def costs(found: RankedSolutions, q: FloatArray) -> Costs:
    """What going to ``q`` (n,) [rad] costs."""
    arm, start = found.solutions.arm, found.start

    def of(criterion: Criterion) -> float:
        return float(energies(criterion, q[None], arm.energy, arm.pitch_joints, start)[0])

    load = 0.0
    if arm.energy.gravity.weighs:
        load = float(_shown("least-torque", np.array(of("least-torque")), arm.energy))
    return Costs(to_degrees(of("least-rotation")), of("shortest-time"), of("least-travel"), load)


# The ways to a target: of a joint that is free the best of each piece; whole turns are folded.


@dataclass(frozen=True, slots=True)
class Way:
    """One way to put the tool there, as a person tells it from others."""

    name: str
    q: FloatArray
    """(n,) [rad]"""
    row: int | None
    """in the list, from 1; None: it is not in it, since a joint would pass its limit"""
    turns: int
    """how many rows of the list differ from it by whole turns of joints alone"""
    refused: str
    """why the arm may not go there from where it stands; empty where it may"""
    costs: Costs
    least: tuple[Criterion, ...] = ()
    """the criteria by which it is the least of those that may be gone to"""


def ways_to(found: RankedSolutions) -> tuple[Way, ...]:
    """What to choose among, of solutions that there are: those that may be gone to first, by energy."""
    solutions = found.solutions
    turned = np.exp(1j * solutions.q[found.order])

    def alike(q: FloatArray) -> list[int]:
        """Rows that differ from ``q`` by whole turns."""
        rows = np.arange(1, len(turned) + 1)
        for joint, one in enumerate(np.exp(1j * q)):
            rows = rows[np.abs(turned[rows - 1, joint] - one) < _SAME_BRANCH]
        return rows.tolist()

    if found.verdicts:
        ways = [_way(found, one.branch.name, alike(one.branch.q), one) for one in found.verdicts]
    else:
        named = _postures(found) if solutions.free_joint is None else _pieces(found)
        listed = solutions.q[found.order]
        ways = [_way(found, name, alike(listed[row - 1]), None) for name, row in named[:_MOST_WAYS]]
    last = len(found.order) + 1
    ways.sort(key=lambda way: (bool(way.refused), way.row or last))
    possible = [way.costs for way in ways if not way.refused]
    return tuple(
        way if way.refused or len(possible) == 1 else replace(way, least=_least_by(way.costs, possible))
        for way in ways
    )


def _least_by(one: Costs, of: Sequence[Costs]) -> tuple[Criterion, ...]:
    return tuple(name for name, cost in _COSTS.items() if cost(one) <= _SAME_COST * min(map(cost, of)))


def _way(found: RankedSolutions, name: str, rows: Sequence[int], one: BranchVerdict | None) -> Way:
    """Of rows of the list, from 1, that differ by whole turns: the first to which the arm may go."""
    row = next((row for row in rows[:_MOST_TURNS] if found.ways.possible(found.q(row))), None)
    row = rows[0] if row is None and rows else row
    if row is None and one is not None:
        return Way(name, one.branch.q, None, 0, one.refused, costs(found, one.branch.q))
    q = found.q(row or 1)
    return Way(name, q, row, len(rows) - 1, found.ways.refused(q), costs(found, q))


def _postures(found: RankedSolutions) -> list[tuple[str, int]]:
    """Name and row of some solutions far from each other, the first of each name, by their energy."""
    robot, far = found.robot, list[FloatArray]()
    named: dict[str, int] = {}
    for row in range(1, len(found.order) + 1):
        q = found.q(row)
        if all(np.abs(np.angle(np.exp(1j * (q - other)))).max() > _FAR_RAD for other in far):
            far.append(q)
            pose = robot.forward(q)
            branches = robot.branches(pose[:3, 3], rotation=pose[:3, :3])
            same = (one.name for one in branches if np.abs(np.exp(1j * one.q) - np.exp(1j * q)).max() < 1e-4)
            named.setdefault(next(same, f"posture {len(far)}"), row)
        if len(far) == _MOST_WAYS:
            break
    return list(named.items())


def _pieces(found: RankedSolutions) -> list[tuple[str, int]]:
    """Name and the row of least energy of each piece of the solutions, by that energy.

    A piece is of one branch, and without a gap in the free joint.
    """
    solutions, free = found.solutions, found.solutions.free_joint
    place = np.empty(len(found.order), dtype=np.int64)
    place[found.order] = np.arange(1, len(found.order) + 1)
    pieces: list[tuple[str, int]] = []
    for i, name in enumerate(solutions.branch_names):
        here = np.flatnonzero(solutions.branch_index == i)
        if free is not None and len(here):
            angles = solutions.q[here, free]
            ahead = np.argsort(angles, kind="stable")
            steps = np.diff(angles[ahead])
            usual = np.median(steps[steps > SAME_RAD]) if (steps > SAME_RAD).any() else np.inf
            parts = np.split(here[ahead], np.flatnonzero(steps > _GAP_STEPS * usual) + 1)
        else:
            parts = [here] if len(here) else []
        for part in parts:
            first = int(place[part].min())
            span = ""
            if free is not None and len(parts) > 1:
                low, high = np.sort(found.robot.shown(solutions.q[part[[0, -1]]])[:, free])
                span = f", {found.robot.joints[free].title} {fixed(low, 0)} … {fixed(high, 0)}°"
            pieces.append((f"{name}{span}", first))
    return sorted(pieces, key=lambda piece: piece[1])


def short_branch(name: str) -> str:
    """A branch name for a narrow column: ``front elbow-up`` becomes ``front up``."""
    return name.replace("shoulder-", "").replace("elbow-", "").replace("tool-in", "in")


def _energy_curve(robot: Robot, found: RankedSolutions) -> Picture | str:
    solutions, free, count = found.solutions, found.solutions.free_joint, len(found.solutions)
    if count == 0:
        return "There is no solution."
    if free is None and robot.inverse_kinematics.is_swept(solutions.target):
        return "These solutions were searched for one by one: no single joint is free to draw a curve over."
    if free is None and (roll := solutions.free_roll) is not None:
        free_one = f"{robot.joints[roll].title} may have any angle, but only turns the tool"
        return f"{counted(count, 'isolated ')}; {free_one}: no curve."
    if free is None:
        return f"No joint is free here: {counted(count, 'isolated ')}, no curve."
    if count == 1:
        return "There is a single solution, and no curve."
    unique, place = np.unique(np.round(robot.shown(solutions.q)[:, free], 6), return_inverse=True)
    angles = unique.astype(np.float64)
    best = None if found.best is None else int(np.abs(angles - robot.shown(found.best)[free]).argmin())
    kept = thinned(len(angles), _MOST_POINTS, [] if best is None else [best])
    lines: list[PlotLine] = []
    for i, name in enumerate(solutions.branch_names):
        here = solutions.branch_index == i
        energy = np.full(len(angles), np.inf)
        np.minimum.at(energy, place.reshape(-1)[here], found.energy[here])
        energy[~np.isfinite(energy)] = np.nan
        if np.isfinite(energy[kept]).any():  # else the criterion admits none of this branch
            lines.append(PlotLine(name, energy[kept], color_of(i)))
    if not lines:
        return "The criterion excludes every solution."
    if best is not None:
        at = np.searchsorted(kept, best)
        dot = np.full(len(kept), np.nan)
        dot[at] = np.fmin.reduce([line.y[at] for line in lines])
        lines.append(PlotLine("least energy", dot, "#e03131", mark=True))
    title = f"Energy ({found.unit}): {found.criterion}"
    return Picture(title, f"{robot.joints[free].title} (°)", angles[kept], tuple(lines))


def counted(count: int, kind: str = "") -> str:
    """So many solutions, in words."""
    return f"{count} {kind}solution{'' if count == 1 else 's'}"
