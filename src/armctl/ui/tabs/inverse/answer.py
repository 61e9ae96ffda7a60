"""What the Inverse tab knows once a target is solved: computed in a worker thread, shown as HTML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import UnreachableError
from armctl.facts import Reason
from armctl.facts.angles import to_degrees
from armctl.kinematics import DEFAULT_STEP, Branch, Criterion, Solutions, Target, checked_criterion
from armctl.kinematics.angles import turned_apart
from armctl.kinematics.energy import EnergyModel, energies
from armctl.lazy_dataclass import dataclass
from armctl.motion import Profile
from armctl.motion.choices import JudgedConfigurations, first_possible
from armctl.motion.figure import color_of
from armctl.robot import Robot
from armctl.ui.widgets.graph import Curves, PlotLine, PlotMark, thinned
from armctl.ui.widgets.html import fixed

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
MOST_WAYS, _MOST_TRIED, _MOST_POSTURES = 16, 4, 32
"""ways to choose among; rows of one that are tried, by energy and nearness; postures that are told apart"""
_SAME_COST = 1 + 1e-6
_GAP_STEPS, _FAR_RAD, _SAME_POSE = 2.5, 0.5, 1e-4


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
    curve: Curves | str = ""
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

    def q(self, row: int | NDArray[np.int64]) -> FloatArray:
        """Configuration (..., n) [rad] of a row or rows of the list, from 1, as the criterion takes them."""
        return self.solutions.taken(self.solutions.q[self.order[row - 1]], self.criterion, self.start)

    @cached_property
    def place(self) -> NDArray[np.int64]:
        """(k,) row of the list, from 1, of each solution in the solver's order."""
        place = np.empty(len(self.order), dtype=np.int64)
        place[self.order] = np.arange(1, len(self.order) + 1)
        return place

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
    found = replace(found, curve=_energy_curve(robot, found), representatives=few, instead=other)
    return replace(found, choices=ways_to(found) if best is not None and not why_not else ())


def _first_possible(robot: Robot, found: RankedSolutions, few: Sequence[Representative]) -> int | None:
    """The first row to which the arm may go, of some that differ from each other and of the ``few``."""
    possible = min((one.row for one in few if not one.refused), default=len(found.order) + 1)
    row = first_possible(robot, found.start, found.q(np.arange(1, possible)), found.ways.possible)
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
        chosen = best is not None and turned_apart(branch.q, best) < _SAME_BRANCH
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
    travel_deg: float
    """from the present pose, of all joints, as ``least-travel`` counts it: a slow one counts for more"""
    load: float
    """of all joints against gravity, as ``least-torque`` counts it, in its unit; 0: no link has a mass"""


