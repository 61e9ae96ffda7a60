"""Builds the docs site: ``python docs/build.py [--serve]``, or ``make docs``.

The pages of ``docs/`` and some other Markdown files are staged into ``build/docs``. On the way the tables of
the references are made from armctl itself, and links are led to where their pages are on the site.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from armctl.cli.main import cli
from armctl.cli.reference import commands
from armctl.ui.docs.tables import TABLES
from armctl.ui.docs.where import FROM_ELSEWHERE

ROOT = Path(__file__).resolve().parents[1]


class PagesError(Exception):
    """Something in the pages that has to be mended before the site is built."""


GENERATED: Mapping[str, Callable[[], str]] = {**TABLES, "commands": lambda: commands(cli), "docstrings": str}
"""what stands in a page for a line that ends with ``<!-- generated: NAME -->``

The line itself tells those who read the file alone where to see it. Docstrings come out of ``:::``.
"""


_LINK = re.compile(r"(?P<code>^ *```.*?^ *```|`[^`\n]*`)|\]\((?P<to>[^)\s]+)\)", re.M | re.S)


def links_of(text: str, source: str, page: str, placed: dict[str, str], wrong: list[str]) -> str:
    """A page's text with its links as they are on the site.

    ``source`` is the page's path in the repository, ``page`` the one on the site. ``placed`` gives the second
    for the first; other files that are linked are added. A link that leads nowhere is ``wrong``.
    """

    def led(found: re.Match[str]) -> str:
        if found["code"] or re.match(r"[a-z]+:|#", found["to"]):
            return found[0]
        to, mark, anchor = found["to"].partition("#")
        target = os.path.normpath(PurePosixPath(source).parent / to)
        if target.startswith("..") or not (target in placed or (ROOT / target).is_file()):
            wrong.append(f"{source}: the link {found['to']} leads to no file")
        there = placed.setdefault(target, f"source/{target}")
        return f"]({os.path.relpath(there, PurePosixPath(page).parent)}{mark}{anchor})"

    return _LINK.sub(led, text)


def stage(folder: Path) -> None:
    """Write all pages into a folder; raises ``PagesError`` with everything that has to be mended."""
    docs = ROOT / "docs"
    files = [path for path in docs.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")]
    placed = {str(path.relative_to(ROOT)): str(path.relative_to(docs)) for path in files}
    placed |= {source: page for source, page in FROM_ELSEWHERE.items() if (ROOT / source).exists()}
    pages = {source: page for source, page in placed.items() if page.endswith(".md")}
    texts: dict[str, str] = {}
    wrong: list[str] = []
    for source, page in pages.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        text = re.sub(r"(?m)^.*<!-- generated: ([\w-]+) -->$", lambda found: GENERATED[found[1]](), text)
        texts[page] = links_of(text, source, page, placed, wrong)
    shown = set(_pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    wrong += [f"mkdocs.yml: nav does not name {page}" for page in sorted(texts.keys() - shown)]
    wrong += [f"mkdocs.yml: nav names {page}, which is not there" for page in sorted(shown - texts.keys())]
    if wrong:
        raise PagesError("\n".join(wrong))
    shutil.rmtree(folder, ignore_errors=True)
    for source, page in placed.items():
        target = folder / page
        target.parent.mkdir(parents=True, exist_ok=True)
        if page in texts:
            target.write_text(texts[page], encoding="utf-8")
        else:
            shutil.copy(ROOT / source, target)


def _pages(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    else:
        for one in nav.values() if isinstance(nav, dict) else nav:
            yield from _pages(one)


def main(arguments: list[str]) -> int:
    """Stage the pages, and build or serve the site; the exit status."""
    try:
        stage(ROOT / "build" / "docs")
    except PagesError as wrong:
        print(wrong, file=sys.stderr)
        return 1
    program = Path(sys.executable).with_name("zensical")
    os.chdir(ROOT)
    if "--serve" in arguments:
        os.execv(program, [program, "serve"])
    return subprocess.run([program, "build", "--strict", "--clean"], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
