"""One word, one meaning: a class name is defined once in the tree, and docs/words.md has each term once."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORDS = (ROOT / "docs" / "words.md").read_text(encoding="utf-8")
TWICE = {"Finding"}
"""of a motion, and of a board: both are what other people's code imports"""


def classes() -> Counter[str]:
    """How often each class name is defined."""
    found: Counter[str] = Counter()
    for path in (ROOT / "src").rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found.update(node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    return found


def test_a_class_name_is_defined_once() -> None:
    assert {name for name, times in classes().items() if times > 1} == TWICE


def test_the_dictionary_has_each_term_once_in_order_and_names_classes_that_are_there() -> None:
    terms = [term.lower() for term in re.findall(r"^- \*\*([^*]+)\*\*: ", WORDS, re.MULTILINE)]
    assert len(terms) == len(re.findall("^- ", WORDS, re.MULTILINE)) > 80
    assert terms == sorted(set(terms), key=lambda term: term.replace("-", ""))
    codes = " ".join(re.findall(r"`([^`]+)`", WORDS))
    named = set(re.findall(r"\b[A-Z][a-z]\w*", codes))
    assert named <= classes().keys()
