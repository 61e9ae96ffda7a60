"""The pages name the labels that the screens have."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import armctl
from armctl.robot.look.rows import MAKES
from armctl.ui.tabs import PROGRAM, TABS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LABELLED = [
    *sorted((DOCS / "screens").glob("*.md")),
    *sorted((DOCS / "boards").glob("*.md")),
    DOCS / "first-hour.md",
    DOCS / "own-arm.md",
    DOCS / "troubleshooting.md",
    *sorted((DOCS / "classroom").glob("*.md")),
]
SOURCES = Path(armctl.__file__).parent
LABELS = "\n".join(
    path.read_text() for folder in ("ui", "program") for path in (SOURCES / folder).rglob("*.py")
)
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
PANELS = {"Control", PROGRAM.label, *(tab.label for tab in TABS)}
"""where a path of labels begins"""


def prose(page: Path) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)


def not_on_a_screen(marked: list[str]) -> list[str]:
    labels = {part for text in marked for part in " ".join(text.split()).split(" → ")}
    return [label for label in sorted(labels) if f'"{label}"' not in LABELS and not label.endswith(".")]


@pytest.mark.parametrize("page", LABELLED, ids=lambda path: path.stem)
def test_every_bold_label_is_on_a_screen(page: Path) -> None:
    assert not_on_a_screen(re.findall(r"\*\*([^*]+)\*\*", prose(page))) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_every_path_of_labels_leads_to_a_screen(page: Path) -> None:
    """Like *Main → Your own arm*; other italics are messages, emphasis or other programs."""
    marked = re.findall(r"(?<!\*)\*([^*\n]+ → [^*]+)\*(?!\*)", prose(page))
    assert not_on_a_screen([path for path in marked if path.split(" → ")[0] in PANELS]) == []


def test_the_table_of_motors_has_their_sizes() -> None:
    number = r"([\d.]+)"
    line = rf"^\| `(\w+)` \| [^|]+ \| {number} × {number} × {number} \| {number} \| {number} \| {number} \|$"
    told = re.findall(line, (DOCS / "looks.md").read_text(), re.MULTILINE)
    assert {name: list(map(float, sizes)) for name, *sizes in told} == {
        name: pytest.approx([*make.case, make.shaft, make.horn[1], 1000 * make.mass_kg])
        for name, make in MAKES.items()
    }
