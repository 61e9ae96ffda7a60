"""The docs site is built without a warning, and its references say what armctl takes."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from armctl.arm import Arm
from armctl.cli.main import COMMANDS
from armctl.errors import DOCS
from armctl.facts.words import KINDS as FACTS
from armctl.handles import ArmControls
from armctl.program.steps import KINDS, all_keys
from armctl.robot import robots_folder

ROOT = Path(__file__).parents[2]
SITE = ROOT / "build" / "site"
BUILD = runpy.run_path(str(ROOT / "docs" / "build.py"))


def keys_in(table: Any) -> Iterator[str]:
    """The keys of a robot file, without the names of poses, points and joints."""
    if isinstance(table, list):
        for one in table:
            yield from keys_in(one)
    elif isinstance(table, dict):
        for key, value in table.items():
            yield key
            if key not in ("poses", "points", "follows"):
                yield from keys_in(value)


def text_of(page: str) -> str:
    """What a reader sees of a page of the site."""
    html = (SITE / page / "index.html").read_text(encoding="utf-8")
    return " ".join(unescape(re.sub(r"<[^>]*>", "", html)).split())


def test_the_site_is_built_and_its_references_are_complete() -> None:
    built = subprocess.run(
        [sys.executable, "docs/build.py"], cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert built.returncode == 0, built.stdout + built.stderr
    used = {
        key for path in robots_folder().glob("*.toml") for key in keys_in(tomllib.loads(path.read_text()))
    }
    tags = [str(kind.__struct_config__.tag) for kind in KINDS]
    calls = [
        f"{name}("
        for name, value in {**vars(ArmControls), **vars(Arm)}.items()
        if callable(value) and name[0] != "_"
    ]
    needed = {
        "reference/robot-file": used - {"kind"},
        "reference/program-file": [*tags, *(key.name for key in all_keys())],
        "reference/cli": [f"armctl {name} " for name in COMMANDS],
        "reference/python": calls,
        "words": [f"{name} " for name in FACTS.keys() - {"Reason"}],
    }
    texts = {page: text_of(page) for page in needed}
    missing = [f"{page}: {one}" for page, words in needed.items() for one in words if one not in texts[page]]
    assert missing == []
    assert f'<link rel="canonical" href="{DOCS}">' in (SITE / "index.html").read_text(encoding="utf-8")
    assert "<!-- generated" not in "".join(path.read_text() for path in SITE.rglob("*.html"))


@pytest.mark.parametrize(
    ("text", "becomes", "complaint"),
    [
        ("[a](safety.md#words)", "[a](../safety.md#words)", ""),
        ("![a](pictures/a.svg)", "![a](../pictures/a.svg)", ""),
        ("[a](../ARCHITECTURE.md)", "[a](../architecture.md)", ""),
        ("[![a](pictures/a.svg)](safety.md)", "[![a](../pictures/a.svg)](../safety.md)", ""),
        ("[a](../tests/conftest.py)", "[a](../source/tests/conftest.py)", ""),
        ("`[a](nowhere.md)` [b](https://a.b) [c](#d)", "`[a](nowhere.md)` [b](https://a.b) [c](#d)", ""),
        ("[a](nowhere.md)", None, "docs/urdf.md: the link nowhere.md leads to no file"),
        ("[a](../../etc/passwd)", None, "docs/urdf.md: the link ../../etc/passwd leads to no file"),
    ],
)
def test_links_lead_to_where_their_pages_are(text: str, becomes: str | None, complaint: str) -> None:
    placed = {
        "docs/safety.md": "safety.md",
        "docs/pictures/a.svg": "pictures/a.svg",
        "ARCHITECTURE.md": "architecture.md",
    }
    wrong: list[str] = []
    led = BUILD["links_of"](text, "docs/urdf.md", "reference/urdf.md", placed, wrong)
    assert becomes in (None, led)
    assert wrong == ([complaint] if complaint else [])


def test_a_page_that_the_navigation_leaves_out_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "repository"
    (root / "docs").mkdir(parents=True)
    (root / "docs" / "index.md").write_text("# Home\n")
    (root / "docs" / "lost.md").write_text("# Lost\n")
    (root / "mkdocs.yml").write_text("nav:\n  - Home: index.md\n  - Gone: gone.md\n")
    monkeypatch.setitem(BUILD["stage"].__globals__, "ROOT", root)
    with pytest.raises(BUILD["PagesError"]) as refused:
        BUILD["stage"](tmp_path / "staged")
    assert str(refused.value).splitlines() == [
        "mkdocs.yml: nav does not name lost.md",
        "mkdocs.yml: nav names gone.md, which is not there",
    ]
