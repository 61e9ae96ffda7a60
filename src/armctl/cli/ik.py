"""``armctl ik``: all inverse kinematic solutions of a point, and the one of least energy."""

from __future__ import annotations

import math

import click
import numpy as np
from numpy.typing import NDArray

from armctl.cli.main import REFUSED
from armctl.cli.options import QUERY_SETTINGS, finite, json_option, print_json, rounded
from armctl.errors import InputError
from armctl.kinematics import CRITERIA, Solutions
from armctl.robot import Robot, load_robot

FloatArray = NDArray[np.float64]
_LISTED = 20
_WIDTH = 13


@click.command(context_settings=QUERY_SETTINGS)
@click.argument("robot")
@click.argument("x", type=float)
@click.argument("y", type=float)
@click.argument("z", type=float)
@click.option("--pitch", type=float, help="Angle of the tool above the horizontal, degrees.")
@click.option("--roll", type=float, help="Angle of the tool about its own axis, degrees.")
@click.option("--choose", type=click.Choice(CRITERIA), default="least-rotation", show_default=True,
              help="What the best solution is.")  # fmt: skip
@click.option(
    "--start", metavar="Q1,Q2,…", help="Where the arm stands, degrees (for least-travel; default: home)."
)
@click.option("--step", type=float, default=0.01, show_default=True, help="Step of the swept joint, degrees.")
@click.option("--all", "every", is_flag=True, help="List every solution.")
@json_option
def ik(
    robot: str, x: float, y: float, z: float, pitch: float | None, roll: float | None,
    choose: str, start: str | None, step: float, every: bool, as_json: bool,
) -> int:  # fmt: skip
    """Solve inverse kinematics: joint angles that put ROBOT's tool on X Y Z (mm)."""
    arm = load_robot(robot)
    point = np.array(
        [finite(value, name) for value, name in ((x, "X"), (y, "Y"), (z, "Z"))], dtype=np.float64
    )
    solutions = arm.inverse(
        point / 1000, _radians(pitch, "--pitch"), _radians(roll, "--roll"), step=math.radians(step)
    )
    if not solutions.success:
        return _refuse(solutions, as_json)
    q = solutions.best(choose, _start(arm, start))
    error_mm = 1000 * float(np.linalg.norm(arm.forward(q)[:3, 3] - point / 1000))
    if as_json:
        print_json(_record(solutions, q, error_mm, every))
    else:
        _print(arm, solutions, q, error_mm, choose, every)
    return 0


def _radians(value: float | None, what: str) -> float | None:
    return None if value is None else math.radians(finite(value, what) or 0.0)


def _start(arm: Robot, text: str | None) -> FloatArray:
    if text is None:
        return arm.pose("home")
    try:
        values = [float(part) for part in text.replace(",", " ").split()]
    except ValueError as cause:
        raise InputError(f"--start needs {arm.n} numbers in degrees, got {text!r}") from cause
    return np.radians(arm.chain.checked(values))


def _record(solutions: Solutions, q: FloatArray, error_mm: float, every: bool) -> dict[str, object]:
    record: dict[str, object] = {
        "count": len(solutions),
        "best_deg": rounded(np.degrees(q)),
        "branch": solutions.branch_of(q),
        "error_mm": error_mm,
        "reason": None,
        "nearest_mm": None,
        "complete": solutions.complete,
    }
    if every:
        record["solutions_deg"] = [rounded(row) for row in np.degrees(solutions.q)]
        record["branches"] = solutions.branch.tolist()
    return record


def _refuse(solutions: Solutions, as_json: bool) -> int:
    nearest = solutions.nearest_m
    if as_json:
        print_json({
            "count": 0,
            "best_deg": None,
            "branch": None,
            "error_mm": None,
            "solutions_deg": [],
            "reason": solutions.reason,
            "nearest_mm": None if nearest is None else rounded(1000 * nearest, 6),
            "nearest_deg": None if solutions.nearest_q is None else rounded(np.degrees(solutions.nearest_q)),
        })  # fmt: skip
    click.echo(f"armctl: {solutions.explanation}", err=True)
    return REFUSED


def _print(
    arm: Robot, solutions: Solutions, q: FloatArray, error_mm: float, choose: str, every: bool
) -> None:
    many = len(solutions) != 1
    free = solutions.free_joint
    swept = "" if free is None else f" ({arm.joints[free].title.lower()} swept)"
    click.echo(f"{len(solutions)} solution{'s' if many else ''} inside the limits{swept}")
    click.echo(f"{'degrees':<21}" + "".join(f"{joint.title:>{_WIDTH}}" for joint in arm.joints))
    click.echo(f"{choose:<21}{_angles(q)}")
    click.echo(f"{'branch':<21}   {solutions.branch_of(q)}")
    click.echo(f"{'position error':<21}   {error_mm:.2e} mm")
    if every or 1 < len(solutions) <= _LISTED:
        for branch, row in zip(solutions.branch, solutions.q, strict=True):
            click.echo(f"{branch:<21}{_angles(row)}")
    elif many:
        click.echo("(--all lists them)")


def _angles(q: FloatArray) -> str:
    """Joint angles [rad] in degrees under their titles, three digits."""
    return "".join(f"{value + 0.0:{_WIDTH}.3f}" for value in np.round(np.degrees(q), 3))
