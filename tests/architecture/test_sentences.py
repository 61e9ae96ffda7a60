"""No code reads a sentence: what is known travels as data (``armctl.facts``)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import armctl

SOURCES = Path(armctl.__file__).parent
_READING = {
    *("partition", "rpartition", "split", "startswith", "endswith", "removeprefix", "removesuffix"),
    *("replace", "find", "index", "count"),
}
_SENTENCES = {
    *("refusal", "cause", "error", "exc", "finding", "warning", "message"),
    *("failed", "failure", "reason", "why", "explanation"),
}
"""what is called so is an error, a finding or a sentence of one"""
_LISTS = {"_what", "_kind", "_which", "_motion", "_choice", "choice", "_list"}
"""what dropdowns are called: their labels are for people"""
KNOWN = {
    "decoding.py": "msgspec tells what is wrong with a document in words alone",
    "protocol/snapshot.py": "whether the cause of a state tells a warning already",
}
"""places that do, and why"""


def _is_sentence(node: ast.expr) -> bool:
    if (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in ("str", "say", "what")
    ):
        return any(isinstance(one, ast.Name) and one.id in _SENTENCES for one in node.args)
    if isinstance(node, ast.Attribute) and node.attr == "value":  # the label that is chosen from a list
        return isinstance(node.value, ast.Attribute) and node.value.attr in _LISTS
    if isinstance(node, ast.Attribute):
        return node.attr in ("cause", "warnings", "explanation", "errors", "what", "answer")
    return isinstance(node, ast.Name) and node.id in _SENTENCES


def readings(code: str) -> Iterator[int]:
    """Lines on which a sentence is searched, cut or compared."""
    for node in ast.walk(ast.parse(code)):
        match node:
            case ast.Call(func=ast.Attribute(value=value, attr=attr), args=[_, *_]) if attr in _READING:
                if _is_sentence(value):
                    yield node.lineno
            case ast.Compare(left=ast.Constant(value=str()), comparators=[value]) if _is_sentence(value):
                yield node.lineno
            case ast.Compare(ops=[ast.In() | ast.NotIn()], comparators=[value]) if _is_sentence(value):
                yield node.lineno
            case _:
                pass


def test_the_search_finds_what_it_is_for() -> None:
    found = [
        'str(refusal).replace("a", "b")',
        '"home again" in str(error)',
        'cause.partition("; ")',
        'one.what.partition(" ")[0]',
        'snapshot.cause.startswith("stopped")',
        "text not in self.cause",
        '"home again" in failed',
        'self._what.value.removeprefix("go to ")',
        'str(refusal).replace(f"{place}/", "").replace(str(place), name)',
    ]
    assert all(list(readings(one)) for one in found)
    assert not list(readings('str(path).replace("a", "b"); name.startswith("x"); "a" in names'))


def test_no_code_reads_a_sentence() -> None:
    places: dict[str, list[int]] = {}
    for file in SOURCES.rglob("*.py"):
        if lines := sorted(set(readings(file.read_text(encoding="utf-8")))):
            places[file.relative_to(SOURCES).as_posix()] = lines
    assert set(places) == set(KNOWN), places
