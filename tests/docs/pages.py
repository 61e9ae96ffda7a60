"""The pages that people read: their code blocks, links, headings and prose."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).parents[2]
_CALLOUT = re.compile(r"(!!!|\?\?\?\+?|===) .*")
_TITLE = re.compile(r'title="([^"]*)"')


class Block(NamedTuple):
    """A fenced block of code."""

    page: Path
    line: int
    language: str
    title: str
    """what stands above it on the site; empty: nothing"""
    text: str

    @property
    def place(self) -> str:
        """For a message."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def run(self, programs: Path, stand_ins: Mapping[str, str], folder: Path, **settings: str) -> str:
        """Carry out its commands in a folder; gives what they print.

        ``stand_ins``: scripts by the names of the programs that they take the place of; they are written
        into ``programs``. ``settings`` go into the environment.
        """
        programs.mkdir(exist_ok=True)
        for name, script in stand_ins.items():
            (programs / name).write_text(f"#!/bin/sh\n{script}\n")
            (programs / name).chmod(0o755)
        places = os.pathsep.join([str(programs), str(Path(sys.executable).parent), os.environ["PATH"]])
        done = subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", self.text],
            capture_output=True,
            text=True,
            cwd=folder,
            env=os.environ | settings | {"PATH": places},
            check=False,
        )
        assert done.returncode == 0, f"{self.place}: {done.stdout}{done.stderr}"
        return done.stdout


def reading_pages() -> list[Path]:
    """README, the docs and the list of examples: what a user reads."""
    return [ROOT / "README.md", ROOT / "examples" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def all_pages() -> list[Path]:
    """These, and what developers read."""
    return [
        *reading_pages(),
        *sorted(set(ROOT.glob("*.md")) - {ROOT / "README.md"}),
        ROOT / "firmware" / "README.md",
    ]


@cache
def tokens(page: Path) -> list[Token]:
    """A page as CommonMark with tables; what a callout or a tab of the site holds counts as plain text."""
    return (
        MarkdownIt("commonmark", {"html": True})
        .enable("table")
        .parse(_plain(page.read_text(encoding="utf-8")))
    )


def _plain(text: str) -> str:
    """Without front matter; the indented text of callouts and tabs moved to the margin, line by line."""
    lines, indents = text.splitlines(), list[int]()
    if lines and lines[0] == "---":
        end = lines.index("---", 1) + 1
        lines[:end] = [""] * end
    for number, line in enumerate(lines):
        own = len(line) - len(line.lstrip())
        while line.strip() and indents and own < indents[-1]:
            indents.pop()
        margin = indents[-1] if indents else 0
        lines[number] = line[margin:]
        if _CALLOUT.fullmatch(lines[number].strip()):
            indents.append(own + 4)
            lines[number] = ""
    return "\n".join(lines)


def blocks(page: Path) -> Iterator[Block]:
    """The fenced and indented blocks of a page; an indented one has no language."""
    for token in tokens(page):
        if token.type in ("fence", "code_block"):
            assert token.map is not None
            language, _, rest = token.info.strip().partition(" ")
            title = _TITLE.search(rest)
            yield Block(page, token.map[0] + 1, language, title[1] if title else "", token.content)


def headings(page: Path) -> Iterator[str]:
    """The text of each heading."""
    found = tokens(page)
    for number, token in enumerate(found):
        if token.type == "heading_open":
            yield _text(found[number + 1])


def anchors(page: Path) -> set[str]:
    """What may stand behind the ``#`` of a link to a page: as GitHub and as the site name its headings."""
    names: set[str] = set(
        re.findall(r'(?:id|name)="([^"]+)"|\{ *#([\w-]+)', page.read_text(encoding="utf-8"))
    )
    found = {one for pair in names for one in pair if one}
    for heading in headings(page):
        plain = heading.lower().strip()
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
        site = re.sub(r"[^\w\s-]", "", plain.encode("ascii", "ignore").decode()).strip()
        found.add(re.sub(r"[-\s]+", "-", site))
    return found


def targets(page: Path) -> Iterator[str]:
    """Where the links and pictures of a page lead."""
    for token in tokens(page):
        for child in token.children or ():
            if child.type == "link_open":
                yield str(child.attrs["href"])
            elif child.type == "image":
                yield str(child.attrs["src"])
        if token.type in ("html_block", "inline"):
            yield from re.findall(
                r'<(?:img|source|video|a)\b[^>]*?\b(?:src|srcset|href)="([^"]+)"', token.content
            )


def prose(page: Path) -> Iterator[str]:
    """The paragraphs and list items of a page, without headings, tables, code and pictures."""
    inside = list[str]()
    for token in tokens(page):
        if token.type in ("heading_open", "table_open"):
            inside.append(token.type)
        elif token.type in ("heading_close", "table_close"):
            inside.pop()
        elif token.type == "inline" and not inside and not token.content.startswith(":::"):
            yield _text(token)


def sentences(page: Path) -> Iterator[str]:
    """Its sentences; a paragraph or a list item ends one."""
    for paragraph in prose(page):
        for one in re.split(r"(?<=[.!?])[\")*]*\s+(?=\S)", paragraph):
            if re.search(r"\w", one):
                yield one.strip()


def _text(token: Token) -> str:
    """What a reader reads of it."""
    parts: list[str] = []
    for child in token.children or ():
        if child.type in ("softbreak", "hardbreak"):
            parts.append(" ")
        elif child.type in ("text", "code_inline"):
            parts.append(child.content)
    return "".join(parts)
