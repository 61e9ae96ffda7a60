"""``armctl published``: every printed table, recomputed, with the differences."""

from __future__ import annotations

import click

from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import json_option, print_json
from armctl.published import REPORTS, Report


@click.command()
@click.argument("robots", metavar="[ROBOT]...", nargs=-1, type=click.Choice(tuple(REPORTS)))
@json_option
def published(robots: tuple[str, ...], as_json: bool) -> int:
    """Recompute every printed table of the papers and show the differences (default: of all robots).

    Exit status 0 when every figure is reproduced within the print's rounding, else 1.
    """
    reports = [REPORTS[name]() for name in robots or REPORTS]
    if as_json:
        print_json([_record(report) for report in reports])
    else:
        for i, report in enumerate(reports):
            if i:
                click.echo()
            _print(report)
    return DONE if all(report.agrees for report in reports) else REFUSED


def _record(report: Report) -> dict[str, object]:
    return {
        "robot": report.robot,
        "title": report.title,
        "agrees": report.agrees,
        "rows": [
            {
                "what": one.what,
                "unit": one.unit,
                "printed": one.printed,
                "computed": [round(value, 6) for value in one.computed],
                "difference": one.difference,
                "tolerance": one.tolerance,
                "agrees": one.agrees,
            }
            for one in report.comparisons
        ],
        "errata": report.errata,
        "improvements": [
            {"what": one.what, "unit": one.unit, "paper": one.paper, "armctl": one.armctl}
            for one in report.improvements
        ],
    }


def _print(report: Report) -> None:
    click.echo(f"{report.robot}: {report.title}")
    for one in report.comparisons:
        printed = "  ".join(f"{value:9.{one.digits}f}" for value in one.printed)
        computed = "  ".join(f"{value:9.{one.digits}f}" for value in one.computed)
        verdict = "agrees" if one.agrees else "DIFFERS"
        click.echo(f"  {one.what}")
        click.echo(f"    printed   {printed}  {one.unit}")
        click.echo(
            f"    computed  {computed}  {one.unit}   {verdict} (largest difference {one.difference:.1e})"
        )
    for one in report.improvements:
        click.echo(f"  {one.what}")
        click.echo(f"    paper     {one.paper:9.4g}  {one.unit}")
        click.echo(f"    armctl    {one.armctl:9.4g}  {one.unit}")
    for erratum in report.errata:
        click.echo(f"  erratum: {erratum}")
    agreeing = sum(one.agrees for one in report.comparisons)
    click.echo(f"  {agreeing} of {len(report.comparisons)} figures reproduced within the print's rounding")