_LEAST_OF: dict[str, Callable[[Costs], float]] = {
    "fastest": lambda one: one.time_s,
    "least travel": lambda one: one.travel_deg,
    "least load": lambda one: one.load,
    "least rotation": lambda one: one.rotation_deg,
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
    solutions, start, place = found.solutions, found.start, found.place
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

    weighs = arm.energy.gravity.weighs
    load = float(_shown("least-torque", np.array(of("least-torque")), arm.energy)) if weighs else 0.0
    travel = to_degrees(of("least-travel") * float(arm.energy.speed_limits.max()))
    return Costs(to_degrees(of("least-rotation")), of("shortest-time"), travel, load)


# The ways to a target: of a joint that is free the best of each piece; whole turns are folded.


@dataclass(frozen=True, slots=True)
class Way:
    """One way to put the tool there, as a person tells it from others."""

    name: str
    q: FloatArray
    """(n,) [rad]"""
    row: int | None
    """in the list, from 1; None: it is not in it, since a joint would pass its limit"""
    rows: NDArray[np.int64]
    """(k,) the rows of the list that are this way"""
    refused: str
    """why the arm may not go there from where it stands; empty where it may"""
    costs: Costs
    folded: bool = False
    """its rows differ by whole turns of joints, or by a roll that is free, alone"""
    least: tuple[str, ...] = ()
    """of these ways that may be gone to"""


def ways_to(found: RankedSolutions) -> tuple[Way, ...]:
    """What to choose among, of solutions that there are: those that may be gone to first, by energy."""
    solutions = found.solutions
    if found.verdicts:
        groups = [(one.branch.name, _turned(found, one.branch.q), one) for one in found.verdicts]
    else:
        named = _postures(found) if solutions.free_joint is None else _pieces(found)
        groups = [(name, rows, None) for name, rows in named]
    last = len(found.order) + 1
    ways = sorted(
        (_way(found, *group) for group in groups[:MOST_WAYS]),
        key=lambda way: (bool(way.refused), way.row or last),
    )
    possible = [way.costs for way in ways if not way.refused]
    return tuple(way if way.refused else replace(way, least=_least_by(way.costs, possible)) for way in ways)


def _turned(found: RankedSolutions, q: FloatArray) -> NDArray[np.int64]:
    """Rows of the list, from 1, that differ from ``q`` (n,) [rad] by whole turns, or a roll that is free."""
    solutions = found.solutions
    counted = [joint for joint in range(len(q)) if joint != solutions.free_roll]
    alike = turned_apart(solutions.q[found.order][:, counted], q[counted]) < _SAME_BRANCH
    return np.flatnonzero(alike) + 1


def _least_by(one: Costs, of: Sequence[Costs]) -> tuple[str, ...]:
    """What it is the least of, where not all are alike."""
    costs_of = {name: [cost(each) for each in of] for name, cost in _LEAST_OF.items()}
    least = {name: _SAME_COST * min(all_of) for name, all_of in costs_of.items()}
    return tuple(n for n, cost in _LEAST_OF.items() if cost(one) <= least[n] < max(costs_of[n]))


def _way(found: RankedSolutions, name: str, rows: NDArray[np.int64], one: BranchVerdict | None) -> Way:
    """Of rows of the list, from 1: the first to which the arm may go, of the least and the nearest ones."""
    if one is not None and not len(rows):
        return Way(name, one.branch.q, None, rows, one.refused, costs(found, one.branch.q))
    away = np.abs(found.q(rows) - found.start).max(axis=1)
    nearest = rows[np.argsort(away, kind="stable")[:_MOST_TRIED]]
    known = rows[rows == (found.instead or 0)]  # it is possible
    tried: list[int] = np.unique(np.concatenate([rows[:_MOST_TRIED], nearest, known])).tolist()
    row = next((row for row in tried if found.ways.possible(found.q(row))), int(rows[0]))
    q = found.q(row)
    return Way(name, q, row, rows, found.ways.refused(q), costs(found, q), folded=one is not None)


def _postures(found: RankedSolutions) -> list[tuple[str, NDArray[np.int64]]]:
    """Name and rows of solutions that are searched for one by one: of one branch, or near each other."""
    robot, named = found.robot, dict[str, list[NDArray[np.int64]]]()
    left = np.arange(1, len(found.order) + 1)
    for number in range(1, _MOST_POSTURES + 1):
        if not len(left):
            break
        q = found.q(left[0])
        near = turned_apart(found.q(left), q) <= _FAR_RAD
        pose = robot.forward(q)
        branches = robot.branches(pose[:3, 3], rotation=pose[:3, :3])
        same = (one.name for one in branches if turned_apart(one.q, q) < _SAME_POSE)
        named.setdefault(next(same, f"posture {number}"), []).append(left[near])
        left = left[~near]
    return [(name, np.sort(np.concatenate(rows))) for name, rows in named.items()]


def _pieces(found: RankedSolutions) -> list[tuple[str, NDArray[np.int64]]]:
    """Name and rows of each piece (of one branch, no gap in the free joint), by its least energy."""
    solutions, free = found.solutions, found.solutions.free_joint or 0
    pieces: list[tuple[str, NDArray[np.int64]]] = []
    for i, name in enumerate(solutions.branch_names):
        here = np.flatnonzero(solutions.branch_index == i)
        here = here[np.argsort(solutions.q[here, free], kind="stable")]
        steps = np.diff(solutions.q[here, free])
        usual = np.median(steps[steps > SAME_RAD]) if (steps > SAME_RAD).any() else np.inf
        parts = np.split(here, np.flatnonzero(steps > _GAP_STEPS * usual) + 1) if len(here) else []
        for part in parts:
            span = ""
            if len(parts) > 1:
                low, high = np.sort(found.robot.shown(solutions.q[part[[0, -1]]])[:, free])
                span = f", {found.robot.joints[free].title} {fixed(low, 0)} … {fixed(high, 0)}°"
            pieces.append((f"{name}{span}", np.sort(found.place[part])))
    return sorted(pieces, key=lambda piece: int(piece[1][0]))


def short_branch(name: str) -> str:
    """A branch name for a narrow column: ``front elbow-up`` becomes ``front up``."""
    return name.replace("shoulder-", "").replace("elbow-", "").replace("tool-in", "in")


def _energy_curve(robot: Robot, found: RankedSolutions) -> Curves | str:
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
    if len(angles) == 1:
        return f"{robot.joints[free].title} has the same angle in all of them: no curve."
    kept = thinned(len(angles), _MOST_POINTS)
    lines: list[PlotLine] = []
    for i, name in enumerate(solutions.branch_names):
        here = solutions.branch_index == i
        energy = np.full(len(angles), np.inf)
        np.minimum.at(energy, place.reshape(-1)[here], found.energy[here])
        energy[~np.isfinite(energy)] = np.nan
        if np.isfinite(energy[kept]).any():  # else the criterion admits none of this branch
            lines.append(PlotLine(short_branch(name), energy[kept], color_of(i)))
    if not lines:
        return "The criterion excludes every solution."
    least = () if found.best is None else (on_curve(found, "least energy", found.best, "currentColor"),)
    return Curves(angles[kept], tuple(lines), marks=least, unit="°")


def on_curve(found: RankedSolutions, name: str, q: FloatArray, color: str) -> PlotMark:
    """Where a configuration ``q`` (n,) [rad] is on the energy curve."""
    angle = float(found.robot.shown(q)[found.solutions.free_joint or 0])
    return PlotMark(name, angle, found.energy_of(q), color)


def counted(count: int, kind: str = "") -> str:
    """So many solutions, in words."""
    return f"{count} {kind}solution{'' if count == 1 else 's'}"
