"""``armctl twin``: a program as a page that plays it, for a mail or a bug report."""

from __future__ import annotations

from pathlib import Path

import click

from armctl.cli.check import check_on_terminal
from armctl.cli.main import DONE, REFUSED
from armctl.cli.opening import load_whole
from armctl.cli.options import ROBOT
from armctl.documents import not_written, write_atomically
from armctl.errors import InputError
from armctl.program import open_program


@click.command()
@click.argument("program", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="The file to write, e.g. pick.html.",
)
@click.option("--robot", type=ROBOT, help="The robot (default: the one that the program names).")
def twin(program: Path, output: Path, robot: str | None) -> int:
    """Write PROGRAM as one HTML file that plays it: arm, graphs, and what the pre-flight found.

    The file opens in any browser, without armctl and without a network. No arm is driven. The program
    begins where 'armctl run' begins it: where the servos start.
    """
    from armctl.ui.twin_file import planned_for_file, program_file

    if not output.is_dir() and output.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(f"--output {output}: the file is a web page; let its name end in .html")

    given = None if robot is None else load_whole(robot)
    loaded = open_program(program, given)
    arm = given or load_whole(loaded.robot)
    plan = planned_for_file(arm, loaded, arm.first_pose, None)
    findings = check_on_terminal(loaded, arm)
    page = program_file(arm, loaded, plan, findings).encode()
    try:
        write_atomically(output, page)
    except OSError as cause:
        raise InputError(not_written(output, cause)) from cause
    errors = [finding for finding in findings if finding.severity == "error"]
    for finding in findings:
        click.echo(f"armctl: {'' if finding in errors else 'warning: '}{program}: {finding}", err=True)
    end = "" if plan.broken is None else f", as far as step {plan.broken.index}"
    click.echo(f"{output}: {loaded.name}{end}, {plan.duration:.1f} s, {len(page) / 1e6:.2f} MB")
    return REFUSED if errors or plan.broken else DONE
