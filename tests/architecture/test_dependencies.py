"""What pyproject.toml declares is what is imported, and the pages of developers name files that are there."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions, version
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def imported() -> set[str]:
    """Top-level packages of others that a module of the package imports, at its top or later."""
    names: set[str] = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names.update(alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
                names.add(node.module.partition(".")[0])
    return names - sys.stdlib_module_names - {"armctl"}


def declared() -> set[str]:
    """Distributions in pyproject.toml, by their normalised names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {normalised(re.split(r"[^\w.-]", line)[0]) for line in project["dependencies"]}


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_what_is_imported_is_declared_and_what_is_declared_is_imported() -> None:
    owners = packages_distributions()
    used = {normalised(owners[package][0]) for package in imported()}
    assert used == declared()


PAGES = [ROOT / "ARCHITECTURE.md", *sorted((ROOT / "docs" / "decisions").glob("*.md"))]
MOST_WORDS = {"ARCHITECTURE.md": 2500}
"""so that a newcomer reads the page on the first day; of a decision: a page"""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_file_and_folder_that_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`([\w./-]+(?:\.py|/))`", text)
    assert page.name != "ARCHITECTURE.md" or len(named) > 30
    assert not [name for name in named if not any(path.endswith(f"/{name}") for path in there())]
    assert page.stem == "index" or len(text.split()) <= MOST_WORDS.get(page.name, 300)


@cache
def there() -> set[str]:
    """Files and folders, each with its whole path."""
    folders = [ROOT / name for name in ("docs", "robots", "src", "tests")]
    paths = [*folders, *(path for folder in folders for path in folder.rglob("*"))]
    return {f"/{path.relative_to(ROOT).as_posix()}{'/' if path.is_dir() else ''}" for path in paths}


INSIDES = {"viser", "websockets", "rich", "pyserial", "msgspec", "trimesh", "pycollada"}
"""of which armctl uses more than what is documented, or reads files of strangers with"""


def test_dependencies_whose_insides_are_used_have_an_upper_bound() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    lines = [*project["dependencies"], *(line for group in extras for line in group)]
    bounded = {re.split(r"[^\w-]", line)[0] for line in lines if re.search(r"==|<\d", line)}
    assert bounded >= INSIDES


def test_what_is_installed_is_within_the_bounds() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for line in project["dependencies"]:
        name = re.split(r"[^\w-]", line)[0]
        if (most := re.search(r"<(\d+(?:\.\d+)*)", line)) is not None:
            have = tuple(int(part) for part in version(name).split(".")[:3])
            assert have < tuple(int(part) for part in most[1].split(".")), line
