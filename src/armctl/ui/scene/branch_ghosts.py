"""Several translucent arms in one page's view, numbered: the branches of a target side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.robot import Robot
from armctl.ui.scene.arm_figure import ArmFigure, Color

FloatArray = NDArray[np.float64]
_ROOT = "/branches"
_OPACITY = 0.4
_SWELL, _MORE = 1.08, 0.03


@dataclass(frozen=True, slots=True)
class GhostMark:
    """One arm to be shown."""

    q: FloatArray
    """(n,) [rad]"""
    color: Color
    label: str
    """written beside it"""


class BranchGhosts:
    """Draws them; those of the last call are gone."""

    def __init__(self, scene: viser.SceneApi, robot: Robot) -> None:
        self._scene, self._robot = scene, robot
        self._figures: list[ArmFigure] = []
        self._labels: list[viser.LabelHandle] = []

    def show(self, marks: Sequence[GhostMark]) -> None:
        """Show these arms; none: nothing."""
        self.hide()
        for i, (mark, place) in enumerate(zip(marks, self._label_places(marks), strict=True)):
            # each a little thicker than the one before: what they share would flicker, or mix its colours
            width = (_SWELL + i * _MORE) * self._robot.look.width
            robot = replace(self._robot, look=replace(self._robot.look, width=width))
            figure = ArmFigure(self._scene, robot, f"{_ROOT}/{i}", color=mark.color, opacity=_OPACITY)
            figure.pose(mark.q)
            self._figures.append(figure)
            self._labels.append(self._scene.add_label(f"{_ROOT}/label{i}", mark.label, position=place))

    def hide(self) -> None:
        """Show nothing."""
        for node in (*self._figures, *self._labels):
            node.remove()
        self._figures, self._labels = [], []

    def _label_places(self, marks: Sequence[GhostMark]) -> FloatArray:
        """(k, 3) for each arm the same frame's origin: of the frame at which they lie farthest apart [m]."""
        if not marks:
            return np.empty((0, 3))
        points = self._robot.frames(np.array([mark.q for mark in marks]))[:, :, :3, 3]  # (k, frames, 3)
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)  # (k, k, frames)
        apart[np.arange(len(marks)), np.arange(len(marks))] = np.inf
        nearest = apart.min(axis=(0, 1))
        frame = int(nearest.argmax()) if len(marks) > 1 else points.shape[1] // 2
        return points[:, frame]
