"""``armctl sheet``: a sheet of crosshairs to print, which the arm touches."""

from __future__ import annotations

from pathlib import Path

import click

from armctl.calibration import PAPERS_MM, Paper, touch_sheet
from armctl.calibration.sheet import WRITERS
from armctl.cli.options import ROBOT
from armctl.documents import not_written
from armctl.errors import CalibrationError
from armctl.robot import load_robot


@click.command()
@click.argument("robot", type=ROBOT)
@click.option("--paper", type=click.Choice(list(PAPERS_MM)), default="a4", show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path), help="FILE.pdf or FILE.svg (default: ROBOT-sheet.pdf)."
)
def sheet(robot: str, paper: Paper, out: Path | None) -> None:
    """Write a sheet of numbered crosshairs that ROBOT can touch, to be printed at 100 %.

    Touch them in the page (Calibration → Known points), or enter them as x_mm, y_mm, z_mm of a table for
    `armctl calibrate points --frame sheet`: the command prints their places.
    """
    arm = load_robot(robot)
    out = out or Path(f"{arm.name}-sheet.pdf")
    if (write := WRITERS.get(out.suffix.lower())) is None:
        raise CalibrationError(f"{out}: its name ends in {out.suffix!r}; give {' or '.join(WRITERS)}")
    made = touch_sheet(arm, paper)
    try:
        out.write_bytes(write(made))
    except OSError as cause:
        raise CalibrationError(not_written(out, cause)) from cause
    lies = f"; lay it on something flat, {made.raised}" if made.raised else ""
    click.echo(f"{out}: {len(made.points_m)} crosshairs{lies}; their places on the sheet [mm]")
    for number, (x, y, z) in enumerate((1000 * made.points_m).round(3).tolist(), 1):
        click.echo(f"{number:>4}   x {x:7.1f}   y {y:7.1f}   z {z:4.1f}")
