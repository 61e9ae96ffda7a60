"""Where the arm was last known to stand: what is drawn while nobody knows where it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.hardware import Source
from armctl.robot import BoardKind
from armctl.runtime import Snapshot

FloatArray = NDArray[np.float64]


class LastKnown:
    """Keeps the newest angle that was known of each joint, once for all pages.

    A board that is lost does not move the arm: it must not seem to jump to where Enable would put it.
    """

    def __init__(self) -> None:
        self._q: FloatArray | None = None

    def note(self, snapshot: Snapshot) -> None:
        """Remember what is known now."""
        now = known(snapshot)
        self._q = now if self._q is None else np.where(np.isnan(now), self._q, now)

    def drawn(self, snapshot: Snapshot) -> FloatArray:
        """Joint angles (n,) [rad] to draw: as known now, else as last known, else where Enable leads to."""
        q = known(snapshot)
        if self._q is not None:
            q = np.where(np.isnan(q), self._q, q)
        return np.where(np.isnan(q), snapshot.q_command, q)

    def standing(self, snapshot: Snapshot) -> FloatArray:
        """Joint angles (n,) [rad] that the arm was told last; where it was told nothing: as it is drawn."""
        return snapshot.q_command if snapshot.commanded else self.drawn(snapshot)

    def remembers(self, snapshot: Snapshot) -> bool:
        """Whether what is drawn is not known now, but every joint was known once."""
        if not np.isnan(known(snapshot)).any():
            return False
        return self._q is not None and not np.isnan(self._q).any()

    def words(self, snapshot: Snapshot, board: BoardKind) -> str:
        """Where the position that is drawn comes from."""
        if not np.isnan(snapshot.q).any() and snapshot.board is not None:
            return snapshot.source.value
        if snapshot.commanded:
            return Source.COMMANDED.value
        homed = board == "encoder"
        if self.remembers(snapshot):
            return f"last known; unknown until the arm is {'homed' if homed else 'enabled'} again"
        if homed:
            return "unknown until the arm is homed; drawn where homing ends"
        return "unknown; drawn where Enable would put it"


def known(snapshot: Snapshot) -> FloatArray:
    """Joint angles (n,) [rad] as the board tells them, or as commanded; NaN where nobody knows."""
    if not snapshot.commanded:
        return snapshot.q
    return np.where(np.isnan(snapshot.q), snapshot.q_command, snapshot.q)
