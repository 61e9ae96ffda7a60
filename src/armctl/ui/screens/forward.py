"""The Forward screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import viser

from armctl.runtime import Snapshot

if TYPE_CHECKING:
    from armctl.ui.session import Session


class ForwardScreen:
    """Forward."""

    label: ClassVar[str] = "Forward"
    icon: ClassVar[viser.IconName | None] = None

    def __init__(self, session: Session) -> None:
        session.gui.add_markdown("Forward")

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
