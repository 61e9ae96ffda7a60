"""The section of the workspace as lines in the 3D view, in the plane that turns with the arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.kinematics import quaternion_wxyz

FloatArray = NDArray[np.float64]
_COLOR = (224, 49, 49)


class SectionLines:
    """One page's drawing of the section."""

    def __init__(self, scene: viser.SceneApi, name: str = "/section") -> None:
        self._scene, self._name = scene, name
        self._lines: viser.LineSegmentsHandle | None = None
        self._pose = np.eye(4)

    def show(self, outline: Sequence[FloatArray]) -> None:
        """Draw closed lines (k, 2), given in x and z of the plane [m]."""
        self.hide()
        if not outline:
            return
        ends = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in outline])
        segments = np.insert(ends, 1, 0.0, axis=2)
        self._lines = self._scene.add_line_segments(
            self._name, segments, _COLOR, thickness=2.5, thickness_units="screen"
        )
        self._place(self._lines)

    def place(self, T_base_plane: FloatArray) -> None:
        """Move the plane (4, 4), metres."""
        if not np.array_equal(T_base_plane, self._pose):
            self._pose = T_base_plane
            if self._lines is not None:
                self._place(self._lines)

    def hide(self) -> None:
        """Draw nothing."""
        if self._lines is not None:
            self._lines.remove()
            self._lines = None

    def _place(self, lines: viser.LineSegmentsHandle) -> None:
        lines.wxyz = quaternion_wxyz(self._pose[:3, :3])
        lines.position = self._pose[:3, 3]
