"""``armctl robots``, ``fk``, ``ik`` and ``published``: what is known of an arm without a board."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict

import click
import numpy as np

from armctl.arrays import FloatArray
from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import (
    NUMBER,
    QUERY_SETTINGS,
    ROBOT,
    Number,
    json_option,
    load_with,
    print_json,
    rounded,
    tool_option,
)
from armctl.errors import ArmctlError, InputError, UnreachableError
from armctl.facts import say
from armctl.facts.angles import DEGREE, from_degrees, to_degrees
from armctl.kinematics import CRITERIA, Branch, Solutions, quaternion_wxyz, roll_pitch_yaw, rotation_of
from armctl.published import REPORTS, Report
from armctl.robot import Robot, hidden_robots, load_robot, shipped_robots, user_robots

_LISTED = 20
_LABEL, _NARROWEST = 17, 11
"""widths of the names and of the angles' columns, at least"""


@click.command()
@json_option
def robots(as_json: bool) -> None:
    """List the shipped robots and your own: joints, limits, source."""
    arms, refused = [load_robot(name) for name in shipped_robots()], list[tuple[str, ArmctlError]]()
    for name in user_robots():
        try:
            arm = load_robot(name)
            _ = arm.inverse_kinematics  # what is not solved refuses here, too
            arms.append(arm)
        except ArmctlError as refusal:
            refused.append((name, refusal))
    _print_robots(arms, as_json)
    for name, refusal in refused:
        click.echo(f"armctl: {name} cannot be opened: {refusal}", err=True)
    for path in hidden_robots():
        click.echo(
            f"armctl: {path} has the name of a shipped robot: open it by its path, or rename it", err=True
        )


def _print_robots(arms: Sequence[Robot], as_json: bool) -> None:
    if as_json:
        print_json([
            {
                "name": arm.name,
                "title": arm.title,
                "source": arm.source,
                "family": arm.inverse_kinematics.family,
                "joints": list(arm.joint_names),
                "tools": [tool.name for tool in arm.tools],
                "limits_deg": [rounded(row, 6) for row in arm.shown(arm.limits.T).T],
                "assumed": list(arm.assumed),
                "simulated_only": arm.simulated_only,
            }
            for arm in arms
        ])  # fmt: skip
        return
    width = 2 + max((len(arm.name) for arm in arms), default=0)
    for arm in arms:
        click.echo(f"{arm.name:<{width}}{arm.title}: {arm.n} joints; {arm.inverse_kinematics.family}")
        if arm.simulated_only is not None:
            click.echo(f"{'':<{width}}simulated only: {arm.simulated_only}")
        if arm.tools:
            click.echo(f"{'':<{width}}tools: {', '.join(tool.name for tool in arm.tools)}")
        for joint, (low, high) in zip(arm.joints, arm.shown(arm.limits.T).T, strict=True):
            click.echo(f"{'':<{width}}{joint.title:<14}{low:9.2f}° … {high:.2f}°")


