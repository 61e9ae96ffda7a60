"""What the pre-flight found, as a list: when, where, what, and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from armctl.motion.preflight import Finding, Unchecked
from armctl.ui.widgets.html import ERROR, WARNING

_MOST = 12
_CHECKED = ("limits", "speeds", "floor", "self-collision", "singularity", "torque")
_MARK = {"error": ("✕ refused", ERROR), "warning": ("! warning", WARNING)}
_BLOCK = "margin:4px 0;padding:2px 0 2px 8px;border-left:3px solid "


def verdict_html(findings: Sequence[Finding], unknown: Sequence[Unchecked] = ()) -> str:
    """Findings as HTML, errors first, one block each; below them what is ``unknown`` (``not_checked``)."""
    if not findings:
        # What is not checked at all must not be told as checked in the line above it.
        left_out = {one.kind for one in unknown if one.kind == "torque"}
        checked = ", ".join(kind for kind in _CHECKED if kind not in left_out)
        summary = "<summary style='cursor:pointer'>Pre-flight: clear</summary>"
        verdict = f"<details style='opacity:.75'>{summary}Checked: {checked}.</details>"
    else:
        shown = sorted(findings, key=lambda finding: finding.severity != "error")
        verdict = _headline(findings) + "".join(_block(finding) for finding in shown[:_MOST])
        if len(shown) > _MOST:
            verdict += f"<div style='opacity:.75'>and {len(shown) - _MOST} more</div>"
    notes = "".join(f"<div style='opacity:.75'>Not checked: {escape(one.text)}.</div>" for one in unknown)
    return verdict + notes


def first_error(findings: Sequence[Finding]) -> str | None:
    """What keeps a program from being run, in one line: step and reason; None: nothing."""
    errors = [finding for finding in findings if finding.severity == "error"]
    if not errors:
        return None
    more = f" (and {len(errors) - 1} more, see the list)" if len(errors) > 1 else ""
    return f"{errors[0]}{more}"


def _headline(findings: Sequence[Finding]) -> str:
    errors = sum(finding.severity == "error" for finding in findings)
    words = (("error", errors), ("warning", len(findings) - errors))
    counts = " and ".join(f"{count} {word}{'s' if count > 1 else ''}" for word, count in words if count)
    verdict = "refused" if errors else "may be run"
    return f"<div style='font-weight:600'>Pre-flight: {verdict}, {counts}</div>"


def _block(finding: Finding) -> str:
    mark, color = _MARK[finding.severity]
    place: list[str] = []
    if finding.step is not None:
        place.append(f"step {finding.step + 1}")
    if finding.time is not None:
        place.append(f"{finding.time:.2f} s")
    if finding.part:
        place.append(finding.part)
    head = f"<b style='color:{color}'>{mark}</b> {escape(' · '.join(place))}"
    mend = f"<div style='opacity:.8'>→ {escape(finding.mend)}</div>" if finding.mend else ""
    return f"<div style='{_BLOCK}{color}'><div>{head}</div><div>{escape(finding.what)}</div>{mend}</div>"
