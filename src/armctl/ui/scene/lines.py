"""Lines in one page's view that are drawn anew: a tool path, a trail, an outline."""

from __future__ import annotations

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz

Rgb = tuple[int, int, int]


def segments(points: FloatArray) -> FloatArray:
    """The line segments (k - 1, 2, ...) between consecutive points (k, ...)."""
    return np.stack([points[:-1], points[1:]], axis=1)


class Lines:
    """Line segments under one name."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Rgb, thickness: float = 2.0) -> None:
        """Draw nothing yet; ``thickness`` in pixels."""
        self._scene, self._name = scene, name
        self._color, self._thickness = color, thickness
        self._handle: viser.LineSegmentsHandle | None = None
        self._pose: FloatArray | None = None

    def show(self, segments: FloatArray) -> None:
        """Draw line segments (k, 2, 3) [m] in place of those before."""
        if self._handle is not None and self._handle.points.shape == segments.shape:
            self._handle.points = segments.astype(np.float32)
            return
        self.hide()
        if len(segments):
            self._handle = self._scene.add_line_segments(
                self._name, segments, self._color, thickness=self._thickness, thickness_units="screen"
            )
            self._place()

    def hide(self) -> None:
        """Draw nothing."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None

    def set_visible(self, visible: bool) -> None:
        """Show or hide the lines; those drawn anew are shown."""
        if self._handle is not None:
            self._handle.visible = visible

    def place(self, T: FloatArray) -> None:
        """Move the lines to a pose (4, 4) in the base frame [m]."""
        if self._pose is None or not np.array_equal(T, self._pose):
            self._pose = T
            self._place()

    def _place(self) -> None:
        if self._handle is not None and self._pose is not None:
            self._handle.wxyz = quaternion_wxyz(self._pose[:3, :3])
            self._handle.position = self._pose[:3, 3]
