"""``armctl ik``: all inverse kinematic solutions of a point, and the one of least energy."""

from __future__ import annotations

import math
from collections.abc import Sequence

import click
import numpy as np

from armctl.arrays import FloatArray
from armctl.cli.main import REFUSED
from armctl.cli.options import NUMBER, QUERY_SETTINGS, Number, json_option, print_json, rounded
from armctl.errors import InputError
from armctl.kinematics import CRITERIA, Branch, Solutions, rotation_from_rpy
from armctl.robot import Robot, load_robot

_LISTED = 20
_LABEL, _NARROWEST = 17, 11
"""widths of the names and of the angles' columns, at least"""


@click.command(context_settings=QUERY_SETTINGS)
@click.argument("robot")
@click.argument("x", type=NUMBER)
@click.argument("y", type=NUMBER)
@click.argument("z", type=NUMBER)
@click.option(
    "--pitch", type=Number(between=(-360, 360)), help="Angle of the tool above the horizontal, degrees."
)
@click.option("--roll", type=NUMBER, help="Angle of the tool about its own axis, degrees.")
@click.option(
    "--rpy",
    type=NUMBER,
    nargs=3,
    metavar="ROLL PITCH YAW",
    default=None,
    help="Orientation as Rz(yaw)·Ry(pitch)·Rx(roll), degrees: the nearest that the arm can take.",
)
@click.option("--choose", type=click.Choice(CRITERIA), default="least-rotation", show_default=True,
              help="What the best solution is.")  # fmt: skip
@click.option(
    "--start", metavar="Q1,Q2,…", help="Where the arm stands, degrees (for least-travel; default: home)."
)
@click.option(
    "--step",
    type=Number(above=0.0),
    default=0.01,
    show_default=True,
    help="Step of the swept joint, degrees.",
)
@click.option(
    "--all", "every", is_flag=True, help="List every solution, and the branches that limits forbid."
)
@json_option
def ik(
    robot: str, x: float, y: float, z: float, pitch: float | None, roll: float | None,
    rpy: tuple[float, float, float] | None, choose: str, start: str | None, step: float, every: bool,
    as_json: bool,
) -> int:  # fmt: skip
    """Solve inverse kinematics: joint angles that put ROBOT's tool on X Y Z (mm)."""
    if rpy is not None and (pitch is not None or roll is not None):
        raise click.UsageError("give either --rpy, or --pitch and --roll, not both")
    arm = load_robot(robot)
    point = np.array([x, y, z])
    wish = (_radians(pitch), _radians(roll), _rotation(rpy))
    solutions = arm.inverse(point / 1000, *wish, step=math.radians(step))
    refused = [branch for branch in arm.branches(point / 1000, *wish) if branch.forbidden] if every else None
    if not solutions.success:
        return _refuse(arm, solutions, refused, as_json)
    q = solutions.best(choose, _start(arm, start))
    error_mm = 1000 * float(np.linalg.norm(arm.forward(q)[:3, 3] - point / 1000))
    if as_json:
        print_json(_record(solutions, q, error_mm, refused))
    else:
        _print(arm, solutions, q, error_mm, choose, refused)
    return 0


def _radians(value: float | None) -> float | None:
    return None if value is None else math.radians(value)


def _rotation(rpy: tuple[float, float, float] | None) -> FloatArray | None:
    if rpy is None:
        return None
    roll, pitch, yaw = rpy
    return rotation_from_rpy(math.radians(roll), math.radians(pitch), math.radians(yaw))


def _start(arm: Robot, text: str | None) -> FloatArray:
    if text is None:
        return arm.pose("home")
    try:
        values = arm.chain.checked([float(part) for part in text.replace(",", " ").split()])
    except (ValueError, InputError) as cause:
        raise click.UsageError(f"--start needs {arm.n} finite numbers in degrees, got {text!r}") from cause
    return np.radians(values)


def _record(
    solutions: Solutions, q: FloatArray, error_mm: float, refused: Sequence[Branch] | None
) -> dict[str, object]:
    record: dict[str, object] = {
        "count": len(solutions),
        "best_deg": rounded(np.degrees(q)),
        "branch": solutions.branch_of(q),
        "error_mm": error_mm,
        "orientation_error_deg": _orientation_error_deg(solutions, q),
        "reason": None,
        "nearest_mm": None,
        "complete": solutions.complete,
    }
    if refused is not None:
        record["solutions_deg"] = [rounded(row) for row in np.degrees(solutions.q)]
        record["branches"] = solutions.branch.tolist()
        record["refused"] = _refused_records(refused)
    return record


