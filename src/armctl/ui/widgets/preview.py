"""The page's ghost as one screen uses it: shown until the arm stands there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.runtime import Snapshot
from armctl.ui.scene.ghost import Ghost

FloatArray = NDArray[np.float64]
_THERE = 1e-4


class Preview:
    """Shows where the arm would stand, until it does or another screen shows something."""

    def __init__(self, ghost: Ghost) -> None:
        self._ghost = ghost
        self._q: FloatArray | None = None

    @property
    def shown(self) -> bool:
        """Whether this screen's ghost is shown."""
        return self._q is not None and self._ghost.shown_by(self)

    @property
    def taken(self) -> bool:
        """Whether another screen shows something in place of what this one has shown last."""
        return self._q is not None and not self._ghost.shown_by(self)

    def show(self, q: FloatArray, present: FloatArray) -> None:
        """Show ``q`` (n,) [rad], unless the arm stands there now."""
        if _same(q, present):
            self.hide()
            return
        self._q = q.copy()
        self._ghost.show(q, self)

    def hide(self) -> None:
        """Show nothing, if it is this screen's ghost that is shown."""
        self._q = None
        self._ghost.hide(self)

    def refresh(self, snapshot: Snapshot) -> None:
        """Hide once the arm has come to the ghost."""
        if self._q is not None and _same(self._q, snapshot.q_command):
            self.hide()


def _same(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.abs(a - b).max() < _THERE)
