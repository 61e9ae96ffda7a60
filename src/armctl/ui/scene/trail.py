"""The path that the tool point has drawn."""

from __future__ import annotations

from collections import deque

import numpy as np
import viser
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_POINTS = 600
_SPACING_M = 0.002
_COLOR = (214, 51, 108)


class Trail:
    """Keeps the newest points, at least 2 mm apart, and draws them as one line."""

    def __init__(self, scene: viser.SceneApi, name: str = "/trail") -> None:
        self._scene, self._name = scene, name
        self._points: deque[FloatArray] = deque(maxlen=_POINTS)
        self._line: viser.LineSegmentsHandle | None = None
        self._stale = False

    def add(self, point: FloatArray) -> None:
        """Add a tool point (3,) [m], if it lies far enough from the last one."""
        if not self._points or np.linalg.norm(point - self._points[-1]) >= _SPACING_M:
            self._points.append(point.copy())
            self._stale = True

    def clear(self) -> None:
        """Forget all points."""
        self._points.clear()
        self._stale = True

    def draw(self) -> None:
        """Send the line, if it has changed."""
        if not self._stale:
            return
        self._stale = False
        if self._line is not None:
            self._line.remove()
            self._line = None
        if len(self._points) > 1:
            points = np.array(self._points)
            self._line = self._scene.add_line_segments(
                self._name, np.stack([points[:-1], points[1:]], axis=1), _COLOR,
                thickness=2.5, thickness_units="screen",
            )  # fmt: skip
