"""The path that the tool point has drawn: kept once for all pages, drawn by each page for itself."""

from __future__ import annotations

from collections import deque
from typing import Self

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.runtime import Snapshot
from armctl.ui.console import Console, known

FloatArray = NDArray[np.float64]
_POINTS = 600
_SPACING_M = 0.002
_COLOR = (214, 51, 108)


class Trail:
    """The newest tool points, at least 2 mm apart; no line goes over what nobody knows."""

    def __init__(self) -> None:
        self._points: deque[FloatArray] = deque(maxlen=_POINTS)
        self._count = 0

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Follow the arm from now on."""
        del before  # another arm, or one calibrated otherwise
        trail = cls()

        def follow(snapshot: Snapshot) -> None:
            if np.isnan(known(snapshot)).any():
                trail.lift()
            else:
                trail.add(console.robot.forward(console.last_known.drawn(snapshot))[:3, 3])

        console.frame_listeners.append(follow)
        return trail

    @property
    def count(self) -> int:
        """How many points were ever added."""
        return self._count

    def add(self, point: FloatArray) -> None:
        """Add a tool point (3,) [m], if it lies far enough from the last one."""
        if not self._points or not np.linalg.norm(point - self._points[-1]) < _SPACING_M:
            self._append(point)

    def lift(self) -> None:
        """Where the tool goes from here on is not known: the line ends, the next point begins another."""
        if self._points and not np.isnan(self._points[-1]).any():
            self._append(np.full(3, np.nan))

    def since(self, first: int) -> FloatArray:
        """Points (k, 3) [m] that are still kept, from the ``first``-th ever added on, oldest first.

        A row of NaN stands between two lines.
        """
        dropped = self._count - len(self._points)
        kept = list(self._points)[max(first - dropped, 0) :]
        return np.array(kept).reshape(-1, 3)

    def _append(self, point: FloatArray) -> None:
        self._points.append(point.copy())
        self._count += 1


class TrailLine:
    """One page's drawing of the trail."""

    def __init__(self, scene: viser.SceneApi, trail: Trail, name: str = "/trail") -> None:
        self._scene, self._name = scene, name
        self._trail = trail
        self._first = 0
        self._drawn = (-1, -1)
        self._line: viser.LineSegmentsHandle | None = None

    def show(self, visible: bool) -> None:
        """Show or hide the line."""
        if self._line is not None and self._line.visible != visible:
            self._line.visible = visible

    def clear(self) -> None:
        """Draw only what comes from now on."""
        self._first = self._trail.count

    def draw(self) -> None:
        """Send the line, if it has changed."""
        state = (self._trail.count, self._first)
        if state == self._drawn:
            return
        self._drawn = state
        points = self._trail.since(self._first)
        segments = np.stack([points[:-1], points[1:]], axis=1)
        segments = segments[~np.isnan(segments).any(axis=(1, 2))]
        if not len(segments):
            self._remove()
            return
        if self._line is None or self._line.points.shape != segments.shape:
            self._remove()
            self._line = self._scene.add_line_segments(
                self._name, segments, _COLOR, thickness=2.5, thickness_units="screen"
            )
        else:
            self._line.points = segments.astype(np.float32)

    def _remove(self) -> None:
        if self._line is not None:
            self._line.remove()
            self._line = None
