"""What the Inverse tab knows of a target, as HTML: result, ways to choose among, list, comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from html import escape
from typing import NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.motion import FLOOR_TOLERANCE_M
from armctl.robot import Robot
from armctl.ui.tabs.inverse.answer import (
    MOST_WAYS,
    SAME_RAD,
    RankedSolutions,
    Representative,
    Way,
    short_branch,
    unit_of,
)
from armctl.ui.widgets.html import fixed, hint, muted, numbers, refused, sentence, strong, warned


def notice_html(robot: Robot, found: RankedSolutions) -> str:
    """What is to be known before a way is chosen: that there is none, or that the best one is refused."""
    solutions, best = found.solutions, found.best
    why_not = refused(sentence(found.why_not)) if found.why_not else ""
    if not solutions.success:
        nearest = solutions.nearest_m
        floor = "" if nearest is None else _floor_note(robot, "The nearest point", nearest)
        return why_not + floor
    text = _floor_note(robot, "The point", solutions.target.position)
    if best is None:
        return why_not + text
    if found.why_not:
        nearest = _in_one_line(numbers(robot.shown(best).tolist(), 3))
        text = f"<div>the nearest that was found: {nearest}</div>" + text
        return strong(f"{_NONE} in that orientation") + why_not + text
    text += way_html(found.way_refused)
    if found.instead is not None:
        text += (
            f"<div>Go by least energy goes to row {found.instead} instead, the best that is possible.</div>"
        )
    return text


def details_html(robot: Robot, found: RankedSolutions) -> str:
    """Of how many branches the solutions are, and the one of least energy; empty where there is none."""
    solutions, best = found.solutions, found.best
    if not solutions.success:
        return ""
    if best is not None and found.why_not:
        return muted("They have the point, and come as near to that orientation as they can.")
    used = zip(*np.unique(solutions.branch_index, return_counts=True), strict=True)
    branches = "; ".join(f"{solutions.branch_names[i]}: {count}" for i, count in used)
    text = muted(branches + ("" if solutions.complete else f"; {solutions.incomplete_reason}"))
    if best is None:
        return text
    error_mm = 1000 * float(np.linalg.norm(robot.forward(best)[:3, 3] - solutions.target.position))
    angles = _in_one_line(numbers(robot.shown(best).tolist(), 3))
    text += f"<div>least energy {'would' if found.way_refused else 'will'} go to {angles}</div>"
    error = "below 0.001 mm" if error_mm < 1e-3 else f"{error_mm:.3f} mm"
    text += muted(f"{solutions.branch_of(best)}; energy {found.energy_text(best)}; error {error}")
    row_1 = found.q(1)
    if np.abs(row_1 - best).max() >= SAME_RAD:
        least = found.energy_text(row_1)
        text += muted(f"The exact least: it lies between two rows of the list (row 1: {least}).")
    if found.criterion == "least-torque":
        text += muted(f"Torques count {solutions.arm.energy.gravity.counted}.")
    return text


def way_html(why: str) -> str:
    """A warning where the way to a configuration is refused; empty where it is not."""
    return warned(f"The way there is refused: {why}.") if why else ""


class SideBySide(NamedTuple):
    """Rows that stand for all, side by side."""

    text: str
    """HTML: what others save against the first, and what loads count"""
    heads: list[str]
    rows: list[tuple[int, list[str]]]
    """each with its number in the list, the chosen one first; none where there is nothing to compare"""
    words: tuple[int, ...]
    """the columns that are text"""


def comparison(found: RankedSolutions) -> SideBySide:
    """The representatives side by side, and what others save against the first."""
    few, model = found.representatives, found.solutions.arm.energy
    if len(few) < 2:
        return SideBySide("", [], [], ())
    digits = 3 if model.stall_torque is None else 1  # N·m, or percents
    load = f"load {unit_of('least-torque', model)}"
    heads = ["least", "row", "sum of angles °", "time s", load, "verdict"]
    rows = [
        [f"{', '.join(one.names)}", str(one.row), fixed(one.costs.rotation_deg, 1),
         fixed(one.costs.time_s, 2), fixed(one.costs.load, digits), "refused" if one.refused else "possible"]
        for one in few
    ]  # fmt: skip
    counts = f"Loads count {model.gravity.counted}."
    if not model.gravity.weighs:
        heads, rows = [*heads[:-2], heads[-1]], [[*row[:-2], row[-1]] for row in rows]
        counts = "There are no loads: the file of the arm gives no masses of links."
    text = "".join(f"<p>{escape(one)}</p>" for one in (*_savings(few), counts))
    numbered = [(one.row, cells) for one, cells in zip(few, rows, strict=True)]
    return SideBySide(text, heads, numbered, (0, len(heads) - 1))


def _savings(rows: Sequence[Representative]) -> list[str]:
    """What rows save against the chosen one; of those to which the arm may go, and has to."""
    chosen, texts = rows[0], list[str]()
    possible = [one for one in rows if not one.refused and round(one.costs.time_s, 2) > 0]
    if chosen.refused or not possible:
        return texts
    columns: tuple[tuple[str, Callable[[Representative], float]], ...] = (
        ("rotation", lambda one: one.costs.rotation_deg),
        ("time", lambda one: one.costs.time_s),
        ("load", lambda one: one.costs.load),
    )
    for what, of in columns:
        least = min(possible, key=of)
        saved = round(100 * (1 - of(least) / of(chosen))) if of(chosen) > 0 else 0
        if saved >= 1:
            texts.append(f"Row {least.row} saves {saved} % {what} against row {chosen.row}.")
    return texts


def list_head(found: RankedSolutions) -> list[str]:
    """The heads of the list of solutions."""
    return ["#", *(f"{joint.title} °" for joint in found.robot.joints), "branch", f"energy {found.unit}"]


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


def _floor_note(robot: Robot, what: str, point: FloatArray) -> str:
    """A warning where a point (3,) [m] is below the floor; empty where it is not."""
    if point[2] >= robot.floor_z - FLOOR_TOLERANCE_M:
        return ""
    return warned(f"{what} is below the floor: a motion down to it is refused.")


def _in_one_line(angles: str) -> str:
    return f"<span style='white-space:nowrap'>θ = (<b>{angles}</b>)°</span>"


# The ways to choose among, as cards.


_WAYS_TOLD = (
    "Seconds: of a planned movement from where the arm stands. Degrees: what its joints turn on the way, "
    "added up; a slow joint's count for more. Then the load: what they bear there, all together."
)
_BEST_TOLD = "{0} may have many angles here: a card is the best of them, the curve shows the others."
_NONE = "No solution"
_FEW_JOINTS = 5
"""so many angles stand beside each other with a decimal on a narrow card"""
_FEW_WAYS = 4
"""so many cards have room for what their numbers are"""
_LARGE_LOAD = 10.0
"""needs one decimal only [N·m]"""
_PICTURE, _DRAWN = 44, 36
"""width of a picture, and of the largest arm in it [px]"""
_UPRIGHT_M = 1e-6
"""how far from the base's axis a tool is that points nowhere"""
_ALONG = 1e-6
"""how far off the vertical or the horizontal an axis is no more along it"""


