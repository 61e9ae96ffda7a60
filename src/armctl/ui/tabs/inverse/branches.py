"""The Branches tab of the Inverse screen: a table, and every branch as a coloured ghost."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from armctl.ui.scene.ghost import BranchGhosts, GhostMark
from armctl.ui.session import Session
from armctl.ui.tabs.inverse.answer import Answer, Verdict, standing_alike, verdicts_html
from armctl.ui.widgets.html import LiveHtml, muted

_MOST_GHOSTS = 8
_LEGEND = "In the 3D view green is the branch of least energy, blue is possible, red is refused."
_CHOSEN, _POSSIBLE, _REFUSED = (47, 158, 68), (34, 139, 230), (224, 49, 49)


class BranchView:
    """Shows the branches of the newest answer; the ghosts only while they are asked for."""

    def __init__(self, session: Session, toggled: Callable[[], None]) -> None:
        """Build the tab; ``toggled`` is called when the ghosts come or go."""
        self._toggled = toggled
        gui = session.gui
        self._robot = session.console.robot
        self._ghosts = BranchGhosts(session.client.scene, self._robot)
        self._ghost = session.ghost
        self._found: tuple[Verdict, ...] = ()
        self._show = gui.add_checkbox("Show as ghosts", initial_value=False)
        self._legend = LiveHtml(gui, muted(_LEGEND))  # no hint: it would lie over the Go button above
        self._legend.visible = False
        self._table = LiveHtml(gui, muted("Nothing is solved yet."))
        session.on(self._show.on_update, self._on_show)

    @property
    def as_ghosts(self) -> bool:
        """Whether the branches are in the 3D view now."""
        return self._show.value and bool(self._found)

    def show(self, found: Answer) -> None:
        """Show the branches of an answer."""
        self._found = found.verdicts
        self._legend.visible = bool(found.verdicts)
        self._table.show(verdicts_html(self._robot, found.verdicts, found.table))
        self._draw()

    async def _on_show(self) -> None:
        self._draw()
        self._toggled()

    def _give_up(self) -> None:
        """Another screen shows something: the branches leave the view."""
        self._show.value = False
        self._ghosts.hide()

    def _draw(self) -> None:
        shown = self._found[:_MOST_GHOSTS] if self._show.value else ()
        if shown:
            self._ghost.claim(self, self._give_up)
        self._ghosts.show([_mark(alike) for alike in standing_alike(self._robot, shown)])


def _mark(alike: Sequence[Verdict]) -> GhostMark:
    """One ghost for branches that look the same, in the colour of the best of them."""
    best = min(alike, key=lambda one: (bool(one.refused), not one.chosen))
    color = _REFUSED if best.refused else _CHOSEN if best.chosen else _POSSIBLE
    return GhostMark(best.branch.q, color, ", ".join(one.label for one in alike))
