"""A report goes into public bug trackers: what names a person or a computer stays out of it."""

from __future__ import annotations

import re

_SHORTEST = 3
"""a shorter name is part of too many words; it also tells little"""
_TELLS_NOTHING = frozenset({"localhost", "root", "user", "armctl"})


def without_personal_data(text: str, home: str, host: str, user: str) -> str:
    """``text`` with the home folder as ``~`` and without the names of computer and user.

    Args:
        text: the report.
        home: the user's home folder.
        host: the computer's name, with or without its domain.
        user: the user's login name.
    """
    if len(home) > 1:
        text = re.sub(rf"{re.escape(home.rstrip('/'))}(?![\w-])", "~", text)
    for name, stands_for in ((host, "<host>"), (host.partition(".")[0], "<host>"), (user, "<user>")):
        if len(name) >= _SHORTEST and name not in _TELLS_NOTHING:
            text = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", stands_for, text)
    return text
