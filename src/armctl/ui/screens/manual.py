"""The Manual screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import viser

from armctl.runtime import Snapshot

if TYPE_CHECKING:
    from armctl.ui.session import Session


class ManualScreen:
    """Manual."""

    label: ClassVar[str] = "Manual"
    icon: ClassVar[viser.IconName | None] = None

    def __init__(self, session: Session) -> None:
        session.gui.add_markdown("Manual")

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
