"""The error report of a path: what was asked for, what the solver reaches, what was read back."""

from __future__ import annotations

from armctl.hardware import Source
from armctl.motion.error_report import ErrorReport
from armctl.motion.path_error import PathError
from armctl.ui.widgets.html_bits import fixed, heading, muted
from armctl.ui.widgets.text import table

POINT_ROWS = 15
_SMALL = 0.001
_MEANING = {
    Source.COMMANDED: "commanded by this computer, not measured",
    Source.TRANSMITTED: "transmitted by the board, not measured",
    Source.MEASURED: "measured by the arm's encoders",
}


def summary_html(name: str, meaning: str, report: ErrorReport) -> str:
    """MSE, RMSE and largest error of each coordinate."""
    rows = [
        ["MSE mm²", *(_figure(1e6 * value) for value in report.mse.tolist()), ""],
        ["RMSE mm", *(_figure(1e3 * value) for value in report.rmse.tolist()), ""],
        ["largest mm", *(_figure(1e3 * value) for value in report.largest.tolist())],
    ]
    rows[2].append(_figure(1e3 * float(report.distance.max())))
    return (
        heading(f"{name}: {len(report.desired)} points")
        + muted(meaning)
        + table(["", "x", "y", "z", "3D"], rows)
    )


def between_html(error: PathError, when: str) -> str:
    """How far the tool strays from the ideal line or arc between the points as well."""
    figures = [["largest mm", _figure(1e3 * error.largest)], ["RMS mm", _figure(1e3 * error.rms)]]
    return (
        heading("Off the ideal line or arc") + muted(f"Between the points, too: {when}.") + table([], figures)
    )


def applied_meaning(source: Source) -> str:
    """What the applied positions are."""
    return f"Where the path that was read back comes closest to each point: {_MEANING[source]}."


def points_html(report: ErrorReport, page: int, selected: int | None) -> str:
    """One page (from 0) of the points: desired, reached, distance; ``selected`` is the point to highlight."""
    first = page * POINT_ROWS
    rows = [
        [
            str(first + i + 1),
            *(fixed(1000 * value, 2) for value in desired),
            *(fixed(1000 * value, 2) for value in reached),
            _figure(1000 * distance),
        ]
        for i, (desired, reached, distance) in enumerate(
            zip(
                report.desired[first : first + POINT_ROWS].tolist(),
                report.reached[first : first + POINT_ROWS].tolist(),
                report.distance[first : first + POINT_ROWS].tolist(),
                strict=True,
            )
        )
    ]
    head = ["#", "x", "y", "z", "x got", "y got", "z got", "error"]
    marked = None if selected is None else selected - 1 - first
    return f"<div style='font-size:11px'>{table(head, rows, marked=marked, names=False)}</div>"


def _figure(value: float) -> str:
    """Millimetres with three decimals, or in powers of ten where those would all be zero."""
    if value == 0 or abs(value) >= _SMALL:
        return fixed(value, 3)
    return f"{value:.1e}".replace("-", "−")
