"""The pages name the labels that the screens have, in sentences that a student can read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import armctl

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md"))
LABELLED = [
    *sorted((DOCS / "screens").glob("*.md")),
    DOCS / "first-hour.md",
    DOCS / "own-arm.md",
    *(DOCS / "classroom").glob("*.md"),
]
SOURCES = Path(armctl.__file__).parent
LABELS = "\n".join(
    path.read_text() for folder in ("ui", "program") for path in (SOURCES / folder).rglob("*.py")
)
LONGEST = 18
"""words a sentence, on average"""


def sentences(page: str) -> list[list[str]]:
    """The words of each sentence of a page's prose: no code, no tables, no headings."""
    text = re.sub(r"^ *```.*?^ *```|<!--.*?-->", "", page, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^(?: {4,}\S|\||#|:::).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"`[^`\n]*`", "it", text)
    text = re.sub(r"!?\[([^]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"^ *(?:[-*]|\d+\.) ", "\n\n", text, flags=re.MULTILINE)
    parts = [part for block in re.split(r"\n\s*\n", text) for part in re.split(r"[.:;?!](?=\s|\*|$)", block)]
    return [words for words in (re.findall(r"[\w'’-]+", part) for part in parts) if words]


@pytest.mark.parametrize("page", LABELLED, ids=lambda path: path.stem)
def test_every_bold_label_is_on_a_screen(page: Path) -> None:
    prose = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    labels = {part for bold in re.findall(r"\*\*([^*]+)\*\*", prose) for part in bold.split(" → ")}
    assert [label for label in sorted(labels) if f'"{label}' not in LABELS and not label.endswith(".")] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(DOCS)))
def test_sentences_are_short(page: Path) -> None:
    lengths = [len(words) for words in sentences(page.read_text())]
    assert sum(lengths) / len(lengths) <= LONGEST
