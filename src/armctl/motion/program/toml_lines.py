"""On which line of a program's TOML text a step, or a key of it, stands."""

from __future__ import annotations

import re
from collections.abc import Iterator

_SKIPPED = (
    r'"""(?:\\.|[^\\])*?"""'  # strings may hold what looks like a header or a key
    r"|'''.*?'''"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'"
    r"|#[^\n]*"
)
_HEADER = r"^[ \t]*\[\[?[^\n]*"
_STEPS = re.compile(r"""[ \t]*\[\[[ \t]*(steps|"steps"|'steps')[ \t]*\]\]""")


def line_of(text: str, step: int | None, key: str | None) -> int | None:
    """Line, from 1, of a key; of the step's header where the key does not stand there.

    Args:
        text: valid TOML.
        step: index of the step; None: a key of the program itself.
        key: its name; None: the step as a whole.

    Returns:
        None where it cannot be told, e.g. for steps that are written as an array of inline tables.
    """
    begin, end = _region(text, step)
    if begin is None:
        return None
    found = None if key is None else _key(text, key, begin, end)
    if found is None:
        found = begin if step is not None else _table(text, key)
    return None if found is None else text.count("\n", 0, found) + 1


def _region(text: str, step: int | None) -> tuple[int | None, int]:
    """Where a step's header begins and where its table ends; with None, what stands before any table."""
    count = -1
    begin: int | None = 0 if step is None else None
    for match in _found(text, _HEADER, 0, len(text)):
        if begin is not None:
            return begin, match.start()
        if _STEPS.match(match.group()):
            count += 1
            if count == step:
                begin = match.start()
    return begin, len(text)


def _key(text: str, key: str, begin: int, end: int) -> int | None:
    name = re.escape(key)
    pattern = rf"""^[ \t]*(?:{name}|"{name}"|'{name}')[ \t]*="""
    return next((match.start() for match in _found(text, pattern, begin, end)), None)


def _table(text: str, key: str | None) -> int | None:
    """Header of a table of the program itself."""
    for match in _found(text, _HEADER, 0, len(text)):
        if match.group().strip(" \t[]").strip("\"'") == key:
            return match.start()
    return None


def _found(text: str, pattern: str, begin: int, end: int) -> Iterator[re.Match[str]]:
    """Matches of a pattern outside strings and comments."""
    scanner = re.compile(f"(?P<wanted>{pattern})|{_SKIPPED}", re.MULTILINE | re.DOTALL)
    for match in scanner.finditer(text, begin, end):
        if match.group("wanted") is not None:
            yield match
