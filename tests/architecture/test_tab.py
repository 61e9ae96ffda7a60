"""A tab is a screen class and one line in the registry."""

from __future__ import annotations

import asyncio
import queue
from pathlib import Path

import numpy as np
import pytest
from tests.browser.served_arm import served_arm
from tests.ui.guard_kit import PATIENCE_S, RawPage, uuid_of

from armctl.runtime import MoveJoints, Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs import TABS, Tab

BUILT: queue.Queue[ToyScreen] = queue.Queue()


class ToyScreen:
    """One button that moves the arm."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.drawn: queue.Queue[Snapshot] = queue.Queue()
        self.moved: queue.Queue[None] = queue.Queue()
        self.button = session.gui.add_button("Turn the base")
        session.on(self.button.on_click, self._on_click)
        BUILT.put(self)

    def refresh(self, snapshot: Snapshot) -> None:
        self.drawn.put(snapshot)

    async def _on_click(self) -> None:
        goal = self._session.snapshot.q_command.copy()
        goal[0] = 0.1
        ticket = await self._session.submit(MoveJoints(goal))
        await asyncio.wrap_future(ticket.finished)
        self.moved.put(None)


def test_a_tab_is_shown_drawn_and_acts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    toy = Tab("Toy", "tests.architecture.test_tab:ToyScreen")
    monkeypatch.setattr("armctl.ui.page.TABS", (*TABS, toy))
    with served_arm(tmp_path) as served, RawPage(served.app.server.get_port()) as page:
        page.introduce()
        page.read_until(b"Toy")
        screen = BUILT.get(timeout=PATIENCE_S)
        assert np.allclose(screen.drawn.get(timeout=PATIENCE_S).q_command, served.robot.pose("home"))
        page.set(uuid_of(screen.button), True)
        screen.moved.get(timeout=PATIENCE_S)
        assert served.now.q_command[0] == pytest.approx(0.1)
