"""The figures of the docs are drawn by the product, and those in the folder are of today."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The text of every figure, as armctl draws it now."""
    folder = tmp_path_factory.mktemp("figures")
    runpy.run_path(str(DOCS / "figures.py"))["main"](folder)
    return {path.name: path.read_text() for path in folder.iterdir()}


def fingerprint(svg: str) -> str:
    (found,) = re.findall("<dc:description>(.*?)</dc:description>", svg)
    return found


def test_every_figure_is_of_today(drawn: dict[str, str]) -> None:
    kept = {path.name: path.read_text() for path in (DOCS / "pictures").glob("*.svg")}
    assert drawn.keys() == kept.keys()
    stale = [name for name in drawn if fingerprint(drawn[name]) != fingerprint(kept[name])]
    assert not stale, f"draw them anew: python docs/figures.py: {stale}"


def test_every_figure_is_on_a_page(drawn: dict[str, str]) -> None:
    pages = "".join(path.read_text() for path in DOCS.rglob("*.md"))
    assert set(re.findall(r"pictures/([\w-]+\.svg)\)", pages)) == drawn.keys()
