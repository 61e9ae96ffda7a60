"""What the pre-flight found, as a list: when, where, what, and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from armctl.motion.preflight import Finding
from armctl.motion.program_check import ProgramFinding

_MOST = 12
_CLEAR = "Pre-flight: clear (limits, speeds, floor, self-collision, singularity, torque checked)"
_MARK = {
    "error": ("✕ refused", "#c92a2a"),
    "warning": ("! warning", "#a65b00"),
}
_CELL = "padding:2px 6px;text-align:left;vertical-align:top"


def verdict_html(findings: Sequence[Finding | ProgramFinding], unknown: Sequence[str] = ()) -> str:
    """A table of findings, errors first; one line where there are none.

    Args:
        findings: of a motion or of a program.
        unknown: what could not be checked (``not_checked``), told below.

    Returns:
        HTML; all texts are escaped.
    """
    if not findings:
        verdict = f"<div style='opacity:.75'>{escape(_CLEAR)}</div>"
    else:
        shown = sorted(findings, key=lambda finding: finding.severity != "error")
        rows = "".join(_row(finding) for finding in shown[:_MOST])
        verdict = (
            f"{_headline(findings)}<table style='border-collapse:collapse;width:100%'>{_head()}{rows}</table>"
        )
        if len(shown) > _MOST:
            verdict += f"<div style='opacity:.75'>and {len(shown) - _MOST} more</div>"
    notes = "".join(f"<div style='opacity:.75'>Not checked: {escape(text)}.</div>" for text in unknown)
    return verdict + notes


def _headline(findings: Sequence[Finding | ProgramFinding]) -> str:
    errors = sum(finding.severity == "error" for finding in findings)
    warnings = len(findings) - errors
    counts = [
        f"{count} {word}{'s' if count > 1 else ''}"
        for count, word in ((errors, "error"), (warnings, "warning"))
        if count
    ]
    verdict = "refused" if errors else "may be run"
    return f"<div style='font-weight:600'>Pre-flight: {verdict}, {' and '.join(counts)}</div>"


def _head() -> str:
    heads = ("", "When", "Where", "What", "How to mend it")
    cells = "".join(f"<th style='{_CELL};font-weight:500'>{text}</th>" for text in heads)
    return f"<tr style='opacity:.7'>{cells}</tr>"


def _row(finding: Finding | ProgramFinding) -> str:
    mark, color = _MARK[finding.severity]
    when = "" if finding.time is None else f"{finding.time:.2f} s"
    if isinstance(finding, ProgramFinding) and finding.step is not None:
        when = f"step {finding.step + 1}{', ' if when else ''}{when}"
    cells = [
        f"<td style='{_CELL};color:{color};font-weight:600;white-space:nowrap'>{mark}</td>",
        f"<td style='{_CELL};white-space:nowrap'>{escape(when)}</td>",
        *(f"<td style='{_CELL}'>{escape(text)}</td>" for text in (finding.part, finding.what, finding.mend)),
    ]
    return f"<tr style='border-top:1px solid rgba(128,128,128,.2)'>{''.join(cells)}</tr>"
