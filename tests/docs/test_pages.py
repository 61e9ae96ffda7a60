"""The pages name the labels that the screens have."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import armctl

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
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


@pytest.mark.parametrize("page", LABELLED, ids=lambda path: path.stem)
def test_every_bold_label_is_on_a_screen(page: Path) -> None:
    prose = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    labels = {part for bold in re.findall(r"\*\*([^*]+)\*\*", prose) for part in bold.split(" → ")}
    assert [label for label in sorted(labels) if f'"{label}' not in LABELS and not label.endswith(".")] == []
