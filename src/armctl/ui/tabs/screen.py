"""What a screen is."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

import viser

from armctl.runtime import Snapshot

if TYPE_CHECKING:
    from armctl.ui.session import Session


class Screen(Protocol):
    """One tab of a page: built once inside its tab, then drawn again and again."""

    label: ClassVar[str]
    icon: ClassVar[viser.IconName | None]

    def __init__(self, session: Session) -> None:
        """Build the widgets in the present GUI container."""
        ...

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot; called about ten times a second, so it writes only what has changed."""
        ...
