"""The Simulation screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import viser

from armctl.runtime import Snapshot

if TYPE_CHECKING:
    from armctl.ui.session import Session


class SimulationScreen:
    """Simulation."""

    label: ClassVar[str] = "Simulation"
    icon: ClassVar[viser.IconName | None] = None

    def __init__(self, session: Session) -> None:
        session.gui.add_markdown("Simulation")

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