def count_html(found: RankedSolutions) -> str:
    """How many ways there are, and what their numbers mean; or that there is none."""
    ways = found.choices
    if not ways:
        return "" if found.solutions.success else f"<b>{_NONE}</b>"
    possible = sum(not way.refused for way in ways)
    many = "1 way" if len(ways) == 1 else f"{len(ways)} ways"
    if len(ways) == MOST_WAYS:
        many = f"The {len(ways)} ways of least energy"
    may = "" if possible == len(ways) else f", {possible} possible" if len(ways) > 1 else ", refused"
    free = found.solutions.free_joint
    about = "" if free is None else f" {_BEST_TOLD.format(found.robot.joints[free].title)}"
    return f"<b>{many}</b>{may}{hint(_WAYS_TOLD + about)}"


def ways_html(found: RankedSolutions, row: int | None, answer: int) -> str:
    """Every way as a card, that of the selected row (from 1) as chosen; empty where there is none.

    A card's key is ``answer``, the number of the answer, and which way of it.
    """
    ways = found.choices
    if not ways:
        return ""
    chosen = next((i for i, way in enumerate(ways) if row is not None and row in way.rows), None)
    pictures = _thumbnails(found.robot, np.array([way.q for way in ways]))
    of = frozenset[str]().union(*(way.least for way in ways))
    cards = "".join(
        _card(
            found,
            way,
            _badges(way.least, of),
            f"{answer}.{i}",
            picture,
            chosen=i == chosen,
            first=i == (chosen or 0),
        )
        for i, (way, picture) in enumerate(zip(ways, pictures, strict=True))
    )
    name = "Ways to the target"
    return f"<div class=armctl-cards role=listbox aria-label='{name}'>{cards}</div>"


_MOST_BADGES = 2


def _badges(least: Sequence[str], of: Set[str]) -> str:
    """What a way is the least ``of``: in a few words, and in all under the mouse."""
    shown = ["best in all"] if len(least) > _MOST_BADGES and of <= set(least) else least[:_MOST_BADGES]
    more = f" title='{escape(', '.join(least))}'" if len(least) > len(shown) else ""
    return "".join(f"<span class=armctl-badge{more}>{one}</span>" for one in shown)


