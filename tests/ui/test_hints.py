"""Hints are only where the page can show them."""

from __future__ import annotations

import ast
from pathlib import Path

import armctl.ui

_WITHOUT = {"add_button", "add_upload_button"}
"""viser's page shows no hint on these, whatever they are given: what has to be known there must be a line"""


def test_no_button_is_given_a_hint_that_nobody_would_see() -> None:
    trees = [ast.parse(path.read_text("utf-8")) for path in Path(armctl.ui.__file__).parent.rglob("*.py")]
    calls = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)]
    buttons = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr in _WITHOUT]
    assert len(buttons) > 20
    hinted = [ast.unparse(call) for call in buttons if "hint" in {keyword.arg for keyword in call.keywords}]
    assert hinted == []
