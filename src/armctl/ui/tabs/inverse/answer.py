"""What the Inverse tab knows once a target is solved: computed in a worker thread, shown as HTML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import UnreachableError
from armctl.facts.angles import to_degrees
from armctl.kinematics import DEFAULT_STEP, Branch, Criterion, Solutions, Target, checked_criterion
from armctl.kinematics.energy import EnergyModel, energies
from armctl.motion import FLOOR_TOLERANCE_M, Profile
from armctl.motion.choices import JudgedConfigurations, first_possible
from armctl.motion.figure import color_of
from armctl.robot import Robot
from armctl.ui.widgets.html import fixed, muted, numbers, refused, strong, table, warned
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
_SAME_RAD = 1e-9
"""a row that is no farther off than this is the same configuration"""
_SAME_BRANCH = 1e-6
_MOST_POINTS = 1000
"""of an energy curve"""


def _shown(criterion: Criterion, energy: FloatArray, model: EnergyModel) -> FloatArray:
    """Energies as they are shown, in ``_unit``; of loads the root of the sum of squares."""
    if criterion == "least-torque":
        return (1.0 if model.stall_torque is None else 100.0) * np.sqrt(energy)
    return _UNITS[criterion][0] * energy


def _unit(criterion: Criterion, model: EnergyModel) -> str:
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
    why_not: str
    """why there is none to go to by itself: no best one, or not in that orientation; empty where there is"""
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
        return int(np.flatnonzero(away <= away.min() + _SAME_RAD)[0]) + 1

    def energy_of(self, q: FloatArray) -> float:
        """Energy of any configuration ``q`` (n,) [rad], as ``energy``; infinite if not admitted."""
        arm = self.solutions.arm
        energy = energies(self.criterion, q[None], arm.energy, arm.pitch_joints, self.start)
        return float(_shown(self.criterion, energy, arm.energy)[0])

    @property
    def unit(self) -> str:
        """Of the energies."""
        return _unit(self.criterion, self.solutions.arm.energy)

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
    best, why_not, energy = None, "", np.empty(0)
    try:
        best = solutions.best(name, start)
        why_not = robot.turned_off(solutions, best) or ""
    except UnreachableError as refusal:
        why_not = str(refusal)
    if solutions.success:
        energy = _shown(name, solutions.energies(name, start), solutions.arm.energy)
    order = solutions.order(name, start)
    ways = JudgedConfigurations(robot, start, profile)
    way = "" if best is None or why_not else ways.refused(best)
    judged = _verdicts(robot, solutions, name, start, best, ways)
    found = RankedSolutions(robot, solutions, name, start, energy, order, best, why_not, ways, judged, way)
    few = representatives(found) if solutions.success else ()
    other = _first_possible(robot, found, few) if way else None
    return replace(found, curve=_energy_curve(robot, found), representatives=few, instead=other)


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


def result_html(robot: Robot, found: RankedSolutions) -> str:
    """Count and branches, and the configuration of least energy; or why there is none."""
    solutions, best = found.solutions, found.best
    if not solutions.success:
        text = strong("No solution") + refused(f"{_capital(found.why_not)}.")
        nearest = solutions.nearest_m
        return text if nearest is None else text + _floor_note(robot, "The nearest point", nearest)
    used = zip(*np.unique(solutions.branch_index, return_counts=True), strict=True)
    branches = "; ".join(f"{solutions.branch_names[i]}: {count}" for i, count in used)
    angles = "" if best is None else numbers(robot.shown(best).tolist(), 3)
    if best is not None and found.why_not:
        text = strong("No solution in that orientation") + refused(f"{_capital(found.why_not)}.")
        text += f"<div>the nearest that was found: {_in_one_line(angles)}</div>"
        text += muted(f"The list has {counted(len(solutions))} of the point, as near to that orientation.")
        return text + _floor_note(robot, "The point", solutions.target.position)
    text = strong(f"{counted(len(solutions))} inside the limits")
    text += muted(branches + ("" if solutions.complete else f"; {solutions.incomplete_reason}"))
    text += _floor_note(robot, "The point", solutions.target.position)
    if best is None:
        return text + refused(_capital(found.why_not))
    error_mm = 1000 * float(np.linalg.norm(robot.forward(best)[:3, 3] - solutions.target.position))
    text += f"<div>least energy {'would' if found.way_refused else 'will'} go to {_in_one_line(angles)}</div>"
    error = "below 0.001 mm" if error_mm < 1e-3 else f"{error_mm:.3f} mm"
    text += muted(f"{solutions.branch_of(best)}; energy {found.energy_text(best)}; error {error}")
    row_1 = found.q(1)
    if np.abs(row_1 - best).max() >= _SAME_RAD:
        least = found.energy_text(row_1)
        text += muted(f"The exact least: it lies between two rows of the list (row 1: {least}).")
    if found.criterion == "least-torque":
        text += muted(f"Torques count {solutions.arm.energy.gravity.counted}.")
    text += way_html(found.way_refused)
    if found.instead is not None:
        angles = _in_one_line(numbers(robot.shown(found.q(found.instead)).tolist(), 3))
        text += f"<div>Go by least energy goes to row {found.instead} instead: {angles}</div>"
        text += muted("It is the best to which the arm may go.")
    return text


def way_html(why: str) -> str:
    """A warning where the way to a configuration is refused; empty where it is not."""
    return warned(f"The way there is refused: {why}.") if why else ""


@dataclass(frozen=True, slots=True)
class Representative:
    """One row of the list that stands for many, and what it costs."""

    names: tuple[str, ...]
    """criteria by which it is the least, or the branch of which it is"""
    row: int
    """in the list, from 1"""
    rotation_deg: float
    """sum of |joint angles|"""
    time_s: float
    """from the present pose, all joints together by a cubic"""
    load: float
    """of all joints against gravity, as ``least-torque`` counts it, in its unit; 0: no link has a mass"""
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
    arm = solutions.arm
    rows: list[Representative] = []
    for row, names in named.items():
        q = found.q(row)
        rotation, time = (
            float(energies(one, q[None], arm.energy, arm.pitch_joints, start)[0])
            for one in ("least-rotation", "shortest-time")
        )
        load = 0.0
        if arm.energy.gravity.weighs:
            squares = energies("least-torque", q[None], arm.energy, arm.pitch_joints, start)
            load = float(_shown("least-torque", squares, arm.energy)[0])
        forbidden = not found.ways.possible(q)
        rows.append(Representative(tuple(names), row, to_degrees(rotation), time, load, forbidden))
    return tuple(rows)


def comparison_html(found: RankedSolutions) -> str:
    """The representatives side by side, and what others save against the first."""
    rows, model = found.representatives, found.solutions.arm.energy
    if len(rows) < 2:
        return ""
    digits = 3 if model.stall_torque is None else 1  # N·m, or percents
    heads = ["", "row", "Σ|θ| °", "time s", f"load {_unit('least-torque', model)}", "verdict"]
    figures = [
        ["least " + ", ".join(one.names), str(one.row), fixed(one.rotation_deg, 1), fixed(one.time_s, 2),
         fixed(one.load, digits), "refused" if one.refused else "possible"]
        for one in rows
    ]  # fmt: skip
    counts = f"Loads count {model.gravity.counted}."
    if not model.gravity.weighs:
        heads, figures = [*heads[:-2], heads[-1]], [[*row[:-2], row[-1]] for row in figures]
        counts = "There are no loads: the file of the arm gives no masses of links."
    html = table(heads, figures, marked=0, words=(0, len(heads) - 1), small=True) + muted(counts)
    return html + "".join(muted(saving) for saving in _savings(rows))


def _savings(rows: Sequence[Representative]) -> list[str]:
    """What rows save against the chosen one; of those that the arm may go to."""
    chosen, texts = rows[0], list[str]()
    possible = [one for one in rows if not one.refused]
    if chosen.refused:
        return texts
    columns: tuple[tuple[str, Callable[[Representative], float]], ...] = (
        ("rotation", lambda one: one.rotation_deg),
        ("time", lambda one: one.time_s),
        ("load", lambda one: one.load),
    )
    for what, of in columns:
        least = min(possible, key=of)
        saved = round(100 * (1 - of(least) / of(chosen))) if of(chosen) > 0 else 0
        if saved >= 1:
            texts.append(f"Row {least.row} saves {saved} % {what} against row {chosen.row}.")
    return texts


def list_head(found: RankedSolutions) -> list[str]:
    """The heads of the list of solutions."""
    return ["#", *theta_heads(len(found.start)), "branch", f"energy {found.unit}"]


def list_row(found: RankedSolutions, row: int) -> list[str]:
    """One row of the list, counted from 1."""
    index = found.order[row - 1]
    return [
        str(row),
        *(fixed(value, 2) for value in found.robot.shown(found.q(row)).tolist()),
        short_branch(str(found.solutions.branch[index])),
        fixed(float(found.energy[index]), 3),
    ]


def selected_html(found: RankedSolutions, row: int | None) -> str:
    """Where the selected row, from 1, goes, and why the way to it is refused, once that is judged."""
    if row is None:
        return muted(f"No row is selected: type a row from 1 to {len(found.solutions)}.")
    why = found.ways.known(found.q(row))
    angles = numbers(found.robot.shown(found.q(row)).tolist(), 2)
    goes = "goes" if why is None else "would go" if why else "will go"
    text = f"<div>selected row {row}: {goes} to θ = (<b>{angles}</b>)°</div>"
    if why and why == found.way_refused:
        return text + warned("Refused, as told above.")
    return text + way_html(why or "")


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


def _floor_note(robot: Robot, what: str, point: FloatArray) -> str:
    """A warning where a point (3,) [m] is below the floor; empty where it is not."""
    if point[2] >= robot.floor_z - FLOOR_TOLERANCE_M:
        return ""
    return warned(f"{what} is below the floor: a motion down to it is refused.")


def _in_one_line(angles: str) -> str:
    return f"<span style='white-space:nowrap'>θ = (<b>{angles}</b>)°</span>"


def theta_heads(n: int) -> list[str]:
    """Heads of the columns of ``n`` joint angles."""
    return [f"θ{i + 1}°" for i in range(n)]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
