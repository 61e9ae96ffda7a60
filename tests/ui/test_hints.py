"""Hints are only where the page can show them."""

from __future__ import annotations

import ast
from pathlib import Path

import armctl.ui

_WITHOUT = {"add_button", "add_upload_button"}
"""viser's page shows no hint on these, whatever they are given: what has to be known there must be a line"""


def calls() -> list[tuple[str, ast.Call, str]]:
    """The method, the call, and where it is."""
    folder = Path(armctl.ui.__file__).parent
    return [
        (node.func.attr, node, f"{path.relative_to(folder)}:{node.lineno}")
        for path in sorted(folder.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]


def test_no_button_is_given_a_hint_that_nobody_would_see() -> None:
    buttons = [(call, where) for method, call, where in calls() if method in _WITHOUT]
    assert len(buttons) > 20
    hinted = [where for call, where in buttons if "hint" in {keyword.arg for keyword in call.keywords}]
    assert hinted == []