@click.command(context_settings=QUERY_SETTINGS)
@click.argument("robot", type=ROBOT)
@click.argument("q", nargs=-1, type=NUMBER)
@tool_option
@json_option
def fk(robot: str, q: tuple[float, ...], tool: str | None, as_json: bool) -> None:
    """Compute the pose of ROBOT's tool at joint angles Q… (degrees).

    Position in mm in the base frame; roll, pitch, yaw as Rz(yaw)·Ry(pitch)·Rx(roll); quaternion w, x, y, z.
    The tool pitch is the angle of the tool above the horizontal, as in the page and for armctl ik --pitch.
    """
    arm = load_with(robot, tool)
    if len(q) != arm.n:
        names = ", ".join(arm.joint_names)
        raise click.UsageError(f"{arm.name} needs {arm.n} joint angles in degrees, got {len(q)}: {names}")
    configuration = arm.read(arm.chain.checked(q))
    T = arm.forward(configuration)
    rpy, quaternion = to_degrees(roll_pitch_yaw(T[:3, :3])), quaternion_wxyz(T[:3, :3])
    tool_pitch, _ = arm.inverse_kinematics.pitch_and_roll(configuration)
    tool_pitch = None if tool_pitch is None else round(to_degrees(tool_pitch), 4) + 0.0
    T[:3, 3] *= 1000
    outside = None
    try:
        arm.check_limits(configuration)
    except ArmctlError as refusal:
        outside = str(refusal)
    if as_json:
        print_json({
            "position_mm": rounded(T[:3, 3]),
            "rpy_deg": rounded(rpy),
            "tool_pitch_deg": tool_pitch,
            "quaternion_wxyz": rounded(quaternion, 12),
            "matrix": [rounded(row, 12) for row in T],
            "outside_limits": outside,
        })  # fmt: skip
    else:
        x, y, z = T[:3, 3] + 0.0
        roll, pitch, yaw = (round(float(angle), 4) + 0.0 for angle in rpy)  # no -0.0000
        click.echo(f"position   x {x:10.4f}   y {y:10.4f}   z {z:10.4f}  mm")
        click.echo(f"rotation   roll {roll:9.4f}   pitch {pitch:9.4f}   yaw {yaw:9.4f}  degrees")
        if tool_pitch is not None:
            click.echo(f"tool pitch      {tool_pitch:9.4f}  degrees above the horizontal")
        w, i, j, k = np.round(quaternion, 6) + 0.0
        click.echo(f"quaternion w {w:9.6f}   x {i:9.6f}   y {j:9.6f}   z {k:9.6f}")
        for row in T:
            click.echo("           " + "  ".join(f"{value + 0.0:11.6f}" for value in row))
    if outside is not None:
        click.echo(f"armctl: warning: the arm cannot stand there: {outside}", err=True)


@click.command(context_settings=QUERY_SETTINGS)
@click.argument("robot", type=ROBOT)
@click.argument("x", type=NUMBER)
@click.argument("y", type=NUMBER)
@click.argument("z", type=NUMBER)
@click.option("--pitch", type=Number(between=(-360, 360)),
              help="Angle of the tool above the horizontal, degrees.")  # fmt: skip
@click.option("--roll", type=NUMBER, help="Angle of the tool about its own axis, degrees.")
@click.option("--rpy", type=NUMBER, nargs=3, metavar="ROLL PITCH YAW", default=None,
              help="Orientation as Rz(yaw)·Ry(pitch)·Rx(roll), degrees: the nearest that the arm can take.",
              )  # fmt: skip
@click.option("--quaternion", type=NUMBER, nargs=4, metavar="W X Y Z", default=None,
              help="The same as a quaternion of any length.")  # fmt: skip
@click.option("--choose", type=click.Choice(CRITERIA), default="least-rotation", show_default=True,
              help="What the best solution is.")  # fmt: skip
@click.option("--start", metavar="Q1,Q2,…",
              help="Where the arm stands, degrees (default: home); for least-travel, and where a "
                   "search begins.")  # fmt: skip
@click.option("--step", type=Number(above=0.0), default=0.01, show_default=True,
              help="Step of the swept joint, degrees.")  # fmt: skip
@click.option("--all", "every", is_flag=True,
              help="List every solution, and the branches that limits forbid.")  # fmt: skip
