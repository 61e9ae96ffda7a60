"""What a page is made of, as text: the widgets and words of each tab. Pictures are compared by it."""

from __future__ import annotations

import asyncio
import re
import tempfile
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import viser
from tests.browser.served_arm import served_arm
from tests.ui.guard_kit import RawPage

_CAUSE = re.compile("<div class='state.*?</div>")


def outlines(robot: str = "uzuner") -> dict[str, str]:
    """A line a widget for each tab, and what is around them, as a page of ``robot`` has them at first."""
    with (
        tempfile.TemporaryDirectory() as folder,
        served_arm(Path(folder), robot) as served,
        RawPage(served.app.server.get_port()) as raw,
    ):
        raw.operate()
        (page,) = served.app._pages.values()

        async def built() -> dict[str, str]:
            page.rebuild()  # and nothing is refreshed before it is read
            containers = page.client.gui._container_handle_from_uuid.values()
            tabs = [one for one in containers if isinstance(one, viser.GuiTabHandle)]
            page._always.refresh(page.session.snapshot)
            page.session.next.refresh(page.session.snapshot)
            parts = page.session.parts
            frame = _CAUSE.sub("", parts["bar"]) + parts["next"]
            return {"Control": _plain(frame)} | {tab._label: "\n".join(_outline(tab)) for tab in tabs}

        return asyncio.run_coroutine_threadsafe(built(), served.app.server.get_event_loop()).result(10)


def _outline(container: Any, depth: int = 1) -> Iterator[str]:
    for handle in container._children.values():
        words: tuple[str, ...] = ()
        inside: list[tuple[str, Any]] = []
        match handle:
            case viser.GuiHtmlHandle() | viser.GuiMarkdownHandle():
                words = (_plain(handle.content),)
            case viser.GuiButtonGroupHandle():
                words = (handle.label, *handle.options)
            case viser.GuiTabGroupHandle():
                inside = [(tab._label, tab) for tab in handle._tab_handles]
            case viser.GuiFolderHandle():
                inside = [(handle.label or "", handle)]
            case _:  # plots and progress bars have no label
                words = (getattr(handle, "label", ""),)
        for title, one in inside:
            yield f"{depth * '  '}{title}:"
            yield from _outline(one, depth + 1)
        if not inside and any(words):
            kind = type(handle).__name__.removeprefix("Gui").removesuffix("Handle")
            yield f"{depth * '  '}{kind} {' | '.join(words)}"


def _plain(html: str) -> str:
    """The words of it; figures may differ from day to day."""
    return re.sub(r"\d+", "#", " ".join(unescape(re.sub("<style.*?</style>|<[^>]*>", " ", html)).split()))
