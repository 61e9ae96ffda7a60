"""No code reads a sentence: what is known travels as data (``armctl.facts``)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import armctl

SOURCES = Path(armctl.__file__).parent
_READING = {
    *("partition", "rpartition", "split", "rsplit", "splitlines", "startswith", "endswith"),
    *("removeprefix", "removesuffix", "replace", "find", "rfind", "index", "rindex", "count"),
}
_PATTERNS = {"match", "fullmatch", "search", "sub", "findall", "finditer"}
"""of a regular expression: what they read is their last positional argument but ``count`` and ``flags``"""
_SENTENCES = {
    *("refusal", "cause", "error", "exc", "finding", "warning", "message"),
    *("failed", "failure", "reason", "why", "explanation", "sentence", "broken", "trouble", "goes_on"),
}
"""what is called so is an error, a finding or a sentence of one"""
_TELLING = {"cause", "warnings", "explanation", "errors", "what", "answer", "label", "title", "note", "mend"}
"""attributes that are sentences, or begin one"""
_LISTS = {"_what", "_kind", "_which", "_motion", "_choice", "choice", "_list", "_frame"}
"""what dropdowns are called: their labels are for people"""
KNOWN = {
    "documents.py": "before Python 3.14 tomllib tells the place of a mistake in words alone",
    "ui/guard/server.py": "websockets tells which of its handlers failed by the words of its log alone",
}
"""places that do, and why"""


class _Scope:
    """A function, or what is in none, and which of its names hold sentences."""

    def __init__(self, nodes: list[ast.AST]) -> None:
        self._held = set[str]()
        for one in nodes:
            if isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name):
                if self.is_sentence(one.value):
                    self._held.add(one.targets[0].id)
            elif isinstance(one, ast.NamedExpr) and self.is_sentence(one.value):
                self._held.add(one.target.id)

    def is_sentence(self, node: ast.expr) -> bool:
        """Whether an expression is something that is said to people."""
        match node:
            case ast.Call(func=ast.Name(id="say" | "what" | "state_words"), args=[_, *_]):
                return True
            case ast.Call(func=ast.Attribute(attr="getMessage")):
                return True
            case ast.Call(func=ast.Name(id="str"), args=[value]):
                return self.is_sentence(value)
            case ast.Attribute(value=ast.Attribute(attr=field), attr="value"):  # chosen from a list
                return field in _LISTS
            case ast.Attribute(attr=attr):
                return attr in _TELLING
            case ast.Name(id=name):
                return name in _SENTENCES or name in self._held
            case _:
                return False

    def reads(self, node: ast.AST) -> bool:
        """Whether a sentence is searched, cut or compared there."""
        match node:
            case ast.Call(func=ast.Attribute(value=value, attr=attr), args=[*_, last]):
                pattern = attr in _PATTERNS and any(map(self.is_sentence, (last, *node.args[-2:])))
                return pattern or (attr in _READING and self.is_sentence(value))
            case ast.Compare(left=left, ops=[ast.In() | ast.NotIn()], comparators=[value]):
                is_text = isinstance(left, ast.Constant | ast.JoinedStr | ast.Name | ast.Call)
                return is_text and self.is_sentence(value)
            case ast.Compare(left=left, ops=[ast.Eq() | ast.NotEq()], comparators=[right]):
                is_said = self.is_sentence(left), self.is_sentence(right)
                return all(is_said) or (any(is_said) and _is_long(right if is_said[0] else left))
            case _:
                return False


def _is_long(node: ast.expr) -> bool:
    """Whether it is a text of several words, which names nothing."""
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and " " in str(node.value))


def readings(code: str) -> Iterator[int]:
    """Lines on which a sentence is searched, cut or compared."""
    scopes: list[ast.AST] = [ast.parse(code)]
    for scope in scopes:  # grows by the functions that are found
        nodes = [scope]
        for node in nodes:
            for one in ast.iter_child_nodes(node):
                inner = isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)
                (scopes if inner else nodes).append(one)
        within = _Scope(nodes)
        yield from (getattr(node, "lineno", 0) for node in nodes if within.reads(node))


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
        "_SYNTAX.fullmatch(message)",
        're.sub("by page", "by you", snapshot.cause)',
        'def f(self):\n    chosen = self._frame.value\n    return chosen.removeprefix("axes of ")',
        'def f(self):\n    words = str(error)\n    if "home" in words: pass',
        'asked.title.replace("pitch kept", "pitch free")',
        "str(goes_on) != cause",
        'record.getMessage() == "connection handler failed"',
    ]
    assert all(list(readings(one)) for one in found), [one for one in found if not list(readings(one))]
    others = 'str(path).replace("a", "b"); name.startswith("x"); "a" in names; one == "off"'
    assert not list(readings(others))


def test_no_code_reads_a_sentence() -> None:
    places: dict[str, list[int]] = {}
    for file in SOURCES.rglob("*.py"):
        if lines := sorted(set(readings(file.read_text(encoding="utf-8")))):
            places[file.relative_to(SOURCES).as_posix()] = lines
    assert set(places) == set(KNOWN), places
