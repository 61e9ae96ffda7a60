"""A tab of your own: one button that turns the base to 10°, and the angle beside it."""

from __future__ import annotations

import numpy as np

from armctl.facts import Need
from armctl.protocol import MoveJoints, Snapshot
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml

ANGLE_DEG = 10.0


class TurnScreen:
    """Built once for each page that opens, from the page's session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.button = session.gui.add_button("Turn the base")
        self.text = LiveHtml(session.gui)
        session.needs(Need.HOLDING, self.button)
        session.on(self.button.on_click, self._on_click)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what changed; called ten times a second while the tab is open."""
        self.text.show(f"The base stands at {np.degrees(snapshot.q_command[0]):.1f}°.")

    async def _on_click(self) -> None:
        """A callback submits a command and waits for nothing. A refusal is shown by the session."""
        goal = self._session.snapshot.q_command.copy()
        goal[0] = np.radians(ANGLE_DEG)
        await self._session.submit(MoveJoints(goal))
