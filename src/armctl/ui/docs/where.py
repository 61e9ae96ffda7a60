"""Where a page of the documentation is: in the repository, on the published site, and in the console."""

from __future__ import annotations

import os
import re
from pathlib import PurePosixPath

from armctl.errors import DOCS, ArmctlError

DOCS_PATH = "/docs"
FROM_ELSEWHERE = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "CODE_OF_CONDUCT.md": "code-of-conduct.md",
    "SECURITY.md": "security.md",
    "examples/README.md": "examples.md",
    "firmware/README.md": "boards/encoder-firmware.md",
}
"""pages of the site that stand outside of docs/"""


def page_of(label: str) -> str:
    """The address, in the console, of the page about a tab or panel with this label."""
    return f"{DOCS_PATH}/screens/{label.lower()}/"


def page_of_error(error: ArmctlError) -> str:
    """The address, in the console, of the section that helps with an error; empty: there is none."""
    return f"{DOCS_PATH}/troubleshooting/#{error.section}" if error.section else ""


def placed(source: str) -> str:
    """The place on the site of a file of the repository, both as paths: ``docs/urdf.md`` as ``urdf.md``."""
    if source in FROM_ELSEWHERE:
        return FROM_ELSEWHERE[source]
    return source.removeprefix("docs/") if source.startswith("docs/") else f"source/{source}"


def source_of(place: str) -> str:
    """The file of the repository that is at a place on the site: the other way round."""
    elsewhere = {page: source for source, page in FROM_ELSEWHERE.items()}
    return elsewhere.get(place, f"docs/{place}")


def address_of(place: str) -> str:
    """The end of the address of a page or picture: ``screens/log.md`` as ``screens/log/``."""
    page, dot, ending = place.rpartition(".")
    if dot + ending != ".md":
        return place
    return "" if page == "index" else f"{page.removesuffix('/index')}/"


def led(link: str, source: str, served: frozenset[str]) -> str:
    """Where a link of a file leads that is shown in the console.

    ``served``: places of the site that the console serves. Other files are on the published site.
    """
    if re.match(r"[a-z]+:|#", link):
        return link
    to, mark, anchor = link.partition("#")
    place = placed(os.path.normpath(PurePosixPath(source).parent / to).replace(os.sep, "/"))
    base = f"{DOCS_PATH}/" if place in served else DOCS
    return f"{base}{address_of(place)}{mark}{anchor}"
