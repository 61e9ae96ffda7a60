"""Nobody in the runtime, and in what it says and hears, writes another object's attributes."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import armctl.protocol
import armctl.runtime

FILES = [
    file
    for package in (armctl.protocol, armctl.runtime)
    for file in sorted(Path(str(package.__file__)).parent.rglob("*.py"))
]


def foreign_writes(tree: ast.Module) -> Iterator[ast.Attribute]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or not isinstance(node.ctx, ast.Store | ast.Del):
            continue
        own = isinstance(node.value, ast.Name) and node.value.id == "self"
        if not own and node.attr != "__cause__":
            yield node


def test_a_class_that_owns_state_is_the_only_one_that_writes_it() -> None:
    found = [
        f"{file.name}:{node.lineno}: {ast.unparse(node)}"
        for file in FILES
        for node in foreign_writes(ast.parse(file.read_text("utf-8")))
    ]
    assert found == []


def test_only_the_core_changes_the_state() -> None:
    for file in FILES:
        calls = [n for n in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(n, ast.Attribute)]
        assert file.name in ("core.py", "state.py") or not any(
            n.attr in ("_enter", "__setattr__") for n in calls
        ), file