def _card(
    found: RankedSolutions, way: Way, badges: str, key: str, picture: str, *, chosen: bool, first: bool
) -> str:
    """One that may be gone to with what it costs, another one with the reason."""
    if way.refused:
        body, angles = f"<em>{escape(way.refused)}</em>", ""
    else:
        cost = way.costs
        turns, load = ("turns ", "load ") if len(found.choices) <= _FEW_WAYS else ("", "")
        figures = [f"{fixed(cost.time_s, 2)} s", f"{turns}{fixed(cost.travel_deg, 0)}°"]
        if cost.load:
            unit = unit_of("least-torque", found.solutions.arm.energy).removesuffix(" of stall")
            digits = 0 if unit == "%" else 1 if cost.load >= _LARGE_LOAD else 2
            figures.append(f"{load}{fixed(cost.load, digits)} {unit}")
        more = len(way.rows) - 1
        whole = f"<span>+{more} by whole turns</span>" * bool(way.folded and more)
        told = "".join(f"<span>{escape(figure)}</span>" for figure in figures)
        body = f"<p>{told}</p><p>{badges}{whole}</p>"
        digits = 1 if len(way.q) <= _FEW_JOINTS or len(found.choices) == 1 else 0
        shown = (f"<span>{fixed(angle, digits)}°</span>" for angle in found.robot.shown(way.q).tolist())
        angles = f"<div class=angles>{''.join(shown)}</div>"
    state = f"aria-selected={'true' if chosen else 'false'}" + " aria-disabled=true" * (way.row is None)
    return (
        f"<div class='armctl-card{' armctl-refused' * bool(way.refused)}' role=option {state} "
        f"tabindex={0 if first else -1} data-key={key} data-do=way data-look=look-way "
        f"title='{escape(way.refused)}'>"
        f"<b>{escape(_in_words(way.name))}</b>{picture}<div>{body}</div>{angles}</div>"
    )


def _in_words(name: str) -> str:
    """``front elbow-up`` as people say it."""
    branch, *span = name.split(", ", 1)
    return ", ".join([*(word.replace("-", " ") for word in branch.split()), *span])


def _thumbnails(robot: Robot, q: FloatArray) -> list[str]:
    """The arm at each of ``q`` (k, n) [rad] as a line drawing, all at one scale."""
    drawn = _flat(robot, q)
    low, high = drawn.min(axis=(0, 1)), drawn.max(axis=(0, 1))
    at = _PICTURE / 2 + _DRAWN / float((high - low).max()) * (drawn - 0.5 * (low + high))
    return [_thumbnail(one) for one in at]


def _thumbnail(at: FloatArray) -> str:
    """The arm as a line drawing through points (k, 2) [px]."""
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in at)
    foot = f"M{at[0][0] - 8:.1f} {at[0][1]:.1f}h16"
    size = f"0 0 {_PICTURE} {_PICTURE}"
    return (
        f"<svg class=armctl-thumb viewBox='{size}' aria-hidden=true><path class=foot d='{foot}'/>"
        f"<path d='{path}'/>"
        f"<circle cx={at[-1][0]:.1f} cy={at[-1][1]:.1f} r=3 /></svg>"
    )


def _flat(robot: Robot, q: FloatArray) -> FloatArray:
    """(k, points, 2) foot, joints and tool at ``q`` (k, n) [rad] in the plane of a picture, y down [m].

    From the side of an arm that turns about the vertical and bends about a horizontal axis, with the tool at
    the right; else from where the 3D view first stands.
    """
    foot = np.broadcast_to([0.0, 0.0, min(0.0, robot.floor_z)], (len(q), 1, 3))
    points = np.concatenate([foot, robot.frames(q)[..., :3, 3], robot.forward(q)[:, None, :3, 3]], axis=1)
    axes = robot.jacobian(q)[:, 3:, :2]  # of the first two joints
    upright = np.abs(axes[:, 2])
    if axes.shape[2] == 2 and bool((upright[:, 0] > 1 - _ALONG).all() and (upright[:, 1] < _ALONG).all()):
        forward = np.einsum("kpi,ki->kp", points[..., :2], np.stack([axes[:, 1, 1], -axes[:, 0, 1]], axis=-1))
        forward *= np.where(forward[:, -1:] < 0, -1.0, 1.0)
        return np.stack([forward, -points[..., 2]], axis=-1)
    ahead = np.array([*robot.forward(robot.pose("home"))[:2, 3], 0.0])
    length = float(np.linalg.norm(ahead))
    ahead = ahead / length if length > _UPRIGHT_M else np.array([1.0, 0.0, 0.0])
    away = 0.62 * ahead + 0.72 * np.array([ahead[1], -ahead[0], 0.0]) + np.array([0.0, 0.0, 0.32])
    right = np.cross([0.0, 0.0, 1.0], away)
    up = np.cross(away, right)
    return np.stack([points @ right / np.linalg.norm(right), -points @ up / np.linalg.norm(up)], axis=-1)
