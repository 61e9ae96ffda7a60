"""``armctl published``: every printed table, recomputed, with the differences."""

from __future__ import annotations

from dataclasses import asdict

import click

from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import json_option, print_json
from armctl.published import REPORTS, Report

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
        print_json([_record(report) for report in reports])
    else:
        click.echo("\n\n".join(map(_text, reports)))
    return DONE if all(report.agrees for report in reports) else REFUSED


def _record(report: Report) -> dict[str, object]:
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


def _text(report: Report) -> str:
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
