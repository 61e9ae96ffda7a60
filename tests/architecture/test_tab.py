"""A tab is a screen class and one line in the registry."""

from __future__ import annotations

import queue
from pathlib import Path

import numpy as np
import pytest
from examples.extending.tab import ANGLE_DEG, TurnScreen
from tests.browser.served_arm import served_arm
from tests.ui.guard_kit import PATIENCE_S, RawPage, uuid_of

from armctl.protocol import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs import TABS, Tab

BUILT: queue.Queue[WatchedScreen] = queue.Queue()


class WatchedScreen(TurnScreen):
    """The example, which tells the test what happens to it."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.drawn: queue.Queue[Snapshot] = queue.Queue()
        self.arrived: queue.Queue[None] = queue.Queue()
        BUILT.put(self)

    def refresh(self, snapshot: Snapshot) -> None:
        super().refresh(snapshot)
        self.drawn.put(snapshot)
        if np.isclose(snapshot.q_command[0], np.radians(ANGLE_DEG), atol=1e-9):
            self.arrived.put(None)


def test_a_tab_is_shown_drawn_and_acts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    toy = Tab("Toy", "tests.architecture.test_tab:WatchedScreen")
    monkeypatch.setattr("armctl.ui.page.TABS", (*TABS, toy))
    with served_arm(tmp_path) as served, RawPage(served.app.server.get_port()) as page:
        page.introduce()
        page.read_until(b"Toy")
        screen = BUILT.get(timeout=PATIENCE_S)
        assert np.allclose(screen.drawn.get(timeout=PATIENCE_S).q_command, served.robot.pose("home"))
        while screen.button.disabled:  # until the arm holds
            screen.drawn.get(timeout=PATIENCE_S)
        page.set(uuid_of(screen.button), True)
        screen.arrived.get(timeout=PATIENCE_S)
