"""``armctl draw``: draw an SVG or G-code file with a pen on a touched plane."""

from __future__ import annotations

import re
from pathlib import Path

import click
import msgspec
import numpy as np

from armctl import log_files
from armctl.arm import Arm
from armctl.cli.main import DONE
from armctl.cli.options import (
    ROBOT,
    ends_like_ctrl_c,
    json_option,
    load_whole,
    port_option,
    pose_option,
    print_json,
    tool_option,
)
from armctl.documents import DocumentKind
from armctl.drawing import read_drawing
from armctl.drawing.plan import DrawingPlan
from armctl.errors import DrawingError
from armctl.facts import say
from armctl.facts.words import fact_record
from armctl.program import DrawStep, Program
from armctl.robot import Robot

PLANE_FILES = DocumentKind(DrawingError, most_bytes=64 * 1024)
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")


class _PlaneFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The points that were touched, in a file of their own."""

    points_mm: tuple[tuple[float, float, float], ...]


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--robot", type=ROBOT, required=True, help="The robot that draws.")
@click.option("--plane", help="Touched points 'x,y,z x,y,z x,y,z' [mm]: origin, to the right, upwards, "
              "then others; or a TOML file with points_mm.  [default: 30 mm high, in front]")  # fmt: skip
@click.option("--size-mm", type=click.FloatRange(min=0, min_open=True), help="Width of the drawing.")
@click.option("--speed-mm-s", type=click.FloatRange(min=0, min_open=True), default=30, show_default=True,
              help="Speed of the pen.")  # fmt: skip
@click.option("--lift-mm", type=click.FloatRange(min=0, min_open=True), default=10, show_default=True,
              help="How high the pen is between strokes.")  # fmt: skip
@click.option("--pitch", type=click.FloatRange(-90, 90), help="Pitch of the pen in degrees.  [default: "
              "straight onto the plane where the arm can]")  # fmt: skip
@click.option(
    "--fit", is_flag=True, help="Make the drawing smaller, and shift it, until all of it is in reach."
)
@click.option("--check", is_flag=True, help="Only say what would be drawn and how long it takes.")
@tool_option
@port_option
@pose_option
@json_option
def draw(
    file: Path,
    robot: str,
    plane: str | None,
    size_mm: float | None,
    speed_mm_s: float,
    lift_mm: float,
    pitch: float | None,
    fit: bool,
    check: bool,
    tool: str | None,
    port: str,
    pose: str | list[float] | None,
    as_json: bool,
) -> int:
    """Draw FILE (.svg or G-code) with a pen in the hand.

    What is out of reach is named before the pen moves, and left out. Nothing is measured while it draws: put
    the plane where the tip of the pen touches it, and begin with --check.
    """
    arm_robot = load_whole(robot, tool)
    points = _plane_in_front(arm_robot) if plane is None else _plane(plane)
    step = DrawStep(file=str(file.absolute()), plane_mm=tuple(points), width_mm=size_mm,
                    pen_speed_mm_s=speed_mm_s, lift_mm=lift_mm, pen_pitch_deg=pitch)  # fmt: skip
    step.check(arm_robot)
    start = arm_robot.first_pose
    if fit:
        step = step.fitted(arm_robot, start)
    plan = step.drawn(arm_robot, start)
    record = _record(file, step, plan)
    if as_json:
        print_json(record)
    else:
        _tell(file, record, plan)
    if check:
        return DONE
    program = Program(robot=arm_robot.name, name=file.stem, steps=(step,))
    with log_files.begin("draw"), ends_like_ctrl_c(), Arm.open(arm_robot, port) as arm:
        if tool is not None:
            arm.set_tool(tool)
        arm.enable(pose)
        arm.run(program)
    if not as_json:
        click.echo(f"done: {file.name}, {1000 * plan.drawn_m:.0f} mm drawn")
    return DONE


def _record(file: Path, step: DrawStep, plan: DrawingPlan) -> dict[str, object]:
    drawing = read_drawing(step.file)
    return {
        "file": str(file),
        "strokes": len(drawing.strokes),
        "drawn_mm": round(1000 * plan.drawn_m, 2),
        "duration_s": round(plan.trajectory.duration, 3),
        "width_mm": step.width_mm,
        "right_mm": step.right_mm,
        "up_mm": step.up_mm,
        "tilt_deg": round(float(np.rad2deg(plan.hold.tilt)), 3),
        "line_error_mm": round(1000 * plan.line_error_m, 4),
        "at_speed": round(plan.at_speed, 4),
        "not_drawn": list(drawing.left_out),
        "left_out": [{**fact_record(one.fact), "text": say(one.fact)} for one in plan.left_out],
    }


def _tell(file: Path, record: dict[str, object], plan: DrawingPlan) -> None:
    for text in read_drawing(file).left_out:
        click.echo(f"armctl: {file}: not drawn: {text}", err=True)
    for one in plan.left_out:
        click.echo(f"armctl: warning: {file}: {say(one.fact)}", err=True)
    tilt = "" if not record["tilt_deg"] else f", the pen tilted by {abs(plan.hold.tilt) * 180 / np.pi:.0f}°"
    strokes = "1 stroke" if record["strokes"] == 1 else f"{record['strokes']} strokes"
    click.echo(
        f"{file}: {strokes}, {1000 * plan.drawn_m:.0f} mm in "
        f"{plan.trajectory.duration:.1f} s{tilt}; the planned line is within "
        f"{1000 * plan.line_error_m:.2f} mm, {100 * plan.at_speed:.0f} % of it at speed"
    )


def _plane(text: str) -> list[float]:
    """The numbers of the points, from the command line or from a file."""
    if any(letter.isalpha() and letter not in "eE" for letter in text):
        path = Path(text)
        found = PLANE_FILES.load(path, lambda content: PLANE_FILES.parse(content).convert(_PlaneFile))
        return [value for point in found.points_mm for value in point]
    parts = re.split(r"[\s,;]+", text.strip())
    if not all(map(_NUMBER.fullmatch, parts)):
        raise click.UsageError(f"--plane {text!r}: give x,y,z of three points in mm, or a TOML file")
    return [float(part) for part in parts]


_AHEAD, _HIGH_MM = 0.36, 30.0
"""of the arm's length; above its floor"""


def _plane_in_front(robot: Robot) -> list[float]:
    """A level plane before the arm, the drawing upright as seen from its base."""
    x = 1000 * _AHEAD * robot.chain.length
    z = 1000 * max(robot.floor_z, -0.5) + _HIGH_MM
    return [x, 30.0, z, x, -70.0, z, x + 100.0, 30.0, z]
