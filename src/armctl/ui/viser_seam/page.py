"""viser's page as a text: where something can be put into it, and what our scripts and styles hold of it."""

from __future__ import annotations

import re
from importlib import resources

from armctl.errors import ServerError

_HERE = resources.files(__name__.rpartition(".")[0])
SCRIPT = _HERE.joinpath("seam.js").read_text("utf-8")
"""``armctlViser``: all that a script may ask of viser's page; it goes ahead of those that ask"""
CONSOLE_STYLE = _HERE.joinpath("console.css").read_text("utf-8")
"""what armctl changes of viser's looks in the console"""
FILE_STYLE = _HERE.joinpath("file.css").read_text("utf-8")
"""… and in a file that shows a motion"""
_ICON = re.compile(r'<link\s+rel="icon"[^>]*>')
_TITLE = "<title>Viser</title>"


def dressed(page: str, *, ahead: str, title: str, icon: str | None = None, behind: str = "") -> str:
    """The page of viser, with HTML ``ahead`` of its scripts and ``behind`` it all, a title and an icon.

    Holds: ``client/build/index.html`` has ``<head>``, ``</body>``, a link to its icon, and its title.
    """
    start, head, rest = page.partition("<head>")
    rest, end, tail = rest.rpartition("</body>")
    if not (head and end):
        raise ServerError("viser's page has no <head> and <body> to put anything into")
    if icon is not None:
        rest = _ICON.sub(lambda _: icon, rest, count=1)
    rest = rest.replace(_TITLE, f"<title>{title}</title>", 1)
    return "".join((start, head, ahead, rest, behind, end, tail))