def _orientation_error_deg(solutions: Solutions, q: FloatArray) -> float | None:
    """Angle between the orientation asked for and the one found; None where none was asked for."""
    if solutions.target.rotation is None:
        return None
    return math.degrees(float(solutions.residual_rad[solutions.index_of(q)]))


def _refused_records(refused: Sequence[Branch]) -> list[dict[str, object]]:
    return [
        {"branch": branch.name, "deg": rounded(np.degrees(branch.q)), "why": "; ".join(branch.forbidden)}
        for branch in refused
    ]


def _refuse(arm: Robot, solutions: Solutions, refused: Sequence[Branch] | None, as_json: bool) -> int:
    nearest = solutions.nearest_m
    if as_json:
        record: dict[str, object] = {
            "count": 0,
            "best_deg": None,
            "branch": None,
            "error_mm": None,
            "orientation_error_deg": None,
            "complete": solutions.complete,
            "solutions_deg": [],
            "reason": solutions.reason,
            "nearest_mm": None if nearest is None else rounded(1000 * nearest, 6),
            "nearest_deg": None if solutions.nearest_q is None else rounded(np.degrees(solutions.nearest_q)),
        }
        if refused is not None:
            record["refused"] = _refused_records(refused)
        print_json(record)
    elif refused:
        _Columns(arm, [branch.name for branch in refused]).print_refused(refused)
    click.echo(f"armctl: {solutions.explanation}", err=True)
    return REFUSED


class _Columns:
    """Angles under the joints' titles, and the names before them; as wide as the longest."""

    def __init__(self, arm: Robot, names: Sequence[str]) -> None:
        self._titles = [joint.title for joint in arm.joints]
        self._label = max(_LABEL, *map(len, names))
        self._width = max(_NARROWEST, *map(len, self._titles)) + 2

    def head(self, text: str) -> None:
        """The line of the joints' titles."""
        titles = "".join(f"{title:>{self._width}}" for title in self._titles)
        click.echo(f"{text:<{self._label}}{titles}")

    def row(self, name: str, q: FloatArray) -> None:
        """A configuration (n,) [rad] in degrees, three digits."""
        angles = "".join(f"{value + 0.0:{self._width}.3f}" for value in np.round(np.degrees(q), 3))
        click.echo(f"{name:<{self._label}}{angles}")

    def note(self, name: str, text: str) -> None:
        """A line of text."""
        click.echo(f"{name:<{self._label}}  {text}")

    def print_refused(self, refused: Sequence[Branch]) -> None:
        """The branches outside the limits, each with what it needs."""
        many = len(refused) != 1
        self.head(f"{len(refused)} branch{'es' if many else ''} refused")
        for branch in refused:
            self.row(branch.name, branch.q)
            self.note("", "; ".join(branch.forbidden))


def _print(
    arm: Robot,
    solutions: Solutions,
    q: FloatArray,
    error_mm: float,
    choose: str,
    refused: Sequence[Branch] | None,
) -> None:
    many = len(solutions) != 1
    free = solutions.free_joint
    swept = "" if free is None else f" ({arm.joints[free].title.lower()} swept)"
    more = "" if solutions.complete else "; found by search, there may be others"
    click.echo(f"{len(solutions)} solution{'s' if many else ''} inside the limits{swept}{more}")
    names = {*CRITERIA, *solutions.branch.tolist(), *(branch.name for branch in refused or ())}
    columns = _Columns(arm, sorted(names))
    columns.head("degrees")
    columns.row(choose, q)
    columns.note("branch", solutions.branch_of(q))
    columns.note("position error", f"{error_mm:.2e} mm")
    turned_deg = _orientation_error_deg(solutions, q)
    if turned_deg is not None:
        columns.note("orientation error", f"{turned_deg:.3f}°")
    if refused is not None or 1 < len(solutions) <= _LISTED:
        for branch, row in zip(solutions.branch.tolist(), solutions.q, strict=True):
            columns.row(branch, row)
    elif many:
        click.echo("(--all lists them)")
    if refused:
        columns.print_refused(refused)