@tool_option
@json_option
def ik(
    robot: str, x: float, y: float, z: float, pitch: float | None, roll: float | None,
    rpy: tuple[float, float, float] | None, quaternion: tuple[float, float, float, float] | None,
    choose: str, start: str | None, step: float, every: bool, tool: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Solve inverse kinematics: joint angles that put ROBOT's tool on X Y Z (mm)."""
    if rpy is not None and quaternion is not None:
        raise click.UsageError("give either --rpy or --quaternion, not both")
    if (rpy is not None or quaternion is not None) and (pitch is not None or roll is not None):
        given = "--quaternion" if rpy is None else "--rpy"
        raise click.UsageError(f"give either {given}, or --pitch and --roll, not both")
    if quaternion is not None and not any(quaternion):
        raise click.UsageError("--quaternion 0 0 0 0 is no orientation: give one of any other length")
    arm = load_with(robot, tool)
    point = np.array([x, y, z]) / 1000
    rotation = rotation_of(None if rpy is None else np.multiply(rpy, DEGREE), quaternion)
    pitch, roll = from_degrees(pitch), from_degrees(roll)
    wish = (pitch, roll, rotation)
    begin = _start(arm, start)
    solutions = arm.inverse(point, *wish, step=step * DEGREE, start=begin)
    refused = [branch for branch in arm.branches(point, *wish) if branch.forbidden] if every else None
    q = solutions.best(choose, begin) if solutions.success else None
    error_mm = 0.0 if q is None else 1000 * float(np.linalg.norm(arm.forward(q)[:3, 3] - point))
    if as_json:
        print_json(_record(arm, solutions, q, error_mm, refused))
    elif q is not None:
        _print(arm, solutions, q, error_mm, choose, refused)
    elif refused:
        _print_table(arm, [branch.name for branch in refused], _refused_rows(refused))
    if q is None:
        raise UnreachableError(solutions.refusal or solutions.explanation)
    if choose == "least-torque":
        click.echo(f"armctl: least-torque counts {arm.gravity.counted}", err=True)


def _start(arm: Robot, text: str | None) -> FloatArray:
    if text is None:
        return arm.pose("home")
    try:
        values = arm.chain.checked([float(part) for part in text.replace(",", " ").split()])
    except (ValueError, InputError) as cause:
        raise click.UsageError(f"--start needs {arm.n} finite numbers in degrees, got {text!r}") from cause
    return arm.read(values)


def _turned_deg(solutions: Solutions, q: FloatArray | None) -> float | None:
    """Angle between the orientation asked for and the one found; None where none was asked for."""
    if q is None or solutions.target.rotation is None:
        return None
    return to_degrees(float(solutions.residual_rad[solutions.index_of(q)]))


def _record(
    arm: Robot, solutions: Solutions, q: FloatArray | None, error_mm: float, refused: Sequence[Branch] | None
) -> dict[str, object]:
    nearest_m, nearest_q = solutions.nearest_m, solutions.nearest_q
    record: dict[str, object] = {
        "count": len(solutions),
        "best_deg": None if q is None else rounded(arm.shown(q)),
        "branch": None if q is None else solutions.branch_of(q),
        "error_mm": None if q is None else error_mm,
        "orientation_error_deg": _turned_deg(solutions, q),
        "reason": solutions.said("en"),
        "nearest_mm": None if nearest_m is None else rounded(1000 * nearest_m, 6),
        "complete": solutions.complete,
        "incomplete_reason": None if solutions.incomplete is None else say(solutions.incomplete, "en"),
    }
    if q is None:
        record["solutions_deg"] = []
        record["nearest_deg"] = None if nearest_q is None else rounded(arm.shown(nearest_q))
    elif refused is not None:
        record["solutions_deg"] = [rounded(row) for row in arm.shown(solutions.q)]
        record["branches"] = solutions.branch.tolist()
    if refused is not None:
        record["refused"] = [
            {
                "branch": branch.name,
                "deg": rounded(arm.shown(branch.q)),
                "why": "; ".join(say(need, "en") for need in branch.needs),
            }
            for branch in refused
        ]
    return record


_Row = tuple[str, FloatArray | str | None]
"""a name before angles (n,) [rad], a text, or the titles of the joints"""


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
    more = "" if solutions.complete else f"; {solutions.incomplete_reason}"
    click.echo(f"{len(solutions)} solution{'s' if many else ''} inside the limits{swept}{more}")
    rows: list[_Row] = [
        ("degrees", None),
        (choose, q),
        ("branch", solutions.branch_of(q)),
        ("position error", f"{error_mm:.2e} mm"),
    ]
    turned_deg = _turned_deg(solutions, q)
    if turned_deg is not None:
        rows.append(("orientation error", f"{turned_deg:.3f}°"))
    branches = solutions.branch.tolist()
    if refused is not None or 1 < len(solutions) <= _LISTED:
        rows += zip(branches, solutions.q, strict=True)
    names = [*branches, *(branch.name for branch in refused or ())]
    _print_table(arm, names, rows)
    if refused is None and len(solutions) > _LISTED:
        click.echo("(--all lists them)")
    if (turned_off := arm.turned_off(solutions, q)) is not None:
        click.echo(f"armctl: warning: {turned_off}", err=True)
    if refused:
        _print_table(arm, names, _refused_rows(refused))


def _refused_rows(refused: Sequence[Branch]) -> Iterable[_Row]:
    """The branches outside the limits, each with what it needs."""
    yield f"{len(refused)} branch{'es' if len(refused) != 1 else ''} refused", None
    for branch in refused:
        yield branch.name, branch.q
        yield "", "; ".join(branch.forbidden)


def _print_table(arm: Robot, names: Sequence[str], rows: Iterable[_Row]) -> None:
    """Columns as wide as the longest of ``names`` and of the joints' titles."""
    titles = [joint.title for joint in arm.joints]
    label, width = max(_LABEL, *map(len, names)), max(_NARROWEST, *map(len, titles)) + 2
    for name, value in rows:
        if value is None:
            text = "".join(f"{title:>{width}}" for title in titles)
        elif isinstance(value, str):
            text = f"  {value}"
        else:
            text = "".join(f"{angle + 0.0:{width}.3f}" for angle in np.round(arm.shown(value), 3))
        click.echo(f"{name:<{label}}{text}")


# ``armctl published``: every printed table, recomputed, with the differences.


_KEYS = ("what", "unit", "printed", "computed", "difference", "tolerance", "agrees")


@click.command()
@click.argument("robots", metavar="[ROBOT]...", nargs=-1, type=click.Choice(tuple(REPORTS)))
@json_option
def published(robots: tuple[str, ...], as_json: bool) -> int:
    """Recompute every printed table of the papers and show the differences (default: of all robots).

    Exit status 0 when every figure is reproduced within the print's rounding, else 1.
    """
    reports = [REPORTS[name]() for name in robots or REPORTS]
    if as_json:
        print_json([_report_record(report) for report in reports])
    else:
        click.echo("\n\n".join(map(_report_text, reports)))
    return DONE if all(report.agrees for report in reports) else REFUSED


def _report_record(report: Report) -> dict[str, object]:
    return {
        "robot": report.robot,
        "title": report.title,
        "agrees": report.agrees,
        "rows": [
            {key: getattr(one, key) for key in _KEYS}
            | {"computed": [round(value, 6) for value in one.computed]}
            for one in report.comparisons
        ],
        "errata": report.errata,
        "improvements": [asdict(one) for one in report.improvements],
    }


def _report_text(report: Report) -> str:
    lines = [f"{report.robot}: {report.title}"]
    for one in report.comparisons:
        printed, computed = (
            "  ".join(f"{value:9.{one.digits}f}" for value in values)
            for values in (one.printed, one.computed)
        )
        verdict = f"{'agrees' if one.agrees else 'DIFFERS'} (largest difference {one.difference:.1e})"
        lines += [
            f"  {one.what}",
            f"    printed   {printed}  {one.unit}",
            f"    computed  {computed}  {one.unit}   {verdict}",
        ]
    for one in report.improvements:
        lines += [
            f"  {one.what}",
            f"    paper     {one.paper:9.4g}  {one.unit}",
            f"    armctl    {one.armctl:9.4g}  {one.unit}",
        ]
    lines += [f"  erratum: {erratum}" for erratum in report.errata]
    agreeing = sum(one.agrees for one in report.comparisons)
    lines.append(f"  {agreeing} of {len(report.comparisons)} figures reproduced within the print's rounding")
    return "\n".join(lines)
