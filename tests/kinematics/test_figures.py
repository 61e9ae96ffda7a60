"""The figures of docs/kinematics.md are drawn by the product."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_every_figure_of_the_page_is_drawn(tmp_path: Path) -> None:
    script = runpy.run_path(str(DOCS / "figures.py"))
    script["main"](tmp_path)
    named = set(re.findall(r"\(pictures/([\w-]+\.svg)\)", (DOCS / "kinematics.md").read_text()))
    assert (
        named == {path.name for path in tmp_path.iterdir()} == {p.name for p in (DOCS / "pictures").iterdir()}
    )
